"""Planes from grey values: alignment of a plane on all pixels of a window, and a search over depths and tilts.

The motion is held fixed. A plane has three parameters, so texture too faint for matching any single patch still
determines it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slopecli.geometry.epipolar import homogeneous
from slopecli.geometry.statistics import GATE_SIGMAS, geman_mcclure, median, robust_sigma
from slopecli.look.dense import contrast_ratio
from slopecli.look.noise import NOISE_GREY, ROUNDING_GREY
from slopecli.look.warp import (
    FloatImage,
    Grid,
    Pyramid,
    Transfer,
    block_sum,
    covered,
    image_gradient,
    local_mean,
    magnification,
    plane_transfer,
    sample_layer,
    transfer_map,
)
from slopecli.types import FloatArray, IntArray

MIN_SEEN = 0.3  # share of the pixels that must lie in image 2 for a plane to be aligned or scored on them
# tangents of the tilt from the line of sight: fronto-parallel, slanted, and grazing as ground before a level camera
TILTS = ((0.0, 0.0), *((a * t, b * t) for t in (1.0, 2.5) for a, b in ((1, 0), (-1, 0), (0, 1), (0, -1))))


class Bundle(NamedTuple):
    """Homogeneous rays (n, 3) of image 1, in the axes of camera 1 and of camera 2."""

    rays: FloatArray
    turned: FloatArray

    def take(self, index: IntArray) -> Bundle:
        """The rays of these indices."""
        return Bundle(self.rays[index], self.turned[index])


@dataclass(frozen=True, eq=False)
class View:
    """A working grid over image 1 with all that is needed to resample image 2 onto it through a plane.

    rays1 : (n, 2) px of image 1 -> normalised.  pixels2 : (n, 2) normalised -> px of image 2.
    R, T : (3, 3) and (3,) motion.  shape2 : (rows, columns) of image 2.
    """

    grid: Grid
    rays1: Transfer
    pixels2: Transfer
    R: FloatArray
    T: FloatArray
    pyramid2: Pyramid
    shape2: tuple[int, int]

    @cached_property
    def pixels(self) -> Bundle:
        """The grid's pixels, row by row."""
        x, y = np.meshgrid(np.arange(self.grid.shape[1]), np.arange(self.grid.shape[0]))
        return self.bundle(self.grid.full(np.stack([x, y], -1).reshape(-1, 2).astype(float)))

    def bundle(self, uv: FloatArray) -> Bundle:
        """Rays of pixels (n, 2) of image 1."""
        rays = homogeneous(self.rays1(uv))
        return Bundle(rays, rays @ self.R.T)

    def transfer(self, bundle: Bundle, normal: FloatArray) -> FloatArray:
        """(n, 2) px of image 2 that correspond to n rays on the plane of scaled normal (3,)."""
        return plane_transfer(bundle.turned, bundle.rays @ normal, self.R @ self.T, self.pixels2)

    def mapping(self, normal: FloatArray) -> FloatImage:
        """(h, w, 2) full px of image 2 that correspond to the grid's pixels on the plane of scaled normal (3,)."""
        return self.transfer(self.pixels, normal).reshape(*self.grid.shape, 2).astype(np.float32)

    def node_mapping(self, normal: FloatArray) -> FloatImage:
        """`mapping`, exact on nodes only and bilinear in between, which is several times faster."""
        return transfer_map(self.grid, lambda uv: self.transfer(self.bundle(uv), normal))


def normalise(image: FloatImage, radius: float) -> FloatImage:
    """Image with local mean 0 and local standard deviation 1 (Gaussian of sigma `radius` px), noise not amplified."""
    centred = detrend(image, radius)
    contrast = np.sqrt(local_mean(centred * centred, radius) + NOISE_GREY**2)
    return np.asarray(centred / contrast, np.float32)


def detrend(image: FloatImage, radius: float) -> FloatImage:
    """Image less its local mean (Gaussian of sigma `radius` px), which removes slow shading and keeps the contrast."""
    return image - local_mean(image, radius)


def gain_between(first: FloatImage, second: FloatImage, valid: NDArray[np.bool_]) -> float:
    """Factor that gives the second of two detrended images the contrast of the first where valid; 1 if nowhere."""
    if not valid.any():
        return 1.0
    ours, theirs = (float(np.sqrt(np.mean(grey[valid] ** 2))) for grey in (first, second))
    return contrast_ratio(ours, theirs)


def correlation(a: FloatImage, b: FloatImage, valid: NDArray[np.bool_]) -> float:
    """Normalised cross-correlation where valid; -1 if hardly anything is."""
    if valid.sum() < 30 or valid.mean() < MIN_SEEN:
        return -1.0
    p, q = a[valid] - a[valid].mean(), b[valid] - b[valid].mean()
    return float((p @ q) / np.sqrt((p @ p) * (q @ q) + 1e-9))


