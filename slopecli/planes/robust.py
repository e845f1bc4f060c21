"""One plane through cells of which some stand far off it."""

from __future__ import annotations

import numpy as np

from slopecli.geometry.epipolar import homogeneous
from slopecli.geometry.metrics import normal_angle
from slopecli.geometry.quantiles import median, quantile
from slopecli.records import dataclass
from slopecli.types import BoolArray, FloatArray, IntArray

HYPOTHESES = 300
RANKED_ON = 250  # points that rank the hypotheses: more cost time, and tell no better which of them is best
GATE = 4.5  # robust sigmas; terrain is not Gaussian, and its hillocks belong to the plane one stands on
CORE, HALF = 0.35, 0.50  # quantiles of the absolute residuals hypotheses are ranked by
CORE_SIGMA, HALF_SIGMA = 0.4538, 0.6745  # and what they are of a Gaussian's sigma
MINORITY = 0.25  # of a window may be left out as standing off, unless across a step
CORES = 12  # best hypotheses of the core that are tried for a step
STEP_GATE = 3.0  # robust sigmas of the core, where part of the window lies on another surface across a step
STEP_SIGMAS = 7.0  # RMS of the rest: how far that part stands off
DOUBT_SHARE = 0.35  # of the angle between the plane kept and the plane of all points
STEP_EVEN, STEP_REST = 0.4, 0.25  # of that distance; at most this share of the part may be further from it
STEP_SHARES = (0.03, 0.5)  # of the window across the step: less is stray, more is the window itself
REWEIGHTS = 6  # rounds of least squares over the inliers at most: they hardly change then


@dataclass(frozen=True, eq=False)
class RobustPlane:
    """normal (3,): w = normal . (x, y, 1); scale: robust 1-sigma of the image-2 residual, normalised;
    inlier (n,): points within `gate` of those."""

    normal: FloatArray
    scale: float
    gate: float
    inlier: BoolArray

    def doubt_rad(self, rows: FloatArray, target: FloatArray) -> float:
        """How much the answer owes to what was left out: a share of the angle to the plane through everything."""
        if self.inlier.all():
            return 0.0
        return DOUBT_SHARE * float(normal_angle(self.normal, _least_squares(rows, target)))

    def over(self, rows: FloatArray, target: FloatArray) -> RobustPlane:
        """The same plane with the inliers among other points: rows (n, 3), target (n,), both times the leverage."""
        inlier = np.abs(target - rows @ self.normal) < self.gate * self.scale
        return RobustPlane(self.normal, self.scale, self.gate, inlier)


def robust_plane(x1: FloatArray, w: FloatArray, leverage: FloatArray, floor: float) -> RobustPlane:
    """Least squares over all points but a minority that stands off by far more than the rest.

    Starts from the least median of squares (Rousseeuw 1984) over random triples with a fixed seed. Where a smaller part
    of the window lies on a second surface across a step (a projecting bay, ground behind a ledge), the plane of the
    larger part is taken alone; relief without a step is averaged over, as a foot or a wheel would.

    Parameters
    ----------
    x1 : (n, 2) normalised points of image 1, n >= 3.  w : (n,) inverse depths, 1/baseline.
    leverage : (n,) image-2 motion per unit of inverse depth.
    floor : smallest sigma believed, normalised coordinates of image 2.
    """
    rays = homogeneous(x1)
    first = _fit(rays * leverage[:, None], w * leverage, floor)
    weight = _relief_weight(np.abs(w - rays @ first.normal), w, leverage, floor)
    return _fit(rays * weight[:, None], w * weight, floor)


def _relief_weight(misfit: FloatArray, w: FloatArray, leverage: FloatArray, floor: float) -> FloatArray:
    """(n,) weight of inverse depths, in image-2 units: noise is even in the image, relief is even on the ground.

    Near the focus of expansion relief hardly shows in the image, so residuals there would seem to be all noise.
    """
    height = misfit / w
    seen = leverage * w >= median(leverage * w)
    relief = median(height[seen]) / HALF_SIGMA
    relief = np.sqrt(max(relief**2 - median((floor / (leverage * w)[seen]) ** 2), 0.0))
    spread = np.sqrt(floor**2 + (relief * leverage * w) ** 2)
    return np.asarray(leverage * median(spread) / spread)


