"""Places on the ground as coordinates of the world: longitude and latitude (WGS 84), and a map projection in metres.

Camera 1 is the origin of axes east, north, up; points of the ground in them are turned into coordinates of the earth
without approximation. The projection is UTM, or polar stereographic (UPS) where there is no UTM.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from slopecli.errors import InputError
from slopecli.options import Position
from slopecli.types import FloatArray, Report

if TYPE_CHECKING:
    from pyproj import Transformer

GEOCENTRIC, GEODETIC = "EPSG:4978", "EPSG:4979"  # WGS 84: x, y, z; longitude, latitude, height above the ellipsoid


@dataclass(frozen=True, eq=False)
class Georeference:
    """Where camera 1 was, and how it was turned.

    enu_from_camera : (3, 3) rotation from camera-1 axes to east (true), north, up.
    tilt_sigma, heading_sigma : 1-sigma of up about a horizontal axis, and of north, rad; scale_sigma : of lengths,
    relative. Each is 0 where it was taken as exact.
    """

    position: Position
    enu_from_camera: FloatArray
    tilt_sigma: float
    heading_sigma: float
    scale_sigma: float

    @classmethod
    def of(cls, report: Report) -> Georeference:
        """That of a report for which `is_georeferenced` holds."""
        place = report.place
        if place is None or place.position is None or place.north_cam1 is None:
            raise InputError("the position of camera 1 or the direction of north is not known; give both")
        up, north = np.array(report.up.vector_cam1), np.array(place.north_cam1)
        up = up / np.linalg.norm(up)
        north = north - (north @ up) * up
        north = north / np.linalg.norm(north)
        return cls(
            place.position,
            np.array([np.cross(north, up), north, up]),
            math.radians(report.up.sigma_deg),
            math.radians(place.heading_sigma_deg or 0.0),
            report.scale.sigma or 0.0,
        )

    def enu(self, points: FloatArray) -> FloatArray:
        """(n, 3) metres east, north, up of camera 1, of points in camera-1 axes."""
        return points @ self.enu_from_camera.T

    def degrees(self, points: FloatArray) -> FloatArray:
        """(n, 2) longitude and latitude of points (n, 3) in camera-1 axes, metres."""
        return self._transformed(self._to_degrees, points)

    def metres(self, points: FloatArray) -> FloatArray:
        """(n, 2) easting and northing of points (n, 3) in camera-1 axes, metres."""
        return self._transformed(self._to_metres, points)

    def sigma_m(self, points: FloatArray) -> FloatArray:
        """(n,) 1-sigma, m, of the places of points (n, 3) in the worse of two horizontal directions.

        By the errors of camera 1's position, of lengths, of north, and of up; those of the matches are smaller.
        """
        east, north, up = self.enu(points).T
        away = np.hypot(east, north)
        turned = np.maximum(self.scale_sigma, self.heading_sigma) * away
        return np.asarray(np.sqrt(self.position.sigma_m**2 + turned**2 + (self.tilt_sigma * up) ** 2))

    @cached_property
    def epsg(self) -> int:
        """Number of the projection in the registry of EPSG."""
        latitude, longitude = self.position.latitude_deg, self.position.longitude_deg
        if latitude > 84.0 or latitude < -80.0:
            return 32661 if latitude > 0.0 else 32761
        zone = int((longitude + 180.0) // 6.0) % 60 + 1
        return (32600 if latitude >= 0.0 else 32700) + zone

    @cached_property
    def projection(self) -> str:
        """Its name: "WGS 84 / UTM zone 32N"."""
        from pyproj import CRS

        return str(CRS.from_epsg(self.epsg).name)

    @cached_property
    def convergence_deg(self) -> float:
        """Azimuth of the projection's north against true north, at camera 1: what to add to its grid bearings."""
        step = 10.0 * np.array([np.zeros(3), self.enu_from_camera[1]])
        (east1, north1), (east2, north2) = self.metres(step)
        return -math.degrees(math.atan2(east2 - east1, north2 - north1))

    @cached_property
    def _geocentric(self) -> tuple[FloatArray, FloatArray]:
        """(3,) geocentric coordinates of camera 1, and (3, 3) rotation from east, north, up to geocentric axes."""
        here = self.position
        lon, lat = math.radians(here.longitude_deg), math.radians(here.latitude_deg)
        east = np.array([-math.sin(lon), math.cos(lon), 0.0])
        up = np.array([math.cos(lat) * math.cos(lon), math.cos(lat) * math.sin(lon), math.sin(lat)])
        origin = _transformer(GEODETIC, GEOCENTRIC).transform(
            here.longitude_deg, here.latitude_deg, here.altitude_m or 0.0
        )
        return np.array(origin), np.column_stack([east, np.cross(up, east), up])

    def _transformed(self, transformer: Transformer, points: FloatArray) -> FloatArray:
        origin, axes = self._geocentric
        x, y, z = (origin + self.enu(np.asarray(points, float).reshape(-1, 3)) @ axes.T).T
        return np.column_stack(transformer.transform(x, y, z)[:2])

    @cached_property
    def _to_degrees(self) -> Transformer:
        return _transformer(GEOCENTRIC, GEODETIC)

    @cached_property
    def _to_metres(self) -> Transformer:
        return _transformer(GEOCENTRIC, f"EPSG:{self.epsg}")


def _transformer(source: str, target: str) -> Any:
    from pyproj import Transformer

    return Transformer.from_crs(source, target, always_xy=True)
