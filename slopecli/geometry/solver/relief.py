"""Relief of terrain patches, whose points lie near their plane, not on it: noise, relief, weights, test of flatness.

A point off its plane is displaced along its epipolar line only. So the residual across the line is image noise, and
the residual along it is noise plus relief. Each patch has its own relative relief r: the RMS height off the plane over
the distance of the plane. With r = 0 this is the exact-plane model. On rough ground the displacement varies from point
to point; on bent or broken ground, or several planes, neighbouring points are displaced alike.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from slopecli.geometry.solver.mismatches import Kept, gate_squared, noise_at_least, residual_scale
from slopecli.geometry.solver.observations import FINEST_RESIDUAL, Observations, Prediction, observe, predict
from slopecli.geometry.statistics import median, robust_sigma
from slopecli.types import BoolArray, FloatArray, IntArray, Solution


class Relief(NamedTuple):
    """noise: 1-sigma in image 2; relative (m,): r of each patch; W (3, n): packed 2x2 weights relative to noise^2;
    log_determinant: sum of log covariance determinants over noise^2 I; kept: points in the fit."""

    noise: float
    relative: FloatArray
    W: FloatArray
    log_determinant: float
    kept: Kept


def estimate_relief(
    observations: Observations,
    prediction: Prediction,
    index: int,
    noise: float | None,
    robust: bool,
    settled: bool = False,
) -> Relief:
    """Noise and relief from the residuals of motion number `index`, and the weights that follow from them.

    noise : known 1-sigma of a normalised coordinate of image 2, or None to estimate it from the residuals across the
        epipolar lines; also estimated if these are significantly larger.
    settled : do not estimate the noise again, as for a second root that is compared under the noise of the first.
    robust : leave out mismatches, and minorities far off their plane.
    """
    along, across, gain = _components(prediction.residual[index], prediction.slide[index])
    across = np.sqrt(observations.weight) * across
    free = np.sqrt(observations.free_weight) * prediction.distance[index]
    keep, keep_free = observations.weight > 0.0, observations.free_weight > 0.0
    if robust:
        keep, keep_free = _match_gate(across, free, keep, keep_free)
    total = float((across[keep] ** 2).sum() + (free[keep_free] ** 2).sum())
    freedom = max(int(keep.sum()) + int(keep_free.sum()) - 5, 1)
    if noise is None:
        noise = float(np.sqrt(total / freedom))
    elif not settled:
        noise = noise_at_least(noise, total, freedom)
    noise = max(noise, 1e-12)
    # one unit of relative height moves the point by this much in image 2
    lever = gain * prediction.inverse_depth[index]
    if robust:
        reach = np.maximum(lever, 1e-150)  # finite heights also at the epipole and behind the camera
        keep &= ~standing_off(along / reach, noise / reach, keep, observations.slices())
    relative = _relative_relief(observations, along, lever, noise, keep)
    return _weights(observations, prediction, index, noise, relative, Kept(keep, keep_free))


def _components(residual: FloatArray, slide: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Residuals (n,) along and across the epipolar lines, and the length (n,) of the slide (2, n)."""
    gain = np.hypot(slide[0], slide[1])
    x, y = slide / np.maximum(gain, np.finfo(float).tiny)
    return x * residual[0] + y * residual[1], x * residual[1] - y * residual[0], gain


def _match_gate(
    across: FloatArray, free: FloatArray, keep: BoolArray, keep_free: BoolArray
) -> tuple[BoolArray, BoolArray]:
    both = np.concatenate([across, free])
    kept = np.concatenate([keep, keep_free])
    scale = residual_scale(both**2, kept, 1, 5.0 / max(int(kept.sum()), 6))
    inside = kept & (both**2 <= gate_squared(len(both)) * scale**2)
    return inside[: len(across)], inside[len(across) :]


def standing_off(height: FloatArray, noise: FloatArray, keep: BoolArray, planes: Iterable[slice]) -> BoolArray:
    """(n,) outliers of each plane, more than 4 sigmas off it and less than a quarter of its points, such as rocks.

    height (n,): of points off their planes, with its noise (n,).  keep (n,): points that count.  planes: those of each.
    """
    off = np.zeros(len(keep), dtype=bool)
    for plane in planes:
        kept = keep[plane]
        if np.count_nonzero(kept) < 6:
            continue
        h = height[plane]
        centre = median(h[kept])
        scale = robust_sigma(h[kept] - centre)
        far = kept & (np.abs(h - centre) > 4.0 * np.hypot(scale, noise[plane]))
        if np.count_nonzero(far) < 0.25 * np.count_nonzero(kept):  # a larger share is the shape of the terrain
            off[plane] = far
    return off


