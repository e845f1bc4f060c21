"""Sums over discs, the footprints, around the cells of a map.

Neighbouring rows of a disc that are as long make a rectangle, whose sum comes from a table of sums over all pixels
above and to the left. Pixels of large discs are first added up in squares.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from slopecli.types import BoolArray, FloatArray, IntArray

COARSE = 12.0  # squares along the radius, for what changes slowly over the image


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


def disc_sums(
    layers: Sequence[NDArray[np.floating] | BoolArray], cells: Cells, along_radius: float = np.inf
) -> list[FloatArray]:
    """Sums (rows, columns) of each layer (h, w) over the footprints of cells; beyond the border they count as zero.

    along_radius : pixels are added up in squares first, as large as leaves so many along the radius of a footprint.
    """
    if (side := _side(cells.radius_px, along_radius)) > 1:
        layers = [_in_squares(layer, side) for layer in layers]
        cells = Cells(cells.u // side, cells.v // side, cells.radius_px / side)
    return [_sums(layer, cells) for layer in layers]


def _sums(layer: NDArray[np.floating] | BoolArray, cells: Cells) -> FloatArray:
    """Sums (rows, columns) of one layer over the footprints, by tables of its sums (Crow 1984)."""
    halves = disc_halves(cells.radius_px)
    reach = len(halves) // 2
    plain: NDArray[Any] = layer.astype(np.uint8) if layer.dtype == np.bool_ else layer
    around = cv2.copyMakeBorder(plain, reach, reach, reach, reach, cv2.BORDER_CONSTANT)
    table = cv2.integral(around, sdepth=cv2.CV_64F)
    flat, width = table.ravel(), table.shape[1]
    first = cells.v[:, None] * width + cells.u  # of the square around a disc: its top left corner
    total = np.zeros(cells.shape)
    begins = np.flatnonzero(np.diff(halves, prepend=-1))
    for top, bottom in pairwise([*begins.tolist(), len(halves)]):
        left, right = reach - int(halves[top]), reach + int(halves[top]) + 1
        total += flat[bottom * width + right :].take(first)
        total -= flat[top * width + right :].take(first)
        total -= flat[bottom * width + left :].take(first)
        total += flat[top * width + left :].take(first)
    return total


def _side(radius_px: float, along_radius: float) -> int:
    """Side of the squares that pixels are added up in, px; 1 for none."""
    return max(1, int(radius_px / along_radius))


def _in_squares(layer: NDArray[np.floating] | BoolArray, side: int) -> NDArray[np.float32]:
    """Sums over squares of pixels, those at the right and at the bottom filled up with zeros."""
    rows, columns = (-(-n // side) for n in layer.shape)
    missing = rows * side - layer.shape[0], columns * side - layer.shape[1]
    whole = cv2.copyMakeBorder(layer.astype(np.float32), 0, missing[0], 0, missing[1], cv2.BORDER_CONSTANT)
    return np.asarray(side**2 * cv2.resize(whole, (columns, rows), interpolation=cv2.INTER_AREA), np.float32)


def disc_halves(radius_px: float) -> IntArray:
    """How many pixels a disc reaches to either side of its middle, in each of its rows."""
    rows = np.arange(-int(radius_px), int(radius_px) + 1)
    return np.floor(np.sqrt(np.maximum(radius_px**2 - rows**2, 0.0)) + 1e-9).astype(np.int64)


def disc_area(radius_px: float, along_radius: float = np.inf) -> int:
    """Number of pixels of a footprint, as `disc_sums` counts them."""
    side = _side(radius_px, along_radius)
    return side**2 * int((2 * disc_halves(radius_px / side) + 1).sum())
