"""What a residual costs: Student's t with three degrees of freedom, noise with a relief of its own.

Surfaces taken for planes have window bays and mouldings, and matches have errors far beyond their usual ones. The
logarithm lets such points stay on their plane where least squares would have them torn away or tear it away.
"""

from __future__ import annotations

import numpy as np

from slopecli.types import FloatArray

FREEDOM = 3.0  # degrees of freedom of t: the variance exists, and the tails are as heavy as that allows
SCALE_ROUNDS = 10  # of expectation and maximisation: the scale moves by less than 1 % then
_NORM = {1: float(np.log(np.sqrt(FREEDOM) * np.pi / 2)), 2: float(np.log(2 * np.pi))}  # -log t(0) of scale 1


def cost_of(squares: FloatArray, scale: float, dim: int) -> FloatArray:
    """Negative log density, nats, of residuals of `dim` 1 or 2 coordinates, given their squared lengths."""
    tail = 0.5 * (FREEDOM + dim) * np.log1p(squares / (FREEDOM * scale**2))
    return np.asarray(tail + (dim * np.log(scale) + _NORM[dim]))


def weight_of(squares: FloatArray, scale: float, dim: int) -> FloatArray:
    """Weights of least squares that minimise `cost_of`, 1/unit^2 times scale^2 (Lange, Little and Taylor 1989)."""
    return np.asarray((FREEDOM + dim) / (FREEDOM + squares / scale**2))


def scale_of(squares: FloatArray, dim: int, start: float, bounds: tuple[float, float]) -> float:
    """The most likely scale of residuals, within bounds, from their squared lengths (n,)."""
    scale = start
    for _ in range(SCALE_ROUNDS):
        mean = float(np.mean(weight_of(squares, scale, dim) * squares)) if len(squares) else scale**2 * dim
        scale = float(np.clip(np.sqrt(mean / dim), *bounds))
    return scale
