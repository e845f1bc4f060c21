"""Reports of solutions made by hand: slopes against up, units of lengths, verdicts, status with its reasons."""

from __future__ import annotations

import json
import re

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

from slopecli.errors import InputError, NoAnswer
from slopecli.findings import finding
from slopecli.options import Options
from slopecli.patches import Footprint, Found, Patch, join_patches, window_footprint
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


# ---- verdicts ----


@pytest.mark.parametrize(("slope", "verdict"), [(10, "safe"), (20, "unsafe"), (15.2, "undecided"), (14.8, "undecided")])
def test_verdict_follows_slope_and_sigma(slope: float, verdict: str) -> None:
    assert only_plane(make_report_of(make_solution([slope], sigma_deg=0.5))).verdict == verdict


def test_verdict_follows_tolerance_and_confidence() -> None:
    solution = make_solution([12.0], sigma_deg=1.0)  # 3 sigmas below 15 degrees: P(safe) = 0.9986
    assert verdicts(make_report_of(solution)) == ["safe"]
    assert verdicts(make_report_of(solution, Options(confidence=0.9999))) == ["undecided"]
    assert verdicts(make_report_of(solution, Options(tolerance_deg=10.0, confidence=0.95))) == ["unsafe"]


def test_p_safe_is_the_probability_of_a_slope_below_the_tolerance() -> None:
    """Against draws of the normal from its covariance."""
    rng = np.random.default_rng(3)
    for slope, sigma in ((14.0, 1.0), (15.5, 0.8), (2.0, 7.0)):
        plane = only_plane(make_report_of(make_solution([slope], sigma_deg=sigma)))
        normals = normal_of(slope, 60) + np.radians(sigma) * rng.standard_normal((200_000, 3))
        tilt = np.degrees(np.arccos(-normals[:, 2] / np.linalg.norm(normals, axis=1)))
        assert plane.p_safe == pytest.approx(np.mean(tilt < 15), abs=0.01)


def test_never_safe_when_the_other_root_is_not() -> None:
    gentle = [5, 5, 5]
    assert verdicts(make_report_of(make_solution(gentle))) == ["safe"] * 3
    other_root = [5, 25, 14.9]
    report = make_report_of(with_second_root(make_solution(gentle), other_root))
    assert verdicts(report) == ["safe", "undecided", "undecided"]
    ruled_out = make_report_of(with_second_root(make_solution(gentle), other_root, status="resolved"))
    assert verdicts(ruled_out) == ["safe"] * 3


def test_nothing_is_safe_in_either_root_while_a_diagnostic_forbids_it() -> None:
    solution = with_second_root(make_solution([5, 25, 40]), [5, 5, 40])
    plain = make_report_of(solution)
    report = make_report_of(solution, diagnostics=[finding("suspect-distortion", "the lens is another one", 3.0)])
    for one, doubted in ((plain, report), (plain.ambiguity.alternative, report.ambiguity.alternative)):
        assert one is not None
        assert doubted is not None
        withheld = ["undecided" if plane.verdict == "safe" else plane.verdict for plane in one.planes]
        assert [plane.verdict for plane in doubted.planes] == withheld
        # a probability that rests on a doubted camera is none; what is steep with it stays unsafe
        stated = [plane.p_safe if plane.verdict == "unsafe" else None for plane in one.planes]
        assert [plane.p_safe for plane in doubted.planes] == stated
    assert [plane.reason for plane in report.planes] == ["suspect-distortion"] * 3
    assert [plane.status for plane in report.planes] == ["ok"] * 3
    assert verdicts(plain) == ["safe", "undecided", "unsafe"]
    assert report.diagnostics[0].message == "the lens is another one; no verdict is safe"


