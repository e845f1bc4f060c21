"""Verdicts of a report: by slope and sigma, of both roots, and of borrowed planes."""

from __future__ import annotations

import numpy as np
import pytest
from report_factory import normal_of
from solution_factory import (
    make_report_of,
    make_solution,
    with_second_root,
)
from test_report import BORROWED, only_plane, verdicts

from slopecli.findings import finding
from slopecli.options import Options

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
