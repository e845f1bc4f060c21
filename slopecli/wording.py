"""Numbers in sentences."""

from __future__ import annotations


def beside(value: float, limit: float) -> str:
    """A number with as few decimals as show on which side of a limit it is: "49.8" below 50, "24" above 10."""
    texts = (f"{value:.{digits}f}" for digits in range(9))
    return next(
        (text for text in texts if (float(text) > limit, float(text) < limit) == (value > limit, value < limit)),
        f"{value:g}",
    )
