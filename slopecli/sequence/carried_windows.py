"""Windows of the first frame in a later reference: points on their planes there, and what these tell of the windows."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from slopecli.geometry.camera import pixels_from_rays, rays_from_pixels
from slopecli.geometry.epipolar import homogeneous
from slopecli.geometry.solver.many_views import ViewsSolution
from slopecli.geometry.solver.reference_change import LaterViews, with_later_views
from slopecli.look.features import Grey
from slopecli.look.matches import LEAST_MATCHES, Matches
from slopecli.patches.windows.unmatched_parts import gaps_of, unseen_rad
from slopecli.sequence.sequence_report import evidence_of
from slopecli.sequence.tracking_tunables import TRACKING
from slopecli.sequence.tracks import Tracks, choose_tracks
from slopecli.sequence.view_estimator import ViewEstimator
from slopecli.types import BoolArray, Camera, FloatArray, IntArray
from slopecli.windows import Window, grid_windows, inside_window, window_polygon


@dataclass(frozen=True, eq=False)
class CarriedWindows:
    """Windows that a later reference shows.

    known : normals of all windows, and the later reference as its second view, as of `last_view`.
    planes (c,) : which window each of the first c planes of the later reference is.  windows : all, px of frame 1.
    """

    known: ViewsSolution
    planes: IntArray
    windows: list[Window]

    def joined(self, estimator: ViewEstimator, unit: float, camera: Camera) -> ViewsSolution:
        """What is known with the views of the later reference. unit : of its lengths, in that of the first move."""
        later, every = estimator.solution(), estimator.best
        told = estimator.alive & (every.root.system.V > 0.0) & (every.root.state.u > 0.0)
        count = np.bincount(estimator.tracks.patch[told & (estimator.tracks.patch >= 0)], minlength=len(self.planes))
        enough = np.flatnonzero(count[: len(self.planes)] >= LEAST_MATCHES)
        if not len(enough):
            return self.known
        parts = self._unseen(estimator, unit, camera, told, enough)
        first = _of_planes(later, np.concatenate([enough, np.arange(len(self.planes), len(later.scaled_normals))]))
        return with_later_views(self.known, LaterViews(first, self.planes[enough], unit, parts))

    def _unseen(
        self, estimator: ViewEstimator, unit: float, camera: Camera, told: BoolArray, enough: IntArray
    ) -> FloatArray:
        """(k, 3, 3) covariance of windows' planes by their parts that the later reference does not show.

        The plane of a part is tilted against that of the window about the middle of the part, and off it by the relief.
        """
        tracks, u = estimator.tracks, estimator.best.root.state.u
        P = self.known.R[1].T @ (tracks.p / np.where(told, u, 1.0)) * unit + self.known.T[1][:, None]
        told = told & (P[2] > 0.0)
        x1 = (P[:2] / np.where(told, P[2], 1.0)).T
        every = Matches(pixels_from_rays(camera, x1), tracks.uv, x1, tracks.p[:2].T)
        evidence = evidence_of(every, 1.0 / np.where(told, P[2], 1.0), told, camera, 1.0)
        parts = np.zeros((len(enough), 3, 3))
        for k, j in enumerate(enough.tolist()):
            own, N = told & (tracks.patch == j), estimator.normals[j]
            gaps = gaps_of(self.windows[self.planes[j]], every.uv1[own], 1.0)
            relief, middle = float(estimator.best.root.relief[j]), tracks.p[:, own].mean(axis=1)
            tilt = unseen_rad(gaps, relief * camera.focal_px, evidence)
            if tilt > 0.0:
                about = np.eye(3) - np.outer(middle, middle) / float(middle @ middle)
                parts[k] = tilt**2 * float(N @ N) * about + relief**2 * np.outer(N, N)
        return parts


def _of_planes(solution: ViewsSolution, kept: IntArray) -> ViewsSolution:
    """The solution without some of its planes."""
    return replace(
        solution,
        scaled_normals=solution.scaled_normals[kept],
        normal_gain=solution.normal_gain[kept],
        own_covariance=solution.own_covariance[kept],
    )


class LaterTracks(NamedTuple):
    """Points of a later reference; its parts, rectangles in px of it; and which window of the first frame (c,) each of
    the first c parts is the bounding box of."""

    tracks: Tracks
    parts: list[Window]
    planes: IntArray


def later_tracks(
    frame: Grey, camera: Camera, windows: list[Window], asked: IntArray, known: ViewsSolution
) -> LaterTracks | None:
    """Points in the windows that a frame shows, as many as for slopes, and in the rest of it, for its motions.

    asked : the windows to be carried over.  known : their planes, and the frame as its last view.
    None where a ninth of the frame has too little texture.
    """
    boxes = {i: box for i in asked.tolist() if (box := _box(windows[i], known, i, camera)) is not None}
    grid = grid_windows(3, 3, camera.width, camera.height)
    wanted = [TRACKING.per_window] * len(boxes) + [TRACKING.later_points] * len(grid)
    tracks = choose_tracks(frame, [*boxes.values(), *grid], camera, wanted)
    kept, taken = np.ones(len(tracks), bool), np.zeros(len(tracks), bool)
    for j, i in enumerate(boxes):
        inside = inside_window(_in_first(tracks.p, known, i, camera), windows[i])
        kept[tracks.patch == j] = inside[tracks.patch == j]
        taken |= inside
    kept &= ~((tracks.patch >= len(boxes)) & taken)
    if min(np.count_nonzero(inside_window(tracks.uv[kept], part)) for part in grid) < LEAST_MATCHES:
        return None
    count = np.bincount(tracks.patch[kept], minlength=len(boxes) + len(grid))
    enough = np.flatnonzero(count >= LEAST_MATCHES)
    parts = [*boxes.values(), *grid]
    planes = np.array([i for j, i in enumerate(boxes) if j in enough], np.int64)
    return LaterTracks(tracks.of_planes(kept, enough), [parts[j] for j in enough], planes)


def _in_first(rays: FloatArray, known: ViewsSolution, i: int, camera: Camera) -> FloatArray:
    """(n, 2) px of the first frame of the points in which rays (3, n) of the last view meet the plane of a window."""
    R, T, N = known.R[-1], known.T[-1], known.scaled_normals[i]
    P = R.T @ rays + T[:, None] * ((R @ N) @ rays / (1.0 - float(N @ T)))
    ahead = P[2] > 1e-6
    uv = pixels_from_rays(camera, (P[:2] / np.where(ahead, P[2], 1.0)).T)
    return np.where(ahead[:, None] & np.isfinite(uv), uv, -1e6)


def _box(window: Window, known: ViewsSolution, i: int, camera: Camera) -> Window | None:
    """The rectangle of the last view around a window by its plane, px; None where the view shows next to none of it."""
    R, T, N = known.R[-1], known.T[-1], known.scaled_normals[i]
    p = homogeneous(rays_from_pixels(camera, window_polygon(window))).T
    y = R @ p - (R @ T)[:, None] * (N @ p)
    if 1.0 - float(N @ T) < 1e-3 or not np.isfinite(y).all() or (y[2] < 1e-3).any():
        return None
    uv = pixels_from_rays(camera, (y[:2] / y[2]).T)
    if not np.isfinite(uv).all():
        return None
    low = np.clip(uv.min(axis=0), 0, [camera.width, camera.height]).astype(int)
    high = np.clip(np.ceil(uv.max(axis=0)), 0, [camera.width, camera.height]).astype(int)
    if (high - low).min() < 2 * TRACKING.border_px:
        return None
    return int(low[0]), int(low[1]), int(high[0] - low[0]), int(high[1] - low[1])
