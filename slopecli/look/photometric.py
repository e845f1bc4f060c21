"""A plane found from the pixels of a whole window at once: what remains when no single spot of it can be matched.

The motion is held; the plane has three parameters, so even faint texture spread over the window decides them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from slopecli.geometry.epipolar import homogeneous
from slopecli.geometry.statistics import median
from slopecli.look.noise import NOISE_GREY, ROUNDING_GREY
from slopecli.look.warp import (
    FloatImage,
    Grid,
    Pyramid,
    Transfer,
    block_sum,
    covered,
    image_gradient,
    magnification,
    sample_layer,
    transfer_map,
)
from slopecli.types import FloatArray

MAX_STEP_PX = 1.0  # a Gauss-Newton step moves no more of the window than this: the image is linear no further
GATE_SIGMAS = 2.5  # robust sigmas of the photometric residual at which a pixel has lost most of its weight
CELL_PRIOR_PX = 0.5  # a cell's displacement from the aligned plane is within this; decides where texture does not
# shares of a window image 2 must show for its plane to be aligned, to be scored in a sweep, and of a cell to count
MIN_SEEN, MIN_SWEPT, MIN_CELL_SEEN = 0.3, 0.4, 0.5
GLIMPSES = 5  # pixels along either side of a window: of a window seen to MIN_SWEPT, one of them is seen
SETTLED_PX = 0.01  # a step that moves no pixel by more ends the alignment
# tangents of the tilt against the line of sight: facing, slanted, and grazing as ground in front of a level camera
TILTS = ((0.0, 0.0), *((a * t, b * t) for t in (1.0, 2.5) for a, b in ((1, 0), (-1, 0), (0, 1), (0, -1))))


@dataclass(frozen=True, eq=False)
class View:
    """A working grid with what is needed to pull image 2 onto it through a plane: rays of its pixels and the motion."""

    grid: Grid
    rays: FloatArray  # (h * w, 3), homogeneous, of image 1
    turned: FloatArray  # (h * w, 3), rays @ R.T
    epipole2: FloatArray  # (3,), R T
    pixels2: Transfer  # (n, 2) normalised -> (n, 2) px of image 2
    pyramid2: Pyramid
    shape2: tuple[int, int]

    def mapping(self, normal: FloatArray) -> FloatImage:
        """Where the plane with this scaled normal sends every pixel, (h, w, 2) full px of image 2."""
        moved = self.turned - (self.rays @ normal)[:, None] * self.epipole2
        return _imaged(moved, self.pixels2).reshape(*self.grid.shape, 2).astype(np.float32)


def plane_map(
    grid: Grid, rays1: Transfer, pixels2: Transfer, R: FloatArray, T: FloatArray, normal: FloatArray
) -> FloatImage:
    """`View.mapping` of a plane, exact on nodes only and bilinear in between, for a fraction of the time."""

    def transfer(uv: FloatArray) -> FloatArray:
        rays = homogeneous(rays1(uv))
        return _imaged((rays - (rays @ normal)[:, None] * T) @ R.T, pixels2)

    return transfer_map(grid, transfer)


def _imaged(moved: FloatArray, pixels2: Transfer) -> FloatArray:
    """Pixels (n, 2) of image 2 of points (n, 3) before camera 2, far outside where there are none."""
    depth = np.where(np.abs(moved[:, 2:]) < 1e-9, 1e-9, moved[:, 2:])
    uv = pixels2(moved[:, :2] / depth)
    uv[moved[:, 2] <= 0] = -1e4
    return np.nan_to_num(uv, nan=-1e4)


def make_view(
    grid: Grid,
    rays1: Transfer,
    pixels2: Transfer,
    R: FloatArray,
    T: FloatArray,
    pyramid2: Pyramid,
    shape2: tuple[int, int],
) -> View:
    """View of image 2 from a grid over image 1 under a motion."""
    rays = grid_rays(grid, rays1)
    return View(grid, rays, rays @ R.T, R @ T, pixels2, pyramid2, shape2)


def grid_rays(grid: Grid, rays1: Transfer) -> FloatArray:
    """(h * w, 3) homogeneous rays of a grid's pixels, row by row; rays1 : (n, 2) px of image 1 -> normalised."""
    x, y = np.meshgrid(np.arange(grid.shape[1]), np.arange(grid.shape[0]))
    return homogeneous(rays1(grid.full(np.stack([x, y], -1).reshape(-1, 2).astype(float))))


def normalise(image: FloatImage, radius: float) -> FloatImage:
    """Local mean removed and local contrast made one, so that exposure and slow shading do not count."""
    centred = image - cv2.GaussianBlur(image, (0, 0), radius)
    contrast = np.sqrt(cv2.GaussianBlur(centred * centred, (0, 0), radius) + NOISE_GREY**2)
    return np.asarray(centred / contrast, np.float32)


def detrend(image: FloatImage, radius: float) -> FloatImage:
    """Local mean removed, so that slow shading does not count; contrast kept, so that noise is equal everywhere."""
    return np.asarray(image - cv2.GaussianBlur(image, (0, 0), radius), np.float32)