@dataclass(frozen=True, eq=False)
class PlaneFit:
    """A plane aligned on pixels: scaled normal (3,), correlation of the images, covariance (3, 3) due to noise."""

    normal: FloatArray
    score: float
    covariance: FloatArray


def align_plane(view: View, normal: FloatArray, iterations: int = 10) -> PlaneFit:
    """Fit a plane to the grey values of a window by robust Gauss-Newton; exposure and shading are removed.

    normal : (3,) scaled normal to start from, 1/baseline; it must map pixels to within a few grid px. The score is -1
        and the covariance infinite if image 2 shows less than MIN_SEEN of the window.
    """
    radius = _shading_radius(view)
    grey = view.grid.grey.astype(np.float32)
    first = detrend(grey, radius)
    system = np.eye(3)
    for _ in range(iterations):
        linear = _linearise(view, normal, first, radius)
        if linear is None:
            return PlaneFit(normal, -1.0, np.full((3, 3), np.inf))
        system, gradient, px_per_depth = linear
        step = -np.linalg.solve(system + 1e-4 * np.diag(np.diag(system)) + 1e-12 * np.eye(3), gradient)
        reach = np.quantile(np.abs(view.pixels.rays @ step) * px_per_depth, 0.9)
        normal = normal + step * min(1.0, 1.0 / max(reach, 1e-9))  # by a px at most: in that range an image is linear
        if reach < 0.01:  # px: settled
            break
    return PlaneFit(normal, _score(view, normal, normalise(grey, radius), radius), _covariance(system))


def _score(view: View, normal: FloatArray, first: FloatImage, radius: float) -> float:
    """Correlation of the normalised image 1 with image 2 through a plane; -1 where too little is seen."""
    mapping = view.mapping(normal)
    valid = covered(mapping, view.shape2)
    if valid.mean() < MIN_SEEN:
        return -1.0
    return correlation(first, normalise(_pulled(view, mapping), radius), valid)


def _covariance(system: FloatArray) -> FloatArray:
    """(3, 3) inverse of the normal matrix; infinite where it is singular."""
    if not np.isfinite(system).all() or np.linalg.cond(system) > 1e14 or np.trace(system) < 1e-9:
        return np.full((3, 3), np.inf)
    return np.asarray(np.linalg.inv(system), float)


def _linearise(
    view: View, normal: FloatArray, first: FloatImage, radius: float
) -> tuple[FloatArray, FloatArray, float] | None:
    """Squared residuals linearised in the plane: normal matrix (3, 3), gradient (3,), and the median displacement, in
    grid px, per unit of inverse depth; None where image 2 shows too little of the window."""
    mapping = view.mapping(normal)
    valid = covered(mapping, view.shape2)
    if valid.mean() < MIN_SEEN:
        return None
    # displacement of each pixel per unit of inverse depth, by a small finite difference along the ray
    depth_step = 1e-3 * float(np.abs(view.pixels.rays @ normal).mean()) + 1e-9
    per_depth = (view.mapping(normal + np.array([0.0, 0.0, depth_step])) - mapping) / np.float32(depth_step)
    shift = np.linalg.norm(per_depth, axis=2)
    unit = per_depth / np.maximum(shift, 1e-9)[..., None]
    grid_px = 1.0 / view.grid.mean_scale
    half = np.float32(0.5 * grid_px * max(magnification(mapping, view.grid), 0.2))
    second = detrend(_pulled(view, mapping), radius)
    gain = gain_between(first, second, valid)
    residual = gain * second - first
    slope = gain * (_pulled(view, mapping + half * unit) - _pulled(view, mapping - half * unit)) / (2 * half) * shift
    weight, sigma = _robust_weight(residual, valid)
    jacobian = slope.reshape(-1, 1) * view.pixels.rays
    weighted = jacobian * weight.reshape(-1, 1)
    system, gradient = weighted.T @ jacobian / sigma**2, weighted.T @ residual.reshape(-1) / sigma**2
    return system, gradient, median(shift) / grid_px


def _robust_weight(residual: FloatImage, valid: NDArray[np.bool_]) -> tuple[FloatArray, float]:
    """Geman-McClure weights (h, w), 0 where not valid, and the robust sigma of the residuals, grey levels."""
    residual64 = residual.astype(float)
    sigma = robust_sigma(residual64[valid], ROUNDING_GREY) if valid.any() else ROUNDING_GREY
    return np.where(valid, geman_mcclure(residual64, GATE_SIGMAS * sigma), 0.0), sigma


def _pulled(view: View, mapping: FloatImage) -> FloatImage:
    """Image 2 resampled onto the grid."""
    # from a layer that depends on the grid alone: if it changed with the plane, the residual would be discontinuous
    return sample_layer(view.pyramid2.at(1.0 / view.grid.mean_scale), mapping)


