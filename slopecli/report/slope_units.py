"""Units that slopes are told in: degrees, or the rise over a run of 100 or of 12."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple


class SlopeUnit(NamedTuple):
    """A unit of slopes.

    suffix : what stands behind a number.  run : that the rise is over; 0 for degrees.
    """

    suffix: str
    run: float = 0.0

    def text(self, slope_deg: float, sigma_deg: float | None = None) -> str:
        """A slope, with its 1-sigma if it has one: "14.94 ± 2.09°", "26.7 ± 3.9 %", "3.20 ± 0.47 in 12"."""
        if not self.has(slope_deg):
            return f"{number_text(slope_deg, 2)}{'' if sigma_deg is None else f' ± {sigma_text(sigma_deg, 2)}'}°"
        slope = number_text(self._rise(slope_deg), self._decimals)
        if sigma_deg is None:
            return f"{slope}{self.suffix}"
        return f"{slope} ± {sigma_text(self._per_deg(slope_deg) * sigma_deg, self._decimals)}{self.suffix}"

    def short(self, slope_deg: float, sigma_deg: float) -> str:
        """A slope with its 1-sigma for a legend: degrees have one decimal."""
        if self.has(slope_deg):
            return self.text(slope_deg, sigma_deg)
        return f"{slope_deg:.1f} ± {sigma_deg:.1f}°"

    def whole(self, slope_deg: float) -> str:
        """A slope for a label without room: "15°", "27 %", "3.2 in 12"."""
        if not self.has(slope_deg):
            return f"{slope_deg:.0f}°"
        return f"{number_text(self._rise(slope_deg), self._decimals - 1)}{self.suffix}"

    def parts(self, slope_deg: float, sigma_deg: float) -> tuple[str, str]:
        """A slope that the unit `has`, and its 1-sigma, as two short texts: "26.7 %" and "± 3.9"."""
        sigma = sigma_text(self._per_deg(slope_deg) * sigma_deg, self._decimals)
        return self.text(slope_deg), f"± {sigma}"

    def interval(self, low_deg: float, high_deg: float) -> str:
        """Two ends of an interval, in degrees where one of them is too steep."""
        if not self.has(max(low_deg, high_deg)):
            return f"{number_text(low_deg, 2)} to {number_text(high_deg, 2)}°"
        low, high = (number_text(self._rise(end), self._decimals) for end in (low_deg, high_deg))
        return f"{low} to {high}{self.suffix}"

    def limit(self, slope_deg: float) -> str:
        """A slope that a user chose, such as a tolerance: "15°", "26.8 %"."""
        return self.text(slope_deg) if self.has(slope_deg) else f"{slope_deg:g}°"

    def classes(self, edges_deg: Sequence[float]) -> list[str]:
        """Names of classes of slopes between ascending edges, the last without an end: "0-5°", ..., "over 30°"."""
        between = zip((0.0, *edges_deg), edges_deg, strict=False)
        return [*(self._class(low, high) for low, high in between), f"over {self.limit(edges_deg[-1])}"]

    def has(self, slope_deg: float) -> bool:
        """Whether a slope is told as a rise, not in degrees: below 80 degrees, as a wall's rise has no meaning."""
        return bool(self.run) and slope_deg < 80.0

    def angle_deg(self, rise: float) -> float:
        """The slope of a rise over the run; of a unit without a run, the same number."""
        return math.degrees(math.atan2(rise, self.run)) if self.run else rise

    def _class(self, low_deg: float, high_deg: float) -> str:
        if not self.has(high_deg):
            return f"{low_deg:g}-{high_deg:g}°"
        low, high = (number_text(self._rise(end), self._decimals) for end in (low_deg, high_deg))
        return f"{low}-{high}{self.suffix}"

    @property
    def _decimals(self) -> int:
        return 1 if self.run > 50 else 2

    def _rise(self, slope_deg: float) -> float:
        return self.run * math.tan(math.radians(slope_deg))

    def _per_deg(self, slope_deg: float) -> float:
        return self.run * math.radians(1.0) / math.cos(math.radians(slope_deg)) ** 2


SLOPE_UNITS = {"deg": SlopeUnit("°"), "percent": SlopeUnit(" %", 100.0), "x-in-12": SlopeUnit(" in 12", 12.0)}


def slope_unit_of(options: Mapping[str, Any]) -> SlopeUnit:
    """The unit that a report's options name; degrees where they name none."""
    return SLOPE_UNITS[options.get("slope_unit") or "deg"]


def number_text(value: float, decimals: int) -> str:
    """A number with so many decimals, a dash for what is not finite."""
    return f"{value:.{decimals}f}" if math.isfinite(value) else "-"


def sigma_text(sigma: float, decimals: int) -> str:
    """A 1-sigma with so many decimals; one that is not zero is never shown as zero: "<0.01"."""
    least = 0.5 * 10.0**-decimals
    return f"<{10.0**-decimals:.{decimals}f}" if 0 < sigma < least else number_text(sigma, decimals)
