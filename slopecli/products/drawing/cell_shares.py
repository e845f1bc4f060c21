"""How much of a map some of its cells are: as a share of the picture, and as an area of ground."""

from __future__ import annotations

import numpy as np

from slopecli.ground.slope_map import SlopeMap
from slopecli.types import BoolArray, FloatArray


def cell_area_m2(slope_map: SlopeMap) -> FloatArray | None:
    """Return (rows, columns) the area of ground that cells show, m^2, 0 where no slope is known; None without metres.

    It is that between neighbouring points of the ground, and where those are not known that of a surface which faces
    the camera. The steep sides of steps count no more than such a surface.
    """
    if slope_map.report.scale.unit != "m":
        return None
    camera = slope_map.report.cameras[0]
    facing = (slope_map.spacing_px * slope_map.points[..., 2] / camera.focal_px) ** 2
    area = np.full(facing.shape, np.nan)
    if min(facing.shape) > 1:
        along_rows, along_columns = np.gradient(slope_map.points, axis=(0, 1))
        area = np.linalg.norm(np.cross(along_rows, along_columns), axis=2)
    usable = np.isfinite(area) & ~slope_map.step
    return np.where(slope_map.known, np.nan_to_num(np.where(usable, area, facing)), 0.0)


def share_text(where: BoolArray, area_m2: FloatArray | None = None) -> str:
    """Return the share of the cells in per cent, and their area where that of every cell is given."""
    percent = 100.0 * float(where.mean()) if where.size else 0.0
    share = "0 %" if percent == 0 else "<0.1 %" if percent < 0.1 else f"{percent:.1f} %"
    return share if area_m2 is None else f"{share}, {number_text(float(area_m2[where].sum()))} sq m"


def number_text(value: float) -> str:
    """Return a number with three digits, and all those before the decimal point."""
    if value == 0 or not np.isfinite(value):
        return "0" if value == 0 else "?"
    decimals = 2 - int(np.floor(np.log10(abs(value))))
    return f"{value:.{min(max(decimals, 0), 6)}f}"
