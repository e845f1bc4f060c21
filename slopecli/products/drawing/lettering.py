"""Text on pictures: its size and layout, what labels of patches say, and its drawing by Pillow."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np

from slopecli.products.drawing.marks import COLOURS, LAYOUT, Colour, Picture
from slopecli.products.drawing.outlines import Footprint
from slopecli.report.slope_units import SLOPE_UNITS, SlopeUnit
from slopecli.types import AlternativePlane, FloatArray, Plane, Rejected

SMALLEST_TEXT_PX = 9  # legible
UNKNOWN = "?"  # in place of a slope that is not known
LEVEL = "level"  # in place of the slope of the plane that is taken as level


@dataclass(frozen=True)
class Label:
    """Rows of text, centred, with an optional badge in front of the first."""

    rows: tuple[str, ...]
    size: int
    badge: str | None = None

    @property
    def badge_radius(self) -> float:
        return 0.52 * self.size if self.badge else 0.0

    @cached_property
    def row_widths(self) -> list[float]:
        widths = [text_width(row, self.size) for row in self.rows]
        widths[0] += 2 * self.badge_radius + (0.5 * self.size if self.badge else 0.0)
        return widths

    @cached_property
    def extent(self) -> FloatArray:
        """(2,) width and height, px, margin included."""
        return (
            np.array([max(self.row_widths), LAYOUT["leading"] * self.size * len(self.rows)]) + 6.0
        )  # 3 px around it are kept free


class Text(NamedTuple):
    """One line of text. `anchor` is Pillow's: "mm" centred on `at`, "lm" and "rm" to its right and left."""

    at: tuple[float, float]
    text: str
    size: int
    anchor: str = "lm"
    colour: Colour = COLOURS["paper"]
    halo: Colour | None = COLOURS["ink"]


def label_texts(label: Label, centre: FloatArray) -> list[Text]:
    """Lay out the rows of a label around its centre (2,)."""
    tops = (np.arange(len(label.rows)) - 0.5 * (len(label.rows) - 1)) * LAYOUT["leading"] * label.size
    shift = label.row_widths[0] - text_width(label.rows[0], label.size)
    return [
        Text((float(centre[0] + (0.5 * shift if i == 0 else 0.0)), float(centre[1] + top)), row, label.size, "mm")
        for i, (row, top) in enumerate(zip(label.rows, tops, strict=True))
    ]


def badge_centre(label: Label, centre: FloatArray) -> FloatArray:
    """Return where the badge of a label at `centre` goes, (2,)."""
    rise = 0.5 * (len(label.rows) - 1) * LAYOUT["leading"] * label.size
    return np.asarray(centre) + np.array([label.badge_radius - 0.5 * label.row_widths[0], -rise])


def write(picture: Picture, texts: Sequence[Text]) -> Picture:
    """Write texts on a picture and return it; those parts of it that texts lie on go through Pillow, not all of it."""
    for item in texts:
        (u, v), above = item.at, 2 * item.size
        aside = math.ceil(text_width(item.text, item.size)) + item.size  # whichever point of the text is anchored
        left, top = max(math.floor(u) - aside, 0), max(math.floor(v) - above, 0)
        under = picture[top : max(math.ceil(v) + above, 0), left : max(math.ceil(u) + aside, 0)]
        if under.size:
            under[:] = _lettered(under, item, (u - left, v - top))
    return picture


def _lettered(ground: Picture, item: Text, at: tuple[float, float]) -> Picture:
    """A copy of a part of a picture with a text on it, `at` px of that part."""
    from PIL import Image, ImageDraw

    options: dict[str, Any] = {"font": _font(item.size), "anchor": item.anchor, "fill": item.colour}
    if item.halo is not None:
        options |= {"stroke_width": max(2, round(item.size / 8)), "stroke_fill": item.halo}
    sheet = Image.fromarray(np.ascontiguousarray(ground))
    ImageDraw.Draw(sheet).text(at, printable(item.text), **options)
    return np.asarray(sheet)


def printable(text: str) -> str:
    """Replace what the built-in font has no glyph for."""
    return text.encode("latin-1", "replace").decode("latin-1")


@lru_cache(maxsize=1024)  # a label is measured for every place it may take, and once more when it is written
def text_width(text: str, size: int) -> float:
    """Return the width of one line, px."""
    return float(_font(size).getlength(printable(text)))


