"""Sums over discs, the footprints, around the cells of a map.

A disc is summed as a stack of rectangles of an integral image; up to `MOST_BANDS` px high it is exact.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from slopecli.types import BoolArray, FloatArray, IntArray

MOST_BANDS = 96  # rectangles that a disc is made of: the cost of a sum, however large the disc is
ROWS = 256  # rows of cells whose sums are taken together, which bounds the memory


@dataclass(frozen=True, eq=False)
class Cells:
    """Cells of a map over a working grid: u (columns,) and v (rows,), the pixels their footprints are centred on.

    radius_px : of the footprints, grid px.
    """

    u: IntArray
    v: IntArray
    radius_px: float

    @property
    def shape(self) -> tuple[int, int]:
        return len(self.v), len(self.u)


def disc_sums(layers: Sequence[NDArray[np.floating] | BoolArray], cells: Cells) -> list[FloatArray]:
    """Sums (rows, columns) of each layer (h, w) over the footprints of cells; beyond the border they count as zero."""
    bands, reach = disc_bands(cells.radius_px), int(cells.radius_px)
    height, width = layers[0].shape
    total = np.zeros((len(cells.v), len(cells.u), len(layers)))
    for first in range(0, len(cells.v), ROWS):
        v = cells.v[first : first + ROWS]
        top, bottom = max(0, int(v[0]) - reach), min(height, int(v[-1]) + reach + 1)
        table = np.empty((bottom - top + 1, width + 1, len(layers)))
        for k, layer in enumerate(layers):
            table[..., k] = cv2.integral(np.asarray(layer[top:bottom], np.float32), sdepth=cv2.CV_64F)
        flat, part = table.reshape(-1, len(layers)), total[first : first + ROWS]
        for above, below, half in bands:
            low, high = (np.clip(v + edge - top, 0, bottom - top)[:, None] * (width + 1) for edge in (above, below + 1))
            left, right = (np.clip(cells.u + edge, 0, width) for edge in (-half, half + 1))
            part += flat.take(high + right, axis=0)
            part -= flat.take(high + left, axis=0)
            part -= flat.take(low + right, axis=0)
            part += flat.take(low + left, axis=0)
    return [total[..., k] for k in range(len(layers))]


def disc_bands(radius_px: float) -> list[tuple[int, int, int]]:
    """Rectangles that make up a disc, as (first row, last row, half width) from its centre, px."""
    rows = np.arange(-int(radius_px), int(radius_px) + 1)
    halves = np.floor(np.sqrt(np.maximum(radius_px**2 - rows**2, 0.0)) + 1e-9)
    parts = np.array_split(np.arange(len(rows)), min(MOST_BANDS, len(rows)))
    return [(int(rows[part[0]]), int(rows[part[-1]]), round(float(halves[part].mean()))) for part in parts]


def disc_area(radius_px: float) -> int:
    """Number of pixels of a footprint."""
    return sum((last - first + 1) * (2 * half + 1) for first, last, half in disc_bands(radius_px))
