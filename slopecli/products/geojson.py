"""slopes.geojson: planes and landing sites as polygons on the earth. Source: RFC 7946."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from slopecli.geometry.camera import points_on_plane
from slopecli.ground.slope_map import Site, SlopeMap
from slopecli.products.georeference import Georeference
from slopecli.products.plane_measures import measures_of
from slopecli.products.slopes_json import rounded
from slopecli.types import FloatArray, Image, Plane, Report


@dataclass(frozen=True)
class _Corners:
    """circle : of that of a site.  side : parts that a side of a footprint is divided into, as lenses bend it."""

    circle: int = 36
    side: int = 8


CORNERS = _Corners()


def encode(report: Report, image: Image) -> bytes:
    """Return the content of slopes.geojson of a report."""
    return _written(report, ())


def encode_map(slope_map: SlopeMap, image: Image) -> bytes:
    """Return the content of slopes.geojson of a map: its windows and its landing sites."""
    place = Georeference.of(slope_map.report)
    sites = (_site(site, slope_map, place) for site in slope_map.sites)
    return _written(slope_map.report, [feature for feature in sites if feature is not None])


def _written(report: Report, sites: Sequence[dict[str, Any]]) -> bytes:
    place = Georeference.of(report)
    planes = (_plane(plane, report, place) for plane in report.planes)
    features = [*(feature for feature in planes if feature is not None), *sites]
    document = {"type": "FeatureCollection", "features": features}
    lines = [json.dumps(feature, allow_nan=False) for feature in features]
    if not lines:
        return (json.dumps(document) + "\n").encode("ascii")
    joined = ",\n".join(lines)
    return f'{{"type": "FeatureCollection", "features": [\n{joined}\n]}}\n'.encode("ascii")


def _plane(plane: Plane, report: Report, place: Georeference) -> dict[str, Any] | None:
    """The footprint of a plane, None where it does not meet the ground in front of the camera."""
    ring = _divided(plane.polygon_px)
    points, met = points_on_plane(report.cameras[0], ring, plane.normal_cam1, plane.distance)
    if not met.all():
        return None
    numbers = measures_of(plane, report)
    properties = {
        "kind": plane.noun,
        "number": plane.id,
        "slope_deg": numbers.slope_deg,
        "slope_sigma_deg": numbers.slope_sigma_deg,
        "slope_percent": numbers.slope_percent,
        "aspect_deg": numbers.aspect_deg,
        "dip_deg": numbers.dip_deg,
        "dip_direction_deg": numbers.dip_direction_deg,
        "strike_deg": numbers.strike_deg,
        "azimuth_sigma_deg": numbers.azimuth_sigma_deg,
        "area_m2": numbers.area,
        "verdict": plane.verdict,
        "p_safe": plane.p_safe,
        "status": plane.status,
        "reason": plane.reason,
    }
    return _feature(points, place, properties)


def _site(site: Site, slope_map: SlopeMap, place: Georeference) -> dict[str, Any] | None:
    """The circle of a landing site around the ground of the cell in its middle."""
    cell = np.floor((np.array(site.centre_px) + 0.5) / slope_map.spacing_px).astype(int)
    rows, columns = slope_map.known.shape
    centre = slope_map.points[min(max(cell[1], 0), rows - 1), min(max(cell[0], 0), columns - 1)]
    if not np.isfinite(centre).all():
        return None
    angle = 2.0 * math.pi * np.arange(CORNERS.circle) / CORNERS.circle
    east, north, _ = place.enu_from_camera
    around = centre + site.radius * (np.outer(np.cos(angle), east) + np.outer(np.sin(angle), north))
    properties = {
        "kind": "site",
        "number": site.id,
        "radius_m": site.radius,
        "slope_deg": site.slope_deg,
        "slope_sigma_deg": site.slope_sigma_deg,
        "verdict": site.verdict,
        "p_safe": site.p_safe,
    }
    return _feature(around, place, properties)


def _feature(ring: FloatArray, place: Georeference, properties: dict[str, Any]) -> dict[str, Any]:
    """A polygon of points (n, 3) in camera-1 axes, with properties and the 1-sigma of its place."""
    sigma = float(place.sigma_m(ring.mean(axis=0, keepdims=True))[0])
    values = {**properties, "position_sigma_m": sigma}
    plain = {name: rounded(value) if isinstance(value, float) else value for name, value in values.items()}
    name = f"{properties['kind']} {properties['number']}"
    return {"type": "Feature", "id": name, "properties": plain, "geometry": _polygon(place.degrees(ring))}


def _polygon(ring: FloatArray) -> dict[str, Any]:
    """Geometry of a ring (n, 2) of longitude and latitude: counter-clockwise, cut where it crosses the date line."""
    ring = ring.copy()
    ring[:, 0] -= 360.0 * np.round((ring[:, 0] - ring[0, 0]) / 360.0)  # no jump between its corners
    x, y = (ring - ring[0]).T
    if float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) < 0.0:
        ring = ring[::-1]
    line = 180.0 * np.sign(ring[0, 0])
    west, east = _half(ring, line, keep_west=True), _half(ring, line, keep_west=False)
    if not len(west) or not len(east):
        return {"type": "Polygon", "coordinates": [_closed(ring)]}
    return {"type": "MultiPolygon", "coordinates": [[_closed(west, line)], [_closed(east, line)]]}


def _half(ring: FloatArray, line: float, *, keep_west: bool) -> FloatArray:
    """The part of a ring on one side of a meridian. Source: Sutherland, Hodgman, 1974."""
    side = (line - ring[:, 0]) * (1.0 if keep_west else -1.0)
    kept: list[FloatArray] = []
    for k, one in enumerate(ring):
        before = k - 1
        if (side[k] > 0.0) != (side[before] > 0.0):
            share = side[before] / (side[before] - side[k])
            kept.append(ring[before] + share * (one - ring[before]))
        if side[k] > 0.0:
            kept.append(one)
    return np.array(kept).reshape(-1, 2)


def _closed(ring: FloatArray, line: float | None = None) -> list[list[float]]:
    """Corners as RFC 7946 wants them: the first once more at the end, within 180 degrees, to a millimetre.

    line : a meridian that the ring may touch, and stays on its side of.
    """
    corners = ring.tolist()
    middle = float(ring[:, 0].mean())
    shift = 360.0 * round((middle - (math.fmod(middle + 540.0, 360.0) - 180.0)) / 360.0)
    written = [[round(lon - shift, 8) + 0.0, round(lat, 8) + 0.0] for lon, lat in corners]
    return [*written, written[0]]


def _divided(ring: FloatArray) -> FloatArray:
    """A ring whose sides are divided, where it has so few that a lens bends them."""
    if len(ring) > CORNERS.circle:
        return ring
    share = np.arange(CORNERS.side)[:, None] / CORNERS.side
    ends = np.roll(ring, -1, axis=0)
    return np.concatenate([one + share * (two - one) for one, two in zip(ring, ends, strict=True)])
