"""The motion alone: what its residual measures, how it is refined among mismatches, on which side the scene lies."""

from __future__ import annotations

import numpy as np
import pytest
from scenery import tilted, turn, unit

from slopecli.geometry import (
    MotionEstimate,
    assess_motion,
    direction_angle,
    epipolar_residual,
    homogeneous,
    inverse_depth,
    refine_motion,
    rotation_angle,
)
from slopecli.types import FloatArray

PX = 1 / 277.0  # of the cameras of these tests, normalised
R, T = turn(1, -2, 3), unit(0.8, 0.2, 0.4)
BOUNDS = (0.05 * PX, 0.7 * PX)
Points = tuple[FloatArray, FloatArray, FloatArray]


def scene(n: int = 300, noise_px: float = 0.0, position: FloatArray = T, seed: int = 0, relief: float = 0.3) -> Points:
    """x1, x2 (n, 2) and true inverse depths (n,) of rough ground; noise in image 2 only."""
    rng = np.random.default_rng(seed)
    x1 = rng.uniform([-0.55, -0.4], [0.55, 0.4], (n, 2))
    w = homogeneous(x1) @ tilted(0.2, -0.1) * rng.uniform(1 - relief, 1 + relief, n)
    return x1, project(x1, w, position) + noise_px * PX * rng.standard_normal((n, 2)), w


def project(x1: FloatArray, w: FloatArray, position: FloatArray = T) -> FloatArray:
    moved = (homogeneous(x1) - np.asarray(w)[:, None] * position) @ R.T
    return np.asarray(moved[:, :2] / moved[:, 2:])


def errors_deg(motion: MotionEstimate, position: FloatArray = T) -> tuple[float, float]:
    return float(np.degrees(rotation_angle(motion.R, R))), float(np.degrees(direction_angle(motion.T, position)))


def test_residual_is_zero_at_the_truth_and_for_the_baseline_reversed() -> None:
    x1, x2, _ = scene()
    assert np.abs(epipolar_residual(R, T, x1, x2)).max() < 1e-14
    assert np.abs(epipolar_residual(R, -T, x1, x2)).max() < 1e-14


@pytest.mark.parametrize(
    ("position", "least"), [((1, 0, 0), 0.98), ((0.8, 0.2, 0.4), 0.93), ((0, 0, 1), 0.86)], ids=str
)
def test_residual_is_nearly_the_distance_from_the_epipolar_line(
    position: tuple[float, float, float], least: float
) -> None:
    true = unit(*position)
    x1, x2, w = scene(position=true)
    along = project(x1, 1.001 * w, true) - x2
    across = np.column_stack([-along[:, 1], along[:, 0]]) / np.linalg.norm(along, axis=1, keepdims=True)
    ratio = np.abs(epipolar_residual(R, true, x1, x2 + 0.5 * PX * across)) / (0.5 * PX)
    # exact where both images are equally large; a descent by one sixth makes the second larger
    assert ratio.min() > least
    assert ratio.max() < 1.02


def test_residual_has_the_spread_of_the_noise() -> None:
    x1, x2, _ = scene(4000, noise_px=0.3)
    assert np.std(epipolar_residual(R, T, x1, x2)) / PX == pytest.approx(0.3, rel=0.05)


@pytest.mark.parametrize("position", [(0.8, 0.2, 0.4), (1, 0, 0), (0, 0, 1)])
@pytest.mark.parametrize("off_deg", [1.0, 4.0])
def test_without_noise_refinement_ends_at_the_truth(position: tuple[float, float, float], off_deg: float) -> None:
    true = unit(*position)
    x1, x2, _ = scene(position=true)
    start = turn(0.6 * off_deg, -0.6 * off_deg, 0.5 * off_deg) @ R
    found = refine_motion(start, turn(off_deg, off_deg) @ true, x1, x2, BOUNDS, iterations=30)
    assert max(errors_deg(found, true)) < 1e-4
    assert found.front == 1.0
    assert found.scale == BOUNDS[0]


def rms_errors_deg(
    bounds: tuple[float, float], noise_px: float, mismatches: int = 0, seeds: int = 10
) -> tuple[float, float]:
    """RMS error of rotation and direction over some scenes of 300 points, deg."""
    errors = []
    for seed in range(seeds):
        x1, x2, _ = scene(noise_px=noise_px, seed=seed)
        x2[:mismatches] = np.random.default_rng(seed + 1).uniform([-0.55, -0.4], [0.55, 0.4], (mismatches, 2))
        errors.append(errors_deg(refine_motion(turn(0.5, -0.5) @ R, T, x1, x2, bounds)))
    rotation, direction = np.sqrt(np.mean(np.square(errors), axis=0))
    return float(rotation), float(direction)


