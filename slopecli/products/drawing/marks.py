"""Shapes of the overlay, drawn by OpenCV with anti-aliasing: hatches, outlines, arrows, badges.

Pictures are (h, w, 3) uint8 RGB and changed in place; points are (k, 2) px of the picture, pixel centres at integers.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from slopecli.types import FloatArray

Picture = NDArray[np.uint8]
Colour = tuple[int, int, int]

COLOURS: dict[str, Colour] = {
    "ink": (20, 20, 24),
    "paper": (250, 250, 250),
    "hazard": (224, 82, 6),  # vermilion: apart from every colour of cividis, also without red-green vision
    "caution": (255, 208, 64),
    "calm": (225, 240, 255),
    "no answer": (165, 165, 165),
    "no answer ink": (70, 70, 70),
    "no region": (30, 30, 34),  # on a map of regions
    "unknown ground": (145, 145, 145),  # of a map, over an image of middle grey; its hatch:
    "hatch": (50, 50, 54),
    "warning": (255, 224, 130),  # ground of the lines above a picture
}
BADGE_COLOURS = {
    "safe": COLOURS["calm"],
    "undecided": COLOURS["caution"],
    "unsafe": COLOURS["hazard"],
    "rejected": COLOURS["no answer"],
    "level": COLOURS["paper"],
}
# heights and widths over the size of the text, and shares
LAYOUT = {
    "leading": 1.22,  # of a row
    "line": 2.1,  # of a line of a legend
    "sign": 4.0,  # width of its signs, with the gap to the text
    "tint": 0.6,  # of a patch's colour; the rest keeps the ground recognisable
    "dash": 0.45,  # of the period; round line ends make it look longer
}

SHIFT = 4  # OpenCV draws at 1/16 px
# lines of the signs in a badge of radius 1: a tick, a cross, a question mark without its dot, a bar, two lines
SIGNS = {
    "safe": ([[-0.5, 0.05], [-0.12, 0.42], [0.52, -0.4]],),
    "unsafe": ([[-0.42, -0.42], [0.42, 0.42]], [[-0.42, 0.42], [0.42, -0.42]]),
    "undecided": ([[-0.4, -0.35], [-0.25, -0.6], [0.1, -0.68], [0.4, -0.42], [0.3, -0.1], [0.0, 0.08], [0.0, 0.25]],),
    "rejected": ([[-0.6, 0.0], [0.6, 0.0]],),
    "level": ([[-0.5, -0.22], [0.5, -0.22]], [[-0.5, 0.22], [0.5, 0.22]]),
}


def fixed_point(points: FloatArray) -> NDArray[np.int32]:
    """Round points (k, 2) to the 1/16 px integers of OpenCV's `shift` argument."""
    return np.rint(np.asarray(points, float) * 2**SHIFT).astype(np.int32)


def stroke(picture: Picture, points: FloatArray, colour: Colour, width: int, *, closed: bool = False) -> None:
    """Draw a line through points (k, 2)."""
    cv2.polylines(picture, [fixed_point(points)], closed, colour, width, cv2.LINE_AA, SHIFT)


def cased_stroke(picture: Picture, points: FloatArray, colour: Colour, width: int, *, closed: bool = False) -> None:
    """Draw a line with a dark rim, so that it shows on any ground."""
    stroke(picture, points, COLOURS["ink"], width + 2, closed=closed)
    stroke(picture, points, colour, width, closed=closed)


def fill(picture: Picture, points: FloatArray, colour: Colour) -> None:
    """Fill a polygon (k, 2)."""
    cv2.fillPoly(picture, [fixed_point(points)], colour, cv2.LINE_AA, SHIFT)


def disc(picture: Picture, centre: FloatArray, radius: float, colour: Colour, width: int = cv2.FILLED) -> None:
    """Draw a disc, or a ring where `width` is positive."""
    u, v = fixed_point(centre)
    cv2.circle(picture, (int(u), int(v)), round(radius * 2**SHIFT), colour, width, cv2.LINE_AA, SHIFT)


def lay_over(picture: Picture, painted: Picture, cover: NDArray[np.uint8]) -> None:
    """Replace a picture by a painted one where `cover` (h, w) is 255, and mix them where it is between."""
    cv2.copyTo(painted, np.multiply(cover == 255, 255, dtype=np.uint8), picture)
    seam = np.nonzero((cover > 0) & (cover < 255))
    share = cover[seam][:, None] / 255.0
    picture[seam] = np.rint(share * painted[seam] + (1.0 - share) * picture[seam])


def lay_colour(picture: Picture, colour: Colour, cover: NDArray[np.uint8]) -> None:
    """Mix a colour into a picture by the share of each pixel that it covers, (h, w), 255 for all."""
    where = np.nonzero(cover > 0)
    share = cover[where].astype(np.float32) / np.float32(255.0)
    for k, value in enumerate(colour):  # channel by channel: half of the time of all three at once
        channel = picture[..., k]
        channel[where] = np.rint(share * np.float32(value) + (np.float32(1.0) - share) * channel[where])


