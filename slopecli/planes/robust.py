"""One plane through cells of which some stand far off it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slopecli.geometry.epipolar import homogeneous
from slopecli.types import BoolArray, FloatArray

HYPOTHESES = 300
GATE = 6.0  # robust sigmas; terrain is not Gaussian, and its hillocks belong to the plane one stands on
# Half-normal quantiles: residuals of one plane alone have these in this ratio. A tighter core is a second surface.
CORE, HALF = 0.30, 0.50
CORE_SIGMA, HALF_SIGMA = 0.3853, 0.6745
SPLIT = 0.4


@dataclass(frozen=True, eq=False)
class RobustPlane:
    """normal (3,): w = normal . (x, y, 1); scale: robust 1-sigma of the image-2 residual, normalised; inlier (n,)."""

    normal: FloatArray
    scale: float
    inlier: BoolArray


def robust_plane(x1: FloatArray, w: FloatArray, leverage: FloatArray, floor: float) -> RobustPlane:
    """Least squares over all points but a minority that stands off by far more than the rest.

    Starts from the least median of squares (Rousseeuw 1984) over random triples with a fixed seed. Where the window
    holds two surfaces, neither with a clear majority, the tighter and larger one is taken: the core quantile of the
    residuals is then far smaller than that of any single plane with noise.

    Parameters
    ----------
    x1 : (n, 2) normalised points of image 1, n >= 3.  w : (n,) inverse depths, 1/baseline.
    leverage : (n,) image-2 motion per unit of inverse depth.
    floor : smallest sigma believed, normalised coordinates of image 2.
    """
    rays = homogeneous(x1)
    rows, target = rays * leverage[:, None], w * leverage
    candidates = _triples(rows, target)
    residual = np.abs(target - candidates @ rows.T)
    half = np.quantile(residual, HALF, axis=1) / HALF_SIGMA
    core = np.quantile(residual, CORE, axis=1) / CORE_SIGMA
    split = core.min() < SPLIT * half.min() and half.min() > 3 * floor
    start = candidates[(core if split else half).argmin()]
    return _reweighted(rows, target, start, floor, CORE if split else HALF)


def _triples(rows: FloatArray, target: FloatArray) -> FloatArray:
    rng = np.random.default_rng(0)
    index = rng.integers(0, len(rows), (HYPOTHESES, 3))
    matrix = rows[index]
    area = np.abs(np.linalg.det(matrix))
    wide = area >= np.quantile(area, 0.4)  # thin triangles leave the plane's tilt to the noise
    wide &= area > 0
    everything = _least_squares(rows, target)[None]
    if not wide.any():
        return everything
    return np.vstack([np.linalg.solve(matrix[wide], target[index[wide]][..., None])[..., 0], everything])


def _reweighted(rows: FloatArray, target: FloatArray, normal: FloatArray, floor: float, quantile: float) -> RobustPlane:
    consistent = CORE_SIGMA if quantile == CORE else HALF_SIGMA
    inlier, scale = np.ones(len(rows), bool), floor
    for _ in range(6):
        residual = np.abs(target - rows @ normal)
        scale = max(float(np.quantile(residual, quantile)) / consistent, floor)
        inlier = residual < GATE * scale
        normal = _least_squares(rows[inlier], target[inlier])
    return RobustPlane(normal, scale, inlier)


def _least_squares(rows: FloatArray, target: FloatArray) -> FloatArray:
    system = rows.T @ rows
    return np.linalg.solve(system + 1e-14 * max(np.trace(system), 1e-30) * np.eye(3), rows.T @ target)