def _relative_relief(
    observations: Observations, along: FloatArray, lever: FloatArray, noise: float, keep: BoolArray
) -> FloatArray:
    """(m,) relief by Fisher scoring on the residuals along epipolar lines; 0 for patches of three points."""
    kept = keep.astype(float)
    count = observations.sum_patches(kept)
    freedom = np.where(count > 3.0, count / np.maximum(count - 3.0, 1.0), 0.0)
    variance = noise**2 / np.where(observations.weight > 0.0, observations.weight, 1.0)
    excess = observations.per_point(freedom) * along**2 - variance
    relative_squared = np.zeros(observations.n_patches)
    for _ in range(5):  # each step reduces the error several times
        expected = variance + lever**2 * observations.per_point(relative_squared)
        share = kept * lever**2 / expected**2
        information = observations.sum_patches(share * lever**2)
        relative_squared = observations.sum_patches(share * excess) / np.maximum(information, np.finfo(float).tiny)
        relative_squared = np.maximum(relative_squared, 0.0)
    return np.sqrt(relative_squared)


def _weights(
    observations: Observations, prediction: Prediction, index: int, noise: float, relative: FloatArray, kept: Kept
) -> Relief:
    """Inverse of noise^2 / weight I + (w r)^2 d d^T by Sherman and Morrison, d the slide, w the inverse depth."""
    slide, inverse_depth = prediction.slide[index], prediction.inverse_depth[index]
    weight = observations.weight * kept.planes
    # a patch's relief is estimated from n - 3 residuals: the variance of Student's t is larger
    freedom = observations.sum_patches(kept.planes.astype(float)) - 3.0
    widening = np.sqrt(np.where(freedom > 2.0, freedom / np.maximum(freedom - 2.0, 1.0), 1.0))
    spread = (inverse_depth * observations.per_point(relative * widening) / noise) ** 2
    squared = (slide * slide).sum(axis=0)
    factor = weight**2 * spread / (1.0 + weight * spread * squared)
    W = np.stack([weight - factor * slide[0] ** 2, -factor * slide[0] * slide[1], weight - factor * slide[1] ** 2])
    log_determinant = float(np.log1p(weight * spread * squared).sum())
    return Relief(noise, relative, W, log_determinant, kept)