def paint_verdict(
    patch: Picture, outlines: Sequence[FloatArray], verdict: str, line: int, *, curved: bool = False
) -> None:
    """Give a patch the hatch and border of its verdict.

    The border is drawn on the outlines; the caller clips it to the patch, so that neighbours keep their own.

    Parameters
    ----------
    patch : the picture under the bounding box of the outlines, its ground already tinted.
    outlines : closed, (k, 2) each, in px of `patch`.
    verdict : "safe", "unsafe", "undecided", "level" (taken as such: no verdict) or "rejected".
    line : width of a thin border, px; the other widths and spacings follow from it.
    curved : the outlines are curves of many short sides, whose corners mean nothing.
    """
    if verdict == "unsafe":
        # vermilion alone is as light as a middling slope: the dark rim shows on a grey print
        spacing = 16 * (max(2, line) if curved else line)  # regions are many and small: sparser, they are read better
        _hatch(patch, spacing, COLOURS["ink"], line + 2, rising=True)
        _hatch(patch, spacing, COLOURS["hazard"], line, rising=True)
        _border(patch, outlines, (COLOURS["ink"], 4 * line + 2), (COLOURS["hazard"], 4 * line))
    elif verdict == "undecided":
        _border(patch, outlines, (COLOURS["ink"], 3 * line))
        cut = curve_dashes if curved else dashes
        for outline in outlines:
            for dash in cut(outline, 14 * line):
                stroke(patch, dash, COLOURS["caution"], 3 * line)
    elif verdict == "safe":
        _border(patch, outlines, (COLOURS["ink"], line + 3), (COLOURS["calm"], line + 1))
    elif verdict == "level":
        _border(patch, outlines, (COLOURS["ink"], line + 1))
    else:
        _hatch(patch, 5 * line, COLOURS["no answer ink"], max(1, round(0.4 * line)), rising=False)
        _border(patch, outlines, (COLOURS["no answer ink"], line + 1))


def _border(patch: Picture, outlines: Sequence[FloatArray], *strokes: tuple[Colour, int]) -> None:
    """Draw closed lines of the given colours and widths, one over the other."""
    for colour, width in strokes:
        for outline in outlines:
            stroke(patch, outline, colour, width, closed=True)


def _hatch(patch: Picture, spacing: float, colour: Colour, width: int, *, rising: bool) -> None:
    """Draw diagonal lines all over; rising ones go up to the right."""
    height, breadth = patch.shape[:2]
    starts = np.arange(-height, breadth, spacing * np.sqrt(2))
    heads, tails = (height, 0) if rising else (0, height)
    ends = np.array([[[u, heads], [u + height, tails]] for u in starts])
    cv2.polylines(patch, list(fixed_point(ends)), False, colour, width, cv2.LINE_AA, SHIFT)


def dashes(points: FloatArray, period: float) -> list[FloatArray]:
    """Cut a closed polygon (k, 2) into dashes, one in every `period`; every corner lies within a dash."""
    pieces = []
    for start, end in zip(points, np.roll(points, -1, axis=0), strict=True):
        count = max(1, round(float(np.linalg.norm(end - start)) / period))
        cuts = np.clip((np.arange(count + 1)[:, None] + [-LAYOUT["dash"] / 2, LAYOUT["dash"] / 2]) / count, 0.0, 1.0)
        pieces += [start + cut[:, None] * (end - start) for cut in cuts]
    return pieces


def curve_dashes(points: FloatArray, period: float) -> list[FloatArray]:
    """Cut a closed curve (k, 2) into dashes, one in every `period` of its length wherever its corners are."""
    closed = np.vstack([points, points[:1]])
    reached = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1)))
    count = max(1, round(float(reached[-1]) / period))
    pieces = []
    for start, end in (np.arange(count)[:, None] + [0.0, LAYOUT["dash"]]) * reached[-1] / count:
        stops = np.r_[start, reached[(reached > start) & (reached < end)], end]
        pieces.append(np.column_stack([np.interp(stops, reached, axis) for axis in closed.T]))
    return pieces


def arrow(picture: Picture, tail: FloatArray, direction: FloatArray, length: float, width: float) -> None:
    """Draw a filled arrow from `tail` along the unit vector `direction`, white with a dark rim."""
    along = np.asarray(direction, float)
    across = np.array([-along[1], along[0]])
    head = min(3.2 * width, 0.6 * length)
    profile = [(0, 0.5), (length - head, 0.5), (length - head, 1.5), (length, 0)]
    side = [(a, b * width) for a, b in profile]
    outline = np.array([tail + a * along + b * across for a, b in side + [(a, -b) for a, b in side[-2::-1]]])
    stroke(picture, outline, COLOURS["ink"], max(3, round(0.8 * width)), closed=True)
    fill(picture, outline, COLOURS["paper"])


def badge(picture: Picture, kind: str, centre: FloatArray, radius: float) -> None:
    """Draw the sign of a verdict: a tick, a cross in a diamond, a question mark, two lines, a barred ring."""
    centre, width = np.asarray(centre, float), max(2, round(0.28 * radius))
    if kind == "unsafe":
        diamond = centre + 1.25 * radius * np.array([[0, -1], [1, 0], [0, 1], [-1, 0]])
        stroke(picture, diamond, COLOURS["ink"], 3, closed=True)
        fill(picture, diamond, COLOURS["hazard"])
    else:
        disc(picture, centre, radius + 1, COLOURS["ink"])
        disc(picture, centre, radius, BADGE_COLOURS[kind])
    for line in SIGNS[kind]:
        stroke(
            picture, centre + radius * np.array(line), COLOURS["paper"] if kind == "unsafe" else COLOURS["ink"], width
        )
    if kind == "undecided":
        disc(picture, centre + radius * np.array([0.0, 0.6]), 0.55 * width, COLOURS["ink"])


def focus_mark(picture: Picture, centre: FloatArray, radius: float) -> None:
    """Mark the epipole: a ring with four outward ticks, as image motion radiates from it."""
    width = max(2, round(0.18 * radius))
    quarters = np.array([[1, 0], [0, 1], [-1, 0], [0, -1]])
    ticks = [centre + radius * np.outer([0.45, 1.5], quarter) for quarter in quarters]
    for colour, extra in ((COLOURS["ink"], 2), ((255, 110, 200), 0)):
        disc(picture, centre, radius, colour, width + extra)
        for tick in ticks:
            stroke(picture, tick, colour, width + extra)
