"""Robust statistics: median, robust sigma, Geman-McClure weights, reweighted least squares; quantiles of chi-square."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slopecli.types import FloatArray

MAD_FACTOR = 1.4826  # sigma of a Gaussian over its median absolute deviation
# quantiles of chi-square, by degrees of freedom and probability
CHI2 = {(1, 0.5): 0.4549, (2, 0.5): 1.3863, (1, 0.99): 6.63, (2, 0.99): 9.21, (3, 0.999): 16.3}
CERTAIN_SIGMAS = 3.0  # a difference that is larger has a cause
GATE_SIGMAS = 2.5  # residual, in robust sigmas, at which a Geman-McClure weight is 1/4


def median(values: ArrayLike) -> float:
    """Median of all values of an array of any shape; NaN for an empty array or one that holds NaN.

    Equal to np.median, which takes ten times as long for a few hundred values; an estimate needs hundreds of medians.
    """
    flat = np.ravel(values)
    if not len(flat):
        return math.nan
    middle = [(len(flat) - 1) // 2, len(flat) // 2, len(flat) - 1]
    lower, upper, largest = np.partition(flat, middle)[middle].tolist()  # NaN sorts last
    return math.nan if math.isnan(largest) else 0.5 * (lower + upper)


def robust_sigma(residual: NDArray[np.floating[Any]], least: float = 0.0, most: float = math.inf) -> float:
    """Sigma of residuals with mean 0 and outliers among them: 1.4826 median(|residual|), within [least, most]."""
    return min(max(MAD_FACTOR * median(np.abs(residual)), least), most)


def geman_mcclure(residual: FloatArray, scale: float | FloatArray) -> FloatArray:
    """Weights, 0..1, of reweighted least squares under the Geman-McClure loss, in the residual's shape and type.

    scale : residual at which the weight is 1/4, usually GATE_SIGMAS robust sigmas; broadcasts against the residual.
    Source: Geman and McClure, "Statistical methods for tomographic image reconstruction", 1987.
    """
    return 1 / (1 + (residual / scale) ** 2) ** 2


def robust_least_squares(
    rows: FloatArray, target: FloatArray, solution: FloatArray, bounds: tuple[float, float], rounds: int
) -> tuple[FloatArray, FloatArray]:
    """Solve `rows @ solution = target` with Geman-McClure weights: (..., p), and (...) sigma of the last weights.

    The scale of the weights follows the residuals: GATE_SIGMAS times their robust sigma in each system.

    rows : (..., n, p).  target : (..., n).  solution : (..., p) to start from.  rounds : number of reweightings.
    bounds : least and largest value that the sigma is given, in the unit of the target; equal for a known sigma.
    """
    columns = np.swapaxes(rows, -1, -2)
    sigma = np.zeros(target.shape[:-1])
    for _ in range(rounds):
        residual = (rows @ solution[..., None])[..., 0] - target
        sigma = np.clip(MAD_FACTOR * np.median(np.abs(residual), axis=-1), *bounds)
        weighted = columns * geman_mcclure(residual, GATE_SIGMAS * sigma[..., None])[..., None, :]
        system = weighted @ rows
        # rows that leave a direction open must not make the system singular
        damping = 1e-9 * np.trace(system, axis1=-2, axis2=-1) + 1e-12
        system = system + damping[..., None, None] * np.eye(rows.shape[-1])
        solution = np.linalg.solve(system, weighted @ target[..., None])[..., 0]
    return solution, sigma
