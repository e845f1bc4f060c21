"""The nouns of a map: the map itself, its landing sites, and what slopes.json says of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slopecli.types import BoolArray, FloatArray, Report, Verdict

AREAS = "safe", "unsafe", "undecided", "unknown"  # verdicts of cells


@dataclass(frozen=True, eq=False)
class Site:
    """A disc of ground to land on. Lengths without a suffix are in the unit of the scale.

    centre_px : in image 1; centre_image2_px in image 2, None where that does not show it.
    radius_px, radius : of the disc, in image 1 and on the ground: every footprint whose ground lies in it is safe.
    slope_deg : of the plane of the disc.  above_plane_max, below_plane_max : largest heights off it.
    p_safe : the least of its cells.  direction_cam1, direction_cam2 : unit vectors from the cameras to the centre.
    lander_slope_deg, lander_clearance : the steepest stand of a lander on its pads over all headings, and the highest
        ground above the plane of its pads; None without a lander.
    """

    id: int
    centre_px: tuple[float, float]
    radius_px: float
    radius: float
    slope_deg: float
    slope_sigma_deg: float
    above_plane_max: float
    below_plane_max: float
    p_safe: float
    verdict: Verdict
    centre_image2_px: tuple[float, float] | None
    direction_cam1: tuple[float, float, float]
    direction_cam2: tuple[float, float, float] | None
    lander_slope_deg: float | None = None
    lander_clearance: float | None = None


@dataclass(frozen=True)
class MapInfo:
    """What slopes.json says of a map; the dataclass has its keys under "map".

    footprint : diameter of a footprint on the ground in the middle of the map, in the unit of the scale.
    valid_share : of all cells, those with a slope.  area_share : of the cells, by verdict; they add up to 1.
    median_sigma_deg : of the slopes; median_sigma_causes_deg : parts of it, whose squares add up to its square.
    """

    file: str
    spacing_px: int
    footprint_px: float
    footprint: float
    bands: tuple[str, ...]
    valid_share: float
    area_share: dict[str, float]
    median_sigma_deg: float | None = None
    median_sigma_causes_deg: dict[str, float] | None = None


@dataclass(frozen=True, eq=False)
class CellArrays:
    """Ground around every cell of a map: arrays (rows, columns), NaN where not known; `SlopeMap` explains them."""

    slope_deg: FloatArray
    sigma_deg: FloatArray
    p_safe: FloatArray
    aspect_deg: FloatArray
    roughness: FloatArray
    above_plane_max: FloatArray
    below_plane_max: FloatArray
    distance: FloatArray
    valid_share: FloatArray
    step: BoolArray
    points: FloatArray


@dataclass(frozen=True, eq=False)
class SlopeMap(CellArrays):
    """Ground around every cell of a regular grid over image 1: arrays (rows, columns), NaN where it is not known.

    The cell of row i and column j has its centre at px ((j + 0.5) spacing_px - 0.5, (i + 0.5) spacing_px - 0.5) of
    image 1. Its footprint is a disc of `footprint_px` around that; the plane of a footprint is the one nearest to its
    ground by perpendicular distance. Lengths are in the unit of `report.scale`.

    slope_deg, sigma_deg, aspect_deg : of that plane; aspect_deg is NaN where the slope is below twice its sigma.
    p_safe : probability that the footprint is safe: not steeper than the tolerance, nothing higher than `max_height`.
    roughness : RMS distance of the ground off the plane.  above_plane_max, below_plane_max : largest distances.
    distance : from camera 1 to the ground in the middle.  valid_share : of the footprint's pixels, those matched.
    step : whether the footprint lies across a step of the ground; such a footprint is never safe.
    points : (rows, columns, 3) ground in the middle of every cell, camera-1 axes, in the unit of the scale.
    sigma_causes_deg : parts of the median 1-sigma by cause, whose squares add up to its square; None without any slope.
    sites : landing sites, best first.  no_site : where there is none, what came nearest and what it lacks.
    """

    spacing_px: int
    footprint_px: float
    footprint: float
    tolerance_deg: float
    confidence: float
    classes_deg: tuple[float, ...]
    sites: tuple[Site, ...]
    no_site: str
    north_cam1: tuple[float, float, float] | None
    report: Report
    sigma_causes_deg: dict[str, float] | None = None

    @property
    def known(self) -> BoolArray:
        """Cells with a slope."""
        return np.asarray(np.isfinite(self.slope_deg))

    @property
    def median_sigma_deg(self) -> float | None:
        """Median 1-sigma of the slopes; None without any."""
        sigmas = self.sigma_deg[self.known]
        return float(np.median(sigmas)) if sigmas.size else None

    @property
    def area_share(self) -> dict[str, float]:
        """Share of all cells by verdict; together they are 1."""
        verdicts = self.verdicts
        return {name: float((verdicts == name).sum() / max(verdicts.size, 1)) for name in AREAS}

    @property
    def verdicts(self) -> NDArray[np.str_]:
        """(rows, columns) "safe", "unsafe", "undecided", or "unknown"."""
        by_chance = np.select(
            [self.p_safe >= self.confidence, self.p_safe <= 1.0 - self.confidence], ["safe", "unsafe"], "undecided"
        )
        return np.where(self.known, by_chance, "unknown")