def test_no_limit_on_p_safe_is_passed_by_one_answer_of_two() -> None:
    report = make_report_of(with_second_root(make_solution([5, 25, 25]), [51, 5, 51]))
    assert report.ambiguity.alternative is not None
    seconds = report.ambiguity.alternative.planes
    assert [plane.p_safe for plane in report.planes] == pytest.approx([0, 0, 0], abs=1e-6)
    assert [plane.p_safe for plane in seconds] == pytest.approx([0, 1, 0], abs=1e-6)
    assert verdicts(report) == ["undecided", "undecided", "unsafe"]
    # never safe in either answer unless in both, as a program may read only one of them
    assert [plane.verdict for plane in seconds] == ["unsafe", "undecided", "unsafe"]
    ruled_out = make_report_of(with_second_root(make_solution([5]), [51], status="resolved"))
    assert only_plane(ruled_out).p_safe == pytest.approx(1, abs=1e-6)


def test_the_second_answer_is_told_in_full() -> None:
    """Like an answer by the second root alone."""
    options = Options(baseline_m=2.5, max_sigma_deg=5.0)
    solution = with_second_root(make_solution([4, 5]), [12, 0.6], sigma_deg=0.5)
    report = make_report_of(solution, options)
    assert report.ambiguity.alternative is not None
    assert solution.ambiguity.alternative is not None
    alone = make_report_of(solution.ambiguity.alternative, options)
    names = ("distance", "slope_deg", "slope_sigma_deg", "slope_ci95_deg", "aspect_deg", "dip_direction_deg", "p_safe")
    names += ("verdict", "slope_known")
    for second, plane in zip(report.ambiguity.alternative.planes, alone.planes, strict=True):
        assert second.normal_cam1 == pytest.approx(plane.normal_cam1)
        for name in names:
            assert getattr(second, name) == pytest.approx(getattr(plane, name)), name
    assert [plane.aspect_deg for plane in report.ambiguity.alternative.planes] == [pytest.approx(60), None]


def test_an_altitude_gives_each_answer_its_own_scale() -> None:
    report = make_report_of(with_second_root(make_solution([0]), [40]), Options(altitude_m=60.0))
    assert report.ambiguity.alternative is not None
    (second,) = report.ambiguity.alternative.planes
    assert only_plane(report).distance == pytest.approx(60)
    alone = make_report_of(make_solution([40]), Options(altitude_m=60.0))
    assert second.distance == pytest.approx(only_plane(alone).distance)
    assert second.distance < 53


def test_unsafe_only_when_both_roots_are() -> None:
    report = make_report_of(with_second_root(make_solution([25, 25]), [30, 10]))
    assert verdicts(report) == ["unsafe", "undecided"]


def test_undecided_however_certain_the_other_root_is_of_safety() -> None:
    """At some slopes and sigmas the probability rounds to 1 exactly."""
    for slope in range(5, 13):
        report = make_report_of(with_second_root(make_solution([30]), [slope], sigma_deg=0.01))
        assert verdicts(report) == ["undecided"], slope


def test_each_root_is_measured_against_its_own_dominant_plane() -> None:
    """The ground is the largest window. In the other root it lies otherwise, and the windows are 20 degrees off it."""
    solution = with_second_root(make_solution([10, 10, 10]), [10, 10, 30])
    report = make_report_of(solution, Options(up="dominant-plane"))
    assert report.ambiguity.alternative is not None
    assert [plane.slope_deg for plane in report.ambiguity.alternative.planes] == pytest.approx([20, 20, 0], abs=1e-6)
    assert verdicts(report)[:2] == ["undecided"] * 2


def test_doubt_holds_for_the_other_root_too() -> None:
    solution = with_second_root(make_solution([3]), [12])
    assert verdicts(make_report_of(solution)) == ["safe"]
    # 12 +- 3 degrees is below 15 with 84 % only
    assert verdicts(make_report_of(solution, patch_changes={0: {"tilt_sigma_rad": np.radians(3)}})) == ["undecided"]


def test_never_safe_when_the_plane_is_borrowed() -> None:
    report = make_report_of(make_solution([1, 1, 40], sigma_deg=0.01), patch_changes={0: BORROWED, 2: BORROWED})
    assert verdicts(report) == ["undecided", "safe", "unsafe"]
    assert [plane.status for plane in report.planes] == ["poor", "ok", "poor"]
    assert report.planes[0].reason == BORROWED["reason"]


