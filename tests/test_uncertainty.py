"""The bound is the bound, and the solver's covariance tells the truth about its errors."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from slopecli.errors import InputError
from slopecli.geometry import (
    cramer_rao_bound,
    direction_angle,
    measure_slopes,
    normal_angle,
    rotation_angle,
    rotation_from_vector,
    slope_interval,
    solve_planes,
)
from slopecli.geometry.solver import Covariance
from slopecli.study import UP, Scene, make_scene, paper_scene, project


def bound(scene: Scene) -> Covariance:
    return cramer_rao_bound(scene.R, scene.T, scene.normals, scene.x1_clean, scene.patch, scene.noise)


def test_bound_is_the_inverse_of_the_numerical_fisher_information() -> None:
    scene = make_scene(np.random.default_rng(1), grid=(2, 1), points=15)
    got = bound(scene)

    def predicted(parameters: np.ndarray) -> np.ndarray:
        T = scene.T + got.tangent @ parameters[3:5]
        N = scene.normals + parameters[5:].reshape(2, 3)
        p = np.column_stack([scene.x1_clean, np.ones(30)])
        R = rotation_from_vector(parameters[:3]) @ scene.R
        return project(R, T, scene.x1_clean, np.sum(N[scene.patch] * p, axis=1)).ravel()

    h = 1e-6
    J = np.array([(predicted(h * e) - predicted(-h * e)) / (2 * h) for e in np.eye(11)]).T
    covariance = scene.noise**2 * np.linalg.inv(J.T @ J)
    assert got.motion_covariance == pytest.approx(covariance[:5, :5], rel=1e-5)
    for i in range(2):
        block = slice(5 + 3 * i, 8 + 3 * i)
        assert got.normal_covariance[i] == pytest.approx(covariance[block, block], rel=1e-5)
    cross = got.normal_gain[0] @ got.motion_covariance @ got.normal_gain[1].T
    assert cross == pytest.approx(covariance[5:8, 8:11], rel=1e-4, abs=1e-6 * np.abs(covariance).max())


def tangent_trace(scene: Scene, covariance: np.ndarray) -> np.ndarray:
    """(m,) variance of the unit normals' direction, rad^2."""
    length = np.linalg.norm(scene.normals, axis=1)
    n = scene.normals / length[:, None]
    P = np.eye(3) - n[:, :, None] * n[:, None]
    return np.trace(P @ covariance @ P, axis1=1, axis2=2) / length**2


def test_bound_of_one_flat_plane_grows_as_one_over_slope_in_vertical_descent() -> None:
    """The normal is uncertain by 1.65 deg at 1 deg of slope, 0.3 px, 270 points: no geometry says less."""
    sigma = {}
    for slope in (1.0, 2.0, 4.0):
        scene = make_scene(
            np.random.default_rng(2), trajectory_deg=0.0, grid=(1, 1), points=270, slopes_deg=[slope], height_spread=0.0
        )
        sigma[slope] = np.degrees(np.sqrt(tangent_trace(scene, bound(scene).normal_covariance)[0]))
    assert sigma[1.0] == pytest.approx(1.65, rel=0.05)
    assert sigma[1.0] / sigma[2.0] == pytest.approx(2.0, rel=0.05)
    assert sigma[2.0] / sigma[4.0] == pytest.approx(2.0, rel=0.05)


def test_bound_refuses_points_on_no_plane() -> None:
    scene = make_scene(np.random.default_rng(3), free_points=3)
    with pytest.raises(InputError, match="points on no patch"):
        bound(scene)


def test_covariance_grows_with_noise_and_with_its_gain() -> None:
    scene = make_scene(np.random.default_rng(4))
    plain = solve_planes(scene.x1, scene.x2, scene.patch, noise=1e-3)
    double = solve_planes(scene.x1, scene.x2, scene.patch, noise=2e-3)
    shared = solve_planes(scene.x1, scene.x2, scene.patch, noise=1e-3, noise_gain=2.0)
    assert double.normal_covariance == pytest.approx(4.0 * plain.normal_covariance, rel=1e-6)
    assert shared.normal_covariance == pytest.approx(double.normal_covariance, rel=1e-6)
    assert shared.noise == plain.noise


