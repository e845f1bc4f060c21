"""A finished answer as it is read back from its files."""

from __future__ import annotations

from dataclasses import dataclass

from slopecli.types import Camera, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class ResultPlane:
    """A plane of slopes.json that is to be compared.

    normals : its unit normal towards camera 1, camera-1 axes; a second one where a second answer is left.
    distance : of the plane from camera 1, in the unit of the scale.  found : whether it was found in the image.
    """

    id: int
    normals: tuple[FloatArray, ...]
    distance: float
    slope_deg: float
    sigma_deg: float | None
    verdict: str | None
    status: str
    polygon_px: FloatArray
    found: bool


@dataclass(frozen=True, eq=False)
class ResultMap:
    """The cells of a map: slope_deg, sigma_deg, p_safe (rows, columns), NaN where not known; px of image 1."""

    slope_deg: FloatArray
    sigma_deg: FloatArray
    p_safe: FloatArray
    spacing_px: int
    footprint_px: float


@dataclass(frozen=True, eq=False)
class Result:
    """An answer: its planes, and what is needed to compare them with the ground.

    labels : (h, w) id of every pixel's plane, None where there is no such file: outlines count then.
    unit : of lengths, "m" or "baseline".  baseline_cam1 : place of camera 2, camera-1 axes, in that unit.
    """

    planes: tuple[ResultPlane, ...]
    cameras: tuple[Camera, Camera]
    up: FloatArray
    unit: str
    baseline_cam1: FloatArray
    tolerance_deg: float
    confidence: float
    labels: IntArray | None
    cells: ResultMap | None = None
