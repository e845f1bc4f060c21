"""Legends and warnings of the maps of slope and of its 1-sigma: sites, classes with their share, marks, scale."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from slopecli.ground.slope_map import Site, SlopeMap
from slopecli.products.drawing import marks
from slopecli.products.drawing.canvas import Frame
from slopecli.products.drawing.cell_shares import cell_area_m2, number_text, share_text
from slopecli.products.drawing.classes import STEP, STEP_COLOUR, UNKNOWN, Classes
from slopecli.products.drawing.ground_marks import (
    bar_length_m,
    edge_sign,
    north_px,
    scale_bar,
    site_circle,
)
from slopecli.products.drawing.legend import UP_WORDS, Sign, Strip, banner, level_banners
from slopecli.products.drawing.lettering import Text, text_width, wrapped, write
from slopecli.products.drawing.marks import COLOURS, LAYOUT, Colour, Picture
from slopecli.products.drawing.patterns import (
    Pattern,
    lay_nothing,
    lay_rough,
    lay_step,
    lay_undecided,
    lay_unknown,
)
from slopecli.report.second_root import margin
from slopecli.report.slope_units import slope_unit_of
from slopecli.types import BoolArray

Cells = NDArray[np.int16]  # (rows, columns) the class of every cell, `STEP` or `UNKNOWN`
Entry = tuple[str, Sign]


def draw_warnings(slope_map: SlopeMap, frame: Frame) -> list[Picture]:
    """Draw what to know before reading a map, (h, w, 3) uint8 RGB strips: level assumed, two answers, no site."""
    report, width, text_px = slope_map.report, frame.width, frame.text_px
    strips = level_banners(report, width, text_px)
    if report.ambiguity.status == "unresolved":
        worse, remedy = margin(report.ambiguity, report.fit.n_inliers), report.ambiguity.resolve_with
        advice = "" if remedy is None else f" Resolve it with {remedy}."
        sentence = f"Two answers: a second motion fits these images as well{worse}. Slopes are those of the first;"
        strips.append(banner(f"{sentence} only what is safe in both is called safe.{advice}", width, text_px))
    if not slope_map.sites and slope_map.no_site:
        strips.append(banner(f"No landing site: {slope_map.no_site}", width, text_px))
    return strips


def undecided_cells(slope_map: SlopeMap, cells: Cells) -> BoolArray:
    """Return (rows, columns) which cells of known slope are neither safe nor unsafe with enough confidence."""
    return np.asarray((cells >= 0) & (slope_map.verdicts == "undecided"))


def rough_cells(slope_map: SlopeMap, classes: Classes, cells: Cells) -> BoolArray:
    """Return (rows, columns) which cells are not too steep and yet unsafe, as something on them is too high."""
    gentle = (cells >= 0) & (cells < (classes.steep_from or 0))
    return np.asarray(gentle & (slope_map.verdicts == "unsafe"))


def slope_entries(slope_map: SlopeMap, classes: Classes, cells: Cells, text_px: int) -> list[list[Entry]]:
    """Return the entries of the map of slopes in groups: sites; classes of slope; other marks."""
    area = cell_area_m2(slope_map)
    gentle: Colour = tuple(classes.colours[(classes.steep_from or 1) - 1].tolist())  # the class below the tolerance
    undecided, rough = undecided_cells(slope_map, cells), rough_cells(slope_map, classes, cells)
    step = cells == STEP
    patterned = (
        ("undecided", undecided, area, gentle, lay_undecided),
        ("gentle but too rough: unsafe", rough, area, gentle, lay_rough),
        ("step: unsafe", step, area, STEP_COLOUR, lay_step),
    )
    marked: list[Entry] = [
        (f"{name}, {share_text(where, each)}", partial(_swatch, text_px, colour, pattern))
        for name, where, each, colour, pattern in patterned
        if where.any()
    ]
    edge: Entry = (f"edge at the tolerance, {classes.unit.limit(slope_map.tolerance_deg)}", edge_sign)
    others = [edge, *marked, _unknown_entry(cells == UNKNOWN, text_px)]
    return [_site_entries(slope_map, text_px), _class_entries(classes, cells, text_px, slope_map), others]


def sigma_entries(slope_map: SlopeMap, classes: Classes, cells: Cells, text_px: int) -> list[list[Entry]]:
    """Return the entries of the map of sigma in groups: sites; classes of sigma; unknown ground."""
    known = _class_entries(classes, cells, text_px)
    return [_site_entries(slope_map, text_px), known, [_unknown_entry(cells == UNKNOWN, text_px)]]


def slope_caption(slope_map: SlopeMap) -> str:
    """Return what the map of slopes shows, in sentences."""
    verdicts, area, unit = slope_map.verdicts, cell_area_m2(slope_map), slope_unit_of(slope_map.report.options)
    shares = (f"{name} {share_text(verdicts == name, area)}" for name in ("safe", "unsafe", "undecided"))
    unknown = share_text(verdicts == "unknown")
    return (
        f"In all: {'; '.join(shares)}; not known {unknown}. "
        f"Slope of the plane of a disc of {_footprint(slope_map)} around every point, against "
        f"{UP_WORDS[slope_map.report.up.source]}. Safe, unsafe: with probability {slope_map.confidence:g} or more the "
        f"disc is, or is not, at most {unit.limit(slope_map.tolerance_deg)} steep and free of what is too high; "
        "undecided: neither. Percentages are of the picture. Hatched ground was not measured: nobody knows whether it "
        f"is safe.{_about_sites(slope_map)}"
    )


def _about_sites(slope_map: SlopeMap) -> str:
    """What the circles mean, in sentences; that they hold other than safe cells is said only where they do."""
    if not slope_map.sites:
        return ""
    best = " The best site is the largest, of equally large ones the safest."
    rows, columns = np.indices(slope_map.p_safe.shape)
    u, v = ((n + 0.5) * slope_map.spacing_px - 0.5 for n in (columns, rows))
    unsafe = slope_map.verdicts != "safe"
    mixed = any(
        unsafe[np.hypot(u - site.centre_px[0], v - site.centre_px[1]) <= site.radius_px].any()
        for site in slope_map.sites
    )
    rim = " Cells in a circle that are not safe stand for discs that reach beyond it; those wholly in it are safe."
    return best + rim if mixed else best


def sigma_caption(slope_map: SlopeMap) -> str:
    """Return what the map of sigma shows, in sentences."""
    return (
        f"1-sigma of the slope of a disc of {_footprint(slope_map)} around every point. "
        "Percentages are of the picture. Hatched ground was not measured."
    )


def windows_entries(
    cells: Cells, undecided: BoolArray, classes: Classes, tolerance: float, text_px: int
) -> list[list[Entry]]:
    """Return the entries of a picture of windows (n,) in groups: classes of slope; other marks."""
    gentle: Colour = tuple(classes.colours[(classes.steep_from or 1) - 1].tolist())
    others: list[Entry] = [(f"edge at the tolerance, {classes.unit.limit(tolerance)}", edge_sign)]
    if undecided.any():
        others.append((f"undecided, {share_text(undecided)}", partial(_swatch, text_px, gentle, lay_undecided)))
    return [_class_entries(classes, cells, text_px), [*others, _unknown_entry(cells == UNKNOWN, text_px)]]


def draw_map_legend(
    slope_map: SlopeMap | None, title: str, groups: Sequence[Sequence[Entry]], caption: str, frame: Frame
) -> Picture:
    """Draw a legend, (h, w, 3) uint8 RGB: title, of a map direction and scale bar, groups of entries, caption."""
    width, size = frame.width, frame.text_px
    strip = Strip(width, size)
    large = round(1.3 * size)
    strip.start(1.2 * large)
    for line in wrapped(title, large, width - 2 * size):
        strip.texts.append(Text((size, strip.v), line, large, "lm", COLOURS["ink"], None))
        strip.v += LAYOUT["leading"] * large
    strip.v += 0.5 * size
    if slope_map is not None:
        _orientation(strip, slope_map, frame.scale)
    for group in groups:
        _columns(strip, group)
    strip.start(strip.v - 0.2 * size)
    for line in wrapped(caption, size, width - 2 * size):
        strip.note(line, size, strip.v)
        strip.v += LAYOUT["leading"] * size
    sheet = np.full((round(strip.v + 0.3 * size), width, 3), COLOURS["paper"], np.uint8)
    for sign, centre in strip.signs:
        sign(sheet, centre, 0.55 * size)
    return write(sheet, strip.texts)


def _columns(strip: Strip, entries: Sequence[Entry]) -> None:
    """Append entries in columns of one width."""
    if not entries:
        return
    widest = LAYOUT["sign"] * strip.size + max(text_width(text, strip.size) for text, _ in entries) + 1.3 * strip.size
    count = max(1, int((strip.width - strip.size) // widest))
    for k, (text, sign) in enumerate(entries):
        if k and k % count == 0:
            strip.v += LAYOUT["line"] * strip.size
        strip.u = strip.size + (k % count) * widest
        strip.add(text, sign)
    strip.start(strip.v + LAYOUT["line"] * strip.size)


def _orientation(strip: Strip, slope_map: SlopeMap, scale: float) -> None:
    """Append a line with the direction of north and a scale bar, each where it is known."""
    north = north_px(slope_map)
    if north is not None:
        strip.add("image up" if slope_map.north_cam1 is None else "north, in the middle", partial(_arrow, north))
    bar = bar_length_m(slope_map, scale, 0.25 * strip.width)
    if bar is not None:
        metres, length_px = bar
        text = f"{metres:g} m, in the middle"
        if strip.u + length_px + strip.size + text_width(text, strip.size) > strip.width:
            strip.start(strip.v + LAYOUT["line"] * strip.size)
        left = np.array([strip.u, strip.v])
        strip.signs.append((lambda sheet, centre, radius: scale_bar(sheet, centre, length_px, 1.2 * radius), left))
        strip.note(text, strip.u + length_px + 0.7 * strip.size, strip.v)
    if north is not None or bar is not None:
        strip.start(strip.v + LAYOUT["line"] * strip.size)


def _class_entries(classes: Classes, cells: Cells, text_px: int, slope_map: SlopeMap | None = None) -> list[Entry]:
    """A swatch for every class, with its share and, for a map of slopes, its area."""
    area = None if slope_map is None else cell_area_m2(slope_map)
    return [
        (
            f"{name}: {share_text(cells == k, area)}",
            partial(_swatch, text_px, tuple(classes.colours[k].tolist()), lay_nothing),
        )
        for k, name in enumerate(classes.names)
    ]


def _unknown_entry(where: BoolArray, text_px: int) -> Entry:
    sign = partial(_swatch, text_px, COLOURS["unknown ground"], lay_unknown)
    return f"NOT KNOWN, {share_text(where)}", sign


def _site_entries(slope_map: SlopeMap, text_px: int) -> list[Entry]:
    unit, slope_unit = slope_map.report.scale.unit, slope_unit_of(slope_map.report.options)
    entries: list[Entry] = []
    for site in slope_map.sites:
        radius = f"{number_text(site.radius)} m" if unit == "m" else f"{site.radius_px:.0f} px"
        rank = "best landing site" if site is slope_map.sites[0] else "landing site"
        slope = slope_unit.short(site.slope_deg, site.slope_sigma_deg)
        words = f"{rank}: radius {radius}, slope {slope}, {site.verdict}"
        entries.append((words, partial(_site_sign, site, text_px)))
    return entries


def _swatch(
    text_px: int, colour: Colour, pattern: Pattern, picture: Picture, centre: np.ndarray, radius: float
) -> None:
    """Draw a rectangle in the colour and pattern of some cells, with a dark rim."""
    half = np.rint([3.0 * radius, 1.5 * radius]).astype(int)
    low = np.rint(centre).astype(int) - half
    patch = np.full((2 * half[1], 2 * half[0], 3), colour, np.uint8)
    pattern(patch, np.full(patch.shape[:2], True), text_px)
    patch[[0, -1]] = COLOURS["ink"]
    patch[:, [0, -1]] = COLOURS["ink"]
    picture[low[1] : low[1] + 2 * half[1], low[0] : low[0] + 2 * half[0]] = patch


def _site_sign(site: Site, text_px: int, picture: Picture, centre: np.ndarray, radius: float) -> None:
    """Draw a small circle of a site around its number."""
    site_circle(picture, centre, 1.45 * radius, site.verdict == "safe", max(2, round(text_px / 8)), centred=False)
    at = (float(centre[0]), float(centre[1]))
    write(picture, [Text(at, str(site.id), text_px, "mm", COLOURS["ink"], None)])


def _arrow(direction: np.ndarray, picture: Picture, centre: np.ndarray, radius: float) -> None:
    marks.arrow(picture, centre - 1.7 * radius * direction, direction, 3.4 * radius, 0.55 * radius)


def _footprint(slope_map: SlopeMap) -> str:
    """Diameter of a footprint, in words."""
    px = f"{slope_map.footprint_px:.0f} px"
    return f"{px} ({number_text(slope_map.footprint)} m)" if slope_map.report.scale.unit == "m" else px