def test_points_on_no_plane_only_help() -> None:
    """One window, level flight: free points sharpen motion and normal."""
    rng = np.random.default_rng(5)
    scene = make_scene(rng, trajectory_deg=90.0, grid=(1, 1), slopes_deg=[10.0], free_points=200)
    alone = scene.patch == 0
    one = solve_planes(scene.x1[alone], scene.x2[alone], scene.patch[alone], noise=scene.noise)
    both = solve_planes(scene.x1, scene.x2, scene.patch, noise=scene.noise)
    assert np.trace(both.motion_covariance) < 0.5 * np.trace(one.motion_covariance)
    assert np.all(np.linalg.eigvalsh(one.normal_covariance[0] - both.normal_covariance[0]) > -1e-12)


def test_joined_roots_cover_what_lies_between_them() -> None:
    """Vertical descent over level ground: each root by itself claims far too much."""
    covered = []
    for seed in range(40):
        scene = make_scene(
            np.random.default_rng([6, seed]), trajectory_deg=0.0, grid=(1, 1), points=270, slopes_deg=[0.5]
        )
        slopes = measure_slopes(solve_planes(scene.x1, scene.x2, scene.patch), UP)
        low, high = slope_interval(slopes)[0]
        covered.append(low <= scene.slopes[0] <= high)
    assert np.mean(covered) > 0.85


@pytest.mark.slow
@pytest.mark.parametrize("trajectory", [0.0, 45.0, 90.0])
def test_errors_are_at_the_cramer_rao_bound_and_intervals_cover(trajectory: float) -> None:
    """40 terrains, 10 noise levels: normals within 5 % of the bound, motion within 10 %, 93-97 % covered."""
    squared, expected, covered = [], [], []
    for k in range(1, 11):
        for terrain in range(40):
            noise_rng = np.random.default_rng([11, terrain, k, int(trajectory)])
            scene = paper_scene(np.random.default_rng([11, terrain]), trajectory, 0.1 * k, noise_rng)
            solution = solve_planes(scene.x1, scene.x2, scene.patch)
            assert solution.converged
            least = bound(scene)
            # in units of the noise, so that every level counts alike
            squared.append(
                [
                    rotation_angle(solution.R, scene.R) ** 2 / scene.noise**2,
                    direction_angle(solution.T, scene.T) ** 2 / scene.noise**2,
                    np.sum(normal_angle(solution.scaled_normals, scene.normals) ** 2) / scene.noise**2,
                ]
            )
            expected.append(
                [
                    np.trace(least.motion_covariance[:3, :3]) / scene.noise**2,
                    np.trace(least.motion_covariance[3:, 3:]) / scene.noise**2,
                    np.sum(tangent_trace(scene, least.normal_covariance)) / scene.noise**2,
                ]
            )
            interval = slope_interval(measure_slopes(solution, UP))
            covered.append((interval[:, 0] <= scene.slopes) & (scene.slopes <= interval[:, 1]))
    rotation, direction, normal = np.sqrt(np.sum(squared, axis=0) / np.sum(expected, axis=0))
    assert normal < 1.05
    assert rotation < 1.1
    assert direction < 1.1
    assert 0.93 < np.mean(covered) < 0.97


def test_work_grows_as_the_number_of_windows() -> None:
    """No array has windows times windows entries, no step count grows: memory, iterations, 64 to 1024 windows."""
    peaks, iterations = [], []
    for side in (8, 32):
        scene = make_scene(np.random.default_rng(21), grid=(side, side))
        tracemalloc.start()
        iterations.append(solve_planes(scene.x1, scene.x2, scene.patch).iterations)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert np.log(peaks[1] / peaks[0]) / np.log(16) < 1.05
    assert max(iterations) <= 5