def plane_variances(
    solution: Solution, x1: FloatArray, x2: FloatArray, patch: IntArray, weights: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """(m, 3, 3) covariances of the normals by the points kept, the motion held, in units of noise^2: flat, and rough.

    The first is what they would be if the points lay on their planes, the second what they are with the relief of the
    solution. Arguments as of `solve_planes`.
    """
    seen = observe(x1, x2, patch, weights * solution.inlier)
    prediction = predict(seen, solution.R[None], solution.T[None], solution.scaled_normals[None])
    squared = (prediction.slide[0] ** 2).sum(axis=0)
    freedom = seen.sum_patches((seen.weight > 0.0).astype(float)) - 3.0
    widening = np.sqrt(np.where(freedom > 2.0, freedom / np.maximum(freedom - 2.0, 1.0), 1.0))
    height = prediction.inverse_depth[0] * seen.per_point(solution.relief * widening)
    spread = (height / max(solution.noise, FINEST_RESIDUAL)) ** 2
    flat = seen.weight * squared
    rough = flat / (1.0 + flat * spread)
    packed = [seen.sum_patches(weight * seen.products) for weight in (flat, rough)]
    V = [sums[[0, 1, 2, 1, 3, 4, 2, 4, 5]].T.reshape(-1, 3, 3) for sums in packed]
    held, loose = (np.asarray(np.linalg.pinv(each, hermitian=True), float) for each in V)
    return held, loose


class Flatness(NamedTuple):
    """Residuals of the points kept against their planes: 1-sigma of a coordinate of weight 1, normalised.

    across : of all points, across their epipolar lines.  along (m,) : of each patch along them.  both (m,) : of each
    patch, both components.  off (m,) : whether along is significantly larger than across.
    shaped (m,) : whether, besides, neighbouring points are displaced alike.
    bent (m,) : whether a curved surface explains most of both components, as of one plane through a ridge or a bowl.
    """

    across: float
    along: FloatArray
    both: FloatArray
    off: BoolArray
    shaped: BoolArray
    bent: BoolArray


def flatness(solution: Solution, x1: FloatArray, x2: FloatArray, patch: IntArray, weights: FloatArray) -> Flatness:
    """Judge every patch of a solution of these correspondences; arguments as of `solve_planes`."""
    seen = observe(x1, x2, patch, weights)
    prediction = predict(seen, solution.R[None], solution.T[None], solution.scaled_normals[None])
    root = np.sqrt(seen.weight)
    along, across = (root * part for part in _components(prediction.residual[0], prediction.slide[0])[:2])
    kept = solution.inlier[seen.order][seen.n_free :]
    count = seen.sum_patches(kept.astype(float))
    alongs, acrosses = (seen.sum_patches(kept * part**2) for part in (along, across))
    spare = np.maximum(count - 3.0, 0.0)  # a plane takes three residuals, all of them along

    freedom = max(float(count.sum()) - 5.0, 1.0)
    noise = float(np.sqrt(acrosses.sum() / freedom))
    sigma = np.sqrt(alongs / np.maximum(spare, 1.0))
    off = (spare > 0.0) & (sigma > FINEST_RESIDUAL) & _larger(sigma**2, spare, noise**2, freedom)

    places, chosen = seen.p[:2].T, kept & np.repeat(off, seen.count)
    # rows with the wrong patch label are displaced like neighbours in other patches
    shaped = off & _shared_by_neighbours(places[chosen], along[chosen])
    for k, own in enumerate(seen.slices()):
        shaped[k] |= off[k] and _shared_by_neighbours(places[own][kept[own]], along[own][kept[own]])
    both = np.sqrt((alongs + acrosses) / np.maximum(2.0 * count - 3.0, 1.0))
    # alone, or one of few planes, a patch bends the motion as well, and then both components hold what is off the plane
    residuals, bent = np.stack([along, across], axis=1), both > FINEST_RESIDUAL
    for k, own in enumerate(seen.slices()):
        mine = kept[own]
        bent[k] &= _curved(places[own][mine], root[own][mine], residuals[own][mine])
    return Flatness(noise, sigma, both, off, shaped, bent)


def _larger(variance: FloatArray, freedom: FloatArray, other: float, other_freedom: float) -> BoolArray:
    """Whether variances (m,) are significantly larger than another (by chance 3 in 100 000, as all patches are tested).

    Source: Paulson, "An approximate normalization of the analysis of variance distribution", 1942.
    """
    ratio = np.cbrt(variance / max(other, np.finfo(float).tiny))
    a, b = 2.0 / (9.0 * np.maximum(freedom, 1.0)), 2.0 / (9.0 * other_freedom)
    return np.asarray((1.0 - b) * ratio - (1.0 - a) > 4.0 * np.sqrt(b * ratio**2 + a))


def _curved(places: FloatArray, root: FloatArray, residuals: FloatArray) -> bool:
    """Whether residuals (n, 2) at places (n, 2), times the root of their weights, are those of a curved surface.

    Terms of second order must explain significantly more than chance, and so much that residuals about the curved
    surface are less than half of those about the plane.
    Source: analysis of variance of nested regressions (Fisher 1925).
    """
    n = len(places)
    x, y = ((places - places.mean(axis=0)) / np.maximum(places.std(axis=0), np.finfo(float).tiny)).T if n else places.T
    terms = np.stack([np.ones(n), x, y, x * x, x * y, y * y], axis=1) * root[:, None]
    if n <= terms.shape[1]:
        return False
    parts = (np.linalg.qr(terms)[0].T @ residuals) ** 2
    level, second = float(parts[:3].sum()), float(parts[3:].sum())
    rest = max(float((residuals**2).sum()) - level - second, 0.0)
    spent, spare = float(parts[3:].size), float((n - len(parts)) * 2)
    significant = _larger(np.array([second / spent]), np.array([spent]), rest / spare, spare)
    return bool(significant[0]) and second > 3.0 * rest


def _shared_by_neighbours(places: FloatArray, values: FloatArray) -> bool:
    """Whether values (n,) at places (n, 2) vary significantly more between neighbourhoods than within.

    Source: analysis of variance (Fisher 1925) over a grid of cells with about three points each.
    """
    n = len(values)
    side = int(np.sqrt(n / 3))
    if side < 2:
        return False
    strip = np.empty(n, np.int64)
    strip[np.argsort(places[:, 0], kind="stable")] = np.arange(n) * side // n
    order = np.lexsort((places[:, 1], strip))
    within_strip = np.arange(n) - np.searchsorted(strip[order], strip[order])
    cell = np.empty(n, np.int64)
    cell[order] = strip[order] * side + within_strip * side // np.bincount(strip)[strip[order]]
    count = np.bincount(cell)
    mean = np.bincount(cell, values) / count
    cells = len(count)
    within = float(((values - mean[cell]) ** 2).sum()) / (n - cells)
    between = np.array([count @ (mean - values.mean()) ** 2 / (cells - 1)])
    return bool(_larger(between, np.array([cells - 1.0]), within, n - cells)[0])
