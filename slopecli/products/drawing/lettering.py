"""Text on pictures: its size and layout, and its drawing by Pillow."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from slopecli.products.drawing.marks import INK, PAPER, Colour, Picture
from slopecli.types import FloatArray

LEADING = 1.22  # row height over font size
MARGIN = 3.0  # px kept free around a label


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
        return np.array([max(self.row_widths), LEADING * self.size * len(self.rows)]) + 2 * MARGIN


@dataclass(frozen=True)
class Text:
    """One line of text. `anchor` is Pillow's: "mm" centred on `at`, "lm" and "rm" to its right and left."""

    at: tuple[float, float]
    text: str
    size: int
    anchor: str = "lm"
    colour: Colour = PAPER
    halo: Colour | None = INK


def label_texts(label: Label, centre: FloatArray) -> list[Text]:
    """Lay out the rows of a label around its centre (2,)."""
    tops = (np.arange(len(label.rows)) - 0.5 * (len(label.rows) - 1)) * LEADING * label.size
    shift = label.row_widths[0] - text_width(label.rows[0], label.size)
    return [
        Text((float(centre[0] + (0.5 * shift if i == 0 else 0.0)), float(centre[1] + top)), row, label.size, "mm")
        for i, (row, top) in enumerate(zip(label.rows, tops, strict=True))
    ]


def badge_centre(label: Label, centre: FloatArray) -> FloatArray:
    """Return where the badge of a label at `centre` goes, (2,)."""
    rise = 0.5 * (len(label.rows) - 1) * LEADING * label.size
    return np.asarray(centre) + np.array([label.badge_radius - 0.5 * label.row_widths[0], -rise])


def write(picture: Picture, texts: Sequence[Text]) -> Picture:
    """Write texts on a picture and return it; those parts of it that texts lie on go through Pillow, not all of it."""
    for item in texts:
        left, top, right, bottom = _reach(item)
        left, top = max(left, 0), max(top, 0)
        under = picture[top : max(bottom, 0), left : max(right, 0)]
        if under.size:
            under[:] = _lettered(under, item, (item.at[0] - left, item.at[1] - top))
    return picture


def _reach(item: Text) -> tuple[int, int, int, int]:
    """Left, top, right, bottom of what a text can touch, whichever of its points is anchored, px."""
    u, v = item.at
    aside, above = math.ceil(text_width(item.text, item.size)) + item.size, 2 * item.size
    return math.floor(u) - aside, math.floor(v) - above, math.ceil(u) + aside, math.ceil(v) + above


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