def test_a_borrowed_orientation_that_is_not_known_is_no_evidence_against_a_window() -> None:
    vague = BORROWED | {"tilt_sigma_rad": np.radians(12)}
    changes = {0: vague, 1: BORROWED, 2: {"tilt_sigma_rad": np.radians(12)}}
    steep = make_solution([80, 80, 80])
    assert verdicts(make_report_of(steep, patch_changes=changes)) == ["undecided", "unsafe", "unsafe"]
    both = make_report_of(with_second_root(steep, [85, 85, 85]), patch_changes=changes)
    assert verdicts(both) == ["undecided", "unsafe", "unsafe"]
    assert both.ambiguity.alternative is not None
    assert [plane.verdict for plane in both.ambiguity.alternative.planes] == ["undecided", "unsafe", "unsafe"]
    # known in the first answer, not in the second
    second = make_report_of(with_second_root(steep, [85, 85, 85], sigma_deg=12), patch_changes={0: BORROWED})
    assert verdicts(second)[0] == "undecided"


def test_a_borrowed_plane_is_never_known_better_than_terrain_varies() -> None:
    plane = only_plane(make_report_of(make_solution([10], sigma_deg=0.01), patch_changes={0: BORROWED}))
    assert plane.slope_sigma_deg >= 5
    assert plane.slope_ci95_deg[0] < 2
    assert plane.slope_ci95_deg[1] > 19
    assert plane.aspect_deg is None


# ---- doubt, statuses, refusals ----


def test_doubt_about_a_match_widens_its_interval_and_no_other() -> None:
    sure = make_report_of(make_solution([10, 10]))
    doubtful = make_report_of(make_solution([10, 10]), patch_changes={1: {"tilt_sigma_rad": np.radians(3)}})
    assert doubtful.planes[0].slope_ci95_deg == sure.planes[0].slope_ci95_deg
    low, high = doubtful.planes[1].slope_ci95_deg
    assert high - low > 10  # 2 x 1.96 x 3 degrees
    assert doubtful.planes[1].slope_sigma_deg == pytest.approx(np.hypot(0.2, 3), rel=0.05)
    assert doubtful.planes[1].p_safe < 0.97 < sure.planes[1].p_safe
    assert doubtful.planes[1].slope_deg == sure.planes[1].slope_deg


def test_doubt_about_the_plane_taken_as_level_is_doubt_about_every_slope_but_its_own() -> None:
    up, doubt = Options(up="dominant-plane"), {2: {"tilt_sigma_rad": np.radians(3)}}
    sure, doubtful = (make_report_of(make_solution([4, 10, 20]), up, patch_changes=c) for c in ({}, doubt))
    assert doubtful.up.vector_cam1 == pytest.approx(doubtful.planes[2].normal_cam1)
    assert doubtful.planes[2].slope_sigma_deg is None
    assert sure.planes[2].slope_sigma_deg is None
    for plain, plane in zip(sure.planes[:2], doubtful.planes, strict=False):
        assert plane.slope_sigma_deg == pytest.approx(np.hypot(plain.slope_sigma_deg, 3), rel=0.05)


def test_what_is_scattered_over_the_image_is_poor_and_never_safe() -> None:
    mask = np.zeros((120, 160), bool)
    mask[::40, :40], mask[20::40, 60:100] = True, True
    scattered = Footprint((60, 40), mask, np.zeros((4, 2)))
    plane = only_plane(make_report_of(make_solution([2]), footprints={0: scattered}))
    assert plane.status == "poor"
    assert plane.reason == "scattered: its largest piece is 17 % of it"
    assert plane.verdict != "safe"
    assert only_plane(make_report_of(make_solution([2]))).verdict == "safe"


def test_doubt_takes_the_aspect_of_a_gentle_slope() -> None:
    assert only_plane(make_report_of(make_solution([4]))).aspect_deg == pytest.approx(60)
    doubtful = make_report_of(make_solution([4]), patch_changes={0: {"tilt_sigma_rad": np.radians(3)}})
    assert only_plane(doubtful).aspect_deg is None
    assert only_plane(doubtful).dip_direction_deg is None


