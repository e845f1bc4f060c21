"""One plane through cells of which some stand far off it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slopecli.geometry.epipolar import homogeneous
from slopecli.geometry.metrics import normal_angle
from slopecli.geometry.statistics import median
from slopecli.types import BoolArray, FloatArray, IntArray

HYPOTHESES = 300
RANKED_ON = 250  # points that rank the hypotheses: more cost time, and tell no better which of them is best
GATE = 4.5  # robust sigmas; terrain is not Gaussian, and its hillocks belong to the plane one stands on
CORE, HALF = 0.35, 0.50  # quantiles of the absolute residuals hypotheses are ranked by
CORE_SIGMA, HALF_SIGMA = 0.4538, 0.6745  # and what they are of a Gaussian's sigma
MINORITY = 0.25  # of a window may be left out as standing off, unless across a step
CORES = 12  # best hypotheses of the core that are tried for a step
LEAST_CORE = 6  # points to which each of them is fitted first, if there are so many
STEP_GATE = 3.0  # robust sigmas of the core, where part of the window lies on another surface across a step
STEP_SIGMAS = 7.0  # RMS of the rest: how far that part stands off
DOUBT_SHARE = 0.35  # of the angle between the plane kept and the plane of all points
STEP_EVEN, STEP_REST = 0.4, 0.25  # of that distance; at most this share of the part may be further from it
STEP_SHARES = (0.03, 0.5)  # of the window across the step: less is stray, more is the window itself
LEAST_SHOWN = 1e-12  # motion in image 2 per unit of relative height, normalised: what shows less shows nothing
TINY, LEAST_TRACE = 1e-14, 1e-30  # share of a system's trace that is added to what may be singular
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

    Starts from the least median of squares (Rousseeuw 1984) over triples, always the same. Where a smaller part
    of the window lies on a second surface across a step (a projecting bay, ground behind a ledge), the plane of the
    larger part is taken alone; relief without a step is averaged over, as a foot or a wheel would.

    Parameters
    ----------
    x1 : (n, 2) normalised points of image 1, n >= 3.  w : (n,) inverse depths, 1/baseline.
    leverage : (n,) image-2 motion per unit of inverse depth.
    floor : smallest sigma believed, normalised coordinates of image 2.
    """
    rays = homogeneous(x1)
    planes = _triple_planes(rays, w)
    first = _fit(rays * leverage[:, None], w * leverage, planes, floor)
    weight = _relief_weight(np.abs(w - rays @ first.normal), w, leverage, floor)
    return _fit(rays * weight[:, None], w * weight, planes, floor)


def _relief_weight(misfit: FloatArray, w: FloatArray, leverage: FloatArray, floor: float) -> FloatArray:
    """(n,) weight of inverse depths, in image-2 units: noise is even in the image, relief is even on the ground.

    Near the focus of expansion relief hardly shows in the image, so residuals there would seem to be all noise.
    """
    height, shown = misfit / w, np.maximum(leverage * w, LEAST_SHOWN)
    seen = shown >= median(shown)
    relief = median(height[seen]) / HALF_SIGMA
    relief = np.sqrt(max(relief**2 - median((floor / shown[seen]) ** 2), 0.0))
    spread = np.sqrt(floor**2 + (relief * shown) ** 2)
    return np.asarray(leverage * median(spread) / spread)


def _fit(rows: FloatArray, target: FloatArray, planes: FloatArray, floor: float) -> RobustPlane:
    everything = _least_squares(rows, target)
    candidates = np.vstack([planes, everything])
    some = _sample(len(rows))
    rows_some, target_some = rows[some], target[some]
    residual = candidates @ rows_some.T
    residual -= target_some  # in place: another array of this size takes longer to get than to fill
    ranked = np.sort(np.abs(residual).astype(np.float32), axis=1)  # one sort of short numbers, for both their quantiles
    core_size, half_size = (ranked[:, _place(share, len(some))] for share in (CORE, HALF))
    cores = _concentrated(rows_some, target_some, candidates[core_size.argsort()[:CORES]])
    found = _step(rows, target, cores, floor)
    if found is not None:
        core, step = found
        return _reweighted(rows[~step], target[~step], core, floor, STEP_GATE).over(rows, target)
    plane = _reweighted(rows, target, candidates[half_size.argmin()], floor, GATE)
    if plane.inlier.mean() < 1 - MINORITY:  # what is left out is no minority but the shape of the ground
        plane = _reweighted(rows, target, everything, floor, GATE)
    return plane


