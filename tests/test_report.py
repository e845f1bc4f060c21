"""Reports of solutions made by hand: slopes against up, units of lengths, verdicts, status with its reasons."""

from __future__ import annotations

import json

import numpy as np
import pytest
from report_factory import normal_of
from solution_factory import (
    CAMERA,
    HEIGHT,
    POINTS,
    WINDOWS,
    make_report_of,
    make_solution,
    with_second_root,
)

from slopecli.errors import InputError
from slopecli.options import Options
from slopecli.products import report_to_json
from slopecli.types import Plane, Report

BORROWED = {"origin": "borrowed", "reason": "too little texture inside: this is the plane around it"}


def verdicts(report: Report) -> list[str | None]:
    return [plane.verdict for plane in report.planes]


def slopes(report: Report) -> list[float]:
    return [plane.slope_deg for plane in report.planes]


def only_plane(report: Report) -> Plane:
    (plane,) = report.planes
    return plane


# ---- scale ----


def test_without_a_scale_lengths_are_baselines() -> None:
    report = make_report_of(make_solution([0, 10, 20]))
    assert (report.scale.unit, report.scale.source) == ("baseline", "none")
    assert np.linalg.norm(report.motion.baseline_cam1) == pytest.approx(1)
    assert [plane.distance for plane in report.planes] == pytest.approx([HEIGHT] * 3)


def test_a_baseline_makes_metres_of_every_length() -> None:
    solution = make_solution([0, 10, 20], relief=np.full(3, 0.002))
    plain, metric = make_report_of(solution), make_report_of(solution, Options(baseline_m=2.5))
    assert (metric.scale.unit, metric.scale.source) == ("m", "baseline")
    assert metric.motion.baseline_cam1 == pytest.approx(2.5 * solution.T)
    assert [plane.distance for plane in metric.planes] == pytest.approx([2.5 * HEIGHT] * 3)
    # relief over distance without a scale, metres with one
    assert [plane.roughness for plane in plain.planes] == pytest.approx([0.002] * 3)
    assert [plane.roughness for plane in metric.planes] == pytest.approx([0.002 * 2.5 * HEIGHT] * 3)
    assert slopes(metric) == slopes(plain)


def test_an_altitude_is_the_height_of_camera_1_above_the_windows() -> None:
    report = make_report_of(make_solution([0, 0, 0]), Options(altitude_m=60.0))
    assert (report.scale.unit, report.scale.source) == ("m", "altitude")
    assert [plane.distance for plane in report.planes] == pytest.approx([60.0] * 3)
    assert np.linalg.norm(report.motion.baseline_cam1) == pytest.approx(60.0 / HEIGHT)


def test_an_altitude_is_measured_along_up_not_along_the_optical_axis() -> None:
    """A camera 30 degrees off nadir over level ground: the ground's distance is the altitude, its depth is not."""
    up = tuple(normal_of(30, 60))
    report = make_report_of(make_solution([30, 30, 30]), Options(altitude_m=60.0, up=up))
    assert [plane.distance for plane in report.planes] == pytest.approx([60.0] * 3)


# ---- up ----


def test_by_default_the_camera_looks_straight_down() -> None:
    report = make_report_of(make_solution([0, 10, 20]))
    assert (report.up.source, report.up.vector_cam1) == ("camera", (0, 0, -1))
    assert slopes(report) == pytest.approx([0, 10, 20], abs=1e-6)


def test_slopes_are_angles_to_the_up_that_is_given_whatever_its_length() -> None:
    up = tuple(7.5 * normal_of(10, 60))
    report = make_report_of(make_solution([0, 10, 25]), Options(up=up))
    assert report.up.source == "given"
    assert report.up.vector_cam1 == pytest.approx(normal_of(10, 60))
    assert slopes(report) == pytest.approx([10, 0, 15], abs=1e-6)


