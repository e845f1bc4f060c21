"""Planes of windows through all their pixels, with their uncertainty."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from slopecli.ground.footprint_planes import FootprintPlanes, middle_of, planes_of_sums
from slopecli.ground.footprints import Cells
from slopecli.ground.tilt_uncertainty import TILT, Root, error_densities, error_layers, normal_covariance, rise_of
from slopecli.look.dense_depth import DEPTH, DenseDepth
from slopecli.look.noise import SYSTEMATIC_PX
from slopecli.look.warp import gaussian_reach
from slopecli.types import BoolArray, FloatArray, IntArray
from slopecli.windows import Window


class WindowPlaneTunables(NamedTuple):
    """Tunables of the planes of windows."""

    hole_px: int = 8  # grid px, side of the holes in the ground matched that are wrong independently of each other
    in_doubt: float = 0.5  # 1-sigma of ground in doubt, in the jumps there
    off_plane: float = 2.0  # 1-sigma of ground that is not matched, in the RMS relief of the rest
    # px, shorter side of the smallest window on the working grid: of grids of 235 px on rough ground the planes are
    # no better (mean error 0.85 degrees both), and their sigmas too small (RMS error over sigma 1.9, here 1.1)
    side_px: float = 160.0


FIT = WindowPlaneTunables()


@dataclass(frozen=True, eq=False)
class WindowPlanes:
    """The plane of every window nearest, by perpendicular distance, to all its ground: `planes`, in one row.

    covariance (n, 3, 3): of the scaled normals, NaN where there is no plane.
    shares (n, 3): of its variance without the motion's, by noise of matches, relief, and ground without matches.
    """

    planes: FootprintPlanes
    covariance: FloatArray
    shares: FloatArray

    @property
    def told(self) -> BoolArray:
        """(n,) windows that are matched nearly all over, as footprints must be."""
        return np.asarray(self.planes.answered[0] & np.isfinite(self.covariance).all((1, 2)))

    @property
    def normal(self) -> FloatArray:
        """(n, 3) scaled normals, 1/baseline."""
        return np.asarray(self.planes.scaled_normal[0])

    @property
    def relief(self) -> FloatArray:
        """(n,) RMS distance of the ground off the plane, over the plane's distance."""
        return np.asarray(self.planes.relief[0] * np.linalg.norm(self.normal, axis=1))


def fit_windows(depth: DenseDepth, windows: Sequence[Window], root: Root) -> WindowPlanes:
    """Fit the planes of windows, px of image 1."""
    parts = parts_of(depth, windows)
    planes = _nearest_planes(depth, parts)
    gradient = _matching(depth, parts, planes)
    unsure, sizes_px = planes.sure[0] < 1.0, np.diff(parts, axis=-1)[..., 0]
    for size_px in np.unique(sizes_px[unsure], axis=0):
        alike = np.flatnonzero(unsure & (sizes_px == size_px).all(1))
        relief = planes.relief[0, alike] / planes.middle[0, alike, 2]
        gradient[alike, 2] = _gaps(depth, parts[alike, :, 0], size_px, relief)
    sizes = np.trace(gradient, axis1=2, axis2=3)
    shares = sizes / np.maximum(sizes.sum(axis=1, keepdims=True), np.finfo(float).tiny)
    return WindowPlanes(planes, normal_covariance(planes, root, gradient.sum(axis=1)[None])[0], shares)


def parts_of(depth: DenseDepth, windows: Sequence[Window]) -> IntArray:
    """(n, 2, 2) first row and the one after the last, and the same of columns, of every window on the working grid.

    At least one row and column each.
    """
    x, y, w, h = np.array(windows, float).T
    low, high = (depth.grid.inside(np.column_stack(ends) - 0.5) + 0.5 for ends in ((x, y), (x + w, y + h)))
    first, last = np.rint(low).astype(np.int64), np.rint(high).astype(np.int64)
    return np.stack([first, np.maximum(last, first + 1)], -1)[:, ::-1]


def _nearest_planes(depth: DenseDepth, parts: IntArray) -> FootprintPlanes:
    """The plane of every part nearest to its ground, in one row; from sums over rectangles."""
    known, area = depth.known, np.diff(parts, axis=-1)[..., 0].prod(1)
    centre = middle_of(depth.points, known)
    x, y, z = (np.where(known, depth.points[..., k] - np.float32(centre[k]), np.float32(0.0)) for k in range(3))
    error = np.where(known, depth.variance, np.float32(0.0))
    layers = (known, depth.sure, x, y, z, x * x, x * y, x * z, y * y, y * z, z * z, error)
    n, certain, *sums = (box_sums(layer, parts) for layer in layers)
    normal, middle, relief = planes_of_sums(n, sums, centre)
    cells = Cells(np.arange(len(parts)), np.arange(1), 0.0)
    return FootprintPlanes(cells, normal[None], middle[None], relief[None], (n / area)[None], (certain / area)[None])


def box_sums(layer: NDArray[Any], parts: IntArray) -> FloatArray:
    """(n,) sums of a layer (h, w) over rectangles."""
    table = cv2.integral(layer.astype(np.float32), sdepth=cv2.CV_64F)
    (top, bottom), (left, right) = parts.transpose(1, 2, 0)
    return np.asarray(table[bottom, right] - table[top, right] - table[bottom, left] + table[top, left])