def _triple_planes(rays: FloatArray, w: FloatArray) -> FloatArray:
    """(k, 3) planes through random triples of points, rays (n, 3); thin triangles leave their tilt to the noise."""
    # a triple that holds a point twice has no area
    index = np.random.default_rng(1).integers(len(rays), size=(HYPOTHESES, 3))
    matrix = rays[index]
    area = np.abs(np.linalg.det(matrix))
    wide = (area >= np.quantile(area, 0.4)) & (area > 1e-9 * area.max())
    return np.asarray(np.linalg.solve(matrix[wide], w[index[wide]][..., None])[..., 0])


def _sample(n: int) -> IntArray:
    """RANKED_ON of n indices, one out of each nearly equal share of them; all where they are no more."""
    if n <= RANKED_ON:
        return np.arange(n)
    ends = np.arange(RANKED_ON + 1) * n // RANKED_ON
    return np.random.default_rng(1).integers(ends[:-1], ends[1:])


def _concentrated(rows: FloatArray, target: FloatArray, cores: FloatArray) -> FloatArray:
    """The planes (k, 3), each fitted to the share of the points nearest to it: what a draw of three has begun.

    Where those points do not tell a plane, as without leverage, it stays as it is.

    Source: the C-step of Rousseeuw and Van Driessen, "Computing LTS Regression for Large Data Sets", 2006.
    """
    if CORE * len(rows) < LEAST_CORE:
        return cores
    size = np.abs(target - cores @ rows.T)
    near = (size <= _row_quantile(size, CORE)[:, None]).astype(float)
    sums = near @ plane_products(rows, target)
    told = sums[:, [0, 5, 10]].sum(axis=1) > LEAST_TRACE
    cores = cores.copy()
    cores[told] = planes_of_sums(sums[told], TINY)
    return cores


def plane_products(rows: FloatArray, target: FloatArray) -> FloatArray:
    """(n, 12) what every point adds to the normal equations of a plane: rows (n, 3), target (n,)."""
    return (rows[:, :, None] * np.column_stack([rows, target])[:, None, :]).reshape(-1, 12)


def planes_of_sums(sums: FloatArray, lift: float) -> FloatArray:
    """(k, 3) planes of sums (k, 12) of `plane_products`; lift : share of the trace added to what may be singular."""
    system = sums.reshape(-1, 3, 4)
    lifted = lift * np.trace(system[:, :, :3], axis1=1, axis2=2)[:, None, None] * np.eye(3)
    return np.asarray(np.linalg.solve(system[:, :, :3] + lifted, system[:, :, 3:])[..., 0])


def _row_quantile(values: FloatArray, share: float) -> FloatArray:
    """The value that a share of every row (..., n) does not exceed; numpy's own takes longer than the rest of a fit."""
    at = _place(share, values.shape[-1])
    return np.asarray(np.partition(values, at, axis=-1)[..., at])


def _place(share: float, n: int) -> int:
    """Index, among n sorted values, of the one that this share of them does not exceed."""
    return int(share * (n - 1))


def _step(rows: FloatArray, target: FloatArray, cores: FloatArray, floor: float) -> tuple[FloatArray, BoolArray] | None:
    """The first of the planes (k, 3) before a step, and the points (n,) beyond it; None where there is none.

    Across a step lies a second surface, parallel and at one distance; a crater wall or a boulder is at all distances.
    """
    residual = target - cores @ rows.T
    size = np.abs(residual)
    scale = np.maximum(_row_quantile(size, CORE) / CORE_SIGMA, floor)
    off = size > STEP_GATE * scale[:, None]
    count = off.sum(axis=1)
    share = count / len(rows)
    spread = np.sqrt((size * size * ~off).sum(axis=1) / np.maximum(len(rows) - count, 1))
    spread = np.maximum(spread, scale)
    # nothing is further off than the furthest: hardly any plane but one before a step needs to be looked at closer
    likely = (share >= STEP_SHARES[0]) & (share <= STEP_SHARES[1]) & (size.max(axis=1) >= STEP_SIGMAS * spread)
    for i in np.flatnonzero(likely):
        beyond = residual[i][off[i]]
        distance = median(beyond)
        aside = np.abs(beyond - distance) > STEP_EVEN * abs(distance)
        if abs(distance) >= STEP_SIGMAS * spread[i] and aside.sum() <= STEP_REST * len(beyond):
            return cores[i], off[i]
    return None


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
    return np.linalg.solve(system + TINY * max(np.trace(system), LEAST_TRACE) * np.eye(3), rows.T @ target)