def test_robustness_costs_little_accuracy() -> None:
    least_squares = rms_errors_deg((10 * PX, 20 * PX), 0.3, seeds=40)  # all weights are one
    robust = rms_errors_deg(BOUNDS, 0.3, seeds=40)
    assert robust[0] < 1.25 * least_squares[0] < 0.08
    assert robust[1] < 1.25 * least_squares[1] < 0.25


def test_noise_is_estimated_with_the_motion() -> None:
    found = refine_motion(R, T, *scene(2000, noise_px=0.3)[:2], BOUNDS)
    assert found.scale / PX == pytest.approx(0.3, rel=0.05)


@pytest.mark.parametrize(("mismatches", "margins_deg"), [(100, (0.1, 0.4)), (180, (0.25, 0.9))])
def test_mismatches_hardly_move_it(mismatches: int, margins_deg: tuple[float, float]) -> None:
    rotation, direction = rms_errors_deg(BOUNDS, 0.2, mismatches)
    assert rotation < margins_deg[0]
    assert direction < margins_deg[1]


def test_a_majority_of_mismatches_does_not_pass_for_noise() -> None:
    x1, x2, _ = scene(noise_px=0.2)
    x2[:180] = np.random.default_rng(1).uniform([-0.55, -0.4], [0.55, 0.4], (180, 2))
    assert refine_motion(R, T, x1, x2, BOUNDS).scale == BOUNDS[1]


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("position", [(0.8, 0.2, 0.4), (-1, 0.1, 0), (0, 0, 1), (0, 0, -1)])
def test_of_two_baselines_the_one_with_the_scene_in_front_is_taken(
    position: tuple[float, float, float], sign: float
) -> None:
    true = unit(*position)
    x1, x2, _ = scene(noise_px=0.2, position=true)
    found = assess_motion(R, sign * true, x1, x2, 0.2 * PX)
    np.testing.assert_allclose(found.T, true, atol=1e-12)
    assert found.front > 0.99


def test_points_near_infinity_are_not_called_behind() -> None:
    x1, _, w = scene()
    w[:50] = 0.0
    x2 = project(x1, w) + 0.2 * PX * np.random.default_rng(2).standard_normal((300, 2))
    assert (inverse_depth(R, T, x1, x2)[0] < 0).any()
    assert assess_motion(R, T, x1, x2, 0.2 * PX).front == 1.0


def test_cost_is_the_truncated_mean_square() -> None:
    x1, x2, _ = scene(noise_px=0.2)
    residual = epipolar_residual(R, T, x1, x2)
    assert assess_motion(R, T, x1, x2, PX).cost == pytest.approx(np.mean(residual**2))
    x2[0] += [0.0, 0.3]  # far off, and no further than far off
    residual[0] = 4 * PX
    assert assess_motion(R, T, x1, x2, PX).cost == pytest.approx(np.mean(residual**2))


def test_inverse_depth_is_exact_without_noise() -> None:
    x1, x2, w = scene()
    np.testing.assert_allclose(inverse_depth(R, T, x1, x2)[0], w, rtol=1e-12)


def test_leverage_is_how_far_the_point_moves_with_its_inverse_depth() -> None:
    x1, x2, w = scene()
    step = 1e-6
    moved = np.linalg.norm(project(x1, w + step) - project(x1, w - step), axis=1) / (2 * step)
    np.testing.assert_allclose(inverse_depth(R, T, x1, x2)[1], moved, rtol=1e-6)


def test_leverage_vanishes_at_the_focus_of_expansion() -> None:
    ahead = unit(0.1, -0.05, 1)
    x1 = ahead[:2] + np.array([[0.0, 0.0], [0.02, 0.0], [0.2, 0.0]])
    _, leverage = inverse_depth(R, ahead, x1, project(x1, np.full(3, 0.2), ahead))
    assert leverage[0] < 0.005
    assert leverage[0] < 0.3 * leverage[1] < 0.1 * leverage[2]


@pytest.mark.parametrize("x2_is", ["same", "rotated"])
def test_without_parallax_it_still_answers_with_numbers(x2_is: str) -> None:
    x1, _, w = scene()
    x2 = x1.copy() if x2_is == "same" else project(x1, 0 * w)
    found = refine_motion(np.eye(3), T, x1, x2, BOUNDS)
    assert np.isfinite(found.R).all()
    assert np.linalg.norm(found.T) == pytest.approx(1.0)
    assert found.cost < 1e-12
