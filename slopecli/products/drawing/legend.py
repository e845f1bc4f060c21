"""Legends below pictures, and the warning above them that a second root is left."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from numpy.typing import NDArray

from slopecli.options import Options
from slopecli.products.drawing import marks
from slopecli.products.drawing.colours import SLOPE_RANGE_DEG, slope_range_colours
from slopecli.products.drawing.lettering import Text, text_width, wrapped, write
from slopecli.products.drawing.marks import LAYOUT, Picture
from slopecli.report.second_root import margin
from slopecli.report.slope_units import SlopeUnit, slope_unit_of
from slopecli.types import FloatArray, Report

UP_WORDS = {
    "camera": "the camera's axis, taken as vertical",
    "given": "the given up direction",
    "exif": "the up direction of the image's metadata",
    "dominant-plane": "the largest plane, taken as level",
}

Sign = Callable[[Picture, np.ndarray, float], None]  # draws into a picture, at a centre, with a radius


@dataclass(eq=False)
class Strip:
    """Layout of a legend: signs and texts from left to right, line by line."""

    width: int
    size: int
    texts: list[Text] = field(default_factory=list)
    signs: list[tuple[Sign, np.ndarray]] = field(default_factory=list)
    u: float = field(init=False)
    v: float = field(init=False)

    def start(self, v: float) -> None:
        """Begin a line at a height."""
        self.u, self.v = self.size, v

    def add(self, text: str, sign: Sign) -> None:
        """Append a sign and its meaning, on the next line if this one is full."""
        length = LAYOUT["sign"] * self.size + text_width(text, self.size)
        if self.u + length > self.width and self.u > self.size:
            self.start(self.v + LAYOUT["line"] * self.size)
        self.signs.append((sign, np.array([self.u + 0.5 * (LAYOUT["sign"] - 0.6) * self.size, self.v])))
        self.note(text, self.u + LAYOUT["sign"] * self.size, self.v)
        self.u += length + 1.3 * self.size

    def note(self, text: str, u: float, v: float, anchor: str = "lm") -> None:
        """Write a text at a place, anchored as `Text` is."""
        self.texts.append(Text((u, v), text, self.size, anchor, marks.COLOURS["ink"], halo=None))


@dataclass(frozen=True)
class ColourBar:
    """A scale of colours; places along it run from 0 at its left end to 1.

    colours : places (n,) -> (n, 3) uint8 RGB.  ticks, mark : place and text.
    """

    colours: Callable[[FloatArray], NDArray[np.uint8]]
    ticks: Sequence[tuple[float, str]]
    mark: tuple[float, str] | None = None


def draw_sheet(
    width: int, text_px: int, caption: str, bar: ColourBar | None = None, entries: Sequence[tuple[str, Sign]] = ()
) -> Picture:
    """Draw a legend, (h, width, 3) uint8 RGB: a bar of colours, signs with their meaning, a caption."""
    strip = Strip(width, max(11, round(0.87 * text_px)))
    bar_v, bar_height = 2.3 * strip.size, 1.1 * strip.size
    strip.start(strip.size if bar is None else bar_v + bar_height + 3.1 * strip.size)
    for text, sign in entries:
        strip.add(text, sign)
    strip.start(strip.v + LAYOUT["line"] * strip.size if entries else strip.v)
    for line in wrapped(caption, strip.size, width - 2 * strip.size):
        strip.note(line, strip.size, strip.v)
        strip.v += LAYOUT["leading"] * strip.size
    sheet = np.full((round(strip.v + 0.3 * strip.size), width, 3), marks.COLOURS["paper"], np.uint8)
    if bar is not None:
        _draw_bar(sheet, strip, bar_v, bar_height, bar)
    for sign, centre in strip.signs:
        sign(sheet, centre, 0.55 * strip.size)
    return write(sheet, strip.texts)


def draw_legend(report: Report, width: int, text_px: int, with_focus: bool) -> Picture:
    """Draw the legend of the overlay, (h, width, 3) uint8 RGB: colours with the tolerance, signs, what up means."""
    low, high = SLOPE_RANGE_DEG
    tolerance = float(report.options.get("tolerance_deg", Options.tolerance_deg))  # that the verdicts were made with
    unit = slope_unit_of(report.options)
    ticks = [((angle - low) / (high - low), text) for angle, text in _ticks(unit)]
    mark = (tolerance - low) / (high - low), f"tolerance {unit.limit(tolerance)}"
    bar = ColourBar(slope_range_colours, ticks, mark if low <= tolerance <= high else None)
    return draw_sheet(width, text_px, _caption(report, tolerance), bar, _entries(report, with_focus))


def _ticks(unit: SlopeUnit) -> list[tuple[float, str]]:
    """Angles, deg, and texts of round numbers of a unit within `SLOPE_RANGE_DEG`; the last has no end."""
    low, high = SLOPE_RANGE_DEG
    step = 10 if unit.run > 50 else 1
    rises = np.arange(0, unit.run, step) if unit.run else np.arange(low, high + 1, 5)
    angles = [(unit.angle_deg(float(rise)), f"{rise:.3g}{unit.suffix}") for rise in rises]
    inside = [one for one in angles if one[0] <= high]
    return [*inside[:-1], (inside[-1][0], f"{inside[-1][1]}+")]


def draw_banner(report: Report, width: int, text_px: int) -> list[Picture]:
    """Draw the warnings that level is assumed, and that a second answer fits too: (h, width, 3) uint8 RGB strips."""
    strips = level_banners(report, width, text_px)
    if report.ambiguity.status != "unresolved":
        return strips
    worse, remedy = margin(report.ambiguity, report.fit.n_inliers), report.ambiguity.resolve_with
    advice = "" if remedy is None else f" Resolve it with {remedy}."
    second = f'Two answers: a second motion, with the slopes after "or", fits these images as well{worse}.{advice}'
    return [*strips, banner(second, width, text_px)]


def level_banners(report: Report, width: int, text_px: int) -> list[Picture]:
    """Draw the warning that level is assumed, if it is: (h, width, 3) uint8 RGB strips."""
    return [
        banner(f"Level is assumed: {one.message}. {(one.remedy or '').capitalize()}.", width, text_px)
        for one in report.diagnostics
        if one.code == "level-assumed"
    ]


def banner(sentence: str, width: int, text_px: int) -> Picture:
    """Draw a warning, (h, width, 3) uint8 RGB."""
    lines = wrapped(sentence, text_px, width - 2 * text_px)
    sheet = np.full(
        (round((len(lines) * LAYOUT["leading"] + 0.8) * text_px), width, 3), marks.COLOURS["warning"], np.uint8
    )
    rows = (np.arange(len(lines)) + 0.5) * LAYOUT["leading"] * text_px + 0.4 * text_px
    texts = [
        Text((text_px, float(v)), s, text_px, "lm", marks.COLOURS["ink"], None)
        for v, s in zip(rows, lines, strict=True)
    ]
    return write(sheet, texts)


def _caption(report: Report, tolerance: float) -> str:
    confidence = float(report.options.get("confidence", Options.confidence))
    ruled_out = report.ambiguity.status == "resolved"
    second = f" A second motion is ruled out{margin(report.ambiguity, report.fit.n_inliers)}." if ruled_out else ""
    limit = slope_unit_of(report.options).limit(tolerance)
    return (
        f"Patch: id, slope ± 1 sigma. Slope against {UP_WORDS[report.up.source]}. "
        f"Safe, unsafe: below, above {limit} with probability {confidence:g} or more.{second}"
    )


def _entries(report: Report, with_focus: bool) -> list[tuple[str, Sign]]:
    verdicts = ("safe", "undecided", "unsafe")
    entries: list[tuple[str, Sign]] = [(name, partial(swatch, name)) for name in verdicts]
    unknown = not all(plane.slope_known for plane in report.planes)
    if any(plane.taken_as_level for plane in report.planes):
        entries.append(("taken as level", partial(swatch, "level")))
    words = [word for word, found in (("no answer", report.rejected), ("slope not known", unknown)) if found]
    if words:
        entries.append((" or ".join(words), partial(swatch, "rejected")))
    if any(plane.aspect_deg is not None and plane.slope_known for plane in report.planes):
        entries.append(("downhill", _arrow))
    if with_focus:
        entries.append(("focus of expansion", focus_sign))
    return entries


def swatch(verdict: str, picture: Picture, centre: np.ndarray, radius: float) -> None:
    """Draw a small patch with border, hatch and badge of its verdict."""
    half = np.rint([3.0 * radius, 1.6 * radius]).astype(int)
    low = np.rint(centre).astype(int) - half
    patch = np.full((2 * half[1], 2 * half[0], 3), marks.COLOURS["no answer"], np.uint8)
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * (2.0 * half - 1)
    marks.paint_verdict(patch, [corners], verdict, max(1, round(0.18 * radius)))
    marks.badge(patch, verdict, half - 0.5, 0.9 * radius)
    picture[low[1] : low[1] + 2 * half[1], low[0] : low[0] + 2 * half[0]] = patch


def _arrow(picture: Picture, centre: np.ndarray, radius: float) -> None:
    marks.arrow(picture, centre - [1.8 * radius, 0], np.array([1.0, 0.0]), 3.6 * radius, 0.55 * radius)


def focus_sign(picture: Picture, centre: np.ndarray, radius: float) -> None:
    """Draw the sign of the focus of expansion."""
    marks.focus_mark(picture, centre, 1.1 * radius)


def _draw_bar(sheet: Picture, strip: Strip, top: float, height: float, bar: ColourBar) -> None:
    """Draw a bar of colours with its ticks, and a mark across it."""
    left, right = 1.6 * strip.size, min(strip.width - 1.6 * strip.size, 36.0 * strip.size)
    columns = np.arange(round(left), round(right))
    places = np.asarray((columns - left) / (right - left), float)
    sheet[round(top) : round(top + height), columns] = bar.colours(places)
    for place, text in bar.ticks:
        u = left + place * (right - left)
        marks.stroke(
            sheet, np.array([[u, top + height], [u, top + height + 0.35 * strip.size]]), marks.COLOURS["ink"], 1
        )
        strip.note(text, u, top + height + 1.1 * strip.size, "mm")
    if bar.mark is not None:
        place, text = bar.mark
        u, half = left + place * (right - left), 0.4 * strip.size
        marks.cased_stroke(sheet, np.array([[u, top - 2], [u, top + height + 2]]), marks.COLOURS["paper"], 2)
        pointer = np.array([u, top]) + half * np.array([[-1.0, -1.6], [1.0, -1.6], [0.0, 0.0]])
        marks.fill(sheet, pointer, marks.COLOURS["hazard"])
        aside = 0.5 * text_width(text, strip.size) + 2
        middle = float(np.clip(u, aside, strip.width - aside))
        strip.note(text, middle, top - 1.4 * strip.size, "mm")
