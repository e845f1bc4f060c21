"""Planes of windows through all their pixels, with their uncertainty."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slopecli.ground.footprint_planes import FootprintPlanes, fit_footprints
from slopecli.ground.footprints import Cells
from slopecli.ground.tilt_uncertainty import Root, matching_variance, normal_covariance
from slopecli.look.dense_depth import DenseDepth
from slopecli.look.warp import FloatImage, block_sum
from slopecli.types import BoolArray, FloatArray
from slopecli.windows import Window


@dataclass(frozen=True)
class WindowPlaneTunables:
    """Tunables of the planes of windows."""

    places: float = 4.0  # discs along a window's side, whose noise is measured
    largest_px: float = 64.0  # radius of these discs; what larger windows have follows from it
    # power of the length by which the variance of a ramp falls: 4 for independent errors, some of which are not
    falls: int = 3
    widened: float = 1.2  # of sigmas: without it, intervals of faint ground hold 92 instead of 95 %
    hole_px: int = 8  # grid px, side of the holes in the ground matched that are wrong independently of each other
    in_doubt: float = 0.5  # 1-sigma of ground in doubt, in the jumps there
    off_plane: float = 2.0  # 1-sigma of ground that is not matched, in the RMS relief of the rest


FIT = WindowPlaneTunables()


@dataclass(frozen=True, eq=False)
class WindowPlanes:
    """The plane of every window nearest, by perpendicular distance, to all its ground: `planes`, in one row.

    covariance (n, 3, 3): of the scaled normals, NaN where there is no plane.
    """

    planes: FootprintPlanes
    covariance: FloatArray

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
    radii = [_radius_px(depth, window) for window in windows]
    discs = {radius_px: _Discs.of(depth, radius_px) for radius_px in {min(r, FIT.largest_px) for r in radii}}
    fitted = []
    for window, radius_px in zip(windows, radii, strict=True):
        measured = min(radius_px, FIT.largest_px)
        smaller = (measured / radius_px) ** FIT.falls
        fitted.append(_fit(depth, _part(depth, window), discs[measured], smaller))
    normal, middle, relief, share, sure, gradient = (np.stack(values)[None] for values in zip(*fitted, strict=True))
    planes = FootprintPlanes(Cells(np.arange(len(windows)), np.arange(1), 0.0), normal, middle, relief, share, sure)
    return WindowPlanes(planes, normal_covariance(planes, root, gradient)[0])


@dataclass(frozen=True, eq=False)
class _Discs:
    """Discs of one size all over the image, with the variance of the gradient of ln w."""

    planes: FootprintPlanes
    gradient: FloatArray

    @classmethod
    def of(cls, depth: DenseDepth, radius_px: float) -> _Discs:
        """The discs of this radius, grid px."""
        step = max(1.0, 2 * radius_px / FIT.places)
        rows, columns = depth.w.shape
        u, v = (np.arange(0.5 * step, count, step).astype(np.int64) for count in (columns, rows))
        planes = fit_footprints(depth.points, depth.known, depth.sure, Cells(u, v, radius_px))
        return cls(planes, FIT.widened**2 * matching_variance(depth, planes))

    def nearest(self, u: float, v: float) -> FloatArray:
        """(2, 2) that variance of the disc nearest to a grid pixel; NaN where none is matched."""
        cells, answered = self.planes.cells, self.planes.answered
        away = (cells.v[:, None] - v) ** 2 + (cells.u - u) ** 2
        if not answered.any():
            return np.full((2, 2), np.nan)
        return self.gradient[np.unravel_index(np.where(answered, away, np.inf).argmin(), away.shape)]


def _radius_px(depth: DenseDepth, window: Window) -> float:
    """Radius of the disc that is as large as a window, to whole grid px."""
    return max(1.0, round(float(np.sqrt(window[2] * window[3] / np.pi)) * depth.grid.mean_scale))


def _part(depth: DenseDepth, window: Window) -> tuple[slice, slice]:
    """Rows and columns of the working grid that a window covers, at least one of each."""
    x, y, w, h = window
    corners = depth.grid.inside(np.array([[x, y], [x + w, y + h]]) - 0.5) + 0.5
    (left, top), (right, bottom) = np.rint(corners).astype(int).tolist()
    return slice(top, max(bottom, top + 1)), slice(left, max(right, left + 1))


def _fit(
    depth: DenseDepth,
    part: tuple[slice, slice],
    discs: _Discs,
    smaller: float,
) -> tuple[FloatArray, FloatArray, float, float, float, FloatArray]:
    """Normal, middle, relief, shares matched and without doubt, and variance of the gradient of ln w, of one window.

    smaller : by which that variance is smaller than that of the discs.
    """
    known, sure = depth.known[part], depth.sure[part]
    if known.sum() < 3:
        return np.array([0.0, 0.0, -1.0]), np.ones(3), 0.0, 0.0, 0.0, np.full((2, 2), np.nan)
    ground = depth.points[part][known].astype(np.float64)
    middle = ground.mean(axis=0)
    offsets = ground - middle
    values, vectors = np.linalg.eigh(offsets.T @ offsets / len(ground))
    normal = vectors[:, 0] * -np.sign(vectors[:, 0] @ middle)
    relief = float(np.sqrt(max(values[0], 0.0)))
    near = discs.nearest(0.5 * (part[1].start + part[1].stop), 0.5 * (part[0].start + part[0].stop))
    gaps = _gaps(depth.rays[part], depth.span[part], known, sure, relief / middle[2])
    return normal, middle, relief, float(known.mean()), float(sure.mean()), smaller * near + gaps


def _gaps(
    rays: FloatImage, span: FloatImage, known: NDArray[np.bool_], sure: NDArray[np.bool_], relief: float
) -> FloatArray:
    """(2, 2) variance of the gradient of ln w by ground that is not matched, or in doubt.

    The former may be as far off the plane as the relief (relative to the distance) and the jumps there, the latter as
    far as half of the jumps.
    """
    variance = np.zeros((2, 2))
    for part, off2 in ((~known, (FIT.off_plane * relief) ** 2), (known & ~sure, 0.0)):
        if part.any():
            jumps = float((span[part] ** 2).mean())
            variance += (off2 + jumps if off2 else FIT.in_doubt**2 * jumps) * _lever(rays, part)
    return variance


def _lever(rays: FloatImage, part: NDArray[np.bool_]) -> FloatArray:
    """(2, 2) variance of the gradient fitted to a window per variance of the ground in a part of it.

    Either all of that part is off to one side, or every hole of `FIT.hole_px` independently; the sum of both is taken.
    """
    x = (rays.reshape(-1, 2) - rays.reshape(-1, 2).mean(0)).astype(np.float64)
    inverse = np.linalg.inv(x.T @ x + 1e-18 * np.eye(2))
    common = inverse @ x[part.ravel()].sum(0)
    if min(part.shape) < FIT.hole_px:
        return np.outer(common, common)
    shifted = x.reshape(*part.shape, 2) * part[..., None]
    holes = np.stack([block_sum(shifted[..., k].astype(np.float32), FIT.hole_px).ravel() for k in (0, 1)], -1)
    return np.asarray(np.outer(common, common) + inverse @ (holes.T @ holes) @ inverse)
