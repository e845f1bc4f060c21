"""Cells of a map: their places in image 1 and the size of their footprints, px."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from slopecli.errors import InputError
from slopecli.ground.footprints import Cells
from slopecli.look.warp import Grid


class GridTunables(NamedTuple):
    """Sizes of cells and footprints."""

    least_footprint_px: float = 12.0  # grid px: smaller discs have no plane that is known to a few degrees
    most_cells: int = 4_000_000  # of a map: 36 MB of numbers a million


GRID = GridTunables()


@dataclass(frozen=True)
class CellGrid:
    """A regular grid of cells over image 1: spacing, and diameter of the footprints, full px of image 1."""

    spacing_px: int
    footprint_px: float

    def over(self, width: int, height: int, grid: Grid) -> Cells:
        """The cells as pixels of a working grid over an image of this size."""
        columns, rows = width // self.spacing_px, height // self.spacing_px
        u, v = ((np.arange(count) + 0.5) * self.spacing_px - 0.5 for count in (columns, rows))
        u = grid.inside(np.column_stack([u, np.zeros(columns)]))[:, 0]
        v = grid.inside(np.column_stack([np.zeros(rows), v]))[:, 1]
        radius_px = 0.5 * self.footprint_px * grid.mean_scale
        return Cells(np.round(u).astype(np.int64), np.round(v).astype(np.int64), radius_px)


def choose_cells(
    width: int, height: int, grid_scale: float, footprint_px: float | None, spacing_px: int | None
) -> CellGrid:
    """The cells of a map of an image of this size; None stands for the default.

    grid_scale : px of the working grid per px of image 1.

    Raises
    ------
    InputError : the footprint is too small to have a plane, or too large for the image; or the cells are too many.
    """
    short = min(width, height)
    footprint_px = float(footprint_px or max(short / 16, GRID.least_footprint_px / grid_scale))
    least, most = GRID.least_footprint_px / grid_scale, 0.5 * short
    if not least - 1e-9 <= footprint_px <= most:
        raise InputError(
            f"a footprint of {footprint_px:.4g} px of image 1 has no plane that can be told; it must be between "
            f"{least:.3g} and {most:.4g} px ({width}x{height} px); change --footprint or --footprint-m"
        )
    spacing_px = spacing_px or max(1, round(footprint_px / 8))
    if spacing_px > short:
        raise InputError(f"cells {spacing_px} px apart leave none in an image of {width}x{height} px; lower --spacing")
    count = (width // spacing_px) * (height // spacing_px)
    if count > GRID.most_cells:
        raise InputError(f"cells {spacing_px} px apart are {count:,}, more than {GRID.most_cells:,}; raise --spacing")
    return CellGrid(spacing_px, footprint_px)
