"""What a window's matches are, whatever found them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from slopecli.geometry.statistics import CHI2_MEDIAN, median
from slopecli.types import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class WindowMatch:
    """Matches that speak for a window's plane.

    uv1, uv2 (n, 2) px; variance_px (n, 2): relative noise variance along and across the epipolar line, px^2;
    index (n, 2): row and column of the cells; origin "own" when they lie in the window, "borrowed" when they are of
    the plane around it; score: correlation of the images after matching; share of the window matched; reason and code:
    why it is borrowed or none; doubt_rad: 1-sigma of the tilt beyond what the residuals show; unseen_rad: what of
    it is owed to parts without matches, and against_rad to those of them that are not on its plane; left_out: share of
    the matches found that stand off the plane by far more than the rest, or across a step.
    """

    uv1: FloatArray
    uv2: FloatArray
    x1: FloatArray
    x2: FloatArray
    index: IntArray
    variance_px: FloatArray
    origin: Literal["own", "borrowed", "none"]
    score: float
    share: float
    reason: str = ""
    code: str = ""
    doubt_rad: float = 0.0
    unseen_rad: float = 0.0
    against_rad: float = 0.0
    left_out: float = 0.0


def no_match(reason: str, code: str = "low-texture") -> WindowMatch:
    """No matches at all, with the reason in words and as a diagnostic code."""
    empty = np.empty((0, 2))
    return WindowMatch(empty, empty, empty, empty, np.empty((0, 2), np.int64), empty, "none", 0.0, 0.0, reason, code)


def overdispersion(normalised_squares: FloatArray) -> float:
    """By how much a window's own residuals exceed the variance predicted from its texture: a robust ratio.

    Many cells may show that they are better than predicted; few cells agree by chance, so they are not believed.
    """
    least = np.interp(len(normalised_squares), [20, 60], [1.0, 0.25])
    return max(median(normalised_squares) / CHI2_MEDIAN, float(least))
