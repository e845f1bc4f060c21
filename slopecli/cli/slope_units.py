"""Units that tables have slopes in: degrees, or the rise over a run of 100 or of 12."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class SlopeUnit:
    """A unit of slopes.

    suffix : what stands behind a number.  run : that the rise is over; 0 for degrees.
    steepest_deg : slopes from there on, such as walls, are in degrees in any unit, as their rise has no meaning.
    """

    suffix: str
    run: float = 0.0
    steepest_deg: float = 80.0

    def text(self, slope_deg: float, sigma_deg: float | None = None) -> str:
        """A slope, with its 1-sigma if it has one: "14.94 ± 2.09°", "26.7 ± 3.9 %", "3.20 ± 0.47 in 12"."""
        if not self.run or not slope_deg < self.steepest_deg:
            return f"{number_text(slope_deg, 2)}{'' if sigma_deg is None else f' ± {_sigma(sigma_deg, 2)}'}°"
        decimals = 1 if self.run > 50 else 2
        if sigma_deg is None:
            return f"{number_text(self._rise(slope_deg), decimals)}{self.suffix}"
        per_deg = self.run * math.radians(1.0) / math.cos(math.radians(slope_deg)) ** 2
        return f"{number_text(self._rise(slope_deg), decimals)} ± {_sigma(per_deg * sigma_deg, decimals)}{self.suffix}"

    def interval(self, low_deg: float, high_deg: float) -> str:
        """Two ends of an interval, in degrees where one of them is too steep."""
        if not self.run or not max(low_deg, high_deg) < self.steepest_deg:
            return f"{number_text(low_deg, 2)} to {number_text(high_deg, 2)}°"
        decimals = 1 if self.run > 50 else 2
        low, high = (number_text(self._rise(end), decimals) for end in (low_deg, high_deg))
        return f"{low} to {high}{self.suffix}"

    def _rise(self, slope_deg: float) -> float:
        return self.run * math.tan(math.radians(slope_deg))


SLOPE_UNITS = {"deg": SlopeUnit("°"), "percent": SlopeUnit(" %", 100.0), "x-in-12": SlopeUnit(" in 12", 12.0)}


def number_text(value: float, decimals: int) -> str:
    """A number with so many decimals, a dash for what is not finite."""
    return f"{value:.{decimals}f}" if math.isfinite(value) else "-"


def _sigma(sigma: float, decimals: int) -> str:
    """A sigma that is not rounded to zero, which would read as certainty."""
    least = 10.0**-decimals
    return f"<{least:.{decimals}f}" if 0 < sigma < least / 2 else number_text(sigma, decimals)
