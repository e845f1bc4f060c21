"""Ground, wall or roof: the kind of a plane by its slope and its height, seen from above and at an angle."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from report_factory import make_camera, make_labels, make_plane, make_report, normal_of, rectangle

from slopecli.report import main_planes, plane_kinds, plane_shares
from slopecli.types import Plane, Report, Up

CAMERA = make_camera()  # 640x480, looks straight down from height 1 where nothing else is said
LEFT, MIDDLE, RIGHT = rectangle(10, 10, 190, 460), rectangle(220, 10, 190, 460), rectangle(430, 10, 190, 460)


def plane(
    plane_id: int, polygon: np.ndarray, slope_deg: float, height: float = 0.0, azimuth_deg: float = 90.0
) -> Plane:
    """A plane whose point under the middle of the polygon is this high above the ground, 1 below the camera."""
    ray = np.linalg.inv(CAMERA.K) @ [*polygon.mean(axis=0), 1.0]
    distance = float(-normal_of(slope_deg, azimuth_deg) @ ray * (1.0 - height))
    return make_plane(plane_id, polygon, slope_deg, 0.5, azimuth_deg, CAMERA, source="region", distance=distance)


def report_of(planes: Sequence[Plane], **changes: object) -> Report:
    return make_report(CAMERA, [], planes=tuple(planes), labels=make_labels(CAMERA, planes), rejected=(), **changes)


def kinds_of(*planes: Plane) -> list[str | None]:
    kinds = plane_kinds(report_of(planes))
    return [kinds[one.id] for one in planes]


GROUND = plane(1, LEFT, 0.0)


@pytest.mark.parametrize(
    ("slope_deg", "kind"), [(59.0, "roof"), (61.0, "wall"), (90.0, "wall"), (119.0, "wall"), (121.0, "ceiling")]
)
def test_what_is_steep_is_a_wall(slope_deg: float, kind: str) -> None:
    assert kinds_of(GROUND, plane(2, MIDDLE, slope_deg, 0.7)) == ["ground", kind]


@pytest.mark.parametrize(("height", "kind"), [(-0.2, "ground"), (0.01, "ground"), (0.05, "roof"), (0.4, "roof")])
def test_what_is_level_is_ground_or_roof_by_its_height(height: float, kind: str) -> None:
    small = plane(2, rectangle(500, 100, 40, 40), 2.0, height)
    assert kinds_of(GROUND, small) == ["ground", kind]


def test_a_slope_that_comes_down_to_the_ground_is_no_roof() -> None:
    bank = plane(2, MIDDLE, 30.0, 0.09)
    assert kinds_of(GROUND, bank) == ["ground", "ground"]
    assert kinds_of(GROUND, plane(2, MIDDLE, 30.0, 0.25)) == ["ground", "roof"]


def test_the_ground_is_low_even_where_roofs_are_larger() -> None:
    roof = plane(1, rectangle(10, 10, 400, 460), 0.5, 0.3)
    assert kinds_of(roof, plane(2, RIGHT, 0.5)) == ["roof", "ground"]


def test_a_small_pit_does_not_make_the_street_a_roof() -> None:
    assert kinds_of(GROUND, plane(2, rectangle(500, 100, 40, 40), 0.5, -0.3)) == ["ground", "ground"]


def test_a_street_that_climbs_is_ground_all_along() -> None:
    """8 degrees: its ends differ by more than a tenth of their distance in height, and are on the same plane."""
    outlines, climb = (LEFT, MIDDLE, RIGHT), math.tan(math.radians(8.0))
    across = [(outline.mean(axis=0)[0] - CAMERA.cx) / CAMERA.fx for outline in outlines]
    # the point of a ray (x, y, 1) on a plane that falls to the right from height 1 below the camera
    heights = [1.0 - 1.0 / (1.0 - climb * x) for x in across]
    assert heights[0] - heights[2] > 0.1
    street, end = plane(1, LEFT, 8.0, heights[0]), plane(3, RIGHT, 8.0, heights[2])
    assert kinds_of(street, plane(2, MIDDLE, 8.0, heights[1] + 0.05), end) == ["ground", "roof", "ground"]


def test_without_a_level_plane_there_is_no_ground_to_stand_on() -> None:
    assert kinds_of(plane(1, LEFT, 40.0, 0.2), plane(2, RIGHT, 80.0, 0.2)) == [None, "wall"]


def test_a_doubtful_slope_does_not_tell_where_the_ground_is() -> None:
    doubtful = replace(plane(1, LEFT, 10.0), slope_sigma_deg=12.0)
    assert kinds_of(doubtful, plane(2, RIGHT, 30.0)) == [None, None]
    assert kinds_of(replace(doubtful, slope_sigma_deg=2.0))[0] == "ground"


def test_up_decides_what_is_a_wall() -> None:
    """A facade seen head-on: taken as level it is ground, and a balcony's floor a wall; up known, they are not."""
    facade, floor = plane(1, LEFT, 0.0), plane(2, RIGHT, 90.0, 0.1, azimuth_deg=0.0)
    assert kinds_of(facade, floor) == ["ground", "wall"]
    up = np.array([0.0, -1.0, 0.0])
    turned = [
        replace(one, slope_deg=math.degrees(math.acos(np.clip(up @ one.normal_cam1, -1, 1)))) for one in (facade, floor)
    ]
    report = report_of(turned, up=Up(tuple(up.tolist()), "given"))
    assert plane_kinds(report) == {1: "wall", 2: "ground"}