def _shading_radius(view: View) -> float:
    """Sigma of the Gaussian, grid px, that separates shading from texture."""
    return max(4.0, min(view.grid.shape) / 6)


@dataclass(frozen=True, eq=False)
class CellShifts:
    """Displacements (n, 2) of cells from an aligned plane, grid px of image 2, with their information.

    centre (n, 2): grid px; information (n, 2, 2): inverse covariance of the shift, px^-2; index (n, 2).
    prior : px^-2, of a cell being on the plane, along either axis.
    """

    centre: FloatArray
    shift: FloatArray
    information: FloatArray
    index: NDArray[np.int64]
    prior: float

    def along(self, axis: FloatArray) -> FloatArray:
        """(n,) shifts along unit vectors (n, 2) if cells can move along no other, grid px.

        Weighted by their information these sum to zero on the plane aligned, which the shifts along two axes, that
        trade off in texture of one direction, do not.
        """
        system = self.information + self.prior * np.eye(2)
        known = np.einsum("ni,nij,nj->n", axis, system, axis)
        return np.asarray(np.einsum("ni,nij,nj->n", axis, system, self.shift) / known)


def cell_shifts(view: View, normal: FloatArray, cell: int) -> CellShifts:
    """One Gauss-Newton step of each cell of `cell` px about a plane aligned on all of them.

    Source: Lucas and Kanade 1981. The sum of these steps is that of the plane's alignment, so the cells carry its whole
    information into the joint solution, and single cells that disagree can be found.
    """
    radius = _shading_radius(view)
    mapping = view.mapping(normal)
    valid = covered(mapping, view.shape2)
    first = detrend(view.grid.grey.astype(np.float32), radius)
    second = detrend(_pulled(view, mapping), radius)
    second = second * np.float32(gain_between(first, second, valid))
    residual = second - first
    gx, gy = image_gradient(0.5 * (first + second))
    robust, sigma = _robust_weight(residual, valid)
    weight = (robust / sigma**2).astype(np.float32)
    layers = (gx * gx, gx * gy, gy * gy, gx * residual, gy * residual)
    a, b, c, p, q = (block_sum(layer * weight, cell).ravel() for layer in layers)
    keep = block_sum(valid.astype(np.float32), cell).ravel() > 0.5 * cell**2
    prior = 1 / 0.5**2  # px^-2: an aligned cell is within 0.5 px of its plane, which decides where texture does not
    system = np.stack([a + prior, b, b, c + prior], -1).reshape(-1, 2, 2)[keep]
    shift = np.asarray(-np.linalg.solve(system, np.stack([p, q], -1)[keep][..., None])[..., 0], float)
    index = np.stack(np.divmod(np.flatnonzero(keep), view.grid.shape[1] // cell), -1)
    centre = index[:, ::-1] * float(cell) + (cell - 1) / 2
    information = np.stack([a, b, b, c], -1).reshape(-1, 2, 2)[keep]
    return CellShifts(centre, shift, information, index, prior)


def sweep_planes(view: View, depths: FloatArray, keep: int = 4) -> list[PlaneFit]:
    """Score planes at inverse depths (n,) in every tilt of TILTS; the `keep` best by correlation, not aligned."""
    radius = _shading_radius(view)
    first = normalise(view.grid.grey.astype(np.float32), radius)
    unknown = np.full((3, 3), np.inf)
    normals = _visible(view, _swept(view.pixels.rays.mean(0), depths))
    fits = [PlaneFit(normal, _score(view, normal, first, radius), unknown) for normal in normals]
    seen = [fit for fit in fits if fit.score > -1.0]
    return sorted(seen, key=lambda fit: -fit.score)[:keep]


def _swept(centre: FloatArray, depths: FloatArray) -> FloatArray:
    """(k, 3) scaled normals of planes with one of the inverse depths (n,) along the ray `centre`, in every tilt."""
    normals = np.zeros((len(depths), len(TILTS), 3))
    normals[:, :, :2] = depths[:, None, None] * np.array(TILTS)
    normals[:, :, 2] = (depths[:, None] - normals @ centre) / centre[2]
    return normals.reshape(-1, 3)


def _visible(view: View, normals: FloatArray) -> FloatArray:
    """Planes (k, 3) that map any of 5 x 5 pixels of the window into image 2: a quick test before they are scored."""
    rows, columns = (np.linspace(0, side - 1, 5).astype(int) for side in view.grid.shape)
    bundle = view.pixels.take((rows[:, None] * view.grid.shape[1] + columns).ravel())
    return normals[[covered(view.transfer(bundle, normal), view.shape2).any() for normal in normals]]
