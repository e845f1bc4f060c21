"""The motion of a new frame to a fraction of a pixel: from the last frame by tracking, or anew by features."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from slopecli.geometry.camera import pixels_from_rays, rays_from_pixels
from slopecli.geometry.epipolar import homogeneous, rotation_from_vector, rotation_vector
from slopecli.geometry.solver.resection import Motion, Resection, resect
from slopecli.geometry.solver.views import predict_views
from slopecli.geometry.statistics import median
from slopecli.look.features import EFFORTS, QUICK, FeatureMemory, Grey, match_sift
from slopecli.look.matches import ON_PLANE_PX
from slopecli.sequence.tracking_tunables import TRACKING
from slopecli.sequence.tracks import Tracks
from slopecli.types import BoolArray, Camera, FloatArray

COARSE_PX = 320  # width of the frames that points are tracked in to place the next
FLOOR_PX = 0.3  # 1-sigma of the coarse tracks, px of the whole frame: they serve to place it only


class CoarseMotion:
    """Places frames one after the other against points of known inverse depths.

    last : the frame used before, its motion and the one before it, from which the next is extrapolated.
    memory : of the features of the reference, where others need them, too.
    """

    def __init__(self, camera: Camera, tracks: Tracks, reference: Grey, memory: FeatureMemory | None = None) -> None:
        self.camera, self.tracks = camera, tracks
        self._reference = reference
        self._memory = memory or FeatureMemory(2)
        self._shrunk = max(round(camera.width / COARSE_PX), 1)
        self._last: Grey | None = None
        self._motions: list[Motion] = [(np.eye(3), np.zeros(3))]

    def accept(self, frame: Grey, motion: Motion) -> None:
        """Remember a frame that was used, with its motion."""
        self._last = self._small(frame)
        self._motions = [*self._motions[-1:], motion]

    @property
    def step(self) -> float:
        """Distance between the last two frames used."""
        return float(np.linalg.norm(self._motions[-1][1] - self._motions[0][1]))

    def predicted(self) -> Motion:
        """The motion if the camera goes on as it went between the last two frames used."""
        if len(self._motions) < 2:
            return self._motions[-1]
        (R0, T0), (R1, T1) = self._motions
        turn = rotation_vector(R1 @ R0.T)
        return rotation_from_vector(turn) @ R1, 2.0 * T1 - T0

    def place(self, frame: Grey, u: FloatArray, alive: BoolArray) -> Resection | None:
        """The motion of a frame near those before it; None where too few points agree with one.

        u : (n,) inverse depths of the points, used where `alive` (n,).
        """
        if self._last is None:
            return None
        small = self._small(frame)
        guesses = [self.predicted(), self._motions[-1]]
        unlike = self._unlike(small, guesses, u, alive)
        if unlike[0] > unlike[1]:
            guesses.reverse()  # the camera has stopped, or turned back
        return self._near(small, guesses[0], u, alive) or self._near(small, guesses[1], u, alive)

    def _unlike(self, small: Grey, guesses: list[Motion], u: FloatArray, alive: BoolArray) -> list[float]:
        """Median differences of grey values of a shrunken frame, where guesses have the points, to the last frame."""
        index = self._sample(alive & (u > 0.0))[::4]  # a hundred tell which is nearer
        p, depth = self.tracks.p[:, index], u[index]
        places = [self._pixels(p, depth, motion) for motion in (self._motions[-1], *guesses)]
        both = np.logical_and.reduce([_inside(uv, self.camera) & (ahead > 0.0) for uv, ahead in places])
        if self._last is None or np.count_nonzero(both) < TRACKING.least_points:
            return [0.0] * len(guesses)
        last, new = (np.asarray(cv2.blur(grey, (7, 7)), np.uint8) for grey in (self._last, small))
        then, *now = (
            _values(grey, uv[both] / self._shrunk)
            for grey, (uv, _) in zip([last, *[new] * len(guesses)], places, strict=True)
        )
        return [median(np.abs(one - then - median(one - then))) for one in now]

    def _small(self, grey: Grey) -> Grey:
        """The frame shrunken to about `COARSE_PX`."""
        h, w = grey.shape
        size = max(w // self._shrunk, 1), max(h // self._shrunk, 1)
        return np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_AREA), np.uint8)

    def _near(self, small: Grey, guessed: Motion, u: FloatArray, alive: BoolArray) -> Resection | None:
        """The motion of a frame, shrunken, near a guess; None where too few points agree with one."""
        if self._last is None:
            return None
        index = self._sample(alive & (u > 0.0))
        if len(index) < TRACKING.least_points:
            return None
        p, depth = self.tracks.p[:, index], u[index]
        before, ahead = self._pixels(p, depth, self._motions[-1])
        guess, ahead2 = self._pixels(p, depth, guessed)
        inside = _inside(before, self.camera) & (ahead > 0.0) & (ahead2 > 0.0)
        guess = np.where(_inside(guess, self.camera)[:, None], guess, before)
        if np.count_nonzero(inside) < TRACKING.least_points:
            return None
        index, p, depth = index[inside], p[:, inside], depth[inside]
        moved, status = _tracked(self._last, small, before[inside], guess[inside], self._shrunk)
        x = rays_from_pixels(self.camera, moved)
        good = status & np.isfinite(x).all(axis=1) & _inside(moved, self.camera, 1.0)
        if np.count_nonzero(good) < TRACKING.least_points:
            return None
        return self._resected(p[:, good], x[good].T, depth[good], [guessed, self._motions[-1]])

    def place_anew(self, frame: Grey, normals: FloatArray, u: FloatArray, alive: BoolArray) -> Resection | None:
        """The motion of a frame anywhere, from features shared with the reference; None if they do not agree."""
        for effort in (QUICK, EFFORTS[0]):
            uv1, uv2, _ = match_sift(self._reference, frame, effort, self._memory)
            if len(uv1) < TRACKING.least_points:
                continue
            rays, x = rays_from_pixels(self.camera, uv1), rays_from_pixels(self.camera, uv2)
            fine = np.isfinite(rays).all(axis=1) & np.isfinite(x).all(axis=1)
            p, x = homogeneous(rays[fine]).T, x[fine].T
            depth = self._depth_near(uv1[fine], normals, u, alive)
            start = _by_consensus(p, x, depth, 4.0 / self.camera.focal_px)
            # places of features are as fine as the grid that they were found on
            found = self._resected(p, x, depth, start, max(np.sqrt(frame.size / effort.max_pixels), 1.0))
            if found is not None:
                return found
        return None

    def _resected(
        self, p: FloatArray, x: FloatArray, u: FloatArray, starts: list[Motion], grid_px: float = 1.0
    ) -> Resection | None:
        """The motion that points agree with to a pixel of a grid of that spacing; None where too few do."""
        if p.shape[1] < TRACKING.least_points:
            return None
        found = resect(p, x, u, starts, FLOOR_PX / self.camera.focal_px)
        # a wrong motion agrees with many points if its tolerance is wide
        sure = found.share >= TRACKING.least_agreement and found.sigma * self.camera.focal_px < ON_PLANE_PX * grid_px
        return found if sure and np.count_nonzero(found.fits) >= TRACKING.least_points else None

    def _pixels(self, p: FloatArray, u: FloatArray, motion: Motion) -> tuple[FloatArray, FloatArray]:
        x, ahead = predict_views(p, motion[0][None], motion[1][None], u)
        return np.nan_to_num(pixels_from_rays(self.camera, x[0].T), nan=-1e6), ahead[0]

    def _sample(self, usable: BoolArray) -> NDArray[np.int64]:
        index = np.flatnonzero(usable)
        step = max(len(index) // TRACKING.coarse_points, 1)
        return np.asarray(index[::step])

    def _depth_near(self, uv: FloatArray, normals: FloatArray, u: FloatArray, alive: BoolArray) -> FloatArray:
        """(k,) inverse depth at pixels (k, 2) of the reference: that of the nearest point tracked."""
        usable = np.flatnonzero(alive & (u > 0.0))
        apart = ((uv[:, None] - self.tracks.uv[usable][None]) ** 2).sum(axis=2)
        return np.asarray(u[usable][apart.argmin(axis=1)])


def _by_consensus(p: FloatArray, x: FloatArray, u: FloatArray, threshold: float) -> list[Motion]:
    """The motion that most points agree with, by random samples of four; none where OpenCV finds none."""
    points = (p / u).T
    done, w, t, _ = cv2.solvePnPRansac(
        np.ascontiguousarray(points),
        np.ascontiguousarray(x.T),
        np.eye(3),
        None,
        iterationsCount=300,
        reprojectionError=threshold,
        flags=cv2.SOLVEPNP_EPNP,
    )
    if not done:
        return []
    R = np.asarray(cv2.Rodrigues(w)[0], float)
    return [(R, -R.T @ np.asarray(t, float).ravel())]


def _tracked(
    last: Grey, frame: Grey, before: FloatArray, guess: FloatArray, shrunk: int
) -> tuple[FloatArray, BoolArray]:
    """Points (n, 2) of the whole last frame in the new one, both images shrunken so many times; status (n,)."""
    start, end = (((uv + 0.5) / shrunk - 0.5).astype(np.float32) for uv in (before, guess))
    moved, status, _ = cv2.calcOpticalFlowPyrLK(
        last,
        frame,
        np.ascontiguousarray(start),
        np.ascontiguousarray(end),
        winSize=(15, 15),
        maxLevel=3,
        criteria=(cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 15, 0.03),
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    return shrunk * (np.asarray(moved, float) + 0.5) - 0.5, np.asarray(status.ravel() > 0)


def _values(grey: Grey, uv: FloatArray) -> FloatArray:
    """Grey values (n,) at the pixels nearest to places (n, 2)."""
    h, w = grey.shape
    u, v = np.clip(uv.astype(np.int64), 0, [w - 1, h - 1]).T
    return grey[v, u].astype(float)


def _inside(uv: FloatArray, camera: Camera, margin: float = 4.0) -> BoolArray:
    u, v = uv.T
    return np.asarray((u >= margin) & (u < camera.width - margin) & (v >= margin) & (v < camera.height - margin))
