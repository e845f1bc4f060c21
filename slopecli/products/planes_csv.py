"""planes.csv: the planes of a report as a table, in the terms of surveyors, roofers and geologists."""

from __future__ import annotations

import csv
import io
from dataclasses import fields
from typing import TYPE_CHECKING

from slopecli.products import is_georeferenced
from slopecli.products.georeference import Georeference
from slopecli.products.plane_measures import PlaneMeasures, centre_of, measures_of
from slopecli.types import Image, Plane, Report

if TYPE_CHECKING:
    from slopecli.ground.slope_map import SlopeMap

_MEASURES = tuple(field.name for field in fields(PlaneMeasures))
COLUMNS = (
    "id",
    *_MEASURES,
    "area_unit",
    "verdict",
    "status",
    "longitude_deg",
    "latitude_deg",
    "position_sigma_m",
    "reason",
)


def encode(report: Report, image: Image) -> bytes:
    """Return the content of planes.csv of a report."""
    return report_to_csv(report).encode("ascii")


def encode_map(slope_map: SlopeMap, image: Image) -> bytes:
    """Return the content of planes.csv of a map: its windows."""
    return report_to_csv(slope_map.report).encode("ascii")


def report_to_csv(report: Report) -> str:
    """Serialise the planes of a report as a table with a header, a row a plane; an empty cell is not known."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    place = Georeference.of(report) if is_georeferenced(report) else None
    unit = "m2" if report.scale.unit == "m" else "baseline2"
    for plane in report.planes:
        measures = measures_of(plane, report)
        numbers = [_cell(getattr(measures, name)) for name in _MEASURES]
        judged = [plane.verdict or "", plane.status]
        reason = (plane.reason or "").replace("°", " deg")  # the table is ASCII, which every spreadsheet reads
        writer.writerow([plane.id, *numbers, unit, *judged, *_place(plane, report, place), reason])
    return text.getvalue()


def _cell(value: float | None) -> str:
    return "" if value is None else f"{value:.6g}"


def _place(plane: Plane, report: Report, place: Georeference | None) -> list[str]:
    """Longitude and latitude of a plane's middle, and the 1-sigma of that, m; empty where they are not known."""
    centre = None if place is None else centre_of(plane, report)
    if place is None or centre is None:
        return ["", "", ""]
    longitude, latitude = place.degrees(centre[None])[0]
    return [f"{longitude:.8f}", f"{latitude:.8f}", f"{float(place.sigma_m(centre[None])[0]):.3g}"]
