"""report.html: everything about an answer on one page that opens from a disk, without a network.

Pictures are in the page as data addresses. The viewer of the model is in it compressed, and unpacked by the browser
when the model comes into view. A content policy forbids the page to load anything from anywhere.
"""

from __future__ import annotations

import base64
import gzip
import html
import math
import re
from collections.abc import Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

from slopecli import __version__
from slopecli.errors import visible
from slopecli.ground.slope_map import SlopeMap
from slopecli.products.origin import Origin
from slopecli.products.page import page_texts
from slopecli.products.page.page_texts import Why, slope_text
from slopecli.products.page.page_tunables import PAGE
from slopecli.products.slopes_json import rounded
from slopecli.report.camera_summary import LENSES, camera_facts
from slopecli.report.kinds import plane_kinds, plane_shares
from slopecli.report.slope_units import SlopeUnit, slope_unit_of
from slopecli.types import AlternativePlane, Camera, Diagnostic, Image, Plane, Report

if TYPE_CHECKING:
    from jinja2 import Environment

JOINED = " x "
OPTION = re.compile(r"(--[a-z][a-z0-9-]*)")


class Row(NamedTuple):
    """A row of the table of planes: cells (text, number to sort by, kind)."""

    cells: list[tuple[str, str, str]]


def encode(report: Report, image: Image, origin: Origin | None = None) -> bytes:
    """Return the content of report.html of planes; image 1 may be without pixels, as of rows of a user's own."""
    from slopecli.products.page import model_viewer, page_pictures

    origin, facts = origin or Origin(), dict[str, Any]()
    if image.grey.size and report.labels.size:
        facts["sheets"] = page_pictures.class_pictures(report, image)
        if origin.image2 is not None:
            facts["pair"] = page_pictures.seen_from_1(report, image, origin.image2)
        facts["viewer"] = _packed(model_viewer.viewer_of_report(report, image))
    whys = page_texts.whys_of(report, PAGE.most_whys)
    return _rendered(report, origin, verdicts=page_texts.verdict_of(report), whys=whys, **facts)


def encode_map(slope_map: SlopeMap, image: Image, origin: Origin | None = None) -> bytes:
    """Return the content of report.html of a map."""
    from slopecli.products.page import model_viewer, page_pictures

    origin, report, facts = origin or Origin(), slope_map.report, dict[str, Any]()
    whys = page_texts.whys_of(report, PAGE.most_whys)
    if slope_map.sigma_causes_deg and slope_map.median_sigma_deg:
        whys.insert(0, page_texts.why("map, median", slope_map.median_sigma_deg, slope_map.sigma_causes_deg))
    if origin.image2 is not None:
        facts["pair"] = page_pictures.map_seen_from_1(slope_map, image, origin.image2)
    facts["viewer"] = _packed(model_viewer.viewer_of_map(slope_map, image))
    facts["sheets"] = page_pictures.map_class_pictures(slope_map, image)
    facts["sites"] = [_site_row(slope_map, k) for k in range(len(slope_map.sites))]
    return _rendered(report, origin, verdicts=page_texts.verdict_of_map(slope_map), whys=whys, **facts)


def _packed(viewer: str) -> str:
    """A page of HTML, compressed, in base64; no date in it."""
    if not viewer:
        return ""
    before, end, after = viewer.rpartition("</body>")
    whole = f"{before}<script>{_templates().get_template('viewer.js').render()}</script>{end}{after}"
    return base64.b64encode(gzip.compress(whole.encode("utf-8"), 9, mtime=0)).decode("ascii")


def _rendered(report: Report, origin: Origin, *, whys: Sequence[Why], **facts: Any) -> bytes:
    unit = "m" if report.scale.unit == "m" else "baselines"
    page = (
        _templates()
        .get_template("page.html")
        .render(
            version=__version__,
            origin=origin,
            report=report,
            unit=unit,
            up=", ".join(f"{round(value, 4) + 0.0:.4f}" for value in report.up.vector_cam1),
            tolerance=slope_unit_of(report.options).limit(float(report.options["tolerance_deg"])),
            images=[image for image in report.images if image.path],
            header=_header(report),
            rows=_rows(report),
            left_out=max(len(report.planes) - PAGE.most_rows, 0),
            whys=whys,
            meanings=page_texts.MEANING,
            causes={name: n for n, name in enumerate(page_texts.CAUSES)},
            cameras=[_camera_facts(camera) for camera in dict.fromkeys(report.cameras)],
            focal=_focal(report),
            notes=list(dict.fromkeys((*origin.notes, *(camera.note for camera in report.cameras if camera.note)))),
            diagnostics=[_said(one) for one in report.diagnostics],
            options=[(name, _option(value)) for name, value in report.options.items() if value is not None],
            limits=page_texts.LIMITS,
            **facts,
        )
    )
    return (page.rstrip("\n") + "\n").encode("utf-8", "backslashreplace")