def wrapped(text: str, size: int, width: float) -> list[str]:
    """Break a sentence into lines no wider than `width` px where its words allow."""
    lines = [""]
    for word in text.split():
        longer = f"{lines[-1]} {word}".strip()
        lines[-1:] = [longer] if text_width(longer, size) <= width or not lines[-1] else [lines[-1], word]
    return lines


@lru_cache(maxsize=32)
def _font(size: int) -> Any:
    from PIL import ImageFont

    return ImageFont.load_default(size)


def slope_text(plane: Plane, unit: SlopeUnit = SLOPE_UNITS["deg"]) -> tuple[str, str]:
    """Return slope and sigma as "12.3°" and "± 0.4°"; "?" for a slope that is not known, "" for such a sigma."""
    sigma = plane.slope_sigma_deg
    if sigma is None:
        return LEVEL, ""
    if plane.slope_known and unit.has(plane.slope_deg):
        return unit.parts(plane.slope_deg, sigma)
    if not math.isfinite(sigma):
        return f"{plane.slope_deg:.1f}°", ""
    digits = 0 if sigma >= 9.95 else 1 if sigma >= 0.095 else 2
    slope = f"{plane.slope_deg:.{min(digits, 1)}f}°" if plane.slope_known else UNKNOWN
    return slope, "± <0.01°" if 0 < sigma < 0.005 else f"± {sigma:.{digits}f}°"


def full_labels(footprint: Footprint, text_px: int) -> list[Label]:
    """Return labels with all that is known of a patch: large, small and, for a wide patch, in narrow rows."""
    size, name = round(np.clip(footprint.size / 14, text_px, 1.4 * text_px)), str(footprint.item.id)
    small = max(SMALLEST_TEXT_PX, round(0.8 * text_px))
    if isinstance(footprint.item, Rejected):
        return [Label((name, footprint.item.reason), height, "rejected") for height in (size, small)]
    slope, sigma = slope_text(footprint.item, footprint.unit)
    if slope == UNKNOWN:
        return [Label((f"{name} {UNKNOWN}", sigma), height, footprint.badge) for height in (size, small)]
    other = footprint.other
    notes = [] if other is None or other.taken_as_level else [f"or {_second_text(other, footprint.unit)}"]
    notes += ["poor"] if footprint.item.status == "poor" else []
    full = Label((name, f"{slope} {sigma}".strip(), *notes), size, footprint.badge)
    labels = [full, replace(full, size=small)]
    if sigma and footprint.size >= 6 * text_px:  # more rows would crowd a smaller patch
        labels.append(replace(full, rows=(name, slope, sigma, *notes), size=small))
    return labels


def tiny_label(footprint: Footprint, text_px: int) -> Label:
    """Return the label of a patch without room: id, whole degrees if it has a slope, and badge."""
    item = footprint.item
    second = (_whole(item, footprint),) if isinstance(item, Plane) else ()
    return Label((str(item.id), *second), _tiny(text_px), footprint.badge)


def shorter_labels(footprint: Footprint, text_px: int) -> Iterator[list[Label]]:
    """Yield labels with ever less than `full_labels`: id and whole degrees with and without badge, then the id."""
    item = footprint.item
    if isinstance(item, Plane):
        slope = _whole(item, footprint)
        for badge in (footprint.badge, None):
            rows = ((str(item.id), slope), (f"{item.id}: {slope}",))
            yield [Label(one, _tiny(text_px), badge) for one in rows]
    yield [number_label(footprint, text_px)]


def number_label(footprint: Footprint, text_px: int) -> Label:
    """Return the smallest label: the id."""
    return Label((str(footprint.item.id),), _tiny(text_px))


def _tiny(text_px: int) -> int:
    return max(SMALLEST_TEXT_PX, round(0.62 * text_px))


def _second_text(other: AlternativePlane, unit: SlopeUnit) -> str:
    if not other.slope_known:
        return UNKNOWN
    return unit.text(other.slope_deg) if unit.has(other.slope_deg) else f"{other.slope_deg:.1f}°"


def _whole(plane: Plane, footprint: Footprint) -> str:
    """Slope in whole degrees; both slopes where a second root is left."""
    both = (plane,) if footprint.other is None else (plane, footprint.other)
    if plane.taken_as_level:
        return LEVEL
    return " or ".join(footprint.unit.whole(one.slope_deg) if one.slope_known else UNKNOWN for one in both)