def test_the_uncertainty_of_up_widens_every_interval() -> None:
    sure = make_report_of(make_solution([5, 10, 20]), Options(up=(0, 0, -1)))
    unsure = make_report_of(make_solution([5, 10, 20]), Options(up=(0, 0, -1), up_sigma_deg=2.0))
    assert unsure.up.sigma_deg == 2.0
    for a, b in zip(sure.planes, unsure.planes, strict=True):
        assert b.slope_sigma_deg == pytest.approx(np.hypot(a.slope_sigma_deg, 2.0), rel=0.03)
        assert b.slope_ci95_deg[0] < a.slope_ci95_deg[0]
        assert b.slope_ci95_deg[1] > a.slope_ci95_deg[1] + 2


def test_the_dominant_plane_is_the_largest_window_and_level() -> None:
    report = make_report_of(make_solution([4, 10, 20]), Options(up="dominant-plane"))
    areas = [w * h for _, _, w, h in WINDOWS]
    largest = areas.index(max(areas))
    assert report.up.source == "dominant-plane"
    assert report.up.vector_cam1 == pytest.approx(report.planes[largest].normal_cam1)
    assert slopes(report) == pytest.approx([16, 10, 0], abs=1e-6)
    # both the plane and what it is measured against are uncertain
    assert report.planes[0].slope_sigma_deg == pytest.approx(0.2 * np.sqrt(2), rel=0.02)


def test_the_plane_taken_as_level_has_slope_0_by_definition_and_no_verdict() -> None:
    """Nothing was measured of it: neither sigma nor interval, probability or verdict, also in the second answer."""
    solution = with_second_root(make_solution([4, 10, 20]), [4, 12, 24])
    report = make_report_of(solution, Options(up="dominant-plane", up_sigma_deg=1.0))
    level, other = report.planes[2], report.ambiguity.others[3]
    assert report.up.plane_id == level.id
    for plane in (level, other):
        assert plane.taken_as_level
        assert plane.slope_deg == pytest.approx(0, abs=1e-9)
        assert (plane.slope_sigma_deg, plane.slope_ci95_deg, plane.p_safe, plane.verdict) == (None,) * 4
    assert (level.status, level.reason) == ("ok", "taken-as-level")
    assert not any(plane.taken_as_level for plane in report.planes[:2])
    written = json.loads(report_to_json(report))
    assert written["up"]["plane_id"] == 3
    assert written["planes"][2]["verdict"] is None


def test_the_plane_taken_as_level_may_be_poor_too() -> None:
    report = make_report_of(make_solution([4, 10, 20], relief=np.full(3, 0.05)), Options(up="dominant-plane"))
    assert (report.planes[2].status, report.planes[2].reason) == ("poor", "taken-as-level; non-planar-patch")


def test_up_that_is_no_planes_normal_leaves_every_plane_its_verdict() -> None:
    for up in ("camera", (0.0, 0.0, -1.0)):
        report = make_report_of(make_solution([4, 10, 20]), Options(up=up))
        assert report.up.plane_id is None
        assert None not in verdicts(report)


def test_a_window_that_was_not_seen_is_not_what_is_level() -> None:
    report = make_report_of(
        make_solution([4, 10, 20]), Options(up="dominant-plane"), patch_changes={2: {**BORROWED, "tilt_sigma_rad": 0.5}}
    )
    assert report.up.vector_cam1 == pytest.approx(report.planes[0].normal_cam1)


def test_a_zero_up_is_refused() -> None:
    with pytest.raises(InputError, match=r"^up is .*not all zero"), np.errstate(invalid="ignore"):
        make_report_of(make_solution([4]), Options(up=(0.0, 0.0, 0.0)))


def test_aspect_is_counted_from_north() -> None:
    from_image = make_report_of(make_solution([20]))
    from_east = make_report_of(make_solution([20]), Options(north=(1.0, 0.0, 0.0)))
    assert only_plane(from_image).aspect_deg == pytest.approx(60)
    assert only_plane(from_east).aspect_deg == pytest.approx(60 - 90 + 360)


