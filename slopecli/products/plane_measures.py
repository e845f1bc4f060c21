"""What surveyors, roofers and geologists call the tilt of a plane, and its area on the ground."""

from __future__ import annotations

import math
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from slopecli.geometry.camera import points_on_plane, rays_from_pixels
from slopecli.geometry.epipolar import homogeneous
from slopecli.report.kinds import plane_pixels
from slopecli.report.slope_units import SLOPE_UNITS
from slopecli.types import Camera, FloatArray, Plane, Report


@dataclass(frozen=True)
class PlaneMeasures:
    """Numbers of a plane; None where one is not known, or does not exist.

    slope_deg, slope_sigma_deg, aspect_deg : as in slopes.json, None where the slope is not known.
    slope_percent, slope_in_12 : rise over a run of 100 and of 12; None where `SlopeUnit` tells slopes in degrees.
    dip_deg : of the plane itself, 0..90.  dip_direction_deg : azimuth of its descent.
    strike_deg : azimuth of its level line, from which it dips to the right.
    azimuth_sigma_deg : 1-sigma of aspect, dip direction and strike.
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
    azimuth_sigma_deg: float | None
    area: float | None


def measures_of(plane: Plane, report: Report) -> PlaneMeasures:
    """The measures of a plane of a report."""
    area = _areas(report).get(plane.id)
    if not plane.slope_known:
        return PlaneMeasures(None, plane.slope_sigma_deg, None, None, None, None, None, None, None, area)
    slope, direction = plane.slope_deg, plane.dip_direction_deg
    rise = math.tan(math.radians(slope)) if SLOPE_UNITS["percent"].has(slope) else None
    return PlaneMeasures(
        slope_deg=slope,
        slope_sigma_deg=plane.slope_sigma_deg,
        slope_percent=None if rise is None else 100.0 * rise,
        slope_in_12=None if rise is None else 12.0 * rise,
        aspect_deg=plane.aspect_deg,
        dip_deg=min(slope, 180.0 - slope),
        dip_direction_deg=direction,
        strike_deg=None if direction is None else (direction - 90.0) % 360.0,
        azimuth_sigma_deg=plane.azimuth_sigma_deg,
        area=area,
    )


def centre_of(plane: Plane, report: Report) -> FloatArray | None:
    """(3,) point of a plane in the middle of its outline, camera-1 axes; None where that is not in front of it."""
    middle = plane.polygon_px.mean(axis=0, keepdims=True)
    points, met = points_on_plane(report.cameras[0], middle, plane.normal_cam1, plane.distance)
    return points[0] if met.all() else None


_AREAS: WeakKeyDictionary[Report, dict[int, float]] = WeakKeyDictionary()


def _areas(report: Report) -> dict[int, float]:
    """Area of every plane of a report, by id, where it is known; made once for all files of it."""
    if report not in _AREAS:
        found = [plane for plane in report.planes if plane.found]
        outlined = [plane for plane in report.planes if not plane.found]
        of_found = _areas_of_pixels(found, report) if found else {}
        _AREAS[report] = {**of_found, **(_areas_of_outlines(outlined, report.cameras[0]) if outlined else {})}
    return _AREAS[report]


def _areas_of_outlines(planes: list[Plane], camera: Camera) -> dict[int, float]:
    """Area within the outline of every plane on it, by id, of those whose corners all meet it in front of camera 1."""
    corners = np.array([len(plane.polygon_px) for plane in planes])
    first, outlines = np.cumsum(corners) - corners, np.concatenate([plane.polygon_px for plane in planes])
    normals = np.repeat([plane.normal_cam1 for plane in planes], corners, axis=0)
    distances = np.repeat([plane.distance for plane in planes], corners)
    points, met = points_on_plane(camera, outlines, normals, distances)
    spokes = points - np.repeat(points[first], corners, axis=0)
    # the side that leads from one outline to the next has no area, as the first spoke of each is 0
    sides = np.cross(spokes, np.roll(spokes, -1, axis=0))
    areas = 0.5 * np.abs(np.add.reduceat((sides * normals).sum(axis=1), first))
    whole = np.logical_and.reduceat(met, first).tolist()
    return {plane.id: area for plane, area, met in zip(planes, areas.tolist(), whole, strict=True) if met}


def _areas_of_pixels(planes: list[Plane], report: Report) -> dict[int, float]:
    """Area of the pixels of every plane on it, by id.

    The image is divided into at most as many squares as tell the sum to its last printed digit. A square of area A in
    normalised coordinates covers A d^2 / |n.r|^3 of the plane n.P = -d that its ray r meets.
    """
    height, width = report.labels.shape
    step = max(1, math.isqrt(report.labels.size // 200_000))
    v, u = np.mgrid[0 : height // step * step + 1 : step, 0 : width // step * step + 1 : step]
    nodes = rays_from_pixels(report.cameras[0], np.column_stack([u.ravel(), v.ravel()]) - 0.5).reshape(*u.shape, 2)
    falling, rising = nodes[1:, 1:] - nodes[:-1, :-1], nodes[1:, :-1] - nodes[:-1, 1:]
    square = np.abs(falling[..., 0] * rising[..., 1] - falling[..., 1] * rising[..., 0]).ravel() / 2.0
    rays = homogeneous(((nodes[1:, 1:] + nodes[:-1, :-1]) / 2.0).reshape(-1, 2))
    label = report.labels[v[:-1, :-1].ravel() + step // 2, u[:-1, :-1].ravel() + step // 2]
    areas = [(plane.id, _covered(plane, rays[label == plane.id], square[label == plane.id])) for plane in planes]
    return {i: float(mean * plane_pixels(report)[i] / step**2) for i, mean in areas if mean > 0.0}


def _covered(plane: Plane, rays: FloatArray, square: FloatArray) -> float:
    """Mean area on a plane of the squares that meet it in front of the camera; 0 where none does."""
    incidence = -(rays @ plane.normal_cam1)
    met = incidence > 0.01 * np.linalg.norm(rays, axis=1)
    return float((square[met] * plane.distance**2 / incidence[met] ** 3).sum() / max(len(rays), 1))