def gain_between(ours: FloatImage, theirs: FloatImage, valid: NDArray[np.bool_]) -> float:
    """Factor that gives theirs the contrast of ours: exposure differs between images."""
    ratio = float(np.sum(ours[valid] ** 2)) / max(float(np.sum(theirs[valid] ** 2)), 1e-6)
    return float(np.sqrt(np.clip(ratio, 0.25, 4.0)))


def correlation(a: FloatImage, b: FloatImage, valid: NDArray[np.bool_]) -> float:
    """Normalised cross-correlation where valid; -1 when hardly anything is."""
    if valid.sum() < 30 or valid.mean() < MIN_SEEN:
        return -1.0
    p, q = a[valid] - a[valid].mean(), b[valid] - b[valid].mean()
    return float((p @ q) / np.sqrt((p @ p) * (q @ q) + 1e-9))


@dataclass(frozen=True, eq=False)
class PlaneFit:
    """A plane aligned on pixels: scaled normal (3,), correlation of the window with image 2 through it, and the
    covariance (3, 3) of the normal from the image noise alone."""

    normal: FloatArray
    score: float
    covariance: FloatArray


def align_plane(view: View, normal: FloatArray, iterations: int = 10) -> PlaneFit:
    """Gauss-Newton on grey values over the three parameters of the plane, robust, exposure and shading removed.

    Parameters
    ----------
    normal : (3,) scaled normal to start from, 1/baseline; image 2 pulled through it must be close to image 1.

    Returns
    -------
    fit : `PlaneFit`; score -1 and infinite covariance where image 2 shows too little of the window.
    """
    radius = _radius(view)
    grey = view.grid.grey.astype(np.float32)
    ours = detrend(grey, radius)
    system = np.eye(3)
    for _ in range(iterations):
        linear = _linearise(view, normal, ours, radius)
        if linear is None:
            return PlaneFit(normal, -1.0, np.full((3, 3), np.inf))
        system = linear.system
        step = -np.linalg.solve(system + 1e-4 * np.diag(np.diag(system)) + 1e-12 * np.eye(3), linear.gradient)
        reach = np.quantile(np.abs(view.rays @ step) * linear.px_per_depth, 0.9)
        step *= min(1.0, MAX_STEP_PX / max(reach, 1e-9))
        normal = normal + step
        if reach < SETTLED_PX:
            break
    mapping = view.mapping(normal)
    valid = covered(mapping, view.shape2)
    score = correlation(normalise(grey, radius), normalise(_pull(view, mapping), radius), valid)
    return PlaneFit(normal, score, _covariance(system))


def _covariance(system: FloatArray) -> FloatArray:
    """(3, 3) inverse of the normal matrix; infinite where the pixels say nothing."""
    if not np.isfinite(system).all() or np.linalg.cond(system) > 1e14 or np.trace(system) < 1e-9:
        return np.full((3, 3), np.inf)
    return np.asarray(np.linalg.inv(system), float)


class _Linear(NamedTuple):
    """Normal matrix (3, 3) and gradient (3,) of the squared residuals by the plane; median grid px a unit of inverse
    depth moves a pixel by."""

    system: FloatArray
    gradient: FloatArray
    px_per_depth: float


def _linearise(view: View, normal: FloatArray, ours: FloatImage, radius: float) -> _Linear | None:
    """The squared residuals about a plane; None where image 2 shows too little of the window."""
    mapping = view.mapping(normal)
    valid = covered(mapping, view.shape2)
    if valid.mean() < MIN_SEEN:
        return None
    # motion of each pixel per unit of inverse depth, by a small finite difference along the ray
    depth_step = 1e-3 * float(np.abs(view.rays @ normal).mean()) + 1e-9
    per_depth = (view.mapping(normal + np.array([0.0, 0.0, depth_step])) - mapping) / np.float32(depth_step)
    shift = np.linalg.norm(per_depth, axis=2)
    unit = per_depth / np.maximum(shift, 1e-9)[..., None]
    grid_px = 1.0 / view.grid.mean_scale
    half = np.float32(0.5 * grid_px * max(magnification(mapping, view.grid), 0.2))
    theirs = detrend(_pull(view, mapping), radius)
    gain = gain_between(ours, theirs, valid)
    residual = gain * theirs - ours
    slope = gain * (_pull(view, mapping + half * unit) - _pull(view, mapping - half * unit)) / (2 * half) * shift
    weight, sigma = _robust_weight(residual, valid)
    jacobian = slope.reshape(-1, 1) * view.rays
    weighted = jacobian * weight.reshape(-1, 1)
    system, gradient = weighted.T @ jacobian / sigma**2, weighted.T @ residual.reshape(-1) / sigma**2
    return _Linear(system, gradient, median(shift) / grid_px)


