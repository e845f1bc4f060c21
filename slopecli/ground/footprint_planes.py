"""Planes of footprints: those nearest, by perpendicular distance, to the ground in discs around the cells of a map."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from slopecli.geometry.slope import CAMERA_UP
from slopecli.ground.footprints import Cells, disc_area, disc_sums
from slopecli.types import BoolArray, FloatArray, IntArray

LEAST_SHARE = 0.85  # of a footprint's pixels that must be matched for its plane to be told
AHEAD = 0.0 - CAMERA_UP  # without negative zeros: normal and middle of a footprint of fewer than three points
BLOCKS = 12  # blocks of pixels along a footprint's diameter, the highest and lowest of which are looked at


@dataclass(frozen=True, eq=False)
class FootprintPlanes:
    """Planes of the footprints of cells (rows, columns); valid where `answered`. Lengths in baselines.

    normal (..., 3): unit, towards camera 1.  middle (..., 3): mean of the ground, on the plane.
    relief: RMS perpendicular distance off the plane.  share: of the footprint's pixels, those matched; sure: those
    matched without doubt.
    """

    cells: Cells
    normal: FloatArray
    middle: FloatArray
    relief: FloatArray
    share: FloatArray
    sure: FloatArray

    @property
    def answered(self) -> BoolArray:
        """Cells whose plane is told."""
        return np.asarray(self.share >= LEAST_SHARE)

    def some(self, columns: IntArray) -> FootprintPlanes:
        """Those of these columns."""
        cells = replace(self.cells, u=self.cells.u[columns])
        every = (self.normal, self.middle, self.relief, self.share, self.sure)
        return FootprintPlanes(cells, *(values[:, columns] for values in every))

    @property
    def scaled_normal(self) -> FloatArray:
        """(rows, columns, 3) N with N.P = 1 on the plane."""
        return self.normal / (self.normal * self.middle).sum(-1, keepdims=True)

    def thinned(self, step: int) -> FootprintPlanes:
        """Those of every step-th row and column."""
        cells = Cells(self.cells.u[::step], self.cells.v[::step], self.cells.radius_px)
        arrays = (self.normal, self.middle, self.relief, self.share, self.sure)
        return FootprintPlanes(cells, *(array[::step, ::step] for array in arrays))


def fit_footprints(
    points: NDArray[np.float32],
    known: BoolArray,
    sure: BoolArray,
    cells: Cells,
    along_radius: float = np.inf,
    variance: NDArray[np.float32] | None = None,
) -> FootprintPlanes:
    """Fit the plane of every footprint to its known points (h, w, 3); sure (h, w): those of them without doubt.

    along_radius : see `footprints.disc_sums`.  variance (h, w) : of the logarithm of a point's distance, by errors;
        None is none.
    """
    centre = middle_of(points, known)
    x, y, z = (np.where(known, points[..., k] - np.float32(centre[k]), np.float32(0.0)) for k in range(3))
    error = np.zeros_like(z) if variance is None else np.where(known, variance, np.float32(0.0))
    squares = x * x, x * y, x * z, y * y, y * z, z * z
    n, certain, *sums = disc_sums((known, sure, x, y, z, *squares, error), cells, along_radius)
    area = disc_area(cells.radius_px, along_radius)
    share, certain = (np.minimum(pixels / area, 1.0) for pixels in (n, certain))
    return FootprintPlanes(cells, *planes_of_sums(n, sums, centre), share, certain)


def middle_of(points: NDArray[np.float32], known: BoolArray) -> FloatArray:
    """(3,) mean of the known points (h, w, 3); ahead of camera 1 if there are none."""
    # axis by axis: a mean over an axis of three takes ten times as long
    return np.array([points[..., k][known].mean(dtype=np.float64) for k in range(3)]) if known.any() else AHEAD


def planes_of_sums(
    n: FloatArray, sums: Sequence[FloatArray], centre: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Normals (..., 3), middles (..., 3) and relief (...) of planes, as in `FootprintPlanes`.

    n (...): numbers of points.  sums: of their x, y, z, xx, xy, xz, yy, yz, zz (...), from `centre` (3,) on, and of the
    variance of the logarithm of their distance.
    """
    count = np.maximum(n, 1.0)[..., None]
    mean, second = np.stack(sums[:3], -1) / count, np.stack(sums[3:9], -1) / count
    scatter = second[..., [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(*n.shape, 3, 3) - mean[..., :, None] * mean[..., None, :]
    middle = mean + centre
    values, vectors = np.linalg.eigh(_without_errors(scatter, middle, sums[9] / count[..., 0]))
    normal = vectors[..., 0]
    normal[n < 3], middle[n < 3] = AHEAD, AHEAD
    away = (normal * middle).sum(-1) > 0
    return np.where(away[..., None], -normal, normal), middle, np.sqrt(np.maximum(values[..., 0], 0.0))


def _without_errors(scatter: FloatArray, middle: FloatArray, variance: FloatArray) -> FloatArray:
    """Scatter matrices (..., 3, 3) without what errors of this variance (...) along the line of sight to the middle
    (..., 3) add, which would tilt planes away from the camera.

    At most as much is taken as leaves points on a plane: then it is the one of the least squared errors of distance.
    """
    first, second, third = np.moveaxis(scatter, -2, 0)
    adjugate = np.stack([np.cross(second, third), np.cross(third, first), np.cross(first, second)], -1)
    volume = (first * adjugate[..., 0]).sum(-1)
    spread = (middle * (adjugate @ middle[..., None])[..., 0]).sum(-1)
    most = np.maximum(volume, 0.0) / np.maximum(spread, np.finfo(float).tiny)
    return np.asarray(scatter - np.minimum(variance, most)[..., None, None] * middle[..., None] * middle[..., None, :])


def heights(points: NDArray[np.float32], known: BoolArray, planes: FootprintPlanes) -> tuple[FloatArray, FloatArray]:
    """Largest distance (rows, columns) of the ground in every footprint above its plane, and below it.

    Of every block of pixels, the highest and the lowest against the plane of the nearest cell are compared.
    """
    cells = planes.cells
    side = max(1, int(2 * cells.radius_px / BLOCKS))
    off = _off_nearest_plane(points, known, planes)
    high, low = (_extremes(points, known, off * sign, side) for sign in (1.0, -1.0))
    reach = int(cells.radius_px) // side
    above, below = np.zeros(cells.shape, np.float32), np.zeros(cells.shape, np.float32)
    base = (planes.normal * planes.middle).sum(-1).astype(np.float32)
    normal = [np.ascontiguousarray(planes.normal[..., k], np.float32) for k in range(3)]
    rows, columns = high.shape[1:]
    for down, right in np.ndindex(2 * reach + 1, 2 * reach + 1):
        if ((down - reach) ** 2 + (right - reach) ** 2) * side**2 > cells.radius_px**2:
            continue
        row = np.clip(cells.v // side + down - reach, 0, rows - 1)
        at = row[:, None] * columns + np.clip(cells.u // side + right - reach, 0, columns - 1)
        top, bottom = (
            sum(n * end.take(at) for n, end in zip(normal, ends, strict=True)) - base for ends in (high, low)
        )
        np.fmax(above, top, out=above)
        np.fmax(below, -bottom, out=below)
    return above.astype(float), below.astype(float)


def nearest_answered(planes: FootprintPlanes) -> IntArray | None:
    """(rows, columns) flat index of the answered cell that is nearest to every cell, roughly; None if there is none."""
    answered = planes.answered
    if not answered.any():
        return None
    unanswered, kind = (~answered).astype(np.uint8), cv2.DIST_LABEL_PIXEL
    labels = cv2.distanceTransformWithLabels(unanswered, cv2.DIST_L2, cv2.DIST_MASK_5, labelType=kind)[1]
    cell_of = np.zeros(labels.max() + 1, np.int64)
    cell_of[labels[answered]] = np.flatnonzero(answered)
    return cell_of[labels]


def _off_nearest_plane(points: NDArray[np.float32], known: BoolArray, planes: FootprintPlanes) -> NDArray[np.float32]:
    """(h, w) distance of every pixel's point above the plane of the answered cell that is nearest to it, roughly."""
    nearest = nearest_answered(planes)
    if nearest is None:
        return np.zeros(known.shape, np.float32)
    base = (planes.normal * planes.middle).sum(-1)
    table = np.dstack([planes.normal, base]).astype(np.float32).reshape(-1, 4)[nearest]
    rows, columns = (
        np.diff([0, *((at[1:] + at[:-1]) // 2 + 1), count])
        for at, count in zip((planes.cells.v, planes.cells.u), known.shape, strict=True)
    )
    shown = np.repeat(np.repeat(table, columns, axis=1), rows, axis=0)
    return np.asarray((points * shown[..., :3]).sum(-1) - shown[..., 3], np.float32)


def _extremes(
    points: NDArray[np.float32], known: BoolArray, off: NDArray[np.float32], side: int
) -> NDArray[np.float32]:
    """(3, h / side, w / side) point of every block with the largest `off` of those known; NaN where none is."""
    rows, columns = (-(-n // side) for n in known.shape)
    pad = ((0, rows * side - known.shape[0]), (0, columns * side - known.shape[1]))
    ranked = np.pad(np.where(known, off, -np.inf), pad, constant_values=-np.inf)
    blocks = ranked.reshape(rows, side, columns, side).swapaxes(1, 2).reshape(rows, columns, -1)
    best = blocks.argmax(-1)
    i = np.minimum(np.arange(rows)[:, None] * side + best // side, known.shape[0] - 1)
    j = np.minimum(np.arange(columns)[None] * side + best % side, known.shape[1] - 1)
    none = ~np.isfinite(np.take_along_axis(blocks, best[..., None], -1)[..., 0])
    return np.moveaxis(np.where(none[..., None], np.float32(np.nan), points[i, j]), -1, 0)
