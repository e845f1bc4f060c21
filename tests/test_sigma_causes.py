"""Why the sigma of a slope is what it is: every cause by itself, and their squares add up to the sigma stated."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from remembered import remembered
from solution_factory import make_report_of, make_solution

from slopecli import Image, MapOptions, Options, load_camera, load_image, slope_map
from slopecli.geometry import surface_normals
from slopecli.report import CAUSES
from slopecli.types import Plane, Report, Solution

SAMPLE = Path(__file__).parent.parent / "sample_data" / "descent"
SIGMA = 0.2


def causes_of(report: Report, plane_id: int = 1) -> dict[str, float]:
    (plane,) = (plane for plane in report.planes if plane.id == plane_id)
    adds_up(plane)
    return {name: value for name, value in (plane.slope_sigma_causes_deg or {}).items() if value > 1e-9}


def adds_up(plane: Plane) -> None:
    assert tuple(plane.slope_sigma_causes_deg or ()) == CAUSES
    total = math.hypot(*(plane.slope_sigma_causes_deg or {}).values())
    assert total == pytest.approx(plane.slope_sigma_deg, rel=1e-6)


def along(solution: Solution) -> np.ndarray:
    """(3,) unit vector in which the first normal moves when its plane gets steeper."""
    normal, up = surface_normals(solution)[0], np.array([0.0, 0.0, -1.0])
    return np.cross(np.cross(up, normal) / np.linalg.norm(np.cross(up, normal)), normal)


@pytest.mark.parametrize("slope_deg", [0.0, 0.1, 0.3, 1.0, 12.0, 88.0])
def test_noise_alone_is_the_matches(slope_deg: float) -> None:
    report = make_report_of(make_solution([slope_deg], SIGMA))
    assert causes_of(report) == pytest.approx({"matches": report.planes[0].slope_sigma_deg})


@pytest.mark.parametrize("slope_deg", [0.0, 0.3, 12.0])
def test_the_vertical_is_its_own_cause_and_changes_no_other_of_a_steep_plane(slope_deg: float) -> None:
    causes = causes_of(make_report_of(make_solution([slope_deg], SIGMA), Options(up_sigma_deg=2.0)))
    assert set(causes) == {"matches", "up"}
    assert causes["up"] / causes["matches"] == pytest.approx(10.0, rel=1e-6)
    if slope_deg > 10.0:
        assert causes == pytest.approx({"matches": SIGMA, "up": 2.0}, rel=0.02)


def test_a_shared_motion_and_a_focal_length_have_their_parts() -> None:
    plain = make_solution([20.0, 25.0], SIGMA)
    length = np.linalg.norm(plain.scaled_normals[0])
    gain = np.zeros((2, 3, 5))
    gain[0, :, 0] = along(plain) * length * math.radians(0.5)  # half a degree a unit of the first coordinate
    C = np.diag([1.0, 0.0, 0.0, 0.0, 0.0])
    shift = np.zeros(11)
    shift[:3] = along(plain) * length * math.radians(0.3)
    covariance = plain.normal_covariance.copy()
    covariance[0] += gain[0] @ C @ gain[0].T + np.outer(shift[:3], shift[:3])
    solution = make_solution(
        [20.0, 25.0], SIGMA, normal_gain=gain, motion_covariance=C, normal_covariance=covariance, focal_shift=shift
    )
    report = make_report_of(solution)
    assert causes_of(report) == pytest.approx({"matches": SIGMA, "motion": 0.5, "camera": 0.3}, rel=1e-3)
    assert causes_of(report, 2) == pytest.approx({"matches": SIGMA}, rel=1e-3)


def test_a_plane_taken_as_level_has_no_causes_and_is_the_vertical_of_the_others() -> None:
    report = make_report_of(make_solution([3.0, 30.0], [0.1, 0.2]), Options(up="dominant-plane"))
    assert report.planes[0].slope_sigma_causes_deg is None
    assert causes_of(report, 2) == pytest.approx({"matches": 0.2, "up": 0.1}, rel=1e-3)


def test_relief_takes_what_the_matches_would_not_have_without_it() -> None:
    flat, rough = (causes_of(make_report_of(make_solution([12.0], SIGMA, relief=np.array([r])))) for r in (1e-9, 0.05))
    assert flat["matches"] == pytest.approx(SIGMA, rel=1e-4)
    assert math.hypot(rough["matches"], rough["relief"]) == pytest.approx(flat["matches"], rel=1e-4)
    assert rough["relief"] > 5 * rough["matches"]  # residuals of 0.1 px, and relief of a twentieth of the distance


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"tilt_sigma_rad": math.radians(0.5)}, {"matches": math.hypot(SIGMA, 0.5)}),
        (
            {"tilt_sigma_rad": math.radians(0.5), "unmatched_sigma_rad": math.radians(0.5)},
            {"matches": SIGMA, "gaps": 0.5},
        ),
        ({"origin": "borrowed", "reason": "not in image 2"}, {"matches": SIGMA, "gaps": 5.0}),
        ({"dense_shares": (0.36, 0.48, 0.16)}, {"matches": 0.12, "relief": SIGMA * math.sqrt(0.48), "gaps": 0.08}),
    ],
)
def test_what_no_residual_shows_has_its_cause(changes: dict[str, object], expected: dict[str, float]) -> None:
    assert causes_of(make_report_of(make_solution([12.0], SIGMA), patch_changes={0: changes})) == pytest.approx(
        expected, rel=2e-3
    )


def test_a_tilt_that_is_surer_along_the_slope_has_a_smaller_part_and_across_it_changes_the_slope_in_nothing() -> None:
    solution = make_solution([60.0], SIGMA)
    down, open_rad, surer_rad = along(solution), math.radians(2.0), math.radians(1.6)
    level = np.cross(surface_normals(solution)[0], down)
    sigmas = []
    for direction, gaps in ((down, 1.2), (level, 2.0)):
        gap = {"tilt_sigma_rad": open_rad, "unmatched_sigma_rad": open_rad, "surer_cam1": surer_rad * direction}
        report = make_report_of(solution, patch_changes={0: gap})
        assert causes_of(report) == pytest.approx({"matches": SIGMA, "gaps": gaps}, rel=2e-3)
        covariance = np.array(report.planes[0].normal_covariance_cam1)
        sigmas.append([math.sqrt(axis @ covariance @ axis) for axis in (down, level)])
    assert sigmas[0] == pytest.approx([math.hypot(SIGMA, 1.2), math.hypot(SIGMA, 2.0)], rel=1e-3)
    assert sigmas[1] == pytest.approx(sigmas[0][::-1], rel=1e-3)


@pytest.mark.parametrize("slope_deg", [1.0, 4.0])
def test_what_is_nearly_level_is_no_surer_for_a_direction_that_it_may_not_face(slope_deg: float) -> None:
    """Its slope errs by 6 degrees of tilt across as much as by the 3 along, of which the sigma is a mean."""
    solution = make_solution([slope_deg], SIGMA)
    gap = {"tilt_sigma_rad": math.radians(6.0), "unmatched_sigma_rad": math.radians(6.0)}
    gap["surer_cam1"] = math.radians(6.0) * math.sqrt(0.75) * along(solution)
    report = make_report_of(solution, patch_changes={0: gap})
    errors = np.random.default_rng(0).normal(size=(2, 200_000)) * [[3.0], [6.0]]
    rms = np.sqrt(np.mean((np.hypot(slope_deg + errors[0], errors[1]) - slope_deg) ** 2))
    assert report.planes[0].slope_sigma_deg == pytest.approx(min(rms, 6.0), rel=0.01)
    causes = causes_of(report)
    assert causes["gaps"] == pytest.approx(min(rms, 6.0), rel=0.01)
    assert math.hypot(*causes.values()) == pytest.approx(report.planes[0].slope_sigma_deg, rel=1e-6)


@pytest.mark.parametrize(
    "options",
    [Options(), Options(up="dominant-plane", focal_sigma_percent=2.0), Options(solver="ha"), Options(up_sigma_deg=1.0)],
    ids=["plain", "level plane, vague focal length", "ha", "vague up"],
)
def test_parts_add_up_on_images(options: Options) -> None:
    camera, images = load_camera(str(SAMPLE / "camera.json")), [load_image(SAMPLE / f"image{k}.png") for k in (1, 2)]
    report = remembered(*images, camera, camera, options)
    for plane in report.planes:
        if not plane.taken_as_level:
            adds_up(plane)
            assert (plane.slope_sigma_causes_deg or {})["matches"] > 0.0


def test_the_causes_of_a_map_add_up_to_its_median_sigma_and_follow_what_is_given() -> None:
    whole = load_camera(str(SAMPLE / "camera.json"))
    camera = replace(whole, width=400, height=400, fx=whole.fx / 2, fy=whole.fy / 2, cx=199.5, cy=199.5)
    large = (load_image(SAMPLE / f"image{k}.png").grey for k in (1, 2))
    images = [Image(cv2.resize(grey, (400, 400), interpolation=cv2.INTER_AREA)) for grey in large]
    wanted = MapOptions(spacing_px=16, sites=0)
    plain, tilted = (slope_map(*images, camera, camera, Options(up_sigma_deg=s), wanted) for s in (0.0, 1.0))
    for one in (plain, tilted):
        assert tuple(one.sigma_causes_deg or ()) == CAUSES
        assert math.hypot(*(one.sigma_causes_deg or {}).values()) == pytest.approx(one.median_sigma_deg)
    before, after = plain.sigma_causes_deg or {}, tilted.sigma_causes_deg or {}
    assert before["up"] == 0.0
    assert after["up"] == pytest.approx(1.0, rel=0.15)
    assert min(before["matches"], before["relief"], before["gaps"], before["motion"]) > 0.0
