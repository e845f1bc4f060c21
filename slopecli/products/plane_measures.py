"""What surveyors, roofers and geologists call the tilt of a plane, and its area on the ground."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from slopecli.geometry.camera import points_on_plane
from slopecli.types import FloatArray, Plane, Report


@dataclass(frozen=True)
class PlaneMeasures:
    """Numbers of a plane; None where one is not known, or does not exist.

    slope_deg, slope_sigma_deg, aspect_deg : as in slopes.json, None where the slope is not known.
    slope_percent, slope_in_12 : rise over a run of 100 and of 12; None of a wall and an overhang.
    dip_deg : of the plane itself, 0..90.  dip_direction_deg : azimuth of its descent.
    strike_deg : azimuth of its level line, from which it dips to the right.
    area : of its footprint, in the unit of the scale squared.
    """

    slope_deg: float | None
    slope_sigma_deg: float | None
    slope_percent: float | None
    slope_in_12: float | None
    aspect_deg: float | None
    dip_deg: float | None
    dip_direction_deg: float | None
    strike_deg: float | None
    area: float | None


def measures_of(plane: Plane, report: Report) -> PlaneMeasures:
    """The measures of a plane of a report."""
    area = _area_of_pixels(plane, report) if plane.found else _area_of_outline(plane, report)
    if not plane.slope_known:
        return PlaneMeasures(None, plane.slope_sigma_deg, None, None, None, None, None, None, area)
    slope, direction = plane.slope_deg, plane.dip_direction_deg
    rise = math.tan(math.radians(slope)) if slope < 89.95 else None  # beyond, the last digit of the slope decides
    return PlaneMeasures(
        slope_deg=slope,
        slope_sigma_deg=plane.slope_sigma_deg,
        slope_percent=None if rise is None else 100.0 * rise,
        slope_in_12=None if rise is None else 12.0 * rise,
        aspect_deg=plane.aspect_deg,
        dip_deg=min(slope, 180.0 - slope),
        dip_direction_deg=direction,
        strike_deg=None if direction is None else (direction - 90.0) % 360.0,
        area=area,
    )


def centre_of(plane: Plane, report: Report) -> FloatArray | None:
    """(3,) point of a plane in the middle of its outline, camera-1 axes; None where that is not in front of it."""
    middle = plane.polygon_px.mean(axis=0, keepdims=True)
    points, met = points_on_plane(report.cameras[0], middle, plane.normal_cam1, plane.distance)
    return points[0] if met.all() else None


def _area_of_outline(plane: Plane, report: Report) -> float | None:
    """Area within the outline on the plane; None where a corner does not meet it in front of the camera."""
    points, met = points_on_plane(report.cameras[0], plane.polygon_px, plane.normal_cam1, plane.distance)
    if not met.all():
        return None
    spokes = points - points[0]
    return float(abs(np.cross(spokes[:-1], spokes[1:]).sum(axis=0) @ plane.normal_cam1) / 2.0)


def _area_of_pixels(plane: Plane, report: Report) -> float | None:
    """Sum of the areas of a plane's pixels on it, of those that meet it; None where none does."""
    v, u = np.nonzero(report.labels == plane.id)
    stride = max(1, len(u) // 100_000)  # as many tell the sum of a smooth function to its last printed digit
    pixels = np.column_stack([u, v])[::stride].astype(float)
    ends = [(0.5, 0.0), (-0.5, 0.0), (0.0, 0.5), (0.0, -0.5)]
    laid = [points_on_plane(report.cameras[0], pixels + end, plane.normal_cam1, plane.distance) for end in ends]
    met = np.logical_and.reduce([ok for _, ok in laid])
    if not met.any():
        return None
    (right, left, down, up) = (points[met] for points, _ in laid)
    return float(np.linalg.norm(np.cross(right - left, down - up), axis=1).sum() * len(u) / len(pixels))