def test_a_window_with_relief_is_poor_and_not_safe() -> None:
    report = make_report_of(make_solution([2, 2], relief=np.array([0.001, 0.08])))
    assert [plane.status for plane in report.planes] == ["ok", "poor"]
    assert report.planes[1].reason == "non-planar-patch"
    assert verdicts(report) == ["safe", "undecided"]
    assert "non-planar-patch" in {d.code for d in report.diagnostics}


def test_no_plane_of_a_solution_that_did_not_converge_is_more_than_poor() -> None:
    report = make_report_of(make_solution([2, 40], converged=False), patch_changes={1: BORROWED})
    assert [plane.status for plane in report.planes] == ["poor", "poor"]
    assert report.planes[0].reason == "the joint solution did not converge"
    assert report.planes[1].reason == f"{BORROWED['reason']}; the joint solution did not converge"
    assert verdicts(report) == ["undecided", "undecided"]


def test_a_plane_that_may_be_at_infinity_is_undecided() -> None:
    assert verdicts(make_report_of(make_solution([88], sigma_deg=10.0))) == ["unsafe"]
    assert verdicts(make_report_of(make_solution([88], sigma_deg=24.5))) == ["undecided"]


def test_a_window_most_of_whose_matches_are_left_out_is_poor() -> None:
    inlier = np.ones(2 * POINTS, bool)
    inlier[POINTS : POINTS + 20] = False
    report = make_report_of(make_solution([2, 2], inlier=inlier))
    assert [plane.status for plane in report.planes] == ["ok", "poor"]
    assert [(plane.n_correspondences, plane.n_inliers) for plane in report.planes] == [(POINTS, POINTS), (POINTS, 10)]
    assert report.fit.n_inliers == POINTS + 10


def test_windows_without_an_answer_keep_their_ids_among_the_rejected() -> None:
    report = make_report_of(make_solution([10, 20]), refused=[1])
    assert [plane.id for plane in report.planes] == [1, 3]
    assert slopes(report) == pytest.approx([10, 20])
    (refused,) = report.rejected
    assert (refused.id, refused.message) == (2, "nothing to see")
    assert set(np.unique(report.labels)) == {0, 1, 3}
    x, y, w, h = WINDOWS[2]
    assert (report.labels[y : y + h, x : x + w] == 3).all()


def test_a_slope_that_could_be_anything_is_refused_not_reported() -> None:
    report = make_report_of(make_solution([10, 10], sigma_deg=[0.2, 90.0]))
    assert [plane.id for plane in report.planes] == [1]
    assert [window.id for window in report.rejected] == [2]
    assert set(np.unique(report.labels)) == {0, 1}


# ---- slopes known too badly to be told ----


def test_a_slope_above_the_largest_sigma_keeps_its_numbers_but_is_poor_and_never_safe() -> None:
    report = make_report_of(make_solution([2, 2], sigma_deg=[0.2, 24.0]), Options(tolerance_deg=85.0, confidence=0.9))
    known, unknown = report.planes
    assert (known.slope_known, known.status, known.verdict) == (True, "ok", "safe")
    assert (unknown.slope_known, unknown.status) == (False, "poor")
    assert unknown.reason is not None
    assert re.fullmatch(r"sigma \d\d° is above --max-sigma 10°", unknown.reason)
    assert unknown.p_safe > 0.95
    assert unknown.verdict == "undecided"
    assert unknown.slope_deg == pytest.approx(2, abs=1e-6)
    written = json.loads(report_to_json(report))
    # what a program tells it by
    vague = [plane["slope_sigma_deg"] > written["options"]["max_sigma_deg"] for plane in written["planes"]]
    assert vague == [False, True]


def test_too_steep_may_be_certain_where_the_slope_is_not() -> None:
    plane = only_plane(make_report_of(make_solution([80], sigma_deg=12)))
    assert (plane.slope_known, plane.verdict) == (False, "unsafe")


