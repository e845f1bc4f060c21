"""A plane found from the pixels of a whole window at once: what remains when no single spot of it can be matched.

The motion is held; the plane has three parameters, so even faint texture spread over the window decides them.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from slopecli.geometry.epipolar import homogeneous
from slopecli.types import FloatArray
from slopecli.vision.warp import FloatImage, Grid, Pyramid, Transfer, block_sum, covered, magnification

NOISE_GREY = 2.0  # grey levels below which contrast is sensor noise, not texture
MAX_STEP_PX = 1.0  # a Gauss-Newton step moves no more of the window than this: the image is linear no further
LEAST_GREY = 0.5  # no image pair agrees better than this, grey levels
TUKEY = 2.5  # robust sigmas of the photometric residual


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
        depth = np.where(np.abs(moved[:, 2:]) < 1e-9, 1e-9, moved[:, 2:])
        uv = self.pixels2(moved[:, :2] / depth)
        uv[moved[:, 2] <= 0] = -1e4
        return np.nan_to_num(uv, nan=-1e4).reshape(*self.grid.shape, 2).astype(np.float32)


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
    x, y = np.meshgrid(np.arange(grid.shape[1]), np.arange(grid.shape[0]))
    rays = homogeneous(rays1(grid.full(np.stack([x, y], -1).reshape(-1, 2).astype(float))))
    return View(grid, rays, rays @ R.T, R @ T, pixels2, pyramid2, shape2)


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
    if valid.sum() < 30 or valid.mean() < 0.3:
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
    """Gauss-Newton on grey values over the three parameters of the plane, robust, exposure and shading removed."""
    radius = max(4.0, min(view.grid.shape) / 6)
    grey = view.grid.grey.astype(np.float32)
    ours = detrend(grey, radius)
    system = np.eye(3)
    for _ in range(iterations):
        linear = _linearise(view, normal, ours, radius)
        if linear is None:
            return PlaneFit(normal, -1.0, np.full((3, 3), np.inf))
        system, gradient, shift = linear
        step = -np.linalg.solve(system + 1e-4 * np.diag(np.diag(system)) + 1e-12 * np.eye(3), gradient)
        reach = float(np.percentile(np.abs(view.rays @ step) * shift, 90))
        step *= min(1.0, MAX_STEP_PX / max(reach, 1e-9))
        normal = normal + step
        if reach < 0.01:
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


Linear = tuple[
    FloatArray, FloatArray, float
]  # normal matrix (3, 3), gradient (3,), median px per unit of inverse depth


def _linearise(view: View, normal: FloatArray, ours: FloatImage, radius: float) -> Linear | None:
    mapping = view.mapping(normal)
    valid = covered(mapping, view.shape2)
    if valid.mean() < 0.3:
        return None
    # motion of each pixel per unit of inverse depth, by a small finite difference along the ray
    depth_step = 1e-3 * float(np.abs(view.rays @ normal).mean()) + 1e-9
    per_depth = (view.mapping(normal + np.array([0.0, 0.0, depth_step])) - mapping) / np.float32(depth_step)
    shift = np.linalg.norm(per_depth, axis=2)
    unit = per_depth / np.maximum(shift, 1e-9)[..., None]
    grid_px = 1.0 / float(np.sqrt(np.prod(view.grid.scale)))
    half = np.float32(0.5 * grid_px * max(magnification(mapping, view.grid), 0.2))
    theirs = detrend(_pull(view, mapping), radius)
    gain = gain_between(ours, theirs, valid)
    residual = gain * theirs - ours
    slope = gain * (_pull(view, mapping + half * unit) - _pull(view, mapping - half * unit)) / (2 * half) * shift
    sigma = max(1.4826 * float(np.median(np.abs(residual[valid]))), LEAST_GREY)
    weight = np.where(valid, 1 / (1 + (residual / (TUKEY * sigma)) ** 2) ** 2, 0).reshape(-1, 1)
    jacobian = slope.reshape(-1, 1) * view.rays
    weighted = jacobian * weight
    pixel_shift = float(np.median(shift)) / grid_px
    return weighted.T @ jacobian / sigma**2, weighted.T @ residual.reshape(-1) / sigma**2, pixel_shift


def _pull(view: View, mapping: FloatImage) -> FloatImage:
    ratio = 1.0 / float(np.sqrt(np.prod(view.grid.scale)))
    layer = view.pyramid2.at(ratio)
    local = (mapping + 0.5) * layer.scale.astype(np.float32) - 0.5
    pulled = cv2.remap(layer.grey, local[..., 0], local[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(pulled, np.float32)


CELL_PRIOR_PX = 0.5  # a cell's displacement from the aligned plane is within this; decides where texture does not


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
    """One Gauss-Newton step of every cell by itself (Lucas and Kanade 1981), about a plane aligned on all of them.

    Added up over the cells these steps are the alignment of the plane, so they carry all it knows into the joint
    solution, and let single cells that disagree be found.
    """
    radius = max(4.0, min(view.grid.shape) / 6)
    mapping = view.mapping(normal)
    valid = covered(mapping, view.shape2)
    ours = detrend(view.grid.grey.astype(np.float32), radius)
    theirs = detrend(_pull(view, mapping), radius)
    theirs = theirs * np.float32(gain_between(ours, theirs, valid))
    residual = theirs - ours
    mean = 0.5 * (ours + theirs)
    gx, gy = cv2.Sobel(mean, cv2.CV_32F, 1, 0, scale=1 / 8), cv2.Sobel(mean, cv2.CV_32F, 0, 1, scale=1 / 8)
    sigma = max(1.4826 * float(np.median(np.abs(residual[valid]))), LEAST_GREY) if valid.any() else 1.0
    weight = np.where(valid, 1 / (1 + (residual / (TUKEY * sigma)) ** 2) ** 2, 0.0).astype(np.float32) / sigma**2
    columns = view.grid.shape[1] // cell
    layers = [gx * gx, gx * gy, gy * gy, gx * residual, gy * residual, valid.astype(np.float32)]
    scaled = [block_sum(layer * weight if k < 5 else layer, cell).ravel() for k, layer in enumerate(layers)]
    a, b, c, p, q, seen = scaled
    keep = seen > 0.5 * cell**2
    prior = 1 / CELL_PRIOR_PX**2
    system = np.stack([a + prior, b, b, c + prior], -1).reshape(-1, 2, 2)[keep]
    shift = np.asarray(-np.linalg.solve(system, np.stack([p, q], -1)[keep][..., None])[..., 0], float)
    index = np.stack(np.divmod(np.flatnonzero(keep), columns), -1)
    centre = index[:, ::-1] * float(cell) + (cell - 1) / 2
    information = np.stack([a, b, b, c], -1).reshape(-1, 2, 2)[keep]
    return CellShifts(centre, shift, information, index)


# tangents of the tilt against the line of sight: facing, slanted, and grazing as ground in front of a level camera
TILTS = ((0.0, 0.0), *((a * t, b * t) for t in (1.0, 2.5) for a, b in ((1, 0), (-1, 0), (0, 1), (0, -1))))


def sweep_planes(view: View, depths: FloatArray, keep: int = 4) -> list[PlaneFit]:
    """Try planes over a range of inverse depths (n,) and a few tilts; the best by correlation, unrefined."""
    radius = max(4.0, min(view.grid.shape) / 6)
    ours = normalise(view.grid.grey.astype(np.float32), radius)
    centre = view.rays.mean(0)
    fits = []
    for w in depths:
        for tilt_x, tilt_y in TILTS:
            normal = np.array([tilt_x * w, tilt_y * w, 0.0])
            normal[2] = (w - normal @ centre) / centre[2]
            mapping = view.mapping(normal)
            valid = covered(mapping, view.shape2)
            if valid.mean() < 0.4:
                continue
            score = correlation(ours, normalise(_pull(view, mapping), radius), valid)
            fits.append(PlaneFit(normal, score, np.full((3, 3), np.inf)))
    return sorted(fits, key=lambda fit: -fit.score)[:keep]
