"""Points of the reference frame that are tracked: the best corner of every cell of every window."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from slopecli.geometry.camera import rays_from_pixels
from slopecli.geometry.epipolar import homogeneous
from slopecli.look.features import Grey
from slopecli.patches.windows.tunables import TUNE
from slopecli.sequence.tracking_tunables import TRACKING
from slopecli.types import BoolArray, Camera, FloatArray, IntArray
from slopecli.windows import Window


class Lattice(NamedTuple):
    """Places all over one window, half as far apart as its points: uv (k, 2) px, rays (3, k); apart: of points, px."""

    uv: FloatArray
    rays: FloatArray
    apart: float


@dataclass(frozen=True, eq=False)
class Tracks:
    """uv (n, 2) px of the reference, p (3, n) rays, patch (n,) window of each, -1 outside; points of a window in turn,
    those outside last; cell (n, 2) row and column on the lattice of its window; cells (m,) of each window; lattices:
    places all over each."""

    uv: FloatArray
    p: FloatArray
    patch: IntArray
    cell: IntArray
    cells: IntArray
    lattices: list[Lattice]

    def __len__(self) -> int:
        return len(self.uv)

    def of_planes(self, kept: BoolArray, planes: IntArray) -> Tracks:
        """The points kept (n,) of some windows, by number in rising order, which are numbered anew from 0."""
        kept = kept & np.isin(self.patch, planes)
        patch = np.searchsorted(planes, self.patch[kept])
        lattices = [self.lattices[i] for i in planes]
        return Tracks(self.uv[kept], self.p[:, kept], patch, self.cell[kept], self.cells[planes], lattices)


def choose_tracks(grey: Grey, windows: list[Window], camera: Camera, wanted: list[int] | None = None) -> Tracks:
    """The points to track in the windows (px) of a frame, and some outside them.

    wanted : in each window; None for as many as their slopes need.
    """
    corner = np.asarray(cv2.cornerMinEigenVal(grey, 7), float)
    height, width = grey.shape
    edge = TRACKING.border_px
    corner[:edge], corner[height - edge :], corner[:, :edge], corner[:, width - edge :] = 0.0, 0.0, 0.0, 0.0
    # a corner that grey noise alone would make: its gradients have a variance of about twice that of the noise
    least = 0.02 * float(np.median(corner[corner > 0.0])) if (corner > 0.0).any() else 0.0
    if wanted is None:
        few = min(TRACKING.in_all // 2 // len(windows), 4 * TRACKING.per_window)
        wanted = [max(min(TRACKING.per_window, TRACKING.in_all // len(windows)), few, 9)] * len(windows)
    parts = [_best_corners(corner, window, number, least) for window, number in zip(windows, wanted, strict=True)]
    covered = np.zeros(grey.shape, bool)
    for x, y, w, h in windows:
        covered[y : y + h, x : x + w] = True
    outside = (np.zeros((0, 2)), np.zeros((0, 2), np.int64), 0)
    if covered.mean() < 0.8:
        free = np.where(covered, 0.0, corner)
        outside = _best_corners(free, (0, 0, width, height), TRACKING.outside, least)
    uv = np.concatenate([*(part[0] for part in parts), outside[0]])
    patch = np.repeat([*range(len(parts)), -1], [*(len(part[0]) for part in parts), len(outside[0])])
    rays = rays_from_pixels(camera, uv)
    seen = np.isfinite(rays).all(axis=1)
    cell = np.concatenate([*(part[1] for part in parts), outside[1]])
    cells = np.array([part[2] for part in parts])
    lattices = [_lattice(window, number, camera) for window, number in zip(windows, wanted, strict=True)]
    return Tracks(uv[seen], homogeneous(rays[seen]).T, patch[seen], cell[seen], cells, lattices)


def _lattice(window: Window, wanted: int, camera: Camera) -> Lattice:
    """Places over a window in which so many points are wanted."""
    x, y, w, h = window
    side = max(np.sqrt(w * h / wanted), TUNE.corner_distance_px)
    u, v = (first + np.arange(0.25 * side, extent, 0.5 * side) - 0.5 for first, extent in ((x, w), (y, h)))
    uv = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
    rays = rays_from_pixels(camera, uv)
    seen = np.isfinite(rays).all(axis=1)
    return Lattice(uv[seen], homogeneous(rays[seen]).T, float(side))


def _best_corners(corner: FloatArray, window: Window, wanted: int, least: float) -> tuple[FloatArray, IntArray, int]:
    """Places (k, 2) of the best corner of every cell that has one, their cells (k, 2), and the number of cells."""
    x, y, w, h = window
    side = max(np.sqrt(w * h / wanted), TUNE.corner_distance_px)
    columns, rows = max(round(w / side), 1), max(round(h / side), 1)
    xs, ys = np.linspace(x, x + w, columns + 1).astype(int), np.linspace(y, y + h, rows + 1).astype(int)
    part = corner[y : y + h, x : x + w]
    best = np.maximum.reduceat(np.maximum.reduceat(part, ys[:-1] - y, axis=0), xs[:-1] - x, axis=1)
    row_of, column_of = np.repeat(np.arange(rows), np.diff(ys)), np.repeat(np.arange(columns), np.diff(xs))
    v, u = np.nonzero((part == best[row_of][:, column_of]) & (part > least))
    # the first of equal ones
    cell, first = np.unique(row_of[v] * columns + column_of[u], return_index=True)
    places = np.stack([x + u[first], y + v[first]], axis=1).astype(float)
    return places, np.stack(np.divmod(cell, columns), axis=1), rows * columns
