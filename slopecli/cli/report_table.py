"""A Report as a table or JSON on stdout, and what a reader should know besides it on stderr."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

from slopecli.cli.table import Table, print_table
from slopecli.cli.talk import Talk, check_stdout, print_result
from slopecli.report.slope_units import SlopeUnit, number_text, slope_unit_of

if TYPE_CHECKING:
    from pathlib import Path

    from slopecli.types import AlternativePlane, Diagnostic, Plane, Report

HEADER = ("id", "slope", "95 % interval", "aspect", "verdict", "P(safe)", "roughness", "points", "note")
VERDICTS = ("safe", "unsafe", "undecided")
CLASSES_HEADER = ("slope", "windows", "median sigma", *VERDICTS)
# for planes found in the image: also what they are and how large
FOUND_HEADER = ("id", "what", "image", "slope", "95 % interval", "aspect", "verdict", "P(safe)", "points", "note")


def print_report(report: Report, written: list[Path], talk: Talk, *, as_json: bool, every: bool = True) -> None:
    """Print the report on stdout, as a table or as JSON; notes and the files written on stderr.

    every : whether the table has all planes that were found, not just those that matter.
    """
    if not written:
        check_stdout()
    if as_json:
        from slopecli.products.slopes_json import report_to_json

        print_result(report_to_json(report))
    else:
        from slopecli.report.kinds import many_windows

        print_table(classes_table(report) if many_windows(report) else result_table(report, every=every), talk)
    say_notes(report, written, talk, every=every)


def say_notes(report: Report, written: list[Path], talk: Talk, *, every: bool = True) -> None:
    """Say on stderr what to know of an answer besides its table, and which files were written."""
    for line in talk_lines(report, every=every):
        talk.say(line)
    if talk.verbose:
        for line in report.segmentation.account if report.segmentation else ():
            talk.say(f"regions: {line}")
        talk.say(focal_line(report))
    if written:
        talk.say(f"wrote {', '.join(map(str, written))}")


def result_table(report: Report, *, every: bool = True) -> Table:
    """A row for each window or plane in the order of ids, those without an answer included.

    every : if not, planes that were found have a row only where they matter.
    """
    unit = slope_unit_of(report.options)
    rows = {plane.id: _plane_cells(plane, report, unit) for plane in report.planes}
    if report.found:
        from slopecli.report.kinds import plane_kinds, plane_shares

        kinds, shares = plane_kinds(report), plane_shares(report)
        for number, cells in rows.items():
            cells |= {"what": kinds[number] or "-", "image": f"{100 * shares[number]:.1f} %"}
    rows |= {one.id: {"id": str(one.id), "note": f"no answer: {one.reason}"} for one in report.rejected}
    header, shown = FOUND_HEADER if report.found else HEADER, sorted(rows)
    if report.found and not every:
        from slopecli.report.kinds import main_planes

        shown = sorted(main_planes(report))
    return Table(header, [tuple(rows[number].get(title, "-") for title in header) for number in shown])


def classes_table(report: Report) -> Table:
    """A row for each class of slope of overlay.png, with how many of many windows are in it, their sigma and their
    verdicts."""
    from slopecli.products.drawing.classes import classes_of

    classes = classes_of(report)
    told = [plane for plane in report.planes if plane.slope_known and plane.status == "ok"]
    class_of = dict(zip(told, classes.of([plane.slope_deg for plane in told]), strict=True))
    rows = []
    for k, name in enumerate(classes.names):
        here = [plane for plane in told if class_of[plane] == k]
        sigmas = sorted(plane.slope_sigma_deg for plane in here if plane.slope_sigma_deg is not None)
        median_deg = f"± {sigmas[len(sigmas) // 2]:.2g}°" if sigmas else "-"
        counts = (sum(plane.verdict == verdict for plane in here) for verdict in VERDICTS)
        rows.append((name, str(len(here)), median_deg, *map(str, counts)))
    rest = len(report.planes) + len(report.rejected) - len(told)
    return Table(CLASSES_HEADER, [*rows, ("not known, or poor", str(rest), "-", *("-",) * len(VERDICTS))])


def _plane_cells(plane: Plane, report: Report, unit: SlopeUnit) -> dict[str, str]:
    """Cells by the title of their column; both slopes where two motions remain, dashes for an unknown slope."""
    other = report.ambiguity.others.get(plane.id)
    low, high = plane.slope_ci95_deg or (math.nan, math.nan)
    known = {
        "95 % interval": "-" if plane.taken_as_level else unit.interval(low, high),
        "aspect": "-" if plane.aspect_deg is None else f"{number_text(plane.aspect_deg, 0)}°",
    }
    is_level = plane.taken_as_level
    in_metres = report.scale.unit == "m" and math.isfinite(plane.roughness)
    return {
        "id": str(plane.id),
        "slope": " or ".join(_slope(one, unit) for one in (plane, other) if one is plane or (one and not is_level)),
        **(known if plane.slope_known else {}),
        "verdict": plane.verdict or "-",
        "P(safe)": "-" if plane.p_safe is None else number_text(plane.p_safe, 3),
        "roughness": number_text(plane.roughness, 4) + (" m" if in_metres else ""),
        "points": f"{plane.n_inliers}/{plane.n_correspondences}",
        "note": _note(plane),
    }


def _note(plane: Plane) -> str:
    """Status and reason of a plane that is poor; of the plane taken as level that, before its other reasons."""
    if not plane.taken_as_level:
        return ": ".join(part for part in (plane.status, plane.reason) if part and part != "ok")
    _, _, others = (plane.reason or "").partition("; ")
    return f"taken as level; {plane.status}: {others}" if others else "taken as level"


def _slope(plane: Plane | AlternativePlane, unit: SlopeUnit) -> str:
    sigma_deg = plane.slope_sigma_deg
    if sigma_deg is not None and not plane.slope_known:  # whole degrees, but two figures of what is below ten
        return f"unknown (± {f'{sigma_deg:.2g}' if sigma_deg < 10 else number_text(sigma_deg, 0)}°)"
    return unit.text(plane.slope_deg, sigma_deg)


def talk_lines(report: Report, *, every: bool = True) -> Iterator[str]:
    """Lines for stderr: planes that the table leaves out, the vertical, the second root, windows without an answer,
    diagnostics."""
    brief = report.found and not every
    if brief and (line := _left_out_line(report)):
        yield line
    yield _up_line(report)
    if report.ambiguity.status != "none":
        yield _ambiguity_line(report)
    for one in () if brief else report.rejected:
        yield f"{report.noun} {one.id}: no answer: {one.reason}: {one.message}"
    yield from map(diagnostic_line, report.diagnostics)


def _left_out_line(report: Report) -> str:
    from slopecli.report.kinds import main_planes

    small, refused = len(report.planes) - len(main_planes(report)), len(report.rejected)
    counts = [f"{small} small or poor ones" * (small > 0), f"{refused} without an answer" * (refused > 0)]
    return f"not shown: {', '.join(filter(None, counts))} (--all shows them)" if small or refused else ""


def focal_line(report: Report) -> str:
    """What the images say of the focal length, for -v."""
    factor, sigma = report.fit.focal_factor, report.fit.focal_factor_sigma
    if factor is None or sigma is None:
        why = "one plane, level views with hardly any rotation, a narrow field of view, or too few points"
        return f"focal length: the images do not tell it ({why})"
    return f"focal length: the images prefer {factor:.4f} ± {sigma:.2g} times the one given"


def diagnostic_line(diagnostic: Diagnostic) -> str:
    """A diagnostic with its remedy as one line."""
    remedy = f"; {diagnostic.remedy}" if diagnostic.remedy else ""
    return f"{diagnostic.severity}: {diagnostic.code}: {diagnostic.message}{remedy}"


def _up_line(report: Report) -> str:
    x, y, z = (round(value, 4) + 0.0 for value in report.up.vector_cam1)  # no negative zero
    meaning = {
        "camera": "camera 1 taken to look straight down; see --up",
        "given": "given",
        "exif": "by the metadata of the image",
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


def say_place(report: Report, talk: Talk) -> None:
    """Say what is missing where the position of camera 1 is known and there are no files of a GIS all the same."""
    if report.place is None or report.place.position is None:
        return
    missing = [
        *(["the direction of north (--yaw, --north)"] if report.place.north_cam1 is None else []),
        *(["metres (--baseline, --altitude)"] if report.scale.unit != "m" else []),
    ]
    if missing:
        talk.say(f"info: no slopes.geojson and no map of a GIS: {' and '.join(missing)} not known")