def _matching(depth: DenseDepth, parts: IntArray, planes: FootprintPlanes) -> FloatArray:
    """(n, 3, 2, 2) variance of the gradient of ln w of windows: by errors of matches, by edges of relief, and 0 for
    ground without matches."""
    *sums, of_one_px = (box_sums(layer, parts) for layer in error_layers(depth))
    # on a finer grid, what lenses, interpolation and the edges of rocks leave of a match is no less, of the ground
    sums[1] += of_one_px * (SYSTEMATIC_PX * np.maximum(_side(parts) / FIT.side_px, 1.0)) ** 2
    # the second moment of a rectangle about either axis is a twelfth of its squared side
    sides = np.diff(parts, axis=-1)[:, ::-1, 0] / depth.focal_px
    moments = np.maximum(sums[0], 1.0)[:, None] * sides**2 / 12.0
    gradient = np.zeros((len(parts), 3, 2, 2))
    for kind, density in enumerate(error_densities(sums, rise_of(planes, depth)[0])):
        gradient[:, kind, [0, 1], [0, 1]] = density[:, None] / moments
    return gradient


def across_steps(depth: DenseDepth, windows: Sequence[Window], planes: FootprintPlanes) -> BoolArray:
    """(n,) whether a window lies across a step of depth, as `tilt_uncertainty.across_step` has it for footprints."""
    parts = parts_of(depth, windows)
    side = _side(parts)
    wider = _grown(depth, parts, np.minimum(TILT.step_off_px, TILT.step_off_share * side))
    stepped = box_sums(depth.step, wider) > TILT.step_length * side
    rise = rise_of(planes, depth)[0]
    for k in np.flatnonzero(stepped):
        jump = float(depth.span[slice(*wider[k, 0].tolist()), slice(*wider[k, 1].tolist())].max())
        stepped[k] = jump - rise[k] > TILT.step_share * side[k] / depth.focal_px
    return np.asarray(stepped)


def steps_across(depth: DenseDepth, windows: Sequence[Window]) -> BoolArray:
    """(n,) as `across_steps`, of windows whose planes through all their ground are not known yet."""
    return across_steps(depth, windows, _nearest_planes(depth, parts_of(depth, windows)))


def onto_bare(depth: DenseDepth, windows: Sequence[Window]) -> BoolArray:
    """(n,) whether a window reaches onto ground without texture of its own, which may be a drop, or nearly so: see
    `tilt_uncertainty.beside_bare`."""
    parts = parts_of(depth, windows)
    wider = _grown(depth, parts, np.full(len(parts), gaussian_reach(DEPTH.window_px)))
    return np.asarray(box_sums(depth.bare, wider) > TILT.step_length * _side(parts))


def _side(parts: IntArray) -> FloatArray:
    """(n,) side of a square as large as a part, grid px."""
    return np.sqrt(np.diff(parts, axis=-1)[..., 0].prod(1))


def _grown(depth: DenseDepth, parts: IntArray, by_px: FloatArray) -> IntArray:
    """(n, 2, 2) the parts with so many more grid px (n,) on every side, where the grid has them."""
    grown = parts + by_px.astype(np.int64)[:, None, None] * np.array([-1, 1])
    return np.clip(grown, 0, np.array(depth.w.shape)[:, None])


def _gaps(depth: DenseDepth, first: IntArray, size_px: IntArray, relief: FloatArray) -> FloatArray:
    """(n, 2, 2) variance of the gradient of ln w by ground that is not matched, or in doubt, of windows of one size.

    The former may be as far off the plane as the relief (relative to the distance) and the jumps there, the latter as
    far as half of the jumps.

    first : (n, 2) first row and column of each.  size_px : (2,) rows and columns.  relief : (n,) of the rest.
    """
    rows, columns = (first[:, k, None] + np.arange(size_px[k]) for k in (0, 1))
    at = rows[:, :, None], columns[:, None, :]
    span2, known, sure = depth.span[at].astype(float) ** 2, depth.known[at], depth.sure[at]
    x = np.stack([depth.rays[..., axis][at].astype(float) for axis in (0, 1)])
    x -= x.mean((2, 3), keepdims=True)
    variance = np.zeros((len(first), 2, 2))
    for part, in_jumps, in_relief in ((~known, 1.0, FIT.off_plane), (known & ~sure, FIT.in_doubt, 0.0)):
        if part.any():
            jumps = (span2 * part).sum((1, 2)) / np.maximum(part.sum((1, 2)), 1)
            off_plane2 = (in_relief * relief) ** 2 + in_jumps**2 * jumps
            variance += off_plane2[:, None, None] * _lever(x, part)
    return variance


def _lever(x: FloatArray, part: BoolArray) -> FloatArray:
    """(n, 2, 2) variance of the gradient fitted to windows per variance of the ground in a part (n, h, w) of each.

    Either all of that part is off to one side, or every hole of `FIT.hole_px` independently; the sum of both is taken.

    x : (2, n, h, w) normalised coordinates from the middle of the window.
    """
    n, height, width = part.shape
    inverse = np.linalg.inv(np.einsum("inhw,jnhw->nij", x, x) + 1e-18 * np.eye(2))
    shifted = x * part
    common = np.einsum("nij,jn->ni", inverse, shifted.sum((2, 3)))
    together = common[:, :, None] * common[:, None]
    rows, columns = height // FIT.hole_px, width // FIT.hole_px
    if not rows or not columns:
        return together
    # rows first: NumPy adds long lines many times faster than short ones
    lines = shifted[:, :, : rows * FIT.hole_px].reshape(2, n, rows, FIT.hole_px, width).sum(3)
    holes = lines[..., : columns * FIT.hole_px].reshape(2, n, rows * columns, FIT.hole_px).sum(3)
    return np.asarray(together + inverse @ np.einsum("inh,jnh->nij", holes, holes) @ inverse)
