"""Polynomials of lenses: their roots, and how they are inverted."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slopecli.types import FloatArray


class Inversion(NamedTuple):
    """How lens polynomials are inverted: Newton's method from a table."""

    table_size: int = 1025  # starts Newton within 1e-6 of the root in any usable field of view
    steps: int = 20  # three or four do
    settled: float = 1e-8  # Newton squares the error: after a step this small only rounding is left
    largest_angle: float = float(np.radians(89.9))  # off the axis; normalised coordinates beyond tan = 573 are useless


INVERSION = Inversion()


def smallest_positive_root(polynomial: FloatArray) -> float:
    """Smallest positive real root of coefficients, highest power first; infinity without one, 0 where they overflow."""
    if not np.isfinite(polynomial).all():
        return 0.0
    # terms that matter nowhere would overflow on division
    polynomial = np.where(np.abs(polynomial) < 1e-30 * np.abs(polynomial).max(), 0.0, polynomial)
    roots = np.roots(polynomial)
    real = roots.real[(np.abs(roots.imag) <= 1e-9 * np.abs(roots)) & (roots.real > 0)]
    return float(real.min()) if len(real) else np.inf
