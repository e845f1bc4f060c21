"""Robust plane fit to inverse depths of a window: outliers, relief, a second surface across a step, unmatched parts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slopecli.geometry.epipolar import homogeneous, normal_angle
from slopecli.geometry.statistics import CERTAIN_SIGMAS, MAD_FACTOR, median, robust_sigma
from slopecli.types import BoolArray, FloatArray, IntArray

PLANE_GATE = 4.5  # robust sigmas within which points belong to the plane; wide, as relief is not Gaussian
CORE_SHARE = 0.35  # of the points belong to one surface even beside a step; their residuals rank hypotheses
CORE_SIGMA = 0.4538  # quantile of |residual| at CORE_SHARE over the sigma of a Gaussian
STEP_SIGMAS = 7.0  # distance of the surface across a step, in RMS residuals of the others
BEND_RAD = np.radians(10.0)  # 1-sigma by which unmatched ground is assumed to tilt against matched ground, either axis


@dataclass(frozen=True, eq=False)
class RobustPlane:
    """normal (3,): w = normal . (x, y, 1).  scale: robust 1-sigma of the image-2 residual, normalised coordinates.
    inlier (n,): points within `gate` scales."""

    normal: FloatArray
    scale: float
    gate: float
    inlier: BoolArray

    def tilt_sigma_rad(self, rows: FloatArray, target: FloatArray) -> float:
        """1-sigma of the tilt due to the choice of inliers: 0.35 of the angle to the plane of all points."""
        if self.inlier.all():
            return 0.0
        return 0.35 * float(normal_angle(self.normal, _least_squares(rows, target)))

    def over(self, rows: FloatArray, target: FloatArray) -> RobustPlane:
        """The same plane with its inliers among other points: rows (n, 3), target (n,), both times the leverage."""
        inlier = np.abs(target - rows @ self.normal) < self.gate * self.scale
        return RobustPlane(self.normal, self.scale, self.gate, inlier)


def robust_plane(x1: FloatArray, w: FloatArray, leverage: FloatArray, floor: float) -> RobustPlane:
    """Least-squares plane of all points but outliers, at most a quarter of them.

    Starts from the least median of squares (Rousseeuw 1984) over triples drawn with a fixed seed. If a smaller part of
    the window lies on a second surface across a step (a projecting bay, ground behind a ledge), the plane is that of
    the larger part; relief without a step is averaged.

    x1 : (n, 2) normalised points of image 1, n >= 3.  w : (n,) inverse depths, 1/baseline, and their leverage (n,).
    floor : lower bound of the sigma of a residual, normalised coordinates of image 2.
    """
    rays = homogeneous(x1)
    planes = _triple_planes(rays, w)
    first = _fit(rays * leverage[:, None], w * leverage, planes, floor)
    weight = _relief_weight(np.abs(w - rays @ first.normal), w, leverage, floor)
    return _fit(rays * weight[:, None], w * weight, planes, floor)


def _relief_weight(misfit: FloatArray, w: FloatArray, leverage: FloatArray, floor: float) -> FloatArray:
    """(n,) weight of inverse depths, in image-2 units, for uniform noise in the image and uniform relief on the ground.

    Relief is estimated where leverage is above its median: near the focus of expansion it does not show in the image.
    """
    height, shown = misfit / w, np.maximum(leverage * w, 1e-12)
    seen = shown >= median(shown)
    relief = MAD_FACTOR * median(height[seen])
    relief = np.sqrt(max(relief**2 - median((floor / shown[seen]) ** 2), 0.0))
    spread = np.sqrt(floor**2 + (relief * shown) ** 2)
    return np.asarray(leverage * median(spread) / spread)


def _fit(rows: FloatArray, target: FloatArray, planes: FloatArray, floor: float) -> RobustPlane:
    """The robust plane of rows (n, 3) @ normal = target (n,), both in image-2 units, from hypotheses (k, 3)."""
    everything = _least_squares(rows, target)
    candidates = np.vstack([planes, everything])
    some = _sample(len(rows))
    rows_some, target_some = rows[some], target[some]
    residual = candidates @ rows_some.T
    residual -= target_some
    ranked = np.sort(np.abs(residual).astype(np.float32), axis=1)
    core_size, half_size = (ranked[:, _place(share, len(some))] for share in (CORE_SHARE, 0.5))
    cores = _concentrated(rows_some, target_some, candidates[core_size.argsort()[:12]])
    found = _step(rows, target, cores, floor)
    if found is not None:
        core, step = found
        return _reweighted(rows[~step], target[~step], core, floor, CERTAIN_SIGMAS).over(rows, target)
    plane = _reweighted(rows, target, candidates[half_size.argmin()], floor, PLANE_GATE)
    if plane.inlier.mean() < 0.75:  # more than a minority: the shape of the ground, not outliers
        plane = _reweighted(rows, target, everything, floor, PLANE_GATE)
    return plane


def _triple_planes(rays: FloatArray, w: FloatArray) -> FloatArray:
    """(k, 3) planes through random triples of points, rays (n, 3), the 60 % with the largest triangles."""
    # a triple that holds a point twice has no area
    index = np.random.default_rng(1).integers(len(rays), size=(300, 3))
    matrix = rays[index]
    area = np.abs(np.linalg.det(matrix))
    wide = (area >= np.quantile(area, 0.4)) & (area > 1e-9 * area.max())
    return np.asarray(np.linalg.solve(matrix[wide], w[index[wide]][..., None])[..., 0])


def _sample(n: int, size: int = 250) -> IntArray:
    """Indices of `size` of n points that rank the hypotheses, a random one of each of as many equal parts."""
    if n <= size:
        return np.arange(n)
    ends = np.arange(size + 1) * n // size
    return np.random.default_rng(1).integers(ends[:-1], ends[1:])


def _concentrated(rows: FloatArray, target: FloatArray, cores: FloatArray) -> FloatArray:
    """Planes (k, 3), each fitted again to the CORE_SHARE of the points nearest to it; unchanged if these fix no plane.

    Source: the C-step of Rousseeuw and Van Driessen, "Computing LTS Regression for Large Data Sets", 2006.
    """
    if CORE_SHARE * len(rows) < 6:
        return cores
    size = np.abs(target - cores @ rows.T)
    near = (size <= _row_quantile(size, CORE_SHARE)[:, None]).astype(float)
    sums = near @ plane_products(rows, target)
    regular = sums[:, [0, 5, 10]].sum(axis=1) > 1e-30  # the trace: points without leverage fix nothing
    cores = cores.copy()
    cores[regular] = planes_of_sums(sums[regular])
    return cores


def plane_products(rows: FloatArray, target: FloatArray) -> FloatArray:
    """(n, 12) contribution of every point to the normal equations of a plane: rows (n, 3), target (n,)."""
    return (rows[:, :, None] * np.column_stack([rows, target])[:, None, :]).reshape(-1, 12)


def planes_of_sums(sums: FloatArray) -> FloatArray:
    """(k, 3) planes of sums (k, 12) of `plane_products`, finite also for points that fix none."""
    system = sums.reshape(-1, 3, 4)
    lift = 1e-12 * np.trace(system[:, :, :3], axis1=1, axis2=2) + 1e-44
    return np.asarray(np.linalg.solve(system[:, :, :3] + lift[:, None, None] * np.eye(3), system[:, :, 3:])[..., 0])


def _row_quantile(values: FloatArray, share: float) -> FloatArray:
    """Lower quantile of every row (..., n), several times as fast as np.quantile."""
    at = _place(share, values.shape[-1])
    return np.asarray(np.partition(values, at, axis=-1)[..., at])


def _place(share: float, n: int) -> int:
    """Index of the lower quantile at this share among n sorted values."""
    return int(share * (n - 1))


def _step(rows: FloatArray, target: FloatArray, cores: FloatArray, floor: float) -> tuple[FloatArray, BoolArray] | None:
    """The first of the planes (k, 3) with a step, and the points (n,) across it; None without a step.

    Across a step lies a second surface, parallel and at one distance; a crater wall or a boulder is at all distances.
    It holds 3 to 50 % of the points, at most a quarter of them further from their median than 0.4 of its distance.
    """
    residual = target - cores @ rows.T
    size = np.abs(residual)
    scale = np.maximum(_row_quantile(size, CORE_SHARE) / CORE_SIGMA, floor)
    off = size > CERTAIN_SIGMAS * scale[:, None]
    count = off.sum(axis=1)
    share = count / len(rows)
    spread = np.sqrt((size * size * ~off).sum(axis=1) / np.maximum(len(rows) - count, 1))
    spread = np.maximum(spread, scale)
    likely = (share >= 0.03) & (share <= 0.5) & (size.max(axis=1) >= STEP_SIGMAS * spread)
    for i in np.flatnonzero(likely):
        beyond = residual[i][off[i]]
        distance = median(beyond)
        aside = np.abs(beyond - distance) > 0.4 * abs(distance)
        if abs(distance) >= STEP_SIGMAS * spread[i] and aside.sum() <= 0.25 * len(beyond):
            return cores[i], off[i]
    return None


def _reweighted(rows: FloatArray, target: FloatArray, normal: FloatArray, floor: float, gate: float) -> RobustPlane:
    """Alternate between inliers within `gate` robust sigmas and their least-squares plane."""
    inlier, scale = np.zeros(len(rows), bool), floor
    for _ in range(6):
        residual = target - rows @ normal
        scale = robust_sigma(residual, floor)
        before, inlier = inlier, np.abs(residual) < gate * scale
        if np.array_equal(inlier, before):
            break
        normal = _least_squares(rows[inlier], target[inlier])
    return RobustPlane(normal, scale, gate, inlier)


def _least_squares(rows: FloatArray, target: FloatArray) -> FloatArray:
    return np.asarray(planes_of_sums(plane_products(rows, target).sum(axis=0))[0])


def lever(at: FloatArray, seen: BoolArray) -> float:
    """Tilt of the plane fitted to the whole window per unit of tilt of its unmatched part, in the worst direction.

    at : (n, 2) places all over the window, px from its middle.  seen : (n,) which of them have matches: all give 0,
    none 1.
    """
    if seen.all() or not seen.any():
        return 0.0 if seen.all() else 1.0
    return min(float(np.linalg.norm(gap_gain(at, seen), 2)), 1.0)


def gap_gain(at: FloatArray, seen: BoolArray) -> FloatArray:
    """(2, 2) tilt of the plane fitted to the whole window by that of its unmatched part, hinged where matches end.

    at, seen : as in `lever`; some seen, some not.
    """
    gap, known = at[~seen], at[seen]
    nearest = known[((gap[:, None] - known[None]) ** 2).sum(axis=2).argmin(axis=1)]
    return np.asarray(np.linalg.lstsq(at.T @ at, gap.T @ (gap - nearest), rcond=None)[0])
