"""Wording of diagnostics: severity and remedy from the row of their code, numbers in sentences, and how far to move."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple

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

    The message of a code that forbids the verdict safe says so at its end.

    Raises
    ------
    ValueError : no row has this code and severity, or two have the code and no severity was given.
    """
    wanted = ("warning", "info") if severity is None else (severity,)
    rows = [row for row in CODES if row.code == code and row.severity in wanted]
    if len(rows) != 1:
        raise ValueError(f"{len(rows)} rows of CODES have the code {code!r} and a severity of {wanted}")
    found: Literal["warning", "info"] = "warning" if rows[0].severity == "warning" else "info"
    if rows[0].forbids_safe:
        message = f"{message}; no verdict is safe"
    return Diagnostic(code, found, message, value, remedy or rows[0].remedy or None)


def listed(parts: Sequence[str]) -> str:
    """The first five parts with commas between them, and how many more there are."""
    return ", ".join([*parts[:5], *([f"and {len(parts) - 5} more"] if len(parts) > 5 else [])])


def beside(value: float, limit: float) -> str:
    """A number with as few decimals as show on which side of a limit it is: "49.8" below 50, "24" above 10."""
    for text in (f"{value:.{digits}f}" for digits in range(9)):
        if (float(text) > limit, float(text) < limit) == (value > limit, value < limit):
            return text
    return f"{value:g}"


def figures(value: float) -> str:
    """A number with four digits, and two decimals at most below 1: "412", "1.3", "0"."""
    return f"{round(value, 2) + 0.0 if abs(value) < 1.0 else value:.4g}"


class Separation(NamedTuple):
    """How far apart the images were taken: `share` of the distance to the scene, and metres where they are known."""

    share: float
    length_m: float | None = None

    def sideways(self) -> str:
        """Remedy for a move straight ahead: as far to the side."""
        if self.length_m is not None:
            return f"move {self.length_m:.2g} m sideways as well"
        return f"move sideways as well, by {100 * self.share:.2g} % of the distance: {self._example(1.0)}"

    def farther(self, factor: float) -> str:
        """Remedy for so many times the parallax."""
        if self.length_m is not None:
            return f"move {factor * self.length_m:.2g} m between the images instead of {self.length_m:.2g} m"
        by = f"{100 * factor * self.share:.2g} % of the distance to the scene (now {100 * self.share:.2g} %)"
        return f"move by {by} between the images: {self._example(factor)}"

    def _example(self, factor: float) -> str:
        return f"{20 * factor * self.share:.2g} m at 20 m height"


def forbid_safe(diagnostics: Sequence[Diagnostic]) -> bool:
    """Whether one of the diagnostics forbids the verdict safe, as the row of its code says."""
    return bool(forbidding(diagnostics))


def forbidding(diagnostics: Sequence[Diagnostic]) -> list[str]:
    """Codes of the diagnostics that forbid the verdict safe."""
    codes = {(row.code, row.severity) for row in CODES if row.forbids_safe}
    return [one.code for one in diagnostics if (one.code, one.severity) in codes]
