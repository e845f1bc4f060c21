"""Colours of slopes: one fixed range for all files, so that pictures of different pairs can be compared."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from slopecli.types import FloatArray

SLOPE_RANGE_DEG = (0.0, 30.0)  # twice the usual tolerance of landers; fixed, never stretched to the data


def slope_colours(slope_deg: ArrayLike) -> NDArray[np.uint8]:
    """Colour slopes by cividis, which reads the same with and without colour-vision deficiency.

    Source: Nunez, Anderton, Renslow, "Optimizing colormaps with consideration for color vision deficiency", 2018.

    Parameters
    ----------
    slope_deg : (n,) slopes in degrees; those outside `SLOPE_RANGE_DEG` take the colour of the nearer end.

    Returns
    -------
    (n, 3) uint8 RGB.
    """
    low, high = SLOPE_RANGE_DEG
    fraction = np.clip((np.atleast_1d(np.asarray(slope_deg, float)) - low) / (high - low), 0.0, 1.0)
    level = np.rint(255.0 * fraction).astype(np.uint8)
    return _cividis()[level]


def slope_range_colours(places: FloatArray) -> NDArray[np.uint8]:
    """Return colours (n, 3) uint8 RGB along `SLOPE_RANGE_DEG`; places (n,) run from 0 at its low end to 1."""
    low, high = SLOPE_RANGE_DEG
    return slope_colours(low + places * (high - low))


@lru_cache(maxsize=1)
def _cividis() -> NDArray[np.uint8]:
    """(256, 3) RGB of every level; OpenCV makes the map anew at every call."""
    levels = np.arange(256, dtype=np.uint8)[:, None]  # (n, 1): OpenCV 4 and 5 differ on 1-D input
    return np.ascontiguousarray(cv2.applyColorMap(levels, cv2.COLORMAP_CIVIDIS)[:, 0, ::-1])
