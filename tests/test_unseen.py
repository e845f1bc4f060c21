"""What is not seen of a window widens its sigma: by where the gaps are, and by how the ground around bends."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from slopecli.look import Evidence
from slopecli.patches.windows import bend_rad, beside_rad, gaps_of, stepped_rad, surer_along, unseen_rad
from slopecli.types import FloatArray

WINDOW = (100, 80, 160, 160)
FOCAL = 500.0


def evidence_of(bend_deg: float, count: int = 3000) -> Evidence:
    """Ground 5 baselines off that tilts by so much more from one block of 80 px to the next, then by so much less."""
    uv1 = np.random.default_rng(0).uniform(0, 480, (count, 2))
    x1 = (uv1 - 240) / FOCAL
    width = 80 / FOCAL
    zigzag = width * np.abs(((x1[:, 0] + 240 / FOCAL) / width) % 2 - 1)
    w = 0.2 + 0.2 * np.tan(np.radians(bend_deg)) * zigzag
    ones = np.ones(count)
    return Evidence(uv1, uv1, x1, x1, w, ones, ones, FOCAL, count)


def matches(spacing: float = 8.0) -> FloatArray:
    x, y, w, h = WINDOW
    u, v = np.meshgrid(np.arange(x + 2, x + w, spacing), np.arange(y + 2, y + h, spacing))
    return np.column_stack([u.ravel(), v.ravel()])


def doubt_deg(uv1: FloatArray, bend_deg: float = 10.0, height_px: float = 0.0) -> float:
    gaps = gaps_of(WINDOW, uv1, len(uv1) / len(matches()))
    return float(np.degrees(unseen_rad(gaps, height_px, evidence_of(bend_deg))))


def test_a_window_seen_all_over_leaves_no_doubt() -> None:
    assert doubt_deg(matches()) == 0.0


def test_half_a_window_leaves_half_the_bend_in_doubt() -> None:
    uv1 = matches()
    bend = float(np.degrees(bend_rad(evidence_of(10.0), 80)))
    assert doubt_deg(uv1[uv1[:, 0] < 180]) == pytest.approx(bend / 2, rel=0.15)
    assert doubt_deg(uv1[uv1[:, 1] > 160]) == pytest.approx(bend / 2, rel=0.15)


def test_the_smaller_the_part_that_is_seen_the_larger_the_doubt() -> None:
    uv1 = matches()
    doubts = [doubt_deg(uv1[uv1[:, 0] < 100 + part * 160]) for part in (0.2, 0.4, 0.6, 0.8, 1.0)]
    assert np.all(np.diff(doubts) < 0)


def test_gaps_between_matches_matter_less_than_a_side_that_is_missing() -> None:
    uv1 = matches()
    thinned = uv1[np.random.default_rng(1).random(len(uv1)) < 0.6]
    side = uv1[uv1[:, 0] < 100 + 0.6 * 160]
    assert doubt_deg(thinned) < 0.3 * doubt_deg(side)


def test_ground_that_bends_more_leaves_more_doubt() -> None:
    half = matches()[:200]
    assert doubt_deg(half, 2.0) < doubt_deg(half, 10.0) < doubt_deg(half, 25.0)


def test_what_is_rough_where_it_is_seen_is_rough_where_it_is_not() -> None:
    side = matches()
    side = side[side[:, 0] < 244]
    assert doubt_deg(side, height_px=5.0) > doubt_deg(side, height_px=2.0) > doubt_deg(side)
    # a tenth of the window at its edge, 5 px high, tilts the least squares over 160 px by 0.1 5 72 / (160^2 / 12)
    assert doubt_deg(side, 0.0, 5.0) == pytest.approx(np.degrees(0.1 * 5 * 72 / (160**2 / 12)), rel=0.3)


@pytest.mark.parametrize(("axis", "along"), [(0, [0.0, 1.0, 0.0]), (1, [1.0, 0.0, 0.0])])
def test_the_tilt_along_the_border_of_what_is_seen_is_surer(axis: int, along: list[float]) -> None:
    uv1 = matches()
    half = uv1[uv1[:, axis] < [180, 160][axis]]
    surer = surer_along(gaps_of(WINDOW, half, 0.5), LEVEL, np.array([0.0, 0.0, 1.0]))
    assert np.sqrt(1.0 - surer @ surer) == pytest.approx(0.5)
    assert abs(surer @ along) == pytest.approx(np.linalg.norm(surer), rel=1e-3)


def test_with_gaps_on_all_sides_the_tilt_is_as_open_in_all_directions() -> None:
    uv1 = matches()
    middle = uv1[np.abs(uv1 - [180, 160]).max(axis=1) < 40]
    surer = surer_along(gaps_of(WINDOW, middle, 0.25), LEVEL, np.array([0.0, 0.0, 1.0]))
    assert np.linalg.norm(surer) < 0.4
    assert not surer_along(gaps_of(WINDOW, uv1, 1.0), LEVEL, np.array([0.0, 0.0, 1.0])).any()


def test_ground_hardly_seen_may_bend_as_ground_does() -> None:
    assert np.degrees(bend_rad(evidence_of(0.0, 3), 80)) == pytest.approx(10.0)
    assert np.degrees(bend_rad(evidence_of(0.0, 0), 80)) == pytest.approx(10.0)


def test_no_bend_is_believed_to_be_nothing() -> None:
    assert 1.0 < np.degrees(bend_rad(evidence_of(0.0), 80)) < 5.0


def test_the_bend_is_that_of_the_ground() -> None:
    # along one of two axes, from +15 to -15 degrees about the mean at every step
    assert 6.0 < np.degrees(bend_rad(evidence_of(15.0), 80)) < 16.0


# ---- steps ----

LEVEL = np.array([0.0, 0.0, 0.2])  # 5 baselines off


def terrace(edge: float, drop: float, count: int = 3000) -> Evidence:
    """Level ground, left of the column `edge` at 5 baselines, right of it farther by the share `drop`."""
    uv1 = np.random.default_rng(0).uniform(0, 480, (count, 2))
    x1 = (uv1 - 240) / FOCAL
    ones = np.ones(count)
    w = np.where(uv1[:, 0] < edge, 0.2, 0.2 / (1 + drop))
    return Evidence(uv1, uv1, x1, x1, w, ones, ones, FOCAL, count)


def left_part(edge: float) -> FloatArray:
    uv1 = matches()
    return uv1[uv1[:, 0] < edge]


def beside_deg(uv1: FloatArray, evidence: Evidence) -> float:
    return float(np.degrees(beside_rad(gaps_of(WINDOW, uv1, len(uv1) / len(matches())), LEVEL, evidence, FOCAL)))


@pytest.mark.parametrize("drop", [0.1, 0.3])
def test_a_gap_may_lie_as_deep_as_the_ground_beside_it(drop: float) -> None:
    """The right quarter of the window has no match, and what the overview has matched there lies across a step."""
    step_px = drop * FOCAL  # at the distance of the plane, about
    sought = np.degrees(np.arctan(0.25 * step_px * 60 / (160**2 / 12)))
    assert beside_deg(left_part(220), terrace(220, drop)) == pytest.approx(min(sought, 30.0), rel=0.35)


def test_a_step_that_begins_beyond_the_window_counts_where_the_window_ends_in_a_gap() -> None:
    assert beside_deg(left_part(244), terrace(262, 0.3)) > 3.0


@pytest.mark.parametrize("zoom", [0.5, 2.0])
def test_a_step_is_as_high_whatever_camera_2_is(zoom: float) -> None:
    seen = terrace(220, 0.1)
    names = ("uv1", "uv2", "x1", "x2", "w", "leverage", "grey")
    zoomed = Evidence(*(getattr(seen, name) for name in names), zoom * FOCAL, len(seen))
    assert beside_deg(left_part(220), zoomed) == pytest.approx(beside_deg(left_part(220), seen), rel=1e-6)


def test_no_gap_no_step() -> None:
    assert beside_deg(matches(), terrace(262, 0.3)) == 0.0
    assert beside_deg(left_part(220), terrace(480, 0.3)) == 0.0


def test_ground_that_bends_beside_a_gap_is_no_step() -> None:
    """Off the plane by no more than it is away: a slope of less than 45 degrees against the window."""
    assert beside_deg(left_part(244), evidence_of(20.0)) < 0.5


def test_a_gap_that_is_confirmed_is_no_step() -> None:
    uv1 = left_part(220)
    gaps = gaps_of(WINDOW, uv1, len(uv1) / len(matches()))
    held = replace(gaps, confirmed=~gaps.seen)
    assert beside_rad(gaps, LEVEL, terrace(220, 0.3), FOCAL) > 0.05
    assert beside_rad(held, LEVEL, terrace(220, 0.3), FOCAL) == 0.0
    assert unseen_rad(held, 5.0, evidence_of(10.0)) < unseen_rad(gaps, 5.0, evidence_of(10.0))


def test_amid_matches_only_what_lies_in_the_gap_itself_counts() -> None:
    """A gap in the window, and ground off the plane beside the window or in the gap only."""
    uv1 = matches()
    gap = np.abs(uv1 - [225, 160]).max(axis=1) < 8
    gaps = gaps_of(WINDOW, uv1[~gap], 1.0)
    seen = terrace(480, 0.0)
    outside = ~seen.near(WINDOW, 0.0)
    inside = np.abs(seen.uv1 - [225, 160]).max(axis=1) < 20
    beyond, within = (replace(seen, w=np.where(off, seen.w / 1.3, seen.w)) for off in (outside, inside))
    assert not gaps.seen.all()
    assert beside_rad(gaps, LEVEL, beyond, FOCAL) == 0.0
    assert beside_rad(gaps, LEVEL, within, FOCAL) > 0.0


def test_mismatches_scattered_beside_a_gap_are_no_step() -> None:
    """The overview matches level ground right of the column 220 as well, but for mismatches at any depth."""
    level = terrace(480, 0.0)
    strip = (level.uv1[:, 0] > 220) & (np.random.default_rng(1).random(len(level)) < 0.1)
    depth = np.random.default_rng(2).uniform(1.5, 4.0, len(level))
    mistaken = replace(level, w=np.where(strip, level.w / depth, level.w))
    assert beside_deg(left_part(220), mistaken) < 0.1 * beside_deg(left_part(220), terrace(220, 0.5))
    gaps = gaps_of(WINDOW, left_part(220), 0.75)
    assert stepped_rad(gaps, LEVEL, mistaken, FOCAL) < 0.1 * stepped_rad(gaps, LEVEL, terrace(220, 0.5), FOCAL)


def test_many_overview_matches_off_the_plane_of_a_large_window_take_little_memory() -> None:
    window, wide = (0, 0, 480, 480), evidence_of(0.0)
    uv1 = matches(4.0) * 480 / 160 - (300, 240)
    left = uv1[uv1[:, 0] < 120]
    across = wide.uv1[:, 0] > 120
    stepped = replace(wide, w=np.where(across, wide.w / 1.3, wide.w))
    gaps = gaps_of(window, left, len(left) / len(uv1))
    tracemalloc.start()
    tilt = stepped_rad(gaps, LEVEL, stepped, FOCAL)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert tilt > 0.05
    assert most < 60e6


def test_the_part_across_a_step_tilts_the_whole() -> None:
    gaps = gaps_of(WINDOW, left_part(220), 0.75)
    assert np.degrees(stepped_rad(gaps, LEVEL, terrace(220, 0.2), FOCAL)) > 10.0
    assert stepped_rad(gaps, LEVEL, terrace(480, 0.2), FOCAL) == 0.0
    # where the window is matched all over, the overview is mistaken
    assert stepped_rad(gaps_of(WINDOW, matches(), 1.0), LEVEL, terrace(220, 0.2), FOCAL) == 0.0


def test_a_strip_along_the_edge_is_not_filled_by_the_matches_beside_it() -> None:
    """Three cells wide it is a gap to its middle; two or three cells inside the window there is none."""
    gaps = gaps_of(WINDOW, left_part(230), 0.81)
    x, y, w, h = WINDOW
    middle = y + np.arange(20.0, h - 20.0)
    assert gaps.filled(np.column_stack([np.full(len(middle), x + w - 15.0), middle])).max() < 0.5
    assert gaps.filled(np.column_stack([np.full(len(middle), x + 60.0), middle])).min() > 0.5
