"""Which pixels of image 1 a patch covers: a window's rectangle, or a region of any shape and number of pieces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from slopecli.look.gradient_components import Labels, resized
from slopecli.types import BoolArray, FloatArray
from slopecli.windows import Window, window_polygon


@dataclass(frozen=True, eq=False)
class Footprint:
    """Pixels of image 1: `mask` (h, w) bool, its top left pixel at `corner` (x, y); `polygon_px` (k, 2) the outline,
    of a window along the edges of its pixels, of a region through the outermost pixels of its largest piece."""

    corner: tuple[int, int]
    mask: BoolArray
    polygon_px: FloatArray

    @property
    def area_px(self) -> int:
        """Pixels covered."""
        return int(np.count_nonzero(self.mask))

    @property
    def largest_share(self) -> float:
        """Share of the pixels that the largest connected piece holds; 1 for a patch in one piece."""
        if self.mask.all():
            return 1.0
        _, _, stats, _ = cv2.connectedComponentsWithStats(self.mask.astype(np.uint8), connectivity=8)
        return float(stats[1:, cv2.CC_STAT_AREA].max(initial=0) / max(self.area_px, 1))

    @property
    def bounds(self) -> Window:
        """The rectangle around it."""
        return (*self.corner, int(self.mask.shape[1]), int(self.mask.shape[0]))

    def covers(self, uv: FloatArray) -> BoolArray:
        """(n,) whether pixels (n, 2) of image 1 lie in it."""
        x, y, w, h = self.bounds
        column, row = np.floor(uv[:, 0] + 0.5).astype(int) - x, np.floor(uv[:, 1] + 0.5).astype(int) - y
        inside = (column >= 0) & (column < w) & (row >= 0) & (row < h)
        return np.asarray(inside & self.mask[np.clip(row, 0, h - 1), np.clip(column, 0, w - 1)])


def window_footprint(window: Window) -> Footprint:
    """All pixels of a window."""
    x, y, w, h = window
    return Footprint((x, y), np.ones((h, w), bool), window_polygon(window))


def region_footprints(labels: Labels, shape: tuple[int, int]) -> list[Footprint]:
    """Footprints 1, 2, ... of a label map, enlarged to the image's shape (rows, columns) if it is smaller.

    Labels are consecutive, and each has at least one pixel.
    """
    labels = resized(labels, shape)
    return [_region(labels, number) for number in range(1, int(labels.max()) + 1)]


def _region(labels: Labels, number: int) -> Footprint:
    mask = (labels == number).astype(np.uint8)
    x, y, w, h = cv2.boundingRect(mask)
    mask = mask[y : y + h, x : x + w]
    return Footprint((x, y), mask.astype(bool), _outline(mask) + np.array([x, y]))


def _outline(mask: NDArray[np.uint8]) -> FloatArray:
    """(k, 2) polygon within 1.5 px of the outer border of the largest piece; holes are ignored."""
    contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    largest = max(contours, key=cv2.contourArea)
    simple = np.asarray(cv2.approxPolyDP(largest, 1.5, True), float).reshape(-1, 2)
    if len(simple) >= 3:
        return simple
    low, high = simple.min(0) - 0.5, simple.max(0) + 0.5  # a piece one pixel wide has no contour
    return np.array([low, [high[0], low[1]], high, [low[0], high[1]]])


def paint_labels(footprints: Sequence[Footprint], ids: Sequence[int], shape: tuple[int, int]) -> NDArray[np.uint16]:
    """(h, w) uint16 with each footprint's id on its pixels; where they overlap the later one wins."""
    labels = np.zeros(shape, np.uint16)
    for footprint, number in zip(footprints, ids, strict=True):
        x, y, w, h = footprint.bounds
        labels[y : y + h, x : x + w][footprint.mask] = number
    return labels
