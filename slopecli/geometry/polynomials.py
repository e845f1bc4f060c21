"""Roots of polynomials of lenses."""

from __future__ import annotations

import numpy as np

from slopecli.types import FloatArray


def smallest_positive_root(polynomial: FloatArray) -> float:
    """Smallest positive real root of coefficients, highest power first; infinity without one, 0 where they overflow."""
    if not np.isfinite(polynomial).all():
        return 0.0
    # terms that matter nowhere would overflow on division
    polynomial = np.where(np.abs(polynomial) < 1e-30 * np.abs(polynomial).max(), 0.0, polynomial)
    roots = np.roots(polynomial)
    real = roots.real[(np.abs(roots.imag) <= 1e-9 * np.abs(roots)) & (roots.real > 0)]
    return float(real.min()) if len(real) else np.inf
