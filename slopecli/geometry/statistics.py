"""Medians and quantiles by themselves: what libraries offer takes longer to load or to call than all the rest."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike


def median(values: ArrayLike) -> float:
    """The median of all values, whatever their shape; NaN where there is none, or where one is NaN."""
    flat = np.ravel(values)
    middle = len(flat) // 2
    if not len(flat):
        return math.nan
    parted = np.partition(flat, middle)
    if math.isnan(parted[middle:].max()):
        return math.nan
    upper = float(parted[middle])
    return upper if len(flat) % 2 else 0.5 * (float(parted[:middle].max()) + upper)


def quantile(values: ArrayLike, at: float) -> float:
    """The value that a share `at` of all does not exceed, linear between neighbours; NaN as of the median."""
    flat = np.ravel(values)
    if not len(flat):
        return math.nan
    place = at * (len(flat) - 1)
    low = int(place)
    parted = np.partition(flat, low)
    above = parted[low + 1 :]
    if math.isnan(parted[low:].max()):
        return math.nan
    lower = float(parted[low])
    return lower + (place - low) * (float(above.min()) - lower) if len(above) else lower


def normal_quantile(probability: float) -> float:
    """Quantile of the standard normal distribution, 0 < probability < 1, by bisection to the last digits.

    Raises
    ------
    ValueError : probability is not between 0 and 1.
    """
    if not 0.0 < probability < 1.0:
        raise ValueError(f"a probability of {probability} has no quantile")
    if probability > 0.5:  # the smaller tail keeps its digits
        return -normal_quantile(1.0 - probability)
    low, high = -40.0, 0.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        below = 0.5 * math.erfc(-middle / math.sqrt(2.0)) < probability
        low, high = (middle, high) if below else (low, middle)
    return high


@lru_cache(maxsize=64)
def student_quantile(probability: float, freedom: int) -> float:
    """Quantile of Student's t with a whole number of degrees of freedom, 0.5 <= probability < 1, by bisection.

    Source: Abramowitz and Stegun, "Handbook of Mathematical Functions", 26.7.3 and 26.7.4.

    Raises
    ------
    ValueError : probability or freedom is out of range.
    """
    if not 0.5 <= probability < 1.0 or freedom < 1:
        raise ValueError(f"Student's t has no quantile for {probability} with {freedom} degrees of freedom here")
    low, high = 0.0, 0.5 * math.pi  # of the angle whose tangent is t / sqrt(freedom)
    for _ in range(60):
        middle = 0.5 * (low + high)
        below = _student_within(middle, freedom) < 2.0 * probability - 1.0
        low, high = (middle, high) if below else (low, middle)
    return math.sqrt(freedom) * math.tan(low)


def _student_within(angle: float, freedom: int) -> float:
    """Probability that |t| stays below sqrt(freedom) tan(angle)."""
    odd = freedom % 2
    term, total = math.cos(angle) ** odd, 0.0
    for k in range(2 + odd, freedom + 1, 2):
        total += term
        term *= (k - 1) / k * math.cos(angle) ** 2
    total *= math.sin(angle)
    return 2.0 / math.pi * (angle + total) if odd else total