def test_the_largest_sigma_follows_the_option_and_says_both_numbers() -> None:
    solution = make_solution([30], sigma_deg=5.2)
    assert only_plane(make_report_of(solution)).slope_known
    sigma = only_plane(make_report_of(solution)).slope_sigma_deg
    at_the_limit = Options(max_sigma_deg=sigma)
    assert only_plane(make_report_of(solution, at_the_limit)).slope_known
    vague = only_plane(make_report_of(solution, Options(max_sigma_deg=5.1)))
    assert vague.reason == "sigma 5.2° is above --max-sigma 5.1°"
    borrowed = make_report_of(solution, Options(max_sigma_deg=2), patch_changes={0: BORROWED})
    assert only_plane(borrowed).reason == f"{BORROWED['reason']}; sigma 7° is above --max-sigma 2°"


def test_relief_is_diagnosed_in_a_window_whose_slope_is_not_known_too() -> None:
    report = make_report_of(make_solution([2], sigma_deg=20, relief=np.array([0.08])))
    assert only_plane(report).reason == "non-planar-patch; sigma 27° is above --max-sigma 10°"
    assert "non-planar-patch" in {d.code for d in report.diagnostics}


def test_a_plane_found_is_dropped_above_the_largest_sigma() -> None:
    solution = make_solution([2, 2], sigma_deg=[0.2, 14.0])
    report = make_report_of(solution, source="region")
    assert [plane.id for plane in report.planes] == [1]
    assert "do not determine the slope: 1-sigma" in report.rejected[0].message
    assert len(make_report_of(solution, Options(max_sigma_deg=30), source="region").planes) == 2


def test_an_up_that_is_not_known_is_not_blamed_on_texture() -> None:
    solution = make_solution([2, 2])
    with pytest.raises(NoAnswer, match=r"^up-unknown: .* that of up, 20°; .*--up-sigma"):
        make_report_of(solution, Options(up_sigma_deg=20), source="region")
    with pytest.raises(NoAnswer, match=r"^low-texture: .*too little texture"):
        make_report_of(make_solution([2, 2], sigma_deg=30), Options(up_sigma_deg=1), source="region")
    with pytest.raises(NoAnswer, match=r"^slope-open: .*its rows do not determine the slope: 1-sigma") as told:
        make_report_of(make_solution([2, 2], sigma_deg=80), source="given")
    assert "texture" not in str(told.value)


def test_never_safe_where_the_slope_of_the_other_root_is_not_known() -> None:
    solution = with_second_root(make_solution([2]), [2], sigma_deg=20)
    assert only_plane(make_report_of(solution, Options(tolerance_deg=85.0, confidence=0.9))).verdict == "undecided"


@pytest.mark.parametrize(("source", "noun"), [("window", "window"), ("ransac", "plane"), ("region", "region")])
def test_messages_call_a_patch_what_it_is(source: str, noun: str) -> None:
    partly = make_report_of(make_solution([5]), patch_changes={0: {"share": 0.3}}, source=source).planes[0]
    assert partly.reason == f"only 30 % of the {noun} could be matched"
    with pytest.raises(NoAnswer, match=f"the matches of all 2 {noun}s do not .*; choose larger {noun}s"):
        make_report_of(make_solution([5, 5], sigma_deg=[90.0, 90.0]), source=source)
    patch = Patch(1, source, window_footprint(WINDOWS[0])).unmatched("nothing to see")
    with pytest.raises(NoAnswer, match=f"none of the 1 {noun}s can be matched: .*; choose {noun}s with"):
        join_patches(Found([patch]), None)  # type: ignore[arg-type]  # the scene is not asked


def test_both_answers_are_reported_with_what_would_decide() -> None:
    found = make_report_of(with_second_root(make_solution([5, 10]), [25, 30])).ambiguity
    assert found.status == "unresolved"
    assert found.delta_chi2 == 2.5
    assert found.resolve_with
    assert found.alternative is not None
    assert [(plane.id, plane.slope_deg) for plane in found.alternative.planes] == [
        (1, pytest.approx(25)),
        (2, pytest.approx(30)),
    ]
    assert [plane.slope_sigma_deg for plane in found.alternative.planes] == pytest.approx([0.2, 0.2], rel=0.01)
    resolved = make_report_of(with_second_root(make_solution([5]), [25], status="resolved")).ambiguity
    assert (resolved.status, resolved.resolve_with) == ("resolved", None)


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