def _fit(rows: FloatArray, target: FloatArray, floor: float) -> RobustPlane:
    candidates = _triples(rows, target)
    some = _sample(len(rows))
    residual = candidates @ rows[some].T
    residual -= target[some]  # in place: another array of this size takes longer to get than to fill
    np.abs(residual, out=residual)
    for core in candidates[_row_quantile(residual, CORE).argsort()[:CORES]]:
        step = _beyond_step(target - rows @ core, floor)
        if step is not None:
            return _reweighted(rows[~step], target[~step], core, floor, STEP_GATE).over(rows, target)
    half = candidates[_row_quantile(residual, HALF).argmin()]
    plane = _reweighted(rows, target, half, floor, GATE)
    if plane.inlier.mean() < 1 - MINORITY:  # what is left out is no minority but the shape of the ground
        plane = _reweighted(rows, target, _least_squares(rows, target), floor, GATE)
    return plane


def _sample(n: int) -> IntArray:
    """At most RANKED_ON of n indices, the same for every n; all where they are no more."""
    return np.arange(n) if n <= RANKED_ON else np.random.default_rng(0).choice(n, RANKED_ON, replace=False)


def _row_quantile(values: FloatArray, quantile: float) -> FloatArray:
    """The value that a share of every row (..., n) does not exceed; numpy's own takes longer than the rest of a fit."""
    at = int(quantile * (values.shape[-1] - 1))
    return np.asarray(np.partition(values, at, axis=-1)[..., at])


def _beyond_step(residual: FloatArray, floor: float) -> BoolArray | None:
    """(n,) points on the far side of a step, None when there is none.

    Across a step lies a second surface, parallel and at one distance; a crater wall or a boulder is at all distances.
    """
    size = np.abs(residual)
    scale = max(float(_row_quantile(size, CORE)) / CORE_SIGMA, floor)
    off = size > STEP_GATE * scale
    if not STEP_SHARES[0] <= off.mean() <= STEP_SHARES[1]:
        return None
    distance = median(residual[off])
    aside = off & (np.abs(residual - distance) > STEP_EVEN * abs(distance))
    spread = max(float(np.sqrt(np.mean(residual[~off] ** 2))), scale)
    if abs(distance) < STEP_SIGMAS * spread or aside.sum() > STEP_REST * off.sum():
        return None
    return off


def _triples(rows: FloatArray, target: FloatArray) -> FloatArray:
    """(k, 3) normals through random triples of points, and the one through everything."""
    rng = np.random.default_rng(0)
    index = rng.integers(0, len(rows), (HYPOTHESES, 3))
    matrix = rows[index]
    area = np.abs(np.linalg.det(matrix))
    wide = area >= quantile(area, 0.4)  # thin triangles leave the plane's tilt to the noise
    wide &= area > 0
    everything = _least_squares(rows, target)[None]
    if not wide.any():
        return everything
    return np.vstack([np.linalg.solve(matrix[wide], target[index[wide]][..., None])[..., 0], everything])


def _reweighted(rows: FloatArray, target: FloatArray, normal: FloatArray, floor: float, gate: float) -> RobustPlane:
    inlier, scale = np.zeros(len(rows), bool), floor
    for _ in range(REWEIGHTS):
        residual = np.abs(target - rows @ normal)
        scale = max(float(_row_quantile(residual, HALF)) / HALF_SIGMA, floor)
        before, inlier = inlier, residual < gate * scale
        if np.array_equal(inlier, before):
            break
        normal = _least_squares(rows[inlier], target[inlier])
    return RobustPlane(normal, scale, gate, inlier)


def _least_squares(rows: FloatArray, target: FloatArray) -> FloatArray:
    system = rows.T @ rows
    return np.linalg.solve(system + 1e-14 * max(np.trace(system), 1e-30) * np.eye(3), rows.T @ target)
