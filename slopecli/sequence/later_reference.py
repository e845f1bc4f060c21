"""Frames that hardly show the windows any more: followed against a later frame, whose motion chains them to the first.

A later reference has points of its own all over it, at depths that those tracked so far tell; their unit of length is
that of the first move. Windows that it shows are carried over by their planes and keep their ids: its views sharpen
them. The others keep the answer of the frames that showed them.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from slopecli.findings.parallax import LOW_PARALLAX_PX
from slopecli.geometry.solver.many_views import ViewsSolution
from slopecli.geometry.solver.reference_change import last_view
from slopecli.geometry.solver.resection import Motion
from slopecli.geometry.statistics import GATE_SIGMAS, median
from slopecli.look.features import Grey
from slopecli.look.matches import ON_PLANE_PX
from slopecli.sequence.carried_windows import CarriedWindows, later_tracks
from slopecli.sequence.coarse_motion import CoarseMotion
from slopecli.sequence.frame_alignment import Aligner, Found
from slopecli.sequence.frame_gates import FrameGates, Skipped
from slopecli.sequence.tracking_tunables import TRACKING
from slopecli.sequence.view_estimator import Held, ViewEstimator
from slopecli.types import Camera, FloatArray, IntArray
from slopecli.windows import Window


@dataclass(eq=False)
class Follower:
    """A reference frame with what follows it.

    R (3, 3), T (3,) : of the reference, in axes of the first frame and the unit of the first move.
    unit : length of this one's own unit, that of its first move, in that unit.
    carried : windows that were carried over to a later reference; None of the first one.
    zoom : px of the last frame to one of the reference.
    """

    aligner: Aligner
    estimator: ViewEstimator
    coarse: CoarseMotion
    R: FloatArray
    T: FloatArray
    unit: float
    carried: CarriedWindows | None
    zoom: float

    def follow(self, frame: Grey, gates: FrameGates) -> Motion | Skipped:
        """The motion of a frame against the reference, in its own unit; the frame is taken into the answer."""
        estimator = self.estimator
        u, alive = estimator.inverse_depth, estimator.alive
        placed = self.coarse.place(frame, u, alive) or self.coarse.place_anew(frame, estimator.normals, u, alive)
        if placed is None:
            return gates.blur_alone(frame) or Skipped("foreign", "does not show the ground of the frames before")
        motion: Motion = (placed.R, placed.T)
        found = self.aligner.find(frame, motion, estimator.normals, u, alive)
        if found.likeness < TRACKING.least_agreement:
            return Skipped("foreign", "does not look like the ground where it should be")
        if (blurred := gates.blur(found.detail)) is not None:
            return blurred
        share = estimator.share_of(found, motion)
        if share < TRACKING.least_agreement:
            return Skipped("foreign", f"agrees with the frames before at {100 * share:.0f} % of its points only")
        if self._repeats(found):
            return Skipped("repeated", "repeats the frame before but for noise")
        estimator.add(found, motion)
        self.coarse.accept(frame, estimator.motion)
        self.zoom = found.zoom
        return estimator.motion

    def _repeats(self, found: Found) -> bool:
        """Whether points moved less since the last frame than noise displaces them: it would add nothing but noise."""
        root, points = self.estimator.best.root, self.estimator.best.points
        both = found.seen & (points.weight[-1] > 0.0)
        moved = np.hypot(*(found.x - points.x[-1])[:, both])
        return bool(both.any()) and median(moved) < GATE_SIGMAS * root.noise * found.zoom

    def in_first(self, motion: Motion) -> Motion:
        """A motion against this reference, in its unit, as one against the first frame, in that of the first move."""
        R, T = motion
        return R @ self.R, self.T + self.unit * self.R.T @ T

    @property
    def is_left(self) -> bool:
        """Whether the last frame showed few of its points, or so much nearer that the reference lacks their detail."""
        return self.shown < TRACKING.new_reference or self.zoom > TRACKING.most_zoom

    @property
    def moves_far(self) -> bool:
        """Whether the three frames that a change takes at this pace would show nothing more of this reference."""
        camera = self.aligner.camera
        step_px = self.zoom * self.coarse.step * median(self.estimator.inverse_depth) * camera.focal_px
        return 3.0 * step_px >= self.shown * camera.width

    @property
    def shown(self) -> float:
        """Share of its points that the last frame showed."""
        return float((self.estimator.best.points.weight[-1] > 0.0).mean())

    @property
    def windows(self) -> IntArray:
        """Windows of the first frame that have planes here: all, or those carried over to a later reference."""
        return np.arange(len(self.estimator.tracks.cells)) if self.carried is None else self.carried.planes

    def known(self) -> ViewsSolution:
        """Normals of all windows, with the view that the answer is of and the last one: see `last_view`."""
        if self.carried is None:
            return last_view(self.estimator.solution())
        return self.carried.joined(self.estimator, self.unit, self.aligner.camera)

    def points_in_last(self) -> tuple[FloatArray, FloatArray]:
        """Rays (3, k) of its points in the axes of the last frame, and inverse depths (k,), unit of the first move."""
        state = self.estimator.best.root.state
        known = self.estimator.alive & (self.estimator.best.root.system.V > 0.0) & (state.u > 0.0)
        p, u = self.estimator.tracks.p[:, known], state.u[known]
        y = state.R[-1] @ p - (state.R[-1] @ state.T[-1])[:, None] * u
        ahead = y[2] > 1e-6
        return y[:, ahead] / y[2, ahead], u[ahead] / y[2, ahead] / self.unit


@dataclass(frozen=True, eq=False)
class ReferenceCandidate:
    """A frame that is to be the next reference: what is kept of the moment when it was the last one.

    number : of the frame.  held : state of the estimator that it was followed by.  known : normals of all windows, and
    the frame as the last view.  asked : windows that may be carried over.  rays (3, k), u (k,) : points in its axes,
    inverse depths in the unit of the first move.  R, T : of the frame, against the first.
    """

    number: int
    grey: Grey
    held: Held
    known: ViewsSolution
    asked: IntArray
    rays: FloatArray
    u: FloatArray
    R: FloatArray
    T: FloatArray

    @classmethod
    def of(cls, number: int, frame: Grey, before: Follower, motion: Motion) -> ReferenceCandidate | None:
        """The last frame; None where it shows too few points. motion : of the frame, against the first."""
        rays, u = before.points_in_last()
        some = slice(None, None, max(len(u) // TRACKING.coarse_points, 1))
        rays, u = rays[:, some], u[some]
        if len(u) < 12:
            return None
        held = before.estimator.kept()
        return cls(number, frame, held, before.known(), before.windows, rays, u, *motion)

    def prepared(self, camera: Camera, windows: list[Window]) -> LaterReference | None:
        """The frame with points all over it; None where it has no texture. This takes the time of a frame or two."""
        chosen = later_tracks(self.grey, camera, windows, self.asked, self.known)
        if chosen is None:
            return None
        tracks, rays = chosen.tracks, self.rays
        plane = np.linalg.lstsq(rays.T, self.u, rcond=None)[0]
        places, points = (np.ascontiguousarray(x[:2].T, np.float32) for x in (rays, tracks.p))
        nearest = cv2.batchDistance(points, places, cv2.CV_32F, K=1)[1].ravel()
        near = np.hypot(*(tracks.p[:2] - rays[:2, nearest])) < 0.1 * camera.width / camera.focal_px
        depth = np.where(near, self.u[nearest], plane @ tracks.p)
        normals = np.repeat(plane[None], len(chosen.parts), axis=0)
        aligner = Aligner(self.grey, camera, chosen.parts, tracks)
        carried = CarriedWindows(self.known, chosen.planes, windows)
        depth = np.maximum(depth, 1e-3 * median(self.u))
        return LaterReference(self.number, self.held, aligner, depth, normals, self.R, self.T, carried)


@dataclass(eq=False)
class LaterReference:
    """A frame that is to be the next reference, until another has moved far enough from it.

    number : of the frame.  held : state of the estimator that it was followed by, as of this frame.
    aligner : with points all over the frame; u (n,) their inverse depths, normals (m, 3) of its parts, both in the unit
    of the first move; R, T : of the frame.  carried : windows of the first reference that it shows.
    """

    number: int
    held: Held
    aligner: Aligner
    u: FloatArray
    normals: FloatArray
    R: FloatArray
    T: FloatArray
    carried: CarriedWindows

    def begun(self, frame: Grey, motion: Motion, camera: Camera) -> Follower | None:
        """What follows this reference from a frame on; None while that has not moved far enough from it.

        motion : of the frame, against the first.
        """
        R = motion[0] @ self.R.T
        T = self.R @ (motion[1] - self.T)
        length = float(np.linalg.norm(T))
        if not _tells_depth(length, self.u, camera):
            return None
        known = np.ones(len(self.u), bool)
        found = self.aligner.find(frame, (R, T), self.normals, self.u, known, levels=1)
        if found.likeness < TRACKING.least_agreement or np.count_nonzero(found.seen) < 0.5 * len(self.u):
            return None
        estimator = ViewEstimator(self.aligner.tracks, camera.focal_px)
        estimator.start_from(found, R, T / length, self.normals * length, self.u * length)
        if estimator.best.root.noise * camera.focal_px > ON_PLANE_PX:
            return None
        planes, u = estimator.normals, estimator.inverse_depth
        estimator.found_again(self.aligner.find(frame, estimator.motion, planes, u, estimator.alive), rounds=1)
        coarse = CoarseMotion(camera, self.aligner.tracks, self.aligner.grey)
        coarse.accept(frame, estimator.motion)
        return Follower(self.aligner, estimator, coarse, self.R, self.T, length, self.carried, 1.0)


def _tells_depth(baseline: float, u: FloatArray, camera: Camera) -> bool:
    """Whether a baseline gives points of inverse depths u (n,) twice the least parallax that a first move needs."""
    return baseline * median(u) * camera.focal_px >= 2.0 * LOW_PARALLAX_PX
