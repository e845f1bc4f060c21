"""Classes of slope and of its 1-sigma, as steps of colour whose lightness grows; for maps and point clouds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from slopecli.ground.slope_map import SlopeMap
from slopecli.options import MapOptions
from slopecli.products.drawing.marks import COLOURS, Colour
from slopecli.report.slope_units import SLOPE_UNITS, SlopeUnit, slope_unit_of
from slopecli.types import FloatArray, Report


class NoClass(IntEnum):
    """What stands in place of a class: no slope is known; the footprint lies across a step of the ground."""

    UNKNOWN = -1
    STEP = -2


UNKNOWN, STEP = NoClass
STEP_COLOUR = COLOURS["ink"]
SIGMA_EDGES_DEG = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)
# from dark to light; one side of the tolerance is blue and the other orange, also without red-green vision
RAMPS: dict[str, Sequence[Colour]] = {
    "gentle": ((10, 26, 80), (28, 76, 168), (90, 150, 225), (190, 216, 250)),
    "steep": ((80, 28, 0), (184, 74, 8), (240, 140, 36), (255, 238, 150)),
}


@dataclass(frozen=True, eq=False)
class Classes:
    """Classes of an angle in degrees.

    edges_deg : ascending; class k ends with edge k, which belongs to it, and the last class has no end.
    colours : (n + 1, 3) uint8 RGB; each is lighter than the one before.
    steep_from : the first class beyond the tolerance; None where there is no tolerance among the edges.
    unit : that their names are in.
    """

    edges_deg: tuple[float, ...]
    colours: NDArray[np.uint8]
    steep_from: int | None = None
    unit: SlopeUnit = SLOPE_UNITS["deg"]

    @property
    def names(self) -> list[str]:
        """What a legend calls the classes."""
        return self.unit.classes(self.edges_deg)

    def of(self, angle_deg: ArrayLike) -> NDArray[np.int16]:
        """Return the class of every angle, `UNKNOWN` for one that is not finite."""
        angles = np.asarray(angle_deg, float)
        found = np.searchsorted(self.edges_deg, np.where(np.isfinite(angles), angles, 0.0), side="left")
        return np.where(np.isfinite(angles), found, UNKNOWN).astype(np.int16)


def slope_classes(slope_map: SlopeMap) -> Classes:
    """Return the classes of slope that a user asked for, with the tolerance among their edges."""
    return classes_between(slope_map.classes_deg, slope_map.tolerance_deg, slope_unit_of(slope_map.report.options))


def classes_of(report: Report) -> Classes:
    """Return the classes of slope that the planes of a report are shown in, with its tolerance among their edges."""
    tolerance_deg = float(report.options["tolerance_deg"])
    return classes_between(MapOptions().classes_deg, tolerance_deg, slope_unit_of(report.options))


def classes_between(edges_deg: Sequence[float], tolerance: float, unit: SlopeUnit = SLOPE_UNITS["deg"]) -> Classes:
    """Return the classes of slope between these edges, with the tolerance among them, deg."""
    edges = tuple(sorted({float(edge) for edge in (*edges_deg, tolerance) if edge > 0}))
    steep_from = edges.index(tolerance) + 1
    lightness = np.linspace(20.0, 92.0, len(edges) + 1)  # CIELAB L* of the first class and of the last
    gentle, steep = (_of_lightness(tuple(ramp), lightness) for ramp in RAMPS.values())
    return Classes(edges, np.vstack([gentle[:steep_from], steep[steep_from:]]), steep_from, unit)


def sigma_classes() -> Classes:
    """Return the classes of 1-sigma of a slope, in the colours of viridis."""
    places = np.linspace(0, 255, len(SIGMA_EDGES_DEG) + 1).round().astype(np.uint8)[:, None]
    colours = np.asarray(cv2.applyColorMap(places, cv2.COLORMAP_VIRIDIS)[:, 0, ::-1], np.uint8)
    return Classes(SIGMA_EDGES_DEG, colours)


def cell_classes(slope_map: SlopeMap, classes: Classes) -> NDArray[np.int16]:
    """Return (rows, columns) the class of slope of every cell, or `STEP` or `UNKNOWN`."""
    return np.where(slope_map.step, np.int16(STEP), classes.of(slope_map.slope_deg))


def lightness_of(colours: ArrayLike) -> FloatArray:
    """Return CIELAB L* (0 to 100) of colours (n, 3) sRGB, 0 to 255.

    Computed here, as the first conversion of a process by OpenCV fills tables for 0.1 s.
    """
    stored = np.asarray(colours, float).reshape(-1, 3) / 255.0
    light = np.where(stored <= 0.04045, stored / 12.92, ((stored + 0.055) / 1.055) ** 2.4)  # of sRGB, linear
    luminance = light @ (0.2126, 0.7152, 0.0722)
    # CIE 15: the cube root, and its tangent near black
    return np.where(luminance > (6 / 29) ** 3, 116.0 * np.cbrt(luminance) - 16.0, (29 / 3) ** 3 * luminance)


def _of_lightness(ramp: tuple[Colour, ...], lightness: FloatArray) -> NDArray[np.uint8]:
    """(n, 3) RGB: the colours of a ramp that have a lightness (n,)."""
    fine = _refined(ramp)
    reached = lightness_of(fine)
    return np.column_stack([np.interp(lightness, reached, fine[:, i]) for i in range(3)]).round().astype(np.uint8)


@lru_cache(maxsize=4)
def _refined(ramp: tuple[Colour, ...]) -> FloatArray:
    """(256, 3) RGB of a ramp between its colours."""
    places, steps = np.linspace(0, len(ramp) - 1, 256), np.arange(len(ramp))
    return np.column_stack([np.interp(places, steps, channel) for channel in np.array(ramp, float).T])
