"""Test whether the points of each patch are coplanar: residuals along epipolar lines against residuals across them.

A point off its plane is displaced along its epipolar line only (see `relief`), so a larger variance along the line is
due to the shape of the ground. On rough ground it varies from point to point; on bent or broken ground, or several
planes, neighbouring points are displaced alike.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slopecli.geometry.solver.observations import FINEST_RESIDUAL, observe, predict
from slopecli.types import BoolArray, FloatArray, IntArray, Solution


class Flatness(NamedTuple):
    """Residuals of the points kept against their planes: 1-sigma of a coordinate of weight 1, normalised.

    across : of all points, across their epipolar lines.  along (m,) : of each patch along them.  both (m,) : of each
    patch, both components.  off (m,) : whether along is significantly larger than across.
    shaped (m,) : whether, besides, neighbouring points are displaced alike.
    """

    across: float
    along: FloatArray
    both: FloatArray
    off: BoolArray
    shaped: BoolArray


def flatness(solution: Solution, x1: FloatArray, x2: FloatArray, patch: IntArray, weights: FloatArray) -> Flatness:
    """Judge every patch of a solution of these correspondences; arguments as of `solve_planes`."""
    seen = observe(x1, x2, patch, weights)
    prediction = predict(seen, solution.R[None], solution.T[None], solution.scaled_normals[None])
    residual, slide = prediction.residual[0], prediction.slide[0]
    direction = slide / np.maximum(np.hypot(slide[0], slide[1]), np.finfo(float).tiny)
    root = np.sqrt(seen.weight)
    along = root * (direction[0] * residual[0] + direction[1] * residual[1])
    across = root * (direction[0] * residual[1] - direction[1] * residual[0])
    kept = solution.inlier[seen.order][seen.n_free :]
    count = seen.sum_patches(kept.astype(float))
    alongs, acrosses = (seen.sum_patches(kept * part**2) for part in (along, across))
    spare = np.maximum(count - 3.0, 0.0)  # a plane takes three residuals, all of them along

    freedom = max(float(count.sum()) - 5.0, 1.0)
    noise = float(np.sqrt(acrosses.sum() / freedom))
    sigma = np.sqrt(alongs / np.maximum(spare, 1.0))
    off = (spare > 0.0) & (sigma > FINEST_RESIDUAL) & _larger(sigma**2, spare, noise**2, freedom)

    places = seen.p[:2].T
    ends = seen.first + seen.count
    patches = [slice(*ends_of) for ends_of in zip(seen.first, ends, strict=True)]
    own = [
        bool(off[k]) and _shared_by_neighbours(places[rows][kept[rows]], along[rows][kept[rows]])
        for k, rows in enumerate(patches)
    ]
    # rows with the wrong patch label are displaced like neighbours in other patches
    chosen = kept & np.repeat(off, seen.count)
    every = _shared_by_neighbours(places[chosen], along[chosen])
    return Flatness(
        noise,
        sigma,
        np.sqrt((alongs + acrosses) / np.maximum(2.0 * count - 3.0, 1.0)),
        off,
        off & (np.array(own) | every),
    )


def _larger(variance: FloatArray, freedom: FloatArray, other: float, other_freedom: float) -> BoolArray:
    """Whether variances (m,) are significantly larger than another (by chance 3 in 100 000, as all patches are tested).

    freedom, other_freedom : degrees of freedom of the variances.

    Source: Paulson, "An approximate normalization of the analysis of variance distribution", 1942.
    """
    ratio = np.cbrt(variance / max(other, np.finfo(float).tiny))
    a, b = 2.0 / (9.0 * np.maximum(freedom, 1.0)), 2.0 / (9.0 * other_freedom)
    return np.asarray((1.0 - b) * ratio - (1.0 - a) > 4.0 * np.sqrt(b * ratio**2 + a))


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