@pytest.mark.parametrize(
    ("lean", "facing", "slope", "aspect", "dip_direction"),
    [
        (-60, 180, 30, 180, 180),
        (-20, 200, 70, 200, 200),
        (0, 180, 90, 180, 180),
        (1, 170, 91, 170, 350),  # an overhang: further down it is further away
        (30, 180, 120, 180, 0),
        (45, 225, 135, 225, 45),
        (45, 140, 135, 140, 320),
        (60, 180, 150, 180, 0),
    ],
)
def test_dip_direction_is_that_of_the_plane_itself(
    lean: float, facing: float, slope: float, aspect: float, dip_direction: float
) -> None:
    """A level camera that looks north; planes face an azimuth and lean towards the camera by `lean` from upright."""
    lean_rad, facing_rad = np.radians([lean, facing])
    normal = np.array([np.cos(lean_rad) * np.sin(facing_rad), np.sin(lean_rad), np.cos(lean_rad) * np.cos(facing_rad)])
    solution = make_solution([0], scaled_normals=-normal[None] / HEIGHT)
    plane = only_plane(make_report_of(solution, Options(up=(0, -1, 0), north=(0, 0, 1))))
    assert (plane.slope_deg, plane.aspect_deg) == (pytest.approx(slope), pytest.approx(aspect))
    assert plane.dip_direction_deg is not None
    assert (plane.dip_direction_deg - dip_direction + 180) % 360 == pytest.approx(180)
    # independently: of all directions in a plane that is not vertical, the one that descends most
    down = np.array([0.0, 1.0, 0.0])
    descent = down - (down @ normal) * normal
    ahead = np.array([np.sin(np.radians(dip_direction)), np.cos(np.radians(dip_direction))])
    assert slope == 90 or descent[[0, 2]] @ ahead == pytest.approx(np.hypot(*descent[[0, 2]]))


def test_a_level_ceiling_has_no_dip_direction() -> None:
    up = tuple(-normal_of(0.1, 60))
    assert only_plane(make_report_of(make_solution([0]), Options(up=up))).dip_direction_deg is None


# ---- what else is written ----


def test_pixel_homographies_take_the_windows_to_image_2() -> None:
    solution = make_solution([0, 10, 20])
    report = make_report_of(solution)
    for plane in report.planes:
        corners = np.column_stack([plane.polygon_px, np.ones(4)])
        y = corners @ plane.homography_px.T
        rays = corners @ np.linalg.inv(CAMERA.K).T
        points = rays / -(rays @ plane.normal_cam1)[:, None] * plane.distance
        expected = (points - solution.T) @ solution.R.T @ CAMERA.K.T
        assert y[:, :2] / y[:, 2:] == pytest.approx(expected[:, :2] / expected[:, 2:], abs=1e-6)


def test_residuals_and_noise_are_in_pixels() -> None:
    report = make_report_of(make_solution([10], noise=0.25 / CAMERA.focal_px, rms=0.3 / CAMERA.focal_px))
    assert report.fit.noise_px == pytest.approx(0.25)
    assert report.fit.rms_px == pytest.approx(0.3)
    assert only_plane(report).rms_px < 1e-9


def test_sigmas_of_the_motion_are_its_largest_in_degrees() -> None:
    report = make_report_of(make_solution([10]))
    assert report.motion.rotation_sigma_deg == pytest.approx(np.degrees(2e-4))
    assert report.motion.direction_sigma_deg == pytest.approx(np.degrees(3e-4))


def test_a_report_of_matches_all_left_out_is_still_json() -> None:
    report = make_report_of(make_solution([10], inlier=np.zeros(POINTS, bool)))
    (plane,) = json.loads(report_to_json(report))["planes"]
    assert plane["rms_px"] is None
    assert (plane["n_inliers"], plane["status"]) == (0, "poor")


def test_options_are_repeated_without_the_one_that_had_no_say() -> None:
    assert make_report_of(make_solution([10])).options["windows"] is None
    listed = make_report_of(make_solution([10]), Options(windows=(WINDOWS[0],))).options
    assert listed["grid"] is None
    assert listed["windows"] == (WINDOWS[0],)
