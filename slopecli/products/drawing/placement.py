"""Where labels go on a picture: in their patch together with the downhill arrow, beside it, or small."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from slopecli.products.drawing.lettering import Label, full_labels, number_label, shorter_labels, tiny_label
from slopecli.products.drawing.outlines import Footprint
from slopecli.types import FloatArray

Box = tuple[float, float, float, float]  # left, top, right, bottom, px


@dataclass(frozen=True, eq=False)
class Placed:
    """A label with its centre (2,), its downhill arrow (length 0: none), and whether it lies outside its patch; px."""

    footprint: Footprint
    label: Label
    centre: FloatArray
    arrow_tail: FloatArray
    arrow_length: float
    outside: bool = False

    @property
    def box(self) -> Box:
        return box_around(self.centre, self.label.extent)

    @property
    def boxes(self) -> list[Box]:
        """Boxes that label and arrow occupy."""
        if self.footprint.downhill is None or self.arrow_length == 0:
            return [self.box]
        ends = np.array([self.arrow_tail, self.arrow_tail + self.arrow_length * self.footprint.downhill])
        return [self.box, box_around(ends.mean(axis=0), np.ptp(ends, axis=0) + 0.6 * self.label.size)]

    def leader(self) -> FloatArray:
        """(2, 2) shortest line from the label to the border of its patch."""
        start = np.clip(self.footprint.centre, self.box[:2], self.box[2:])
        corners = self.footprint.polygon
        edges = np.roll(corners, -1, axis=0) - corners
        along = ((start - corners) * edges).sum(axis=1) / np.maximum((edges**2).sum(axis=1), 1e-9)
        nearest = corners + np.clip(along, 0.0, 1.0)[:, None] * edges
        end = nearest[np.argmin(((nearest - start) ** 2).sum(axis=1))]
        return np.array([start, end])


# from a patch and the boxes taken: its label inside the patch, or None without room; its label elsewhere
Inside = Callable[[Footprint, Sequence[Box]], Placed | None]
Outside = Callable[[Footprint, Sequence[Box]], Placed]


def place_labels(
    footprints: Sequence[Footprint], obstacles: Sequence[Box], shape: tuple[int, int], text_px: int
) -> list[Placed]:
    """Place one label for every patch.

    Labels that fit into their patches come first, the largest patch first. A window without room gets its label on
    free ground beside it, or a small one across it, which alone may overlap something. Regions are many and of any
    shape: their labels are shortened until they fit, at last to the id alone, in the region or near it.

    Parameters
    ----------
    footprints : patches on the picture.  obstacles : boxes that labels keep clear of.
    shape : height and width of the picture, px.  text_px : size of the text.
    """
    ground = np.full(shape, 255, np.uint8)  # non-zero where a label may lie outside its patch

    def in_region(one: Footprint, taken: Sequence[Box]) -> Placed | None:
        fuller = (full_labels(one, text_px), *shorter_labels(one, text_px))
        return next(filter(None, (_place_with_or_without_arrow(one, labels, taken) for labels in fuller)), None)

    def in_window(one: Footprint, taken: Sequence[Box]) -> Placed | None:
        return _place_inside(one, full_labels(one, text_px), taken, one.downhill)

    def near_window(one: Footprint, taken: Sequence[Box]) -> Placed:
        return _place_beside(one, ground, taken, text_px) or _place_tiny(one, taken, text_px)

    if any(one.pieces is not None for one in footprints):
        return _place(footprints, obstacles, in_region, lambda one, taken: _place_number(one, ground, taken, text_px))
    for one in footprints:
        one.crop(ground)[one.mask > 0] = 0
    return _place(footprints, obstacles, in_window, near_window)


def place_numbers(footprints: Sequence[Footprint], shape: tuple[int, int], text_px: int) -> list[Placed]:
    """Place the id of every patch and nothing else: in it, across it or near it."""
    ground = np.full(shape, 255, np.uint8)
    return _place(
        footprints,
        [],
        lambda footprint, taken: _place_inside(footprint, [Label((str(footprint.item.id),), text_px)], taken, None),
        lambda footprint, taken: _place_number(footprint, ground, taken, text_px),
    )


def _place(footprints: Sequence[Footprint], obstacles: Sequence[Box], inside: Inside, outside: Outside) -> list[Placed]:
    """Place labels inside all patches that have room, largest first, then those of the others."""
    placed: list[Placed] = []
    taken, waiting = list(obstacles), []
    for footprint in sorted(footprints, key=lambda one: -one.size):
        one = inside(footprint, taken)
        if one is None:
            waiting.append(footprint)
        else:
            placed.append(one)
            taken += one.boxes
    for footprint in waiting:
        placed.append(outside(footprint, taken))
        taken.append(placed[-1].box)
    return placed


def _place_with_or_without_arrow(footprint: Footprint, labels: Sequence[Label], taken: Sequence[Box]) -> Placed | None:
    return _place_inside(footprint, labels, taken, footprint.downhill) or _place_inside(footprint, labels, taken, None)


def _place_inside(
    footprint: Footprint, labels: Sequence[Label], taken: Sequence[Box], downhill: FloatArray | None
) -> Placed | None:
    """First label that fits into the patch with an arrow along `downhill` (None: no arrow), nearest to its centre."""
    for label in labels:
        wide = footprint.pieces is None or label.extent.min() <= 2 * footprint.pieces.radius
        if not wide or label.extent.prod() > footprint.size**2:
            continue  # too large for the patch anywhere
        tail, least = _arrow_from(label, downhill)
        points = np.array([-label.extent / 2, label.extent / 2, tail + least])
        low, high = points.min(axis=0), points.max(axis=0)
        extent = high - low + 0.5 * label.size
        room = find_room(footprint.ground, np.array(footprint.corner), extent, footprint.centre, taken)
        if room is not None:
            centre = room - (low + high) / 2
            length = 0.0 if downhill is None else _arrow_length(footprint, downhill, centre + tail, label.size)
            return Placed(footprint, label, centre, centre + tail, length)
    return None


def _arrow_from(label: Label, downhill: FloatArray | None) -> tuple[FloatArray, FloatArray]:
    """Where the arrow leaves the label, relative to its centre, and the shortest arrow, as vectors (2,)."""
    if downhill is None:
        return np.zeros(2), np.zeros(2)
    reach = (label.extent / 2 / np.maximum(np.abs(downhill), 1e-9)).min() + 0.2 * label.size
    return reach * downhill, 1.6 * label.size * downhill


def _arrow_length(footprint: Footprint, downhill: FloatArray, tail: FloatArray, size: int) -> float:
    """Length, px: what the patch allows up to a fifth of its side or 1.6 `size` (of text); at least 1.4 `size`."""
    lengths = np.linspace(1.0, max(1.6 * size, 0.2 * footprint.size), 24)
    within = [_lies_on(footprint, tail + (length + 0.5 * size) * downhill) for length in lengths]
    usable = lengths if all(within) else lengths[: within.index(False)]
    return float(max([1.4 * size, *usable[-1:]]))


def _place_beside(footprint: Footprint, free: NDArray[np.uint8], taken: Sequence[Box], text_px: int) -> Placed | None:
    """Label next to a patch too small for it, on ground that no patch needs; the arrow stays inside."""
    label, corner = full_labels(footprint, text_px)[1], np.array(footprint.corner)
    reach = 2.2 * label.extent
    low, high = corner - reach, corner + footprint.mask.shape[::-1] + reach
    centre = _room_near(footprint, free, (low, high), label.extent + 0.5 * text_px, taken)
    if centre is None:
        return None
    length = 0.0 if footprint.downhill is None else 0.7 * footprint.size
    tail = footprint.centre if footprint.downhill is None else footprint.centre - 0.5 * length * footprint.downhill
    return Placed(footprint, label, centre, tail, length, outside=True)


def _place_tiny(footprint: Footprint, taken: Sequence[Box], text_px: int) -> Placed:
    """Id and whole degrees for a small patch among others, with the arrow only where it fits."""
    label = tiny_label(footprint, text_px)
    return _place_with_or_without_arrow(footprint, [label], taken) or Placed(
        footprint, label, footprint.centre, footprint.centre, 0.0
    )


def _place_number(footprint: Footprint, ground: NDArray[np.uint8], taken: Sequence[Box], text_px: int) -> Placed:
    """Id of a patch without room for it: in the free place nearest to its centre, at the centre if none is near."""
    label, centre = number_label(footprint, text_px), footprint.centre
    reach = 8 * label.size
    found = _room_near(footprint, ground, (centre - reach, centre + reach + 1), label.extent, taken)
    place = centre if found is None else found
    return Placed(footprint, label, place, centre, 0.0, outside=not _lies_on(footprint, place))


def _lies_on(footprint: Footprint, point: FloatArray) -> bool:
    """Whether a point (2,) of the picture, px, lies where the patch may have its label."""
    u, v = np.rint(point - footprint.corner).astype(int)
    height, width = footprint.ground.shape
    return bool(0 <= u < width and 0 <= v < height and footprint.ground[v, u])


def _room_near(
    footprint: Footprint,
    free: NDArray[np.uint8],
    within: tuple[FloatArray, FloatArray],
    extent: FloatArray,
    taken: Sequence[Box],
) -> FloatArray | None:
    """Free place for a box near a patch, as `find_room`; `within` : two corners (2,) of the part to search, px."""
    low = np.clip(np.floor(within[0]), 0, None).astype(int)
    high = np.ceil(within[1]).astype(int)
    return find_room(free[low[1] : high[1], low[0] : high[0]], low.astype(float), extent, footprint.centre, taken)


def find_room(
    mask: NDArray[np.uint8], corner: FloatArray, extent: FloatArray, wish: FloatArray, taken: Sequence[Box]
) -> FloatArray | None:
    """Find the place nearest to `wish` where a box lies wholly on the mask and on nothing taken.

    Parameters
    ----------
    mask : (h, w) uint8, non-zero where the box may lie.
    corner : (2,) px of the mask's first pixel in the picture; the other points are in the picture too.
    extent : (2,) width and height of the box, px.
    wish : (2,) wanted centre of the box.
    taken : boxes to keep clear of.

    Returns
    -------
    (2,) centre of the box, or None when it fits nowhere.
    """
    step = max(1.0, max(mask.shape) / 80)  # a grid of at most 80 cells a side is searched
    shape = [max(1, round(side / step)) for side in mask.shape]
    cells = cv2.resize(mask, (shape[1], shape[0]), interpolation=cv2.INTER_NEAREST)
    for left, top, right, bottom in _in_cells(taken, corner, mask.shape, step):
        cells[top:bottom, left:right] = 0
    kernel = np.ones([max(1, int(np.ceil(side / step))) for side in extent[::-1]], np.uint8)
    free = cv2.erode(cells, kernel, borderType=cv2.BORDER_CONSTANT, borderValue=0)
    rows, columns = np.nonzero(free)
    if not len(rows):
        return None
    centres = (np.column_stack([columns, rows]) + 0.5) * step - 0.5 + corner
    return np.asarray(centres[np.argmin(((centres - wish) ** 2).sum(axis=1))])


def _in_cells(taken: Sequence[Box], corner: FloatArray, shape: tuple[int, ...], step: float) -> NDArray[np.int64]:
    """(n, 4) left, top, right, bottom of the boxes that touch the mask, in cells of `step` px from its first pixel."""
    boxes = (np.array(taken, float).reshape(-1, 4) - np.tile(corner, 2)) / step
    ends = np.tile(np.array(shape[1::-1]) / step, 2)
    cells = np.clip(np.column_stack([np.floor(boxes[:, :2]), np.ceil(boxes[:, 2:])]), 0, np.ceil(ends)).astype(np.int64)
    return np.asarray(cells[(cells[:, 2:] > cells[:, :2]).all(axis=1)])


def box_around(centre: FloatArray, extent: FloatArray) -> Box:
    """Return the box of a given width and height around a centre."""
    left, top = np.asarray(centre) - extent / 2
    return (float(left), float(top), float(left + extent[0]), float(top + extent[1]))
