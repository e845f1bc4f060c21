"""A Report as the table on stdout and the talk on stderr."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from slopecli.types import Plane, Rejected, Report

HEADER = ("id", "slope", "95 % interval", "aspect", "verdict", "P(safe)", "roughness", "points", "note")
# of planes found in the image, of which it is asked what they are and how large
FOUND_HEADER = ("id", "what", "image", "slope", "95 % interval", "aspect", "verdict", "P(safe)", "points", "note")
LEFT_ALIGNED = ("what", "verdict", "note", "pair", "result", "image 1", "image 2", "camera")
VERDICT_COLOURS = {"safe": "green", "unsafe": "red", "undecided": "yellow"}
VERDICT_COLOURS |= {"answered": "green", "failed": "red", "no answer": "yellow"}


def result_table(report: Report) -> str:
    """One line per window or plane in the order of ids, those without an answer included; angles in degrees."""
    return "\n".join(_found_table(report) if report.found else _window_table(report))


def _window_table(report: Report) -> Iterator[str]:
    others = report.ambiguity.other_slopes_deg
    rows = [(plane.id, _plane_cells(plane, report.scale.unit, others.get(plane.id))) for plane in report.planes]
    rows += [(window.id, _rejected_cells(window, len(HEADER))) for window in report.rejected]
    return aligned(HEADER, [cells for _, cells in sorted(rows)])


def _found_table(report: Report) -> Iterator[str]:
    from slopecli.kinds import plane_kinds, plane_shares

    kinds, shares, others = plane_kinds(report), plane_shares(report), report.ambiguity.other_slopes_deg
    rows = [
        (plane.id, _found_cells(plane, kinds[plane.id] or "-", shares[plane.id], others.get(plane.id)))
        for plane in report.planes
    ]
    rows += [(region.id, _rejected_cells(region, len(FOUND_HEADER))) for region in report.rejected]
    return aligned(FOUND_HEADER, [cells for _, cells in sorted(rows)])


def _plane_cells(plane: Plane, unit: str, other_slope_deg: float | None) -> tuple[str, ...]:
    return (
        str(plane.id),
        *_slope_cells(plane),
        plane.verdict,
        _number(plane.p_safe, 3),
        _number(plane.roughness, 4) + (" m" if unit == "m" else ""),
        f"{plane.n_inliers}/{plane.n_correspondences}",
        _note(plane, other_slope_deg),
    )


def _slope_cells(plane: Plane) -> tuple[str, str, str]:
    """Slope, interval and aspect; of a slope that is not known only how little is known of it."""
    if not plane.slope_known:
        return f"unknown (± {_number(plane.slope_sigma_deg, 0)}°)", "-", "-"
    low, high = plane.slope_ci95_deg
    aspect = "-" if plane.aspect_deg is None else f"{_number(plane.aspect_deg, 0)}°"
    slope = f"{_number(plane.slope_deg, 2)} ± {_number(plane.slope_sigma_deg, 2)}°"
    return slope, f"{_number(low, 2)} to {_number(high, 2)}°", aspect


def _found_cells(plane: Plane, kind: str, share: float, other_slope_deg: float | None) -> tuple[str, ...]:
    number, slope, interval, aspect, verdict, safe, _, points, note = _plane_cells(plane, "", other_slope_deg)
    return number, kind, f"{100 * share:.1f} %", slope, interval, aspect, verdict, safe, points, note


def _note(plane: Plane, other_slope_deg: float | None) -> str:
    other = "" if other_slope_deg is None else f"or {_number(other_slope_deg, 1)}°"
    status = ": ".join(part for part in (plane.status, plane.reason) if part and part != "ok")
    return "; ".join(filter(None, (other, status)))


def _rejected_cells(rejected: Rejected, columns: int) -> tuple[str, ...]:
    return (str(rejected.id), *"-" * (columns - 2), f"no answer: {rejected.reason}")


def _number(value: float, decimals: int) -> str:
    return f"{value:.{decimals}f}" if math.isfinite(value) else "-"


def aligned(header: tuple[str, ...], rows: list[tuple[str, ...]]) -> Iterator[str]:
    """Lines of a table: numbers to the right, words to the left, verdicts in colour."""
    widths = [max(map(len, column)) for column in zip(header, *rows, strict=True)]
    for row in (header, *rows):
        cells = [_padded(*cell) for cell in zip(header, row, widths, strict=True)]
        yield "  ".join(cells).rstrip()


def _padded(column: str, cell: str, width: int) -> str:
    padded = cell.ljust(width) if column in LEFT_ALIGNED else cell.rjust(width)
    # the escape codes have no width, so they come after padding
    coloured = cell in VERDICT_COLOURS and cell != column  # a title is no verdict
    return click.style(padded, fg=VERDICT_COLOURS[cell]) if coloured else padded


def talk_lines(report: Report) -> Iterator[str]:
    """What a reader of the table should know besides: the reference of the slopes, ambiguity, refusals, diagnostics."""
    yield _up_line(report)
    if report.ambiguity.status == "unresolved":
        yield _ambiguity_line(report)
    for one in report.rejected:
        yield f"{report.noun} {one.id}: no answer: {one.reason}: {one.message}"
    for diagnostic in report.diagnostics:
        remedy = f"; {diagnostic.remedy}" if diagnostic.remedy else ""
        yield f"{diagnostic.severity}: {diagnostic.code}: {diagnostic.message}{remedy}"


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
    remedy = report.ambiguity.resolve_with
    doubt = f"a second motion fits as well, with other slopes; no {report.noun} is called safe unless it is in both"
    return f"warning: {doubt}" + (f"; resolve it with {remedy}" if remedy else "")
