"""What is taken as level: believed of ground and towns seen from above, doubted of facades before an upright camera."""

from __future__ import annotations

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest
from report_factory import make_camera, make_image, make_region_report, normal_of, with_level_plane
from solution_factory import make_report_of, make_solution

from slopecli.findings import SUPPORTED, LevelOdds, Seen, odds_of_camera, odds_of_plane
from slopecli.look import Evidence, Segments, find_segments
from slopecli.options import Options
from slopecli.products import draw_overlay, report_to_json
from slopecli.report import plane_kinds
from slopecli.types import Ambiguity, FloatArray, Report

DOWN = np.array([0.0, 1.0, 0.0])
FACADE_YAWS = (-65.0, -40.0, -20.0, 15.0, 35.0, 60.0)


def unit(*vector: float) -> FloatArray:
    return np.array(vector) / np.linalg.norm(vector)


def turned_about_x(degrees: float) -> FloatArray:
    """Rotation that lowers the optical axis by an angle: from axes of the horizon to those of the camera."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def edges_along(*directions: FloatArray, each: int = 20, seed: int = 0) -> Segments:
    """Edges of these directions at random places ahead of the camera."""
    rng = np.random.default_rng(seed)
    normals = [unit(*np.cross([*rng.uniform(-0.5, 0.5, 2), 1.0], way)) for way in directions for _ in range(each)]
    return Segments(np.array(normals), np.full(len(normals), 50.0))


def scene(planes: list[tuple[FloatArray, float, float]], segments: Segments | None = None) -> Seen:
    """Planes as normal, distance and area, with as many points as their areas, each where its plane is the nearest."""
    rng = np.random.default_rng(1)
    x1 = rng.uniform(-0.5, 0.5, (1500, 2))
    rays = np.column_stack([x1, np.ones(1500)])
    w = np.max([-(rays @ normal) / distance for normal, distance, _ in planes], axis=0)
    seen = w > 0.02
    points = Evidence(
        400 + 700 * x1[seen],
        x1[seen],
        x1[seen],
        x1[seen],
        w[seen],
        np.ones(seen.sum()),
        w[seen],
        700.0,
        int(seen.sum()),
    )
    normals, distances, areas = (np.array(column) for column in zip(*planes, strict=True))
    return Seen(normals, distances, areas, points, segments)


def town(tilt_deg: float, heading_deg: float = 25.0) -> tuple[FloatArray, Seen]:
    """Ground, roofs that lean both ways and a wall, from a camera `tilt_deg` off the vertical with a level horizon."""
    look = turned_about_x(90.0 - tilt_deg)
    h, s = np.radians(heading_deg), np.sin(np.radians(35.0))
    ways = [np.array([np.cos(a), 0.0, np.sin(a)]) for a in (h, h + np.pi / 2, h + np.pi, h - np.pi / 2)]
    up = look @ -DOWN
    roofs = [look @ unit(*(s * way - np.cos(np.radians(35.0)) * DOWN)) for way in (ways[0], ways[2])]
    wall = look @ ways[3]
    planes = [(up, 10.0, 5000.0), *((roof, 9.0, 400.0) for roof in roofs), (wall, 7.0, 300.0)]
    return up, scene(planes, edges_along(look @ ways[0], look @ ways[1]))


def street(
    yaw_deg: float, raised_deg: float = 8.0, *, with_ground: bool = True, side: float = 0.0
) -> tuple[FloatArray, FloatArray, Seen]:
    """A facade turned by a yaw before a camera that is raised a little: its normal, true up, and the scene.

    side : 1 or -1 of a camera that is held on one of its sides.
    """
    look = turned_about_x(-raised_deg)
    if side:
        look = np.array([[0.0, -side, 0.0], [side, 0.0, 0.0], [0.0, 0.0, 1.0]]) @ look
    yaw = np.radians(yaw_deg)
    facade, along = look @ [np.sin(yaw), 0.0, -np.cos(yaw)], look @ [np.cos(yaw), 0.0, np.sin(yaw)]
    up = look @ -DOWN
    ground = [(up, 1.7, 600.0)] if with_ground else []
    return facade, up, scene([(facade, 6.0, 5000.0), *ground], edges_along(up, along))


@pytest.mark.parametrize("tilt_deg", [20.0, 35.0, 50.0, 65.0])
def test_the_ground_of_a_town_from_above_is_believed_level(tilt_deg: float) -> None:
    up, seen = town(tilt_deg)
    odds = odds_of_plane(up, 10.0, seen)
    assert not odds.doubted
    assert odds.probability > 0.95


@pytest.mark.parametrize("yaw_deg", FACADE_YAWS)
@pytest.mark.parametrize("with_ground", [True, False])
def test_a_facade_is_not_believed_level_and_the_true_up_is_named(yaw_deg: float, with_ground: bool) -> None:
    facade, up, seen = street(yaw_deg, with_ground=with_ground)
    odds = odds_of_plane(facade, 6.0, seen)
    assert odds.doubted
    assert odds.against
    assert odds.upright @ up > np.cos(np.radians(12))


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("yaw_deg", FACADE_YAWS)
def test_a_facade_in_a_picture_held_on_its_side_is_not_believed_level(yaw_deg: float, side: float) -> None:
    facade, up, seen = street(yaw_deg, side=side)
    odds = odds_of_plane(facade, 6.0, seen)
    assert odds.doubted
    assert odds.against
    if abs(yaw_deg) >= 40.0:  # one that is seen more squarely may be held any way
        assert odds.upright @ up > np.cos(np.radians(12))
        assert odds.probability < 0.5


@pytest.mark.parametrize("tilt_deg", [35.0, 50.0])
def test_a_town_whose_streets_run_along_the_image_is_no_facade_on_its_side(tilt_deg: float) -> None:
    up, seen = town(tilt_deg, 0.0)
    assert not odds_of_plane(up, 10.0, seen).doubted


@pytest.mark.parametrize("raised_deg", [0.0, 10.0, 20.0])
def test_a_facade_that_is_looked_at_squarely_and_from_below_is_not_believed_level(raised_deg: float) -> None:
    facade, _, seen = street(0.0, raised_deg, with_ground=False)
    assert odds_of_plane(facade, 6.0, seen).doubted


def test_the_floor_before_an_upright_camera_is_believed_level() -> None:
    up = turned_about_x(20.0) @ -DOWN
    assert not odds_of_plane(up, 1.6, scene([(up, 1.6, 5000.0)])).doubted


def test_one_plane_and_nothing_else_is_not_enough() -> None:
    normal = unit(0.1, 0.1, -1.0)
    odds = odds_of_plane(normal, 10.0, scene([(normal, 10.0, 5000.0)]))
    assert odds.doubted
    assert odds.log_odds > 0 > odds.log_odds - SUPPORTED


@pytest.mark.parametrize("yaw_deg", FACADE_YAWS)
def test_a_camera_that_is_upright_by_edges_and_walls_is_not_taken_to_look_down(yaw_deg: float) -> None:
    _, up, seen = street(yaw_deg)
    odds = odds_of_camera(np.array([0.0, 0.0, -1.0]), seen)
    assert odds.doubted
    assert odds.upright @ up > np.cos(np.radians(12))


@pytest.mark.parametrize(("heading_deg", "tilt_deg"), [(0, 0.5), (10, 0.5), (10, 10), (25, 10), (45, 0.5), (45, 10)])
def test_a_camera_over_a_town_is_taken_to_look_down(heading_deg: float, tilt_deg: float) -> None:
    """Also where the streets run along the image: roofs that lean both ways and walls tell."""
    assert not odds_of_camera(np.array([0.0, 0.0, -1.0]), town(tilt_deg, heading_deg)[1]).doubted


def test_both_sides_of_a_niche_before_an_upright_camera_are_not_two_sides_of_a_roof() -> None:
    look = turned_about_x(-4.0)
    up, along = look @ -DOWN, look @ [1.0, 0.0, 0.0]
    sides = [look @ unit(side, 0.0, -1.0) for side in (1.0, -0.9)]
    seen = scene([(side, 5.0, 1000.0) for side in sides], edges_along(up, along))
    assert odds_of_camera(np.array([0.0, 0.0, -1.0]), seen).doubted


def test_slabs_that_lean_every_way_with_edges_along_the_image_are_seen_from_above() -> None:
    """None of them is upright, were the camera: to 10 deg some would be, of which 3 deg are left by the edges."""
    slabs = [unit(0.45, 0.12, -0.88), unit(-0.36, 0.14, -0.92)]
    edges = edges_along(np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0]))
    seen = scene([(slab, 5.0, 1000.0) for slab in slabs], edges)
    assert not odds_of_camera(np.array([0.0, 0.0, -1.0]), seen).doubted


def test_without_evidence_the_default_stands() -> None:
    normal = unit(0.1, 0.2, -1.0)
    assert not odds_of_camera(np.array([0.0, 0.0, -1.0]), scene([(normal, 10.0, 5000.0)])).doubted


def test_segments_of_an_image_converge_to_the_vanishing_point_of_their_direction() -> None:
    """Verticals of a camera that is raised by 12 deg, through a lens with distortion."""
    camera = make_camera()
    up = turned_about_x(-12.0) @ -DOWN
    picture = np.full((camera.height, camera.width), 90, np.uint8)
    for x in np.linspace(-0.5, 0.5, 9):
        ends = [np.array([x, 0.0, 1.0]) + t * up for t in (-0.3, 0.3)]
        (u0, v0, _), (u1, v1, _) = (camera.K @ (end / end[2]) for end in ends)
        cv2.line(picture, (round(u0), round(v0)), (round(u1), round(v1)), 200, 9, cv2.LINE_AA)
    found = find_segments(picture, camera)
    assert len(found.length) >= 9
    towards = found.length_towards(np.array([up, [1.0, 0.0, 0.0]]), 2.0)
    assert towards[0] > 0.9 * found.length.sum()
    assert towards[1] < 0.1 * found.length.sum()


def test_edges_of_the_black_around_an_undistorted_image_are_none_of_the_scene() -> None:
    camera = make_camera()
    picture = np.zeros((camera.height, camera.width), np.uint8)
    picture[60:-60, 80:-80] = 90
    cv2.line(picture, (200, 120), (camera.width - 200, camera.height - 150), 200, 9, cv2.LINE_AA)
    found = find_segments(picture, camera)
    assert 1 <= len(found.length) <= 4
    upright = found.length_towards(np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]), 2.0)
    assert upright.max() == 0.0
    picture[150:-150, 180:220] = 0  # a dark door is
    door = find_segments(picture, camera).length_towards(np.array([[0.0, 1.0, 0.0]]), 2.0)
    assert door[0] > 50.0


# ---- in the report ----


def doubted_report(**options: object) -> Report:
    """Three windows of which the largest, taken as level, faces the camera from the side, as a facade does."""
    return make_report_of(make_solution([4, 10, 20]), Options(up="dominant-plane", **options))  # type: ignore[arg-type]


def test_where_level_is_doubted_nothing_is_safe_and_the_other_up_is_named() -> None:
    report = doubted_report()
    (found,) = (one for one in report.diagnostics if one.code == "level-assumed")
    assert found.severity == "warning"
    assert not any(plane.verdict == "safe" for plane in report.planes)
    written = json.loads(report_to_json(report))
    other = written["up"]["otherwise_cam1"]
    assert np.linalg.norm(other) == pytest.approx(1)
    assert f"--up {','.join(f'{value:.4f}' for value in other)}" in found.remedy
    # against the other direction these planes are walls
    assert all(plane.p_safe < 0.01 for plane in report.planes if plane.p_safe is not None)


def test_a_plane_is_unsafe_only_if_it_is_so_against_both_directions() -> None:
    report = doubted_report()
    # 16 and 10 deg against the plane taken as level, walls against the other direction
    assert [plane.verdict for plane in report.planes] == ["unsafe", "undecided", None]


def test_verdicts_of_a_second_root_hold_against_both_directions_too() -> None:
    second = replace(make_solution([4, 38, 20]), ambiguity=Ambiguity("none"))
    for up, verdicts in (("camera", ["safe", "unsafe", "unsafe"]), ("dominant-plane", ["unsafe", "unsafe", None])):
        main = replace(make_solution([4, 10, 20]), ambiguity=Ambiguity("unresolved", 1.0, second))
        report = make_report_of(main, Options(up=up))  # type: ignore[arg-type]
        assert report.ambiguity.alternative is not None
        found = {plane.id: plane for plane in report.ambiguity.alternative.planes}
        if up == "dominant-plane":
            assert report.up.otherwise_cam1 is not None
            assert all(plane.p_safe < 0.01 for plane in found.values() if plane.p_safe is not None)
            assert "safe" not in {plane.verdict for plane in found.values()}
        assert [found[plane.id].verdict for plane in report.planes] == verdicts


@pytest.mark.parametrize("up", ["camera", tuple(normal_of(20, 60))])
def test_up_that_was_given_is_never_doubted_nor_is_the_default_without_evidence(up: str | tuple[float, ...]) -> None:
    report = make_report_of(make_solution([4, 10, 20]), Options(up=up))  # type: ignore[arg-type]
    assert not any(one.code == "level-assumed" for one in report.diagnostics)
    assert report.up.otherwise_cam1 is None
    assert any(plane.verdict == "safe" for plane in report.planes)


def test_kinds_and_the_overlay_say_that_level_is_in_doubt() -> None:
    sure, doubtful = with_level_plane(make_region_report()), with_level_plane(make_region_report())
    object.__setattr__(doubtful, "up", doubted_report().up)
    object.__setattr__(doubtful, "diagnostics", doubted_report().diagnostics)
    assert set(plane_kinds(doubtful).values()) == {None}
    assert set(plane_kinds(sure).values()) != {None}
    assert draw_overlay(doubtful, make_image()).shape[0] > draw_overlay(sure, make_image()).shape[0]


def test_the_probability_never_overflows() -> None:
    for log_odds in (-1e4, 0.0, 1e4):
        assert 0.0 <= LevelOdds(log_odds, 0.0, -DOWN, ()).probability <= 1.0


@pytest.mark.parametrize(
    ("pitch_deg", "given_deg", "slope_deg", "said"),
    [
        (-50.0, 50.0, 0.0, True),
        (-25.0, 25.0, 8.0, True),
        (-50.0, -50.0, 0.0, False),
        (-50.0, -50.0, 30.0, False),
        (0.0, 0.0, 80.0, False),
        (-10.0, 10.0, 85.0, False),  # of walls, it cannot be told
    ],
)
def test_a_wrong_sign_of_the_pitch_is_told(pitch_deg: float, given_deg: float, slope_deg: float, said: bool) -> None:
    """Planes of a slope that face aside, seen under a pitch; another one is given."""
    true, given = (turned_about_x(-pitch) @ [0.0, -1.0, 0.0] for pitch in (pitch_deg, given_deg))
    aside = np.array([1.0, 0.0, 0.0])
    normal = np.cos(np.radians(slope_deg)) * true + np.sin(np.radians(slope_deg)) * aside
    normal *= -1.0 if normal[2] > 0.0 else 1.0
    solution = make_solution([10.0, 10.0], scaled_normals=np.array([-normal, -normal]) / 5.0)
    report = make_report_of(solution, Options(up=(float(given[0]), float(given[1]), float(given[2]))))
    assert ("pitch-sign" in {one.code for one in report.diagnostics}) == said
