"""Wording of diagnostics: severity and remedy from the row of their code, and numbers in sentences."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from slopecli.findings.codes import CODES
from slopecli.types import Diagnostic


def finding(
    code: str,
    message: str,
    value: float | None = None,
    remedy: str | None = None,
    severity: Literal["warning", "info"] | None = None,
) -> Diagnostic:
    """Make a diagnostic; its severity and, unless a more specific one is given, its remedy are those of its row.

    Raises
    ------
    ValueError : no row has this code and severity, or two have the code and no severity was given.
    """
    wanted = ("warning", "info") if severity is None else (severity,)
    rows = [row for row in CODES if row.code == code and row.severity in wanted]
    if len(rows) != 1:
        raise ValueError(f"{len(rows)} rows of CODES have the code {code!r} and a severity of {wanted}")
    found: Literal["warning", "info"] = "warning" if rows[0].severity == "warning" else "info"
    return Diagnostic(code, found, message, value, remedy or rows[0].remedy or None)


def listed(parts: Sequence[str]) -> str:
    """The first five parts with commas between them, and how many more there are."""
    more = [f"and {len(parts) - 5} more"] if len(parts) > 5 else []
    return ", ".join([*parts[:5], *more])


def beside(value: float, limit: float) -> str:
    """A number with as few decimals as show on which side of a limit it is: "49.8" below 50, "24" above 10."""
    texts = (f"{value:.{digits}f}" for digits in range(9))
    return next(
        (text for text in texts if (float(text) > limit, float(text) < limit) == (value > limit, value < limit)),
        f"{value:g}",
    )


def figures(value: float) -> str:
    """A number with four digits, and two decimals at most below 1: "412", "1.3", "0"."""
    return f"{round(value, 2) + 0.0 if abs(value) < 1.0 else value:.4g}"
