"""A Report as a table or JSON on stdout, and what a reader should know besides it on stderr."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

from slopecli.cli.table import Table, print_table
from slopecli.cli.talk import Talk, print_result

if TYPE_CHECKING:
    from pathlib import Path

    from slopecli.types import AlternativePlane, Diagnostic, Plane, Rejected, Report

HEADER = ("id", "slope", "95 % interval", "aspect", "verdict", "P(safe)", "roughness", "points", "note")
# for planes found in the image: also what they are and how large
FOUND_HEADER = ("id", "what", "image", "slope", "95 % interval", "aspect", "verdict", "P(safe)", "points", "note")


def print_report(report: Report, written: list[Path], talk: Talk, *, as_json: bool) -> None:
    """Print the report on stdout, as a table or as JSON; notes and the files written on stderr."""
    if as_json:
        from slopecli.products.slopes_json import report_to_json

        print_result(report_to_json(report))
    else:
        print_table(result_table(report))
    for line in talk_lines(report):
        talk.say(line)
    if written:
        talk.say(f"wrote {', '.join(map(str, written))}")


def result_table(report: Report) -> Table:
    """A row for each window or plane in the order of ids, those without an answer included; angles in degrees."""
    return _found_table(report) if report.found else _window_table(report)


def _window_table(report: Report) -> Table:
    others = report.ambiguity.others
    rows = [(plane.id, _plane_cells(plane, report.scale.unit, others.get(plane.id))) for plane in report.planes]
    rows += [(window.id, _rejected_cells(window, len(HEADER))) for window in report.rejected]
    return Table(HEADER, [cells for _, cells in sorted(rows)])


def _found_table(report: Report) -> Table:
    from slopecli.report.kinds import plane_kinds, plane_shares

    kinds, shares, others = plane_kinds(report), plane_shares(report), report.ambiguity.others
    rows = [
        (plane.id, _found_cells(plane, kinds[plane.id] or "-", shares[plane.id], others.get(plane.id)))
        for plane in report.planes
    ]
    rows += [(region.id, _rejected_cells(region, len(FOUND_HEADER))) for region in report.rejected]
    return Table(FOUND_HEADER, [cells for _, cells in sorted(rows)])


def _plane_cells(plane: Plane, unit: str, other: AlternativePlane | None) -> tuple[str, ...]:
    return (
        str(plane.id),
        *_slope_cells(plane, other),
        plane.verdict,
        _number(plane.p_safe, 3),
        _number(plane.roughness, 4) + (" m" if unit == "m" and math.isfinite(plane.roughness) else ""),
        f"{plane.n_inliers}/{plane.n_correspondences}",
        ": ".join(part for part in (plane.status, plane.reason) if part and part != "ok"),
    )


def _slope_cells(plane: Plane, other: AlternativePlane | None) -> tuple[str, str, str]:
    """Slope (both slopes where two motions remain), interval and aspect; dashes for an unknown slope."""
    slope = _slope(plane) if other is None else f"{_slope(plane)} or {_slope(other)}"
    if not plane.slope_known:
        return slope, "-", "-"
    low, high = plane.slope_ci95_deg
    aspect = "-" if plane.aspect_deg is None else f"{_number(plane.aspect_deg, 0)}°"
    return slope, f"{_number(low, 2)} to {_number(high, 2)}°", aspect


def _slope(plane: Plane | AlternativePlane) -> str:
    if not plane.slope_known:
        return f"unknown (± {_two_figures(plane.slope_sigma_deg)}°)"
    return f"{_number(plane.slope_deg, 2)} ± {_sigma(plane.slope_sigma_deg)}°"


def _sigma(sigma_deg: float) -> str:
    """To 0.01 degrees; a smaller one is "<0.01", as "0.00" would read as certainty."""
    return "<0.01" if 0 < sigma_deg < 0.005 else _number(sigma_deg, 2)


def _two_figures(value: float) -> str:
    """Whole numbers, but two figures of what is below ten."""
    return f"{value:.2g}" if value < 10 else _number(value, 0)


def _found_cells(plane: Plane, kind: str, share: float, other: AlternativePlane | None) -> tuple[str, ...]:
    number, slope, interval, aspect, verdict, safe, _, points, note = _plane_cells(plane, "", other)
    return number, kind, f"{100 * share:.1f} %", slope, interval, aspect, verdict, safe, points, note


def _rejected_cells(rejected: Rejected, columns: int) -> tuple[str, ...]:
    return (str(rejected.id), *"-" * (columns - 2), f"no answer: {rejected.reason}")


def _number(value: float, decimals: int) -> str:
    return f"{value:.{decimals}f}" if math.isfinite(value) else "-"


def talk_lines(report: Report) -> Iterator[str]:
    """Lines for stderr: the vertical, the second root, windows without an answer, diagnostics."""
    yield _up_line(report)
    if report.ambiguity.status != "none":
        yield _ambiguity_line(report)
    for one in report.rejected:
        yield f"{report.noun} {one.id}: no answer: {one.reason}: {one.message}"
    yield from map(diagnostic_line, report.diagnostics)


def diagnostic_line(diagnostic: Diagnostic) -> str:
    """A diagnostic with its remedy as one line."""
    remedy = f"; {diagnostic.remedy}" if diagnostic.remedy else ""
    return f"{diagnostic.severity}: {diagnostic.code}: {diagnostic.message}{remedy}"


def _up_line(report: Report) -> str:
    x, y, z = report.up.vector_cam1
    meaning = {
        "camera": "camera 1 taken to look straight down; see --up",
        "given": "given",
        "dominant-plane": "the largest plane taken as level; if it is a wall, give --up X,Y,Z",
    }[report.up.source]
    sigma = f" ± {report.up.sigma_deg:g}°" if report.up.sigma_deg else ""
    return f"up: ({x:.4f}, {y:.4f}, {z:.4f}){sigma} in camera-1 axes ({meaning})"


def _ambiguity_line(report: Report) -> str:
    from slopecli.report.second_root import margin

    worse, remedy = margin(report.ambiguity, report.fit.n_inliers), report.ambiguity.resolve_with
    if report.ambiguity.status == "resolved":
        return f"info: a second motion is ruled out{worse}; slopes.json has it"
    two = f'two answers: a second motion, with the slopes after "or", fits as well{worse}'
    verdict = f"no {report.noun} is called safe unless it is in both, P(safe) is the smaller of the two; "
    verdict += "interval and aspect are the first answer's, slopes.json has the second's"
    return f"warning: {two}; {verdict}" + (f"; resolve it with {remedy}" if remedy else "")
