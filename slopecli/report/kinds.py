"""How planes are shown: many windows as a map; those of a built scene as ground, wall, roof or ceiling."""

from __future__ import annotations

from typing import Literal
from weakref import WeakKeyDictionary

import numpy as np

from slopecli.findings.plane_checks import WALL_DEG
from slopecli.geometry.camera import points_on_plane
from slopecli.geometry.statistics import median
from slopecli.look.noise import APART
from slopecli.options import MANY_WINDOWS
from slopecli.patches.patch import IN_DOUBT_DEG
from slopecli.types import FloatArray, Plane, Report

Kind = Literal["ground", "wall", "roof", "ceiling"]

LEVEL_DEG = 15.0  # streets and squares are flatter than this; flat roofs are higher
LARGE = 0.1  # of the area of the largest level plane: a smaller one below it may be a mistake, or a pit
LEAST_CEILING = 0.02  # share of image 1: what is smaller and faces down is part of a tree, or of a person
SHOWN = 0.005  # share of image 1 from which on a plane matters
POOR_COUNTS = 0.25  # what a share counts of a plane that is poor, or that nothing tells the slope of


def many_windows(report: Report) -> bool:
    """Whether it has so many windows that they are shown as a map and counted, not listed one by one."""
    return len(report.planes) + len(report.rejected) >= MANY_WINDOWS and report.noun == "window"


_PIXELS: WeakKeyDictionary[Report, dict[int, int]] = WeakKeyDictionary()  # of `plane_pixels`, while a report lives


def plane_pixels(report: Report) -> dict[int, int]:
    """Return the number of pixels of image 1 that every plane of the report holds, by id; counted once."""
    if report not in _PIXELS:
        counts = np.zeros(1 + max(int(report.labels.max()), *(plane.id for plane in report.planes), 0), np.int64)
        # a few rows at a time: to count, NumPy makes every label eight bytes long
        for rows in np.array_split(report.labels, 1 + report.labels.size // 2**20):
            counts += np.bincount(rows.ravel(), minlength=len(counts))
        _PIXELS[report] = {plane.id: int(counts[plane.id]) for plane in report.planes}
    return _PIXELS[report]


def plane_shares(report: Report) -> dict[int, float]:
    """Return the share of image 1, 0..1, that every plane of the report holds, by id."""
    return {number: count / report.labels.size for number, count in plane_pixels(report).items()}


def main_planes(report: Report) -> set[int]:
    """Return the ids of the planes that matter by their evidence and area; the largest one in any case."""
    weight = {
        plane.id: share * (1.0 if plane.status == "ok" and plane.slope_known else POOR_COUNTS)
        for plane, share in zip(report.planes, plane_shares(report).values(), strict=True)
    }
    least = min(SHOWN, max(weight.values(), default=0.0))
    return {number for number, one in weight.items() if one >= least}


def plane_kinds(report: Report) -> dict[int, Kind | None]:
    """Kind of every plane of the report by id; it is only as good as the report's up direction.

    A plane steeper than 60 degrees is a wall. One that faces down, beyond 120 degrees, is a ceiling, or None where it
    is poor, small or in doubt, as facets of trees and people are. The others are ground if their low end is on the
    ground or below it, roof if it is above: any surface that stands on something.
    The ground is the lowest of the large level planes, extended. Without a level plane there is no height that tells
    ground from roof, and the kind is None; of all planes where what is level is in doubt.
    """
    if report.up.otherwise_cam1 is not None:  # what is level is in doubt
        return dict.fromkeys((plane.id for plane in report.planes), None)
    outlines = {plane.id: _outline(plane, report) for plane in report.planes}
    ground = _ground(report, outlines)
    shares = plane_shares(report)
    return {plane.id: _kind(plane, outlines[plane.id], ground, shares[plane.id]) for plane in report.planes}


def _kind(plane: Plane, outline: FloatArray, ground: Plane | None, share: float) -> Kind | None:
    if plane.slope_deg > 180.0 - WALL_DEG:
        surely = plane.status == "ok" and (plane.slope_sigma_deg or 0.0) < IN_DOUBT_DEG and share >= LEAST_CEILING
        return "ceiling" if surely else None
    if plane.slope_deg > WALL_DEG:
        return "wall"
    if ground is None:
        return None
    # height of its lower end (10 % of its outline) above the ground, over its distance to the camera
    height = (outline @ ground.normal_cam1 + ground.distance) / np.linalg.norm(outline, axis=1)
    return "roof" if len(height) and np.quantile(height, 0.1) >= APART else "ground"


def _outline(plane: Plane, report: Report) -> FloatArray:
    """(n, 3) points of a plane's outline in camera-1 axes, without those towards its horizon."""
    points, met = points_on_plane(report.cameras[0], plane.polygon_px, plane.normal_cam1, plane.distance)
    return points[met]


def _ground(report: Report, outlines: dict[int, FloatArray]) -> Plane | None:
    """The lowest of the large level planes along up, None where no plane is level."""
    flat = [
        plane
        for plane in report.planes
        if plane.slope_deg < LEVEL_DEG and (plane.slope_sigma_deg or 0.0) < IN_DOUBT_DEG
    ]
    level = [plane for plane in flat if len(outlines[plane.id])]
    shares, up = plane_shares(report), np.array(report.up.vector_cam1)
    least = LARGE * max((shares[plane.id] for plane in level), default=0.0)
    large = [plane for plane in level if shares[plane.id] >= least]
    return min(large, key=lambda plane: median(outlines[plane.id] @ up), default=None)
