"""Sums over discs, the footprints, around the cells of a map.

Every row of a disc is a difference of two running sums. A disc has as many rows as its diameter, and a map by default
a number of cells that falls with the square of the diameter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slopecli.types import BoolArray, FloatArray, IntArray

ROWS = 64  # rows of cells whose sums are taken together, which bounds the memory


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
    halves = disc_halves(cells.radius_px)
    reach = len(halves) // 2 + 1
    total = np.zeros((len(cells.v), len(cells.u), len(layers)))
    for first in range(0, len(cells.v), ROWS):
        v = cells.v[first : first + ROWS]
        table = _running_sums(layers, int(v[0]) - reach, int(v[-1]) + reach, reach)
        v, u, part = v - v[0] + reach, cells.u + reach, total[first : first + ROWS]
        for row, half in enumerate(halves, start=1 - reach):
            line = table[_regular(v + row)]
            part += line[:, _regular(u + half + 1)]
            part -= line[:, _regular(u - half)]
    return [total[..., k] for k in range(len(layers))]


def _running_sums(layers: Sequence[NDArray[np.floating] | BoolArray], first: int, last: int, margin: int) -> FloatArray:
    """Sums from the left along rows first..last of the layers, (rows, width + 2 margin + 1, k), with zeros around."""
    height, width = layers[0].shape
    top, bottom = max(0, first), min(height, last + 1)
    table = np.zeros((last - first + 1, width + 2 * margin + 1, len(layers)))
    inner = table[top - first : bottom - first]
    for k, layer in enumerate(layers):
        np.cumsum(layer[top:bottom], axis=1, out=inner[:, margin + 1 : margin + width + 1, k], dtype=np.float64)
    inner[:, margin + width + 1 :] = inner[:, margin + width, None]
    return table


def _regular(index: IntArray) -> slice | IntArray:
    """The same indices as a slice where they are evenly spaced, which is several times as fast."""
    step = int(index[1] - index[0]) if len(index) > 1 else 1
    if step > 0 and (np.diff(index) == step).all():
        return slice(int(index[0]), int(index[-1]) + 1, step)
    return index


def disc_halves(radius_px: float) -> IntArray:
    """How many pixels a disc reaches to either side of its middle, in each of its rows."""
    rows = np.arange(-int(radius_px), int(radius_px) + 1)
    return np.floor(np.sqrt(np.maximum(radius_px**2 - rows**2, 0.0)) + 1e-9).astype(np.int64)


def disc_area(radius_px: float) -> int:
    """Number of pixels of a footprint."""
    return int((2 * disc_halves(radius_px) + 1).sum())
