"""Where the labels go when planes are found as regions: many, of any shape, some of them smaller than a word.

Every plane has its number on the picture; what else is said of it there is what its ground has room for.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from slopecli.products.drawing.lettering import Box, Label, box_around, find_room
from slopecli.products.drawing.outlines import Footprint
from slopecli.products.drawing.placement import (
    LARGE,
    SMALLEST_TEXT_PX,
    TINY,
    Placed,
    degrees_text,
    full_labels,
    place_inside,
)
from slopecli.types import FloatArray, Plane

REACH = 8.0  # of the size of a number that finds no room in its region: how far off it is looked for


def place_region_labels(
    footprints: Sequence[Footprint], obstacles: Sequence[Box], shape: tuple[int, int], text_px: int
) -> list[Placed]:
    """Place one label for every patch: in it as much as fits, or its number across it or beside it.

    Parameters
    ----------
    footprints : patches on the picture.
    obstacles : boxes that labels keep clear of.
    shape : height and width of the picture, px.
    text_px : size of the text.
    """
    placed: list[Placed] = []
    taken, waiting = list(obstacles), []
    for footprint in sorted(footprints, key=lambda one: -one.size):
        one = _place_what_fits(footprint, taken, text_px)
        if one is None:
            waiting.append(footprint)
        else:
            placed.append(one)
            taken += _boxes(one)
    for footprint in waiting:
        placed.append(_place_number(footprint, taken, shape, text_px))
        taken.append(placed[-1].box)
    return placed


def place_numbers(footprints: Sequence[Footprint], shape: tuple[int, int], text_px: int) -> list[Placed]:
    """Place the number of every patch and nothing else: in it, across it or beside it."""
    placed: list[Placed] = []
    for footprint in sorted(footprints, key=lambda one: -one.size):
        taken = [one.box for one in placed]
        label = Label((str(footprint.item.id),), text_px)
        inside = place_inside(replace(footprint, downhill=None), [label], taken)
        placed.append(inside or _place_number(footprint, taken, shape, text_px))
    return placed


def _place_what_fits(footprint: Footprint, taken: Sequence[Box], text_px: int) -> Placed | None:
    """Fullest label that fits into the patch, with its arrow if that fits too."""
    still = replace(footprint, downhill=None)
    for every in _labels(footprint, text_px):
        labels = [label for label in every if _may_fit(footprint, label)]
        one = place_inside(footprint, labels, taken) or place_inside(still, labels, taken)
        if one is not None:
            return one
    return None


def _may_fit(footprint: Footprint, label: Label) -> bool:
    """Whether a patch is large and wide enough for a label, which spares looking for its place."""
    wide = footprint.pieces is None or label.extent.min() <= 2 * footprint.pieces.radius
    return wide and bool(label.extent.prod() <= footprint.size**2)


def _labels(footprint: Footprint, text_px: int) -> Iterator[list[Label]]:
    """What a label may say, the fullest first: all, number and slope, the number alone."""
    item, size = footprint.item, round(np.clip(footprint.size / 14, text_px, LARGE * text_px))
    yield full_labels(footprint, size, text_px)
    small = _small(text_px)
    if isinstance(item, Plane):
        slope = degrees_text(item, footprint.other)
        for badge in (footprint.badge, None):
            yield [Label((str(item.id), slope), small, badge), Label((f"{item.id}: {slope}",), small, badge)]
    yield [Label((str(item.id),), small)]


def _small(text_px: int) -> int:
    return max(SMALLEST_TEXT_PX, round(TINY * text_px))


def _boxes(one: Placed) -> list[Box]:
    """What a label and its arrow take up."""
    if one.footprint.downhill is None or one.arrow_length == 0:
        return [one.box]
    ends = np.array([one.arrow_tail, one.arrow_tail + one.arrow_length * one.footprint.downhill])
    extent = np.ptp(ends, axis=0) + 0.6 * one.label.size
    return [one.box, box_around(ends.mean(axis=0), extent)]


def _place_number(footprint: Footprint, taken: Sequence[Box], shape: tuple[int, int], text_px: int) -> Placed:
    """Number of a patch it does not fit into, at the free place nearest to the patch's pole."""
    label = Label((str(footprint.item.id),), _small(text_px))
    reach = REACH * label.size
    low = np.clip(np.floor(footprint.centre - reach), 0, None).astype(int)
    high = np.minimum(np.ceil(footprint.centre + reach).astype(int) + 1, shape[::-1])
    around = np.full((high[1] - low[1], high[0] - low[0]), 255, np.uint8)
    found = find_room(around, low.astype(float), label.extent, footprint.centre, taken)
    centre: FloatArray = footprint.centre if found is None else found
    still = replace(footprint, downhill=None)
    return Placed(still, label, centre, footprint.centre, 0.0, outside=not _lies_on(footprint, centre))


def _lies_on(footprint: Footprint, point: FloatArray) -> bool:
    """Whether a point (2,) of the picture is one of the patch's ground."""
    u, v = np.rint(point - footprint.corner).astype(int)
    height, width = footprint.ground.shape
    return bool(0 <= u < width and 0 <= v < height and footprint.ground[v, u])
