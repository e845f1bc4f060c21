"""Numbers in sentences."""

from __future__ import annotations


def beside(value: float, limit: float) -> str:
    """A number with as few decimals as show on which side of a limit it is: "49.8" below 50, "24" above 10."""
    texts = (f"{value:.{digits}f}" for digits in range(9))
    return next(
        (text for text in texts if (float(text) > limit, float(text) < limit) == (value > limit, value < limit)),
        f"{value:g}",
    )


def figures(value: float) -> str:
    """Four figures, and nothing of what does not show in two decimals: "412", "1.3", "0"."""
    return f"{round(value, 2) + 0.0 if abs(value) < 1.0 else value:.4g}"