@lru_cache(maxsize=1)
def _templates() -> Environment:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    loader = PackageLoader("slopecli", "products/page")
    found = Environment(loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    found.filters["visible"] = lambda text: visible(str(text))
    found.filters["said"] = _said_in_html
    return found


class _Html(str):
    """Text that is HTML already, and is not escaped again."""

    def __html__(self) -> str:
        return self


def _said_in_html(text: object) -> _Html:
    """A sentence, escaped; names of options in it are not broken at their hyphens."""
    return _Html(OPTION.sub(r'<span class="option">\1</span>', html.escape(visible(str(text)))))


# ---- tables ----


def _header(report: Report) -> list[tuple[str, str, str]]:
    """Titles of the table of planes, what it is sorted by ("number" or "text"), and an explanation."""
    what = [("what", "text", "ground, wall or roof"), ("image", "number", "share of image 1")] if report.found else []
    two = [("or slope", "number", "slope in the second answer, with 1 sigma")] if report.ambiguity.others else []
    return [
        ("id", "number", f"number of the {report.noun}"),
        *what,
        ("slope", "number", "angle to level, with 1 sigma"),
        *two,
        ("sigma", "number", "1 sigma of the slope"),
        ("95 %", "number", "interval that holds the slope with 95 % confidence"),
        ("aspect", "number", "direction downhill, clockwise from north or the image's up"),
        ("verdict", "text", "against the tolerance"),
        ("P(safe)", "number", "probability that the slope is below the tolerance"),
        ("roughness", "number", "RMS height off the plane, over its distance, or in m"),
        ("points", "number", "matches kept, and found"),
        ("note", "text", "what to know"),
    ]


def _rows(report: Report) -> list[Row]:
    """Rows of the table of planes; of planes found also what they are, and how much of image 1 they hold."""
    kinds, shares = (plane_kinds(report), plane_shares(report)) if report.found else ({}, {})
    rows = []
    for plane in report.planes[: PAGE.most_rows]:
        number, *others = _row(plane, report).cells
        what: list[tuple[str, str, str]] = []
        if report.found:
            kind = str(kinds[plane.id] or "-")
            what = [(kind, kind, ""), _number(100 * shares[plane.id], 1, " %")]
        rows.append(Row([number, *what, *others]))
    return rows


def _row(plane: Plane, report: Report) -> Row:
    other = report.ambiguity.others.get(plane.id)
    low, high = plane.slope_ci95_deg or (math.nan, math.nan)
    unit = slope_unit_of(report.options)
    interval = unit.interval(low, high) if math.isfinite(low) and plane.slope_known else "-"
    poor = "poor: " if plane.status == "poor" and plane.reason else ""
    note = "taken as level" if plane.taken_as_level else f"{poor}{plane.reason or ''}"
    seconds = [_slope_cell(other, unit)] if other is not None else [("-", "", "number")] * bool(report.ambiguity.others)
    cells = [
        (str(plane.id), str(plane.id), "number"),
        _slope_cell(plane, unit),
        *seconds,
        _number(plane.slope_sigma_deg, 2, "°"),
        (interval, _key(low if plane.slope_known else math.nan), "number"),
        _number(plane.aspect_deg, 0, "°"),
        (plane.verdict or "level", plane.verdict or "level", f"verdict {plane.verdict or 'level'}"),
        _number(plane.p_safe, 3),
        _number(plane.roughness, 4),
        (f"{plane.n_inliers}/{plane.n_correspondences}", str(plane.n_inliers), "number"),
        (note, note, "note"),
    ]
    return Row(cells)


def _slope_cell(plane: Plane | AlternativePlane, unit: SlopeUnit) -> tuple[str, str, str]:
    if not plane.slope_known:
        return "not known", "", "number"
    return slope_text(plane.slope_deg, plane.slope_sigma_deg, unit), _key(plane.slope_deg), "number"


def _number(value: float | None, decimals: int, unit: str = "") -> tuple[str, str, str]:
    known = value is not None and math.isfinite(value)
    return (f"{value:.{decimals}f}{unit}" if known else "-"), _key(value), "number"


def _key(value: float | None) -> str:
    """What a column of numbers is sorted by, "" where it is not known."""
    return "" if value is None or not math.isfinite(value) else f"{value:.9g}"


def _site_row(slope_map: SlopeMap, k: int) -> list[str]:
    site, in_m = slope_map.sites[k], slope_map.report.scale.unit == "m"
    return [
        str(site.id),
        f"{site.centre_px[0]:.1f}, {site.centre_px[1]:.1f}",
        f"{site.radius_px:.0f} px" + (f" = {site.radius:.3g} m" if in_m else ""),
        slope_text(site.slope_deg, site.slope_sigma_deg, slope_unit_of(slope_map.report.options)),
        f"{site.p_safe:.3f}",
        site.verdict,
    ]


# ---- what else is said ----


def _camera_facts(camera: Camera) -> dict[str, str]:
    """What was read of a camera, by name."""
    across = camera_facts(camera).horizontal_deg if camera.width else None
    lens = ", ".join(f"{value:.6g}" for value in camera.distortion) or "none"
    return {
        "source": camera.source,
        "size": f"{camera.width}{JOINED}{camera.height} px" if camera.width else "not given",
        "focal length": f"{camera.fx:.2f}, {camera.fy:.2f} px",
        "principal point": f"{camera.cx:.2f}, {camera.cy:.2f} px",
        "lens": LENSES[camera.model],
        "distortion": lens,
        "field of view": "-" if across is None else f"{across:.1f}° across",
    }


def _focal(report: Report) -> str:
    factor, sigma = report.fit.focal_factor, report.fit.focal_factor_sigma
    if factor is None or sigma is None:
        return "The images do not tell the focal length."
    return f"The images prefer {factor:.4f} ± {sigma:.2g} times the focal length given."


def _said(one: Diagnostic) -> dict[str, str]:
    """A diagnostic in words."""
    meaning = page_texts.meaning_of(one.code, one.severity)
    texts = {"message": one.message, "meaning": meaning, "remedy": one.remedy or ""}
    return {"code": one.code, "severity": one.severity, **texts}


def _option(value: Any) -> str:
    """The value of an option as text, the same on every machine."""
    if isinstance(value, dict):
        return ", ".join(f"{name} {_option(item)}" for name, item in value.items())
    if isinstance(value, list | tuple):
        return ", ".join(map(_option, value)) or "none"
    return f"{rounded(value)}" if isinstance(value, float) else str(value)
