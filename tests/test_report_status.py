"""Status of planes with its reasons: doubt, slopes known too badly, and patches without an answer."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from solution_factory import (
    POINTS,
    WINDOWS,
    make_report_of,
    make_solution,
    with_second_root,
)
from test_report import BORROWED, only_plane, slopes, verdicts

from slopecli.errors import NoAnswer
from slopecli.options import Options
from slopecli.patches import Footprint, Found, Patch, join_patches, window_footprint
from slopecli.products import report_to_json

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