def test_kinds_do_not_depend_on_the_unit_of_length() -> None:
    planes = (GROUND, plane(2, MIDDLE, 30.0, 0.25), plane(3, RIGHT, 1.0, 0.01))
    metres = [replace(one, distance=57.0 * one.distance) for one in planes]
    assert kinds_of(*metres) == kinds_of(*planes) == ["ground", "roof", "ground"]


def test_the_horizon_does_not_count() -> None:
    """Seen level with the ground, which ends at the horizon in the middle of the image."""
    up = np.array([0.0, -1.0, 0.0])
    near, far = rectangle(10, 400, 600, 70), rectangle(10, CAMERA.cy, 600, 100)
    level = [replace(make_plane(i, outline, 0.0), normal_cam1=up, distance=1.0) for i, outline in ((1, near), (2, far))]
    with np.errstate(all="raise"):
        assert plane_kinds(report_of(level, up=Up((0.0, -1.0, 0.0), "given"))) == {1: "ground", 2: "ground"}


def test_shares_are_of_the_whole_image() -> None:
    shares = plane_shares(report_of([GROUND, plane(3, RIGHT, 40.0)]))
    assert list(shares) == [1, 3]
    assert shares[1] == pytest.approx(190 * 460 / (640 * 480), rel=0.02)


def test_pixels_are_counted_in_every_part_of_a_large_image_and_those_of_other_labels_are_not() -> None:
    labels = np.zeros((1200, 1000), np.uint16)
    labels[0], labels[100:110], labels[1190:] = 7, 1, 1
    report = replace(report_of([GROUND, plane(3, RIGHT, 40.0)]), labels=labels)
    assert plane_shares(report) == {1: 20_000 / labels.size, 3: 0.0}


def test_trees_and_people_are_no_ceilings() -> None:
    hanging = plane(2, MIDDLE, 130.0, 0.7)
    small = plane(2, rectangle(300, 100, 60, 60), 130.0, 0.7)
    assert kinds_of(GROUND, hanging) == ["ground", "ceiling"]
    for doubtful in (small, replace(hanging, status="poor"), replace(hanging, slope_sigma_deg=9.0)):
        assert kinds_of(GROUND, doubtful) == ["ground", None]


def test_what_matters_is_large_or_at_least_not_poor() -> None:
    crumb, patch = rectangle(500, 20, 30, 30), rectangle(300, 20, 60, 60)  # 0.3 and 1.2 % of the image
    planes = [GROUND, plane(2, patch, 30.0), plane(3, crumb, 30.0)]
    assert main_planes(report_of(planes)) == {1, 2}
    assert main_planes(report_of([GROUND, replace(planes[1], status="poor"), planes[2]])) == {1}
    assert main_planes(report_of([planes[2]])) == {3}
