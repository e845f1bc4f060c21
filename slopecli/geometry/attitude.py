"""Attitude of a camera over the ground, and displacement between two places on it.

World axes are north, east, down (NED). A forward-looking body has x along the line of sight, y to the right and z down;
angles are applied in the order yaw, pitch, roll (about z, y, x of the body), as aircraft and gimbals state them. At all
angles zero the camera looks north along the horizon with its image upright; a pitch of -90 degrees looks straight down.
"""

from __future__ import annotations

from math import asin, atan2, cos, degrees, hypot, radians, sin, sqrt
from typing import NamedTuple

import numpy as np

from slopecli.types import FloatArray


class Ellipsoid(NamedTuple):
    """The earth of WGS 84: semi-major axis, m, and first eccentricity squared."""

    semi_major_m: float
    eccentricity2: float


WGS84 = Ellipsoid(6378137.0, 6.69437999014e-3)


def ned_from_camera(yaw_deg: float, pitch_deg: float, roll_deg: float, *, downward: bool = False) -> FloatArray:
    """(3, 3) rotation from camera axes (x right, y down, z forward) to north, east, down.

    downward : whether the camera looks out of the floor of the body, the top of its image ahead, in place of ahead.
    """
    yaw, pitch, roll = (radians(angle) for angle in (yaw_deg, pitch_deg, roll_deg))
    about_z = np.array([[cos(yaw), -sin(yaw), 0.0], [sin(yaw), cos(yaw), 0.0], [0.0, 0.0, 1.0]])
    about_y = np.array([[cos(pitch), 0.0, sin(pitch)], [0.0, 1.0, 0.0], [-sin(pitch), 0.0, cos(pitch)]])
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, cos(roll), -sin(roll)], [0.0, sin(roll), cos(roll)]])
    body_from_camera = [[0, -1, 0], [1, 0, 0], [0, 0, 1]] if downward else [[0, 0, 1], [1, 0, 0], [0, 1, 0]]
    return np.asarray(about_z @ about_y @ about_x @ np.array(body_from_camera, float))


def forward_angles_deg(rotation: FloatArray) -> tuple[float, float, float]:
    """Yaw (0 to 360), pitch and roll of a camera that looks ahead, out of its (3, 3) rotation to north, east, down.

    Straight down or up, where yaw and roll turn about the same axis, the roll is 0.
    """
    body = rotation @ ned_from_camera(0.0, 0.0, 0.0).T
    pitch = asin(max(-1.0, min(1.0, -body[2, 0])))
    if hypot(body[2, 1], body[2, 2]) < 1e-6:
        return degrees(atan2(-body[0, 1], body[1, 1])) % 360.0, degrees(pitch), 0.0
    yaw, roll = atan2(body[1, 0], body[0, 0]), atan2(body[2, 1], body[2, 2])
    return degrees(yaw) % 360.0, degrees(pitch), degrees(roll)


def about_line_of_sight(turn_deg: float) -> FloatArray:
    """(3, 3) rotation of camera axes by which x turns towards y: clockwise in the image."""
    turn = radians(turn_deg)
    return np.array([[cos(turn), -sin(turn), 0.0], [sin(turn), cos(turn), 0.0], [0.0, 0.0, 1.0]])


def ned_displacement(
    latitude1_deg: float, longitude1_deg: float, latitude2_deg: float, longitude2_deg: float, climb_m: float
) -> FloatArray:
    """(3,) metres north, east and down from place 1 to place 2, a few kilometres apart at most.

    climb_m : height of place 2 above place 1.
    """
    middle = radians((latitude1_deg + latitude2_deg) / 2)
    inside = 1.0 - WGS84.eccentricity2 * sin(middle) ** 2
    meridian = WGS84.semi_major_m * (1.0 - WGS84.eccentricity2) / (inside * sqrt(inside))  # radii of curvature
    parallel = WGS84.semi_major_m / sqrt(inside) * cos(middle)
    east = (longitude2_deg - longitude1_deg + 180.0) % 360.0 - 180.0  # across the date line too
    return np.array([radians(latitude2_deg - latitude1_deg) * meridian, radians(east) * parallel, -climb_m])
