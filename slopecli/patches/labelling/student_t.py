"""Student's t with three degrees of freedom as the density of residuals: cost, weight and scale.

Real surfaces have window bays and mouldings, and some matches have errors far beyond the usual ones. Under the heavy
tails of t such points stay on their plane and hardly move it.
"""

from __future__ import annotations

from math import lgamma, log, pi

import numpy as np

from slopecli.types import FloatArray

FREEDOM = 3.0  # degrees of freedom: the fewest whole number with a variance, so the heaviest tails


def t_cost(squares: FloatArray, scale: float, dim: int) -> FloatArray:
    """Return the negative log density, nats, of residuals of `dim` coordinates, from their squared lengths."""
    normalisation = lgamma(FREEDOM / 2) - lgamma((FREEDOM + dim) / 2) + dim / 2 * log(FREEDOM * pi)
    tail = 0.5 * (FREEDOM + dim) * np.log1p(squares / (FREEDOM * scale**2))
    return np.asarray(tail + (dim * log(scale) + normalisation))


def t_weight(squares: FloatArray, scale: float, dim: int) -> FloatArray:
    """Return weights with which least squares minimises `t_cost` (Lange, Little and Taylor 1989)."""
    return np.asarray((FREEDOM + dim) / (FREEDOM + squares / scale**2))


def t_scale(squares: FloatArray, dim: int, start: float, bounds: tuple[float, float]) -> float:
    """Return the most likely scale of residuals, within bounds, from their squared lengths (n,)."""
    scale = start
    for _ in range(10 if len(squares) else 0):  # expectation-maximisation, to within 1 %
        mean = float(np.mean(t_weight(squares, scale, dim) * squares))
        scale = float(np.clip(np.sqrt(mean / dim), *bounds))
    return scale