def _robust_weight(residual: FloatImage, valid: NDArray[np.bool_]) -> tuple[FloatImage, float]:
    """Geman-McClure weights (h, w), 0 where not valid, and the robust sigma they refer to, grey levels."""
    sigma = max(1.4826 * median(np.abs(residual[valid])), ROUNDING_GREY) if valid.any() else ROUNDING_GREY
    return np.where(valid, 1 / (1 + (residual / (GATE_SIGMAS * sigma)) ** 2) ** 2, np.float32(0)), sigma


def _pull(view: View, mapping: FloatImage) -> FloatImage:
    # the layer depends on the grid alone: one that changed with the plane would make the residual jump
    return sample_layer(view.pyramid2.at(1.0 / view.grid.mean_scale), mapping)


def _radius(view: View) -> float:
    """Grid px over which brightness is taken for exposure and shading, not texture."""
    return max(4.0, min(view.grid.shape) / 6)


@dataclass(frozen=True, eq=False)
class CellShifts:
    """What the cells of an aligned window still want to move, (n, 2) grid px, and what they know of it.

    centre (n, 2): grid px; information (n, 2, 2): inverse covariance of the shift, px^-2; index (n, 2).
    """

    centre: FloatArray
    shift: FloatArray
    information: FloatArray
    index: NDArray[np.int64]


def cell_shifts(view: View, normal: FloatArray, cell: int) -> CellShifts:
    """One Gauss-Newton step of every cell of `cell` px (Lucas and Kanade 1981), about a plane aligned on all of them.

    Added up over the cells these steps are the alignment of the plane, so they carry all it knows into the joint
    solution, and let single cells that disagree be found.
    """
    radius = _radius(view)
    mapping = view.mapping(normal)
    valid = covered(mapping, view.shape2)
    ours = detrend(view.grid.grey.astype(np.float32), radius)
    theirs = detrend(_pull(view, mapping), radius)
    theirs = theirs * np.float32(gain_between(ours, theirs, valid))
    residual = theirs - ours
    mean = 0.5 * (ours + theirs)
    gx, gy = image_gradient(mean)
    robust, sigma = _robust_weight(residual, valid)
    weight = robust / np.float32(sigma**2)
    layers = (gx * gx, gx * gy, gy * gy, gx * residual, gy * residual)
    a, b, c, p, q = (block_sum(layer * weight, cell).ravel() for layer in layers)
    seen = block_sum(valid.astype(np.float32), cell).ravel()
    keep = seen > MIN_CELL_SEEN * cell**2
    prior = 1 / CELL_PRIOR_PX**2
    system = np.stack([a + prior, b, b, c + prior], -1).reshape(-1, 2, 2)[keep]
    shift = np.asarray(-np.linalg.solve(system, np.stack([p, q], -1)[keep][..., None])[..., 0], float)
    index = np.stack(np.divmod(np.flatnonzero(keep), view.grid.shape[1] // cell), -1)
    centre = index[:, ::-1] * float(cell) + (cell - 1) / 2
    information = np.stack([a, b, b, c], -1).reshape(-1, 2, 2)[keep]
    return CellShifts(centre, shift, information, index)


def sweep_planes(view: View, depths: FloatArray, keep: int = 4) -> list[PlaneFit]:
    """Try planes over a range of inverse depths (n,) and a few tilts; the best by correlation, unrefined."""
    radius = _radius(view)
    ours = normalise(view.grid.grey.astype(np.float32), radius)
    fits = []
    for normal in _glimpsed(view, _swept(view.rays.mean(0), depths)):
        mapping = view.mapping(normal)
        valid = covered(mapping, view.shape2)
        if valid.mean() < MIN_SWEPT:
            continue
        score = correlation(ours, normalise(_pull(view, mapping), radius), valid)
        fits.append(PlaneFit(normal, score, np.full((3, 3), np.inf)))
    return sorted(fits, key=lambda fit: -fit.score)[:keep]


def _swept(centre: FloatArray, depths: FloatArray) -> FloatArray:
    """(k, 3) scaled normals of planes with one of the inverse depths (n,) along the ray `centre`, in every tilt."""
    normals = np.zeros((len(depths), len(TILTS), 3))
    normals[:, :, :2] = depths[:, None, None] * np.array(TILTS)
    normals[:, :, 2] = (depths[:, None] - normals @ centre) / centre[2]
    return normals.reshape(-1, 3)


def _glimpsed(view: View, normals: FloatArray) -> FloatArray:
    """Those of the planes (k, 3) through which image 2 shows one of a few pixels spread over the window, or more.

    Of a window that image 2 does not show, a look at those is all it takes.
    """
    rows, columns = (np.linspace(0, side - 1, GLIMPSES).astype(int) for side in view.grid.shape)
    some = (rows[:, None] * view.grid.shape[1] + columns).ravel()
    moved = view.turned[some] - (normals @ view.rays[some].T)[:, :, None] * view.epipole2
    imaged = _imaged(moved.reshape(-1, 3), view.pixels2).reshape(*moved.shape[:2], 2)
    return normals[covered(imaged, view.shape2).any(axis=1)]
