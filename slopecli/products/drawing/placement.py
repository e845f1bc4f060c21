"""Where the labels of the overlay go: inside their patch with the downhill arrow, beside it, or small."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from slopecli.products.drawing.lettering import Box, Label, box_around, find_room
from slopecli.products.drawing.outlines import Footprint
from slopecli.types import AlternativePlane, FloatArray, Plane, Rejected

LARGE, SMALL, TINY = 1.4, 0.8, 0.62  # text sizes over that of the overlay
SMALLEST_TEXT_PX = 9
UNKNOWN = "?"  # in place of a slope that is not known
NARROW_FROM = 6.0  # side of a patch over the text size below which a label in three rows would crowd it


@dataclass(frozen=True, eq=False)
class Placed:
    """A label with its place, its downhill arrow and, if it stands outside its patch, the need of a leader."""

    footprint: Footprint
    label: Label
    centre: FloatArray
    arrow_tail: FloatArray
    arrow_length: float
    outside: bool = False

    @property
    def box(self) -> Box:
        return box_around(self.centre, self.label.extent)

    def leader(self) -> FloatArray:
        """(2, 2) shortest way from the label to the border of its patch."""
        start = np.clip(self.footprint.centre, self.box[:2], self.box[2:])
        corners = self.footprint.polygon
        edges = np.roll(corners, -1, axis=0) - corners
        along = ((start - corners) * edges).sum(axis=1) / np.maximum((edges**2).sum(axis=1), 1e-9)
        nearest = corners + np.clip(along, 0.0, 1.0)[:, None] * edges
        end = nearest[np.argmin(((nearest - start) ** 2).sum(axis=1))]
        return np.array([start, end])


def place_labels(
    footprints: Sequence[Footprint], obstacles: Sequence[Box], shape: tuple[int, int], text_px: int
) -> list[Placed]:
    """Place one label for every patch.

    Labels that fit into their patches come first, then those that find ground beside theirs, then small ones; only
    these may overlap something, when nothing else is left.

    Parameters
    ----------
    footprints : patches on the picture, in the order of their right to a place.
    obstacles : boxes that labels keep clear of.
    shape : height and width of the picture, px.
    text_px : size of the text.
    """
    placed: list[Placed] = []
    taken, waiting = list(obstacles), []
    for footprint in footprints:
        size = round(np.clip(footprint.size / 14, text_px, LARGE * text_px))
        one = place_inside(footprint, full_labels(footprint, size, text_px), taken)
        if one is None:
            waiting.append(footprint)
        else:
            placed.append(one)
            taken.append(one.box)
    free = _free_of(footprints, shape)
    for footprint in waiting:
        one = _place_beside(footprint, free, taken, text_px) or _place_tiny(footprint, taken, text_px)
        placed.append(one)
        taken.append(one.box)
    return placed


def slope_text(plane: Plane) -> tuple[str, str]:
    """Return slope and sigma as a label says them, "12.3°" and "± 0.4°"; "?" for a slope, "" for a sigma not known."""
    sigma = plane.slope_sigma_deg
    if not math.isfinite(sigma):
        return f"{plane.slope_deg:.1f}°", ""
    digits = 0 if sigma >= 9.95 else 1 if sigma >= 0.095 else 2
    slope = f"{plane.slope_deg:.{min(digits, 1)}f}°" if plane.slope_known else UNKNOWN
    return slope, "± <0.01°" if 0 < sigma < 0.005 else f"± {sigma:.{digits}f}°"


def degrees_text(plane: Plane, other: AlternativePlane | None) -> str:
    """Return the slope as a label without room says it; of two that may be true both."""
    either = (plane,) if other is None else (plane, other)
    return " or ".join(f"{one.slope_deg:.0f}°" if one.slope_known else UNKNOWN for one in either)


def full_labels(footprint: Footprint, size: int, text_px: int) -> list[Label]:
    """Return what a label of a patch with room may say, the fullest first."""
    small, name = max(SMALLEST_TEXT_PX, round(SMALL * text_px)), str(footprint.item.id)
    if isinstance(footprint.item, Rejected):
        full = Label((name, footprint.item.reason), size, "rejected")
        return [full, replace(full, size=small)]
    slope, sigma = slope_text(footprint.item)
    if slope == UNKNOWN:
        full = Label((f"{name} {UNKNOWN}", sigma), size, footprint.badge)
        return [full, replace(full, size=small)]
    other = footprint.other
    notes = [] if other is None else [f"or {other.slope_deg:.1f}°" if other.slope_known else f"or {UNKNOWN}"]
    notes += ["poor"] if footprint.item.status == "poor" else []
    full = Label((name, f"{slope} {sigma}".strip(), *notes), size, footprint.badge)
    labels = [full, replace(full, size=small)]
    if sigma and footprint.size >= NARROW_FROM * text_px:
        labels.append(replace(full, rows=(name, slope, sigma, *notes), size=small))
    return labels


def place_inside(footprint: Footprint, labels: Sequence[Label], taken: Sequence[Box]) -> Placed | None:
    """Place the fullest label that fits into the patch together with its arrow, the pair centred as well as can be."""
    for label in labels:
        tail, least = _arrow_from(label, footprint.downhill)
        points = np.array([-label.extent / 2, label.extent / 2, tail + least])
        low, high = points.min(axis=0), points.max(axis=0)
        extent = high - low + 0.5 * label.size
        room = find_room(footprint.ground, np.array(footprint.corner), extent, footprint.centre, taken)
        if room is not None:
            centre = room - (low + high) / 2
            return Placed(footprint, label, centre, centre + tail, _arrow_length(footprint, centre + tail, label.size))
    return None


def _arrow_from(label: Label, downhill: FloatArray | None) -> tuple[FloatArray, FloatArray]:
    """Where the arrow leaves the label, relative to its centre, and the shortest arrow, as vectors (2,)."""
    if downhill is None:
        return np.zeros(2), np.zeros(2)
    reach = (label.extent / 2 / np.maximum(np.abs(downhill), 1e-9)).min() + 0.2 * label.size
    return reach * downhill, 1.6 * label.size * downhill


def _arrow_length(footprint: Footprint, tail: FloatArray, size: int) -> float:
    """As long as the patch allows, up to a fifth of its size; 0 without a downhill direction."""
    if footprint.downhill is None:
        return 0.0
    lengths = np.linspace(1.0, max(1.6 * size, 0.2 * footprint.size), 24)
    ahead = tail + (lengths + 0.5 * size)[:, None] * footprint.downhill - footprint.corner
    columns, rows = np.rint(ahead).astype(int).T
    height, width = footprint.ground.shape
    within = (columns >= 0) & (rows >= 0) & (columns < width) & (rows < height)
    within[within] = footprint.ground[rows[within], columns[within]] > 0
    usable = lengths if within.all() else lengths[: int(np.argmin(within))]
    return float(max([1.4 * size, *usable[-1:]]))


def _free_of(footprints: Sequence[Footprint], shape: tuple[int, int]) -> NDArray[np.uint8]:
    """(h, w) uint8, 255 where there is no patch."""
    free = np.full(shape, 255, np.uint8)
    for footprint in footprints:
        footprint.crop(free)[footprint.mask > 0] = 0
    return free


def _place_beside(footprint: Footprint, free: NDArray[np.uint8], taken: Sequence[Box], text_px: int) -> Placed | None:
    """Label next to a patch too small for it, on ground that no other patch needs; the arrow stays inside."""
    label = full_labels(footprint, text_px, text_px)[1]
    low = np.maximum(np.floor(footprint.corner - 2.2 * label.extent).astype(int), 0)
    high = np.ceil(footprint.corner + 2.2 * label.extent + footprint.mask.shape[::-1]).astype(int)
    around = free[low[1] : high[1], low[0] : high[0]]
    centre = find_room(around, low.astype(float), label.extent + 0.5 * text_px, footprint.centre, taken)
    if centre is None:
        return None
    if footprint.downhill is None:
        return Placed(footprint, label, centre, footprint.centre, 0.0, outside=True)
    length = 0.7 * footprint.size
    return Placed(footprint, label, centre, footprint.centre - 0.5 * length * footprint.downhill, length, outside=True)


def _place_tiny(footprint: Footprint, taken: Sequence[Box], text_px: int) -> Placed:
    """Id and whole degrees for a small patch among others, with the arrow only where it fits."""
    item = footprint.item
    second = (degrees_text(item, footprint.other),) if isinstance(item, Plane) else ()
    label = Label((str(item.id), *second), max(SMALLEST_TEXT_PX, round(TINY * text_px)), footprint.badge)
    still = replace(footprint, downhill=None)
    placed = place_inside(footprint, [label], taken) or place_inside(still, [label], taken)
    return placed or Placed(still, label, footprint.centre, footprint.centre, 0.0)
