"""Covariance of the motion by the scatter of what parts of the image ask for.

Matching noise is not all that moves a motion: lenses are never exactly as modelled, shutters roll, flow errs alike over
a whole surface. Such errors are shared by far more matches than neighbours are correlated, and residuals of single
matches do not show them. So the image is divided into blocks, and the steps that these ask of the motion, beside those
of all the others, are compared with what noise alone would make of them. Source: White, "Maximum likelihood estimation
of misspecified models", 1982; Liang and Zeger, "Longitudinal data analysis using generalized linear models", 1986.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from slopecli.errors import DegenerateConfiguration
from slopecli.geometry.solver.intrinsics import Settled, eliminated, lifted, whitened_rows, with_planes
from slopecli.geometry.solver.observations import observe
from slopecli.geometry.solver.one_thread import one_blas_thread
from slopecli.geometry.solver.seen_points import Sightings
from slopecli.types import FloatArray, IntArray, Solution


@dataclass(frozen=True)
class ScatterTunables:
    """How image 1 is divided. Blocks of 64 px told nothing of images of 2 MP: lens errors and surfaces are larger."""

    blocks: tuple[float, float] = (8.0, 5.0)  # along the longer side, two divisions
    outside: float = 3.0  # along each side, for the points on no patch, where every patch is a part of its own
    fewest: int = 8  # parts with matches: fewer do not tell a scatter


SCATTER = ScatterTunables()


def with_scatter(solution: Solution, sightings: Sightings) -> Solution:
    """The solution, covariances of motion and normals larger by the excess of that scatter over noise.

    sightings : the points that the solution kept.  A motion with a prior keeps its covariance.
    """
    if solution.solver != "mle" or solution.prior_chi2 is not None:
        return solution
    factor = scatter_of(sightings, Settled.of(solution))
    if factor <= 1.0:
        return solution
    other = solution.ambiguity.alternative
    if other is not None:
        solution = replace(solution, ambiguity=replace(solution.ambiguity, alternative=_widened(other, factor)))
    return _widened(solution, factor)


def _widened(root: Solution, factor: float) -> Solution:
    """One root, the variance of its motion times a factor; normals follow the motion."""
    added, gain = (factor - 1.0) * root.motion_covariance, root.normal_gain
    return replace(
        root,
        motion_covariance=root.motion_covariance + added,
        normal_covariance=root.normal_covariance + gain @ added @ gain.swapaxes(1, 2),
    )


@one_blas_thread()
def scatter_of(sightings: Sightings, settled: Settled) -> float:
    """Variance of the motion by the scatter of parts of the image over that by noise, mean over its five coordinates.

    The largest of three divisions; 1 where it is less, the parts are too few, or the points determine no motion.
    """
    sightings, settled = with_planes(sightings, settled)
    still = np.zeros((4, 2, len(sightings.patch)))  # the camera is held fixed
    try:
        seen = observe(*sightings.rays(), sightings.patch, sightings.weight)
        left, _ = eliminated(seen, whitened_rows(seen, settled, still, still))
    except DegenerateConfiguration:
        return 1.0
    k, n = seen.n_free, len(seen.weight)
    row = np.concatenate([np.arange(k, k + n), np.arange(k, k + n), np.arange(k)])  # point of each row
    rows, residual = left[:5], left[9]
    covariance = np.asarray(np.linalg.inv(lifted(rows @ rows.T)))
    asked = rows * (residual - rows.T @ (covariance @ (rows @ residual)))
    place, camera = sightings.uv1[seen.order], sightings.cameras[0]
    divisions = [_numbers(place / max(camera.width, camera.height) * blocks) for blocks in SCATTER.blocks]
    outside = _numbers(place[:k] / (camera.width, camera.height) * SCATTER.outside)
    patches = np.repeat(np.arange(seen.n_patches), seen.count) + outside.max(initial=-1) + 1
    divisions.append(np.concatenate([outside, patches]))
    largest = max(_excess(asked, covariance, parts[row]) for parts in divisions)
    return max(largest / sightings.gain**2, 1.0)


def _excess(asked: FloatArray, covariance: FloatArray, part: IntArray) -> float:
    """Trace of the scatter of the motion by parts of the image times the inverse of the covariance by noise, over 5.

    asked (5, rows): gradient of each row.  covariance (5, 5): of independent noise.  part (rows,): number of its part.
    """
    sums = np.array([np.bincount(part, one) for one in asked])
    count = int(np.count_nonzero(np.bincount(part)))
    if count < SCATTER.fewest:
        return 1.0
    return float(np.einsum("ib,ij,jb->", sums, covariance, sums)) / 5.0 * count / (count - 1)


def _numbers(place: FloatArray) -> IntArray:
    """(n,) number of the unit square that each place (n, 2) lies in, 0 upward."""
    if not len(place):
        return np.zeros(0, np.int64)
    column, line = np.floor(place - place.min(axis=0)).astype(np.int64).T
    return np.asarray(line * (column.max() + 1) + column)
