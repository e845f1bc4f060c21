"""What a plane of an urban scene is, from its slope and its height: ground, wall or roof."""

from __future__ import annotations

from typing import Literal

import numpy as np

from slopecli.types import Plane, Report

Kind = Literal["ground", "wall", "roof"]

WALL_DEG = 60.0  # steeper than any roof one walks on, less steep than any wall
GROUND_DEG = 15.0  # streets and gardens are flatter, pitched roofs steeper
LOWEST_SHARE = 0.2  # of the largest level plane's area: smaller level planes do not say where the ground is
SAME_HEIGHT = 0.03  # of the ground's depth below the camera: a level plane this close to it is ground


def plane_kinds(report: Report) -> dict[int, Kind]:
    """Kind of every plane by id: wall if steep, ground if level and as low as the lowest large level plane, else roof.

    As good as the report's `up`: where the largest plane, taken as level, is a facade, its walls are no walls.
    """
    level = [plane for plane in report.planes if _is_level(plane)]
    ground = _ground_depth(report, level)
    return {plane.id: _kind(plane, report, ground) for plane in report.planes}


def _is_level(plane: Plane) -> bool:
    return plane.slope_deg < GROUND_DEG


def _kind(plane: Plane, report: Report, ground: float) -> Kind:
    if plane.slope_deg > WALL_DEG:
        return "wall"
    if _is_level(plane) and _depth_below(plane, report) > ground * (1 - SAME_HEIGHT):
        return "ground"
    return "roof"


def _ground_depth(report: Report, level: list[Plane]) -> float:
    """How far below camera 1 the lowest of the large level planes lies, in the report's unit."""
    if not level:
        return float("inf")
    areas = np.array([plane_share(report, plane) for plane in level])
    depths = np.array([_depth_below(plane, report) for plane in level])
    return float(depths[areas >= LOWEST_SHARE * areas.max()].max())


def _depth_below(plane: Plane, report: Report) -> float:
    """Height of camera 1 over the plane, along up."""
    return plane.distance / float(np.array(report.up.vector_cam1) @ np.asarray(plane.normal_cam1))


def plane_share(report: Report, plane: Plane) -> float:
    """Share of image 1 that the plane holds."""
    return float(np.count_nonzero(report.labels == plane.id) / report.labels.size)
