"""Checks of a pair and of its planes: every refusal and diagnostic with its code, its number and its remedy."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from report_factory import grid_polygons, make_camera, make_image, make_labels, make_planes, make_region_report
from scenery import warped_pair
from solution_factory import WINDOWS, make_report_of, make_solution, with_second_root

from slopecli.errors import NoAnswer
from slopecli.findings import (
    AnswerFacts,
    Separation,
    check_parallax,
    epipole1_px,
    focus_of_expansion_in_plane,
    parallax_px,
    refuse_identical,
    refuse_unmatched,
)
from slopecli.geometry import homogeneous, pixels_from_rays, rotation_from_vector
from slopecli.options import Options
from slopecli.pipeline import estimate
from slopecli.study import project
from slopecli.types import Diagnostic, FloatArray, Image, Plane, Report

CAMERA = make_camera()
FOCAL = CAMERA.focal_px
TURN = rotation_from_vector(np.radians([1.0, -2.0, 3.0]))


def matches(
    baseline: float, noise_px: float = 0.0, n: int = 400, R: FloatArray = TURN
) -> tuple[FloatArray, FloatArray]:
    """Normalised matches (n, 2) of ground at distances 0.8 to 1.2, after a rotation and a sideways move."""
    rng = np.random.default_rng(1)
    x1 = rng.uniform([-0.55, -0.4], [0.55, 0.4], (n, 2))
    inverse_depth = baseline / rng.uniform(0.8, 1.2, n)
    x2 = project(R, np.array([1.0, 0.0, 0.0]), x1, inverse_depth)
    return x1, x2 + noise_px / FOCAL * rng.standard_normal(x2.shape)


def codes(found: list[Diagnostic] | tuple[Diagnostic, ...]) -> list[str]:
    return [diagnostic.code for diagnostic in found]


def reported(report: Report) -> list[str]:
    return codes(report.diagnostics)


# ---- refusals ----


def test_identical_images_are_refused() -> None:
    image = make_image()
    with pytest.raises(NoAnswer, match=r"^pure-rotation: the two images are identical") as refusal:
        refuse_identical(image, replace(image, path="a copy of it.png"))
    assert refusal.value.value == 0
    assert "another place" in refusal.value.remedy


def test_images_that_differ_in_one_pixel_or_in_size_are_not_identical() -> None:
    image = make_image()
    other = image.grey.copy()
    other[5, 7] ^= 1
    for changed in (other, image.grey[:-1]):
        assert refuse_identical(image, replace(image, grey=changed)) is None  # type: ignore[func-returns-value]


def test_one_point_is_singular() -> None:
    with pytest.raises(NoAnswer, match="only 1 distinctive point, 60 are needed"):
        refuse_unmatched((1, 900), n_matches=5, n_inliers=4)


@pytest.mark.parametrize(("found", "which"), [((7, 900), 1), ((900, 7), 2)])
def test_too_few_features_blame_the_image_that_has_them(found: tuple[int, int], which: int) -> None:
    with pytest.raises(NoAnswer, match=f"^low-texture: image {which} has only 7 distinctive points") as refusal:
        refuse_unmatched(found, n_matches=5, n_inliers=4)
    assert refusal.value.value == 7


@pytest.mark.parametrize(("n_matches", "n_inliers"), [(90, 9), (0, 0), (400, 40)])
def test_matches_that_do_not_agree_on_a_motion_are_no_overlap(n_matches: int, n_inliers: int) -> None:
    """The last: more than 20 agree, but so few of so many do by chance."""
    sentence = f"^no-overlap: of {n_matches} tentative matches only {n_inliers} agree"
    with pytest.raises(NoAnswer, match=sentence) as refusal:
        refuse_unmatched((900, 900), n_matches, n_inliers)
    assert refusal.value.value == n_inliers
    assert "same ground" in refusal.value.remedy


def test_enough_agreeing_matches_pass() -> None:
    assert refuse_unmatched((900, 900), n_matches=60, n_inliers=25) is None  # type: ignore[func-returns-value]


@pytest.mark.parametrize("noise_px", [0.0, 0.1, 0.5])
def test_a_camera_that_only_turned_is_refused(noise_px: float) -> None:
    parallax = parallax_px(*matches(baseline=0.0, noise_px=noise_px), FOCAL)
    with pytest.raises(NoAnswer, match=r"^pure-rotation: a rotation .* explains all matches to \d") as refusal:
        check_parallax(parallax, noise_px)
    assert refusal.value.value == pytest.approx(np.quantile(parallax, 0.98))
    assert "5 to 20 %" in refusal.value.remedy


def test_a_rotation_is_seen_through_mismatches() -> None:
    """One match in twenty is gross; the rotation is that of the others."""
    x1, x2 = matches(baseline=0.0, noise_px=0.1)
    x2[::20] += 0.1
    parallax = np.delete(parallax_px(x1, x2, FOCAL), np.arange(0, 400, 20))
    assert np.median(parallax) < 0.2


def test_large_turns_leave_no_parallax() -> None:
    roll = rotation_from_vector(np.array([0.0, 0.0, np.pi / 2]))
    assert parallax_px(*matches(baseline=0.0, R=roll), FOCAL).max() < 1e-6


def test_ample_parallax_says_nothing() -> None:
    # over relief of 20 % of the height a baseline of a fifth of it moves points by a twentieth of it
    assert check_parallax(parallax_px(*matches(baseline=0.2, noise_px=0.1), FOCAL), 0.1) == []


def test_little_parallax_is_a_warning_with_its_number_and_how_much_farther_to_move() -> None:
    parallax = parallax_px(*matches(baseline=0.02, noise_px=0.05), FOCAL)
    (warning,) = check_parallax(parallax, 0.05)
    assert (warning.code, warning.severity) == ("low-parallax", "warning")
    assert warning.value == pytest.approx(np.median(parallax))
    factor = float(str(warning.remedy).split()[1])
    assert factor == pytest.approx(3 / np.median(parallax), abs=0.05)


@pytest.mark.parametrize("length_m", [None, 0.4])
def test_little_parallax_has_a_remedy_in_lengths_where_the_distance_is_known(length_m: float | None) -> None:
    parallax = parallax_px(*matches(baseline=0.02, noise_px=0.05), FOCAL)
    (warning,) = check_parallax(parallax, 0.05, Separation(0.02, length_m))
    factor = 3 / np.median(parallax)
    if length_m is None:
        percent, now, example = map(float, re.findall(r"([\d.]+) (?:%|m at)", str(warning.remedy)))
        assert (percent, now) == (pytest.approx(2 * factor, rel=0.05), 2)
        assert example == pytest.approx(20 * percent / 100, rel=0.05)
        assert str(warning.remedy).endswith("m at 20 m height")
    else:
        assert f"move {factor * 0.4:.2g} m between the images instead of 0.4 m" == warning.remedy


# ---- the tolerance ----


def test_a_move_that_would_decide_about_a_window_is_named() -> None:
    """14 +- 0.6 degrees is decided at 15 with a sigma of 0.43: 1.4 times as far, 28 % of the distance, is too far."""
    solution = make_solution([14.0, 5.0], sigma_deg=0.6)
    assert "low-parallax" not in reported(make_report_of(solution))
    solution = make_solution([14.2, 14.0, 5.0], sigma_deg=[0.6, 0.5, 0.6])
    report = make_report_of(solution)
    assert [plane.verdict for plane in report.planes] == ["undecided", "undecided", "safe"]
    (info,) = report.diagnostics
    assert (info.code, info.severity) == ("low-parallax", "info")
    assert info.value == pytest.approx(0.5 / (1 / 2.326), rel=0.01)
    assert "window 2 has a sigma of 0.5°, and 0.43° would decide" in info.message
    assert "window 1" not in info.message
    assert "23 % of the distance" in str(info.remedy)
    (info,) = make_report_of(solution, Options(baseline_m=2.0)).diagnostics
    assert info.remedy == "move 2.3 m between the images instead of 2 m"


def test_no_move_is_recommended_against_the_uncertainty_of_up() -> None:
    solution = make_solution([14.0, 5.0], sigma_deg=[0.3, 0.3])
    report = make_report_of(solution, Options(up_sigma_deg=0.42))
    assert report.planes[0].verdict == "undecided"  # 14 +- 0.52
    assert "low-parallax" not in reported(report)  # 0.09 of 0.43 are left for the images


def test_a_slope_that_is_not_known_wants_parallax_too() -> None:
    report = make_report_of(make_solution([20, 5], sigma_deg=[12.2, 0.6]))
    (info,) = report.diagnostics
    assert "window 1 has a sigma of 11°, and 10° would decide" in info.message
    assert info.value == pytest.approx(report.planes[0].slope_sigma_deg / 10)


def test_a_window_seen_by_half_is_told_and_no_longer_move_is_recommended_for_it() -> None:
    """14 degrees, 0.3 by its matches and 2 by what is hidden: no parallax decides that."""
    doubt = {"tilt_sigma_rad": np.radians(2.0), "unmatched_sigma_rad": np.radians(2.0), "share": 0.55}
    report = make_report_of(make_solution([14.0, 5.0], sigma_deg=0.3), patch_changes={0: doubt})
    assert report.planes[0].verdict == "undecided"
    (info,) = report.diagnostics
    assert (info.code, info.severity, info.value) == ("partly-seen", "info", 1.0)
    assert "only 55 % of window 1 could be matched" in info.message
    assert "2°, is due to ground without matches" in info.message


def test_a_window_across_a_step_is_told_so() -> None:
    doubts = [
        {
            "tilt_sigma_rad": np.radians(9.0),
            "unmatched_sigma_rad": np.radians(9.0),
            "off_plane_sigma_rad": np.radians(against),
        }
        for against in (9.0, 1.0)
    ]
    report = make_report_of(make_solution([14.0, 5.0], sigma_deg=0.3), patch_changes=dict(enumerate(doubts)))
    step, hidden = report.diagnostics
    assert (step.code, step.severity, step.value) == ("step-or-object", "info", 1.0)
    assert step.message.startswith("parts of window 1 are not on its plane")
    assert (hidden.code, hidden.value) == ("partly-seen", 1.0)
    assert "of window 2 could be matched" in hidden.message


def test_a_window_matched_nearly_all_over_is_not_said_to_be_seen_by_a_share() -> None:
    doubts = [
        {"tilt_sigma_rad": np.radians(9.0), "unmatched_sigma_rad": np.radians(9.0), "share": share}
        for share in (0.7, 1.02)
    ]
    solution = make_solution([14.0, 5.0], sigma_deg=0.3)
    (info,) = make_report_of(solution, patch_changes=dict(enumerate(doubts))).diagnostics
    assert info.message.startswith("not all of windows 1, 2 could be matched: most of the sigma, up to 9")


def test_nothing_is_said_of_parallax_where_two_answers_are_undecided() -> None:
    solution = with_second_root(make_solution([14.0, 5.0], sigma_deg=0.5), [30, 30])
    assert "low-parallax" not in reported(make_report_of(solution))


# ---- the epipole ----


def test_the_epipole_is_the_pixel_the_camera_moves_towards() -> None:
    T = np.array([0.1, -0.05, 1.0])
    expected = CAMERA.K @ T
    for sign in (1, -1):
        found = epipole1_px(make_solution([10], T=sign * T), CAMERA)
        assert found == pytest.approx(tuple(expected[:2]), abs=1e-6)


@pytest.mark.parametrize("T", [(1.0, 0.0, 0.0), (1.0, 0.0, 1.0), (0.0, 1.0, 1e-12)])
def test_an_epipole_outside_the_image_is_none(T: tuple[float, float, float]) -> None:
    assert epipole1_px(make_solution([10], T=T), CAMERA) is None


def test_the_epipole_is_in_the_image_as_stored() -> None:
    distorted = replace(CAMERA, model="brown", distortion=(-0.2, 0.05))
    T = np.array([0.3, 0.2, 1.0])
    found = epipole1_px(make_solution([10], T=T), distorted)
    assert found == pytest.approx(tuple(pixels_from_rays(distorted, T[None, :2])[0]))
    ideal = epipole1_px(make_solution([10], T=T), CAMERA)
    assert found is not None
    assert ideal is not None
    assert np.hypot(*np.subtract(found, ideal)) > 5


def in_planes(
    planes: tuple[Plane, ...], labels: NDArray[np.uint16], epipole: tuple[float, float] | None
) -> list[Diagnostic]:
    """The findings about an epipole, for which nothing but planes and labels is looked at."""
    T = (1.0, 0.0, 0.0) if epipole is None else np.linalg.inv(CAMERA.K) @ [*epipole, 1.0]
    nothing: Any = None
    facts = AnswerFacts(planes, make_solution([10], T=T), nothing, (CAMERA, CAMERA), Options(), labels)
    return focus_of_expansion_in_plane(facts)


def test_the_window_that_holds_the_epipole_is_named() -> None:
    planes = make_planes(CAMERA, grid_polygons(CAMERA.width, CAMERA.height, 3, 3))
    labels = make_labels(CAMERA, planes)
    (found,) = in_planes(planes, labels, (600.0, 30.0))
    assert (found.code, found.severity, found.value) == ("foe-in-window", "info", 3)
    assert "window 3" in found.message
    assert in_planes(planes, labels, None) == []


def test_of_regions_that_reach_around_one_another_the_one_that_holds_the_epipole_is_named() -> None:
    labels = np.ones((CAMERA.height, CAMERA.width), np.uint16)
    labels[100:200, 100:300] = 2
    labels[150:160, 150:160] = 0
    planes = make_region_report(CAMERA, labels).planes
    assert [found.value for found in in_planes(planes, labels, (200.0, 120.0))] == [2]
    assert [found.value for found in in_planes(planes, labels, (-0.4, CAMERA.height - 0.6))] == [1]
    assert in_planes(planes, labels, (155.0, 155.0)) == []


def test_a_window_beside_the_epipole_is_not_named() -> None:
    forward = make_report_of(make_solution([10], T=(0, 0, 1)))  # the epipole is the image centre, no window holds it
    assert forward.epipole1_px == pytest.approx((CAMERA.cx, CAMERA.cy))
    assert "foe-in-window" not in reported(forward)
    windows = [WINDOWS[0], (260, 180, 120, 120), WINDOWS[2]]
    held = make_report_of(make_solution([10, 20, 5], T=(0, 0, 1)), windows=windows)
    assert reported(held) == ["foe-in-window"]


# ---- the solution ----


def test_a_clean_answer_needs_no_words() -> None:
    assert reported(make_report_of(make_solution([10, 20, 5]))) == []


def test_relief_is_told_in_percent_of_the_distance() -> None:
    report = make_report_of(make_solution([10, 20], relief=np.array([0.001, 0.045])))
    (found,) = report.diagnostics
    assert (found.code, found.severity, found.value) == ("non-planar-patch", "warning", 2)
    assert "4.5 %" in found.message
    assert found.remedy == "use smaller windows"


def test_a_second_motion_is_a_warning_only_while_it_is_not_ruled_out() -> None:
    solution = make_solution([10, 20])
    (found,) = make_report_of(with_second_root(solution, [30, 30])).diagnostics
    assert (found.code, found.severity, found.value) == ("single-plane", "warning", 2.5)
    assert "third image" in str(found.remedy)
    assert reported(make_report_of(with_second_root(solution, [30, 30], status="resolved"))) == []


def test_a_solution_that_did_not_converge_is_a_poor_fit() -> None:
    (found,) = make_report_of(make_solution([10, 20], converged=False)).diagnostics
    assert (found.code, found.severity) == ("poor-fit", "warning")
    assert "camera file" in str(found.remedy)


def test_parallax_is_what_the_rotation_does_not_explain() -> None:
    """Level ground and a sideways move: all points shift alike, which a rotation explains but for its perspective."""
    x1, _ = matches(baseline=0.0)
    x2 = project(np.eye(3), np.array([1.0, 0.0, 0.0]), x1, np.full(len(x1), 0.1))
    shift = np.linalg.norm(homogeneous(x2) - homogeneous(x1), axis=1) * FOCAL
    parallax = parallax_px(x1, x2, FOCAL)
    assert shift == pytest.approx(0.1 * FOCAL)
    assert np.median(parallax) < 0.25 * np.median(shift)
    assert np.median(parallax) > 1


# ---- the shape of the ground, and the way over it ----


def test_a_straight_descent_over_level_ground_is_the_least_informative() -> None:
    descent = make_report_of(make_solution([1.0, 2.0, 0.5], T=(0.05, 0, 1)))
    (found,) = (d for d in descent.diagnostics if d.code == "weak-geometry")
    assert found.severity == "info"
    assert found.value == pytest.approx(2.9, abs=1.5)
    assert "sideways as well, by 20 % of the distance: 4 m at 20 m height" in str(found.remedy)
    assert "--rotation-prior" in str(found.remedy)
    assert "--merge-coplanar" in str(found.remedy)
    metric = make_report_of(make_solution([1.0, 2.0, 0.5], T=(0, 0, 1)), Options(baseline_m=3.0))
    assert "move 3 m sideways as well" in str(next(d for d in metric.diagnostics if d.code == "weak-geometry").remedy)


@pytest.mark.parametrize(("slopes", "T"), [([1, 2, 0.5], (0.6, 0, 0.8)), ([1, 25, 12], (0, 0, 1))])
def test_a_glide_or_uneven_ground_tells_enough(slopes: list[float], T: tuple[float, float, float]) -> None:
    assert "weak-geometry" not in reported(make_report_of(make_solution(slopes, T=T)))


def one_plane_of(report: Report) -> Diagnostic | None:
    return next((d for d in report.diagnostics if d.code == "single-plane"), None)


@pytest.mark.parametrize("status", ["none", "resolved"])
def test_that_the_motion_rests_on_one_plane_is_told_where_no_second_answer_is_left(status: str) -> None:
    solution = make_solution([10, 10, 10])
    report = make_report_of(with_second_root(solution, [30, 30, 30], status) if status == "resolved" else solution)
    found = one_plane_of(report)
    assert found is not None
    assert found.severity == "info"
    assert found.value == pytest.approx(0.0, abs=0.05)
    assert "px of one plane" in found.message


def test_ground_with_relief_is_not_one_plane() -> None:
    assert one_plane_of(make_report_of(make_solution([10, 20, 5]))) is None


def test_where_two_answers_are_left_one_plane_is_told_once() -> None:
    found = make_report_of(with_second_root(make_solution([10, 10]), [30, 30]))
    assert [(d.code, d.severity) for d in found.diagnostics] == [("single-plane", "warning")]


def test_one_image_shifted_against_itself_is_level_ground_on_a_sideways_move() -> None:
    """Nothing in the pixels tells the two apart; told is that all rests on one plane, and on little parallax."""
    grey = warped_pair(lambda uv: uv, (380, 240))[0]
    camera = make_camera(360, 240)
    report = estimate(Image(grey[:, 20:].copy()), Image(grey[:, :360].copy()), camera, camera, Options())
    assert max(plane.slope_deg for plane in report.planes) < 1
    assert {"low-parallax", "single-plane"} <= set(reported(report))


# ---- up ----


def test_up_the_wrong_way_round_is_told() -> None:
    solution = make_solution([14.0, 5.0], sigma_deg=0.3)
    found = reported(make_report_of(solution, Options(up=(0.0, 0.0, 1.0))))
    assert "upside-down" in found
    assert "upside-down" not in reported(make_report_of(solution, Options(up=(0.0, 0.0, -1.0))))
    assert "upside-down" not in reported(make_report_of(solution))


@pytest.mark.parametrize(
    ("slopes_deg", "sigma_deg", "told"),
    [
        ([75.0, 88.0], 0.3, False),  # walls that lean over against up: 105 and 92 degrees
        ([14.0, 75.0], 0.3, False),  # one of them is a wall
        ([14.0, 75.0], [0.3, 20.0], True),  # a window of unknown slope has no say
        ([14.0, 5.0], 20.0, False),  # none is known
    ],
)
def test_up_is_wrong_only_where_all_that_is_known_is_a_ceiling(
    slopes_deg: list[float], sigma_deg: float | list[float], told: bool
) -> None:
    solution = make_solution(slopes_deg, sigma_deg=sigma_deg)
    assert ("upside-down" in reported(make_report_of(solution, Options(up=(0.0, 0.0, 1.0))))) == told
