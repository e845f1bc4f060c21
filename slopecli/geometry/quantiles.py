"""Medians and quantiles by themselves: what libraries offer takes longer to load or to call than all the rest."""

from __future__ import annotations

import math

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
