"""Motions from matches: the truth is among them whatever the share of mismatches, on flat ground both roots are."""

from __future__ import annotations

import numpy as np
import pytest
from scenery import make_camera, tilted, turn, unit

from slopecli.geometry import (
    MotionEstimate,
    decompose_homography,
    direction_angle,
    epipolar_residual,
    homogeneous,
    rotation_angle,
)
from slopecli.look import distinct_motions, inliers_of, rank_motions, starting_motions
from slopecli.types import FloatArray

CAMERA = make_camera()
FOCAL = CAMERA.focal_px
R, T, GROUND = turn(1, -2, 3), unit(0.8, 0.2, 0.4), tilted(0.2, -0.1)
Points = tuple[FloatArray, FloatArray]


def matches(n: int, relief: float, mismatched: float, seed: int = 0, noise_px: float = 0.2) -> Points:
    """x1, x2 (n, 2): `relief` is the spread of inverse depths about the ground; mismatches come first."""
    rng = np.random.default_rng(seed)
    x1 = (rng.uniform([0, 0], [CAMERA.width, CAMERA.height], (n, 2)) - [CAMERA.cx, CAMERA.cy]) / FOCAL
    w = homogeneous(x1) @ GROUND * rng.uniform(1 - relief, 1 + relief, n)
    moved = (homogeneous(x1) - w[:, None] * T) @ R.T
    x2 = moved[:, :2] / moved[:, 2:] + noise_px / FOCAL * rng.standard_normal((n, 2))
    wrong = int(mismatched * n)
    x2[:wrong] = rng.uniform([-0.57, -0.43], [0.57, 0.43], (wrong, 2))
    return x1, x2


def apart_deg(motion: MotionEstimate, rotation: FloatArray = R, position: FloatArray = T) -> tuple[float, float]:
    """Angles of rotation and direction between a motion and the truth, deg."""
    return (
        float(np.degrees(rotation_angle(motion.R, rotation))),
        float(np.degrees(direction_angle(motion.T, position))),
    )


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("mismatched", "margins_deg"), [(0.0, (0.1, 0.3)), (0.3, (0.1, 0.3)), (0.6, (0.7, 4.0))])
def test_the_best_start_is_the_truth(mismatched: float, margins_deg: tuple[float, float], seed: int) -> None:
    best = starting_motions(*matches(400, 0.3, mismatched, seed), FOCAL)[0]
    rotation, direction = apart_deg(best)
    assert rotation < margins_deg[0]
    assert direction < margins_deg[1]
    assert best.front > 0.97


@pytest.mark.slow
def test_a_thorough_search_bears_three_quarters_of_mismatches() -> None:
    x1, x2 = matches(400, 0.3, 0.75)
    best = starting_motions(x1, x2, FOCAL, thorough=True)[0]
    rotation, direction = apart_deg(best)
    assert rotation < 0.5
    assert direction < 2.0
    found = inliers_of(epipolar_residual(best.R, best.T, x1, x2), FOCAL)
    assert found[300:].mean() > 0.99
    assert found[:300].mean() < 0.1  # mismatches lie near their epipolar lines by chance


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("mismatched", [0.0, 0.3])
def test_flat_ground_gives_both_roots(mismatched: float, seed: int) -> None:
    motions = starting_motions(*matches(400, 0.0, mismatched, seed), FOCAL)
    homography = R @ (np.eye(3) - np.outer(T, GROUND))
    roots = [m for m in decompose_homography(homography) if m.N[2] > 0]
    assert len(roots) == 2
    for root in roots:
        nearest = min((apart_deg(m, root.R, root.T) for m in motions), key=sum)
        assert nearest[0] < 1.0
        assert nearest[1] < 2.5


@pytest.mark.parametrize("direction", [(1, 0, 0), (-1, 0, 0), (0, 0, 1), (0, 0, -1)])
def test_the_ground_is_in_front_and_not_behind(direction: tuple[float, float, float]) -> None:
    rng = np.random.default_rng(1)
    position = unit(*direction)
    x1 = rng.uniform([-0.55, -0.4], [0.55, 0.4], (300, 2))
    moved = (homogeneous(x1) - (homogeneous(x1) @ GROUND * rng.uniform(0.7, 1.3, 300))[:, None] * position) @ R.T
    x2 = moved[:, :2] / moved[:, 2:] + 0.1 / FOCAL * rng.standard_normal((300, 2))
    best = starting_motions(x1, x2, FOCAL)[0]
    assert max(apart_deg(best, R, position)) < 0.5
    assert best.front == 1.0


def test_same_matches_same_starts() -> None:
    x1, x2 = matches(300, 0.2, 0.4)
    first, second = (starting_motions(x1, x2, FOCAL, thorough=True) for _ in range(2))
    assert len(first) == len(second)
    for a, b in zip(first, second, strict=True):
        assert np.array_equal(a.R, b.R)
        assert np.array_equal(a.T, b.T)


@pytest.mark.parametrize("n", [0, 1, 7])
def test_fewer_than_eight_matches_give_none(n: int) -> None:
    x1, x2 = matches(8, 0.3, 0.0)
    assert starting_motions(x1[:n], x2[:n], FOCAL) == []


@pytest.mark.parametrize("case", ["eight", "coincident", "collinear", "still"])
def test_bad_matches_raise_nothing(case: str) -> None:
    x1, x2 = matches(60, 0.3, 0.0)
    if case == "eight":
        x1, x2 = x1[:8], x2[:8]
    if case == "coincident":
        x1, x2 = np.repeat(x1[:1], 60, 0), np.repeat(x2[:1], 60, 0)
    if case == "collinear":
        x1 = x2 = np.column_stack([np.linspace(-0.5, 0.5, 60), np.zeros(60)])
    if case == "still":
        x2 = x1
    for motion in starting_motions(x1, x2, FOCAL):
        assert np.isfinite(motion.R).all()
        assert np.linalg.norm(motion.T) == pytest.approx(1.0)


def motion(rotation: FloatArray, position: FloatArray) -> MotionEstimate:
    return MotionEstimate(rotation, position, 1e-3, 0.0, 1.0)


def test_motions_are_ranked_by_how_well_they_fit() -> None:
    x1, x2 = matches(300, 0.3, 0.2)
    near, far = motion(turn(0.1) @ R, T), motion(turn(0, 4) @ R, unit(0.7, 0.4, 0.4))
    ranked = rank_motions([far, motion(R, T), near], x1, x2, FOCAL)
    # the near one repeats the truth and is dropped
    assert [apart_deg(m)[0] < 0.01 for m in ranked] == [True, False]
    assert ranked[0].cost < ranked[1].cost


def test_repeats_are_dropped_but_not_other_roots() -> None:
    first, again = motion(R, T), motion(turn(0.5) @ R, T)
    turned, moved = motion(turn(1.5) @ R, T), motion(R, unit(*(T + np.array([0.0, 0.06, 0.0]))))
    assert distinct_motions([first, again, turned, moved]) == [first, turned, moved]
    assert distinct_motions([first, again, turned, moved], limit=2) == [first, turned]


def test_matches_within_two_pixels_of_their_epipolar_line_count() -> None:
    assert inliers_of(np.array([0.0, 1.9, -1.9, 2.1, -40.0]) / FOCAL, FOCAL).tolist() == [True] * 3 + [False] * 2
