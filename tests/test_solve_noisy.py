"""solve_planes on noisy, contaminated and rough data."""

from __future__ import annotations

import numpy as np
import pytest
from campaign import seeds

from slopecli.geometry import (
    direction_angle,
    measure_slopes,
    normal_angle,
    rotation_angle,
    rotation_vector,
    slope_interval,
    solve_planes,
)
from slopecli.study import UP, Scene, make_scene, paper_scene
from slopecli.types import Solution


def motion_chi2(solution: Solution, scene: Scene) -> float:
    """Squared motion error in units of its covariance; mean 5."""
    error = np.concatenate(
        [rotation_vector(scene.R @ solution.R.T), solution.tangent.T @ (scene.T - solution.T)],
    )
    return float(error @ np.linalg.solve(solution.motion_covariance, error))


@pytest.mark.parametrize("trajectory", [0.0, 45.0, 90.0])
def test_clean_noise_is_estimated_and_nothing_is_thrown_away(trajectory: float) -> None:
    ratios, kept = [], []
    for seed in seeds(20, 8):
        scene = paper_scene(np.random.default_rng([1, seed]), trajectory, 0.3)
        solution = solve_planes(scene.x1, scene.x2, scene.patch)
        ratios.append(solution.noise / scene.noise)
        kept.append(solution.inlier.mean())
        assert solution.converged
        assert solution.rms == pytest.approx(np.sqrt(2.0) * scene.noise, rel=0.15)
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.02)
    assert np.mean(kept) > 0.999


@pytest.mark.parametrize("trajectory", [0.0, 45.0, 90.0])
@pytest.mark.parametrize("free_points", [0, 100])
def test_twenty_percent_mismatches_are_found(trajectory: float, free_points: int) -> None:
    chi2, ratios = [], []
    for seed in seeds(15, 5):
        scene = make_scene(
            np.random.default_rng([2, seed]), trajectory_deg=trajectory, outliers=0.2, free_points=free_points
        )
        solution = solve_planes(scene.x1, scene.x2, scene.patch)
        chi2.append(motion_chi2(solution, scene))
        ratios.append(solution.noise / scene.noise)
        on_patch = scene.patch >= 0
        assert not solution.inlier[scene.outlier & on_patch].any()
        assert solution.inlier[~scene.outlier].mean() > 0.99
    # a mismatch of a free point along its epipolar line cannot be seen, and a short one hardly
    assert np.median(chi2) < 9.0
    assert np.median(ratios) == pytest.approx(1.0, abs=0.05)


def test_mismatches_are_kept_when_asked() -> None:
    scene = make_scene(np.random.default_rng(3), outliers=0.1)
    assert solve_planes(scene.x1, scene.x2, scene.patch, robust=False).inlier.all()


def test_same_input_same_answer_with_mismatches() -> None:
    scene = make_scene(np.random.default_rng(4), outliers=0.3)
    a, b = (solve_planes(scene.x1, scene.x2, scene.patch) for _ in range(2))
    assert np.array_equal(a.R, b.R)
    assert np.array_equal(a.scaled_normals, b.scaled_normals)


def test_coplanar_windows_stay_unresolved_and_bent_ones_do_not() -> None:
    flat = make_scene(np.random.default_rng(5), trajectory_deg=30.0, slopes_deg=[0.0] * 9, height_spread=0.0)
    solution = solve_planes(flat.x1, flat.x2, flat.patch)
    assert solution.ambiguity.status == "unresolved"
    assert solution.ambiguity.delta_chi2 is not None
    assert 0.0 <= solution.ambiguity.delta_chi2 < 13.8
    roots = [solution, solution.ambiguity.alternative]
    assert min(direction_angle(root.T, flat.T) for root in roots if root) < np.radians(1.0)
    bent = make_scene(np.random.default_rng(5), trajectory_deg=30.0)
    assert solve_planes(bent.x1, bent.x2, bent.patch).ambiguity.status in ("none", "resolved")


def test_alternative_is_a_whole_solution_that_fits() -> None:
    scene = make_scene(np.random.default_rng(6), trajectory_deg=45.0, grid=(1, 1), points=200, slopes_deg=[5.0])
    solution = solve_planes(scene.x1, scene.x2, scene.patch)
    alternative = solution.ambiguity.alternative
    assert alternative is not None
    assert alternative.rms == pytest.approx(solution.rms, rel=0.05)
    assert alternative.chi2 - solution.chi2 == pytest.approx(solution.ambiguity.delta_chi2, abs=1e-6)
    assert alternative.normal_covariance.shape == (1, 3, 3)
    assert alternative.ambiguity.alternative is None
    truth = measure_slopes(solution, UP).slope_rad[0], measure_slopes(alternative, UP).slope_rad[0]
    assert min(abs(s - scene.slopes[0]) for s in truth) < np.radians(0.5)


@pytest.mark.parametrize("relief", [False, True])
def test_noise_given_too_small_does_not_make_the_answer_too_sure(relief: bool) -> None:
    """Residuals of 0.3 px against a noise given as 0.1 px: the sigmas are those of 0.3 px; given right, it stays."""
    for seed in range(5):
        scene = make_scene(np.random.default_rng([6, seed]), noise_px=0.3)
        known, told = (
            solve_planes(scene.x1, scene.x2, scene.patch, noise=noise, relief=relief)
            for noise in (scene.noise, scene.noise / 3)
        )
        assert known.noise == scene.noise
        assert told.noise == pytest.approx(scene.noise, rel=0.15)
        assert measure_slopes(told, UP).sigma_rad == pytest.approx(measure_slopes(known, UP).sigma_rad, rel=0.3)


def test_noise_in_both_images_is_absorbed() -> None:
    ratios = []
    for seed in seeds(20, 8):
        scene = make_scene(np.random.default_rng([7, seed]), noise_px=0.3, noise1_px=0.3)
        ratios.append(solve_planes(scene.x1, scene.x2, scene.patch).noise / scene.noise)
    assert np.mean(ratios) == pytest.approx(np.sqrt(2.0), rel=0.15)


@pytest.mark.parametrize("relief", [0.003, 0.02])
@pytest.mark.parametrize("trajectory", [0.0, 45.0, 90.0])
def test_relief_is_measured_and_leaves_noise_and_motion_alone(trajectory: float, relief: float) -> None:
    noise, found, chi2 = [], [], []
    for seed in seeds(12, 4):
        scene = make_scene(np.random.default_rng([8, seed]), trajectory_deg=trajectory, relief=relief)
        solution = solve_planes(scene.x1, scene.x2, scene.patch, relief=True)
        noise.append(solution.noise / scene.noise)
        found.append(np.mean(solution.relief**2))
        chi2.append(motion_chi2(solution, scene))
        assert solution.inlier.mean() > 0.98
    assert np.mean(noise) == pytest.approx(1.0, abs=0.04)
    assert np.sqrt(np.mean(found)) == pytest.approx(relief, rel=0.1)
    assert np.mean(chi2) < 9.0


def test_relief_makes_no_difference_on_exact_planes() -> None:
    for seed in range(5):
        scene = make_scene(np.random.default_rng([9, seed]))
        plain = solve_planes(scene.x1, scene.x2, scene.patch)
        rough = solve_planes(scene.x1, scene.x2, scene.patch, relief=True)
        sigma = measure_slopes(plain, UP).sigma_rad
        assert (normal_angle(plain.scaled_normals, rough.scaled_normals) < sigma).all()
        assert rotation_angle(plain.R, rough.R) < np.sqrt(np.trace(plain.motion_covariance[:3, :3]))
        assert rough.relief.max() < 0.003
        assert not plain.relief.any()


def best_fit_normals(scene: Scene) -> np.ndarray:
    """(m, 3) planes through the true points: least squares of height off the plane over its distance, N.P = 1."""
    p = np.column_stack([scene.x1_clean, np.ones(len(scene.x1))])
    y = scene.R @ scene.T
    normals = []
    for i in range(len(scene.normals)):
        inside = scene.patch == i
        rays, seen = p[inside], np.column_stack([scene.x2_clean[inside], np.ones(inside.sum())])
        # depth from the true correspondence: seen x (R p - w R T) = 0
        a, b = np.cross(seen, y), np.cross(seen, rays @ scene.R.T)
        inverse_depth = np.sum(a * b, axis=1) / np.sum(a * a, axis=1)
        normals.append(np.linalg.lstsq(rays / inverse_depth[:, None], np.ones(inside.sum()), rcond=None)[0])
    return np.array(normals)


def test_rough_patch_gets_the_best_fit_plane_of_its_points() -> None:
    """With little image noise the answer is the least-squares plane of the points, not the one they scatter about."""
    to_fit, to_truth = [], []
    for seed in range(6):
        scene = make_scene(np.random.default_rng([10, seed]), relief=0.01, noise_px=0.02, points=60)
        solution = solve_planes(scene.x1, scene.x2, scene.patch, relief=True)
        to_fit.append(normal_angle(solution.scaled_normals, best_fit_normals(scene)))
        to_truth.append(normal_angle(solution.scaled_normals, scene.normals))
    assert np.sqrt(np.mean(np.square(to_fit))) < 0.3 * np.sqrt(np.mean(np.square(to_truth)))


def test_a_minority_standing_off_does_not_tilt_the_plane() -> None:
    """A tenth of the points 15 % of the distance nearer, on one side of each patch, as a boulder is."""
    scene = make_scene(np.random.default_rng(11), relief=0.003, points=60, max_slope_deg=15.0)
    x2 = scene.x2.copy()
    p = np.column_stack([scene.x1_clean, np.ones(len(x2))])
    boulder = np.zeros(len(x2), dtype=bool)
    for i in range(9):
        inside = np.flatnonzero(scene.patch == i)
        boulder[inside[np.argsort(scene.x1[inside, 0])[-6:]]] = True
    inverse_depth = np.sum(scene.normals[scene.patch] * p, axis=1) / 0.85
    y = (p - inverse_depth[:, None] * scene.T) @ scene.R.T
    x2[boulder] = (y[:, :2] / y[:, 2:])[boulder]
    solution = solve_planes(scene.x1, x2, scene.patch, relief=True)
    assert not solution.inlier[boulder].any()
    assert np.degrees(normal_angle(solution.scaled_normals, scene.normals)).max() < 1.5


@pytest.mark.slow
@pytest.mark.parametrize("relief", [0.003, 0.02])
def test_slope_intervals_cover_on_rough_terrain(relief: float) -> None:
    covered = []
    for seed in range(100):
        trajectory = (0.0, 45.0, 90.0)[seed % 3]
        scene = make_scene(np.random.default_rng([12, seed]), trajectory_deg=trajectory, relief=relief)
        solution = solve_planes(scene.x1, scene.x2, scene.patch, relief=True)
        interval = slope_interval(measure_slopes(solution, UP))
        covered.append((interval[:, 0] <= scene.slopes) & (scene.slopes <= interval[:, 1]))
    assert 0.93 < np.mean(covered) < 0.97


@pytest.mark.slow
@pytest.mark.parametrize("solver", ["mle", "ha"])
def test_no_run_of_the_papers_simulation_is_without_an_answer(solver: str) -> None:
    """1320 trials: 40 terrains, 3 trajectories, noise from 0 to 1 px."""
    worst = {0.0: 0.0, 45.0: 0.0, 90.0: 0.0}
    for trajectory in worst:
        for k in range(11):
            for terrain in range(40):
                noise_rng = np.random.default_rng([13, terrain, k])
                scene = paper_scene(np.random.default_rng([13, terrain]), trajectory, 0.1 * k, noise_rng)
                solution = solve_planes(scene.x1, scene.x2, scene.patch, solver)  # type: ignore[arg-type]
                worst[trajectory] = max(worst[trajectory], float(np.degrees(rotation_angle(solution.R, scene.R))))
                assert solver == "ha" or solution.converged
    assert max(worst.values()) < (1.0 if solver == "mle" else 20.0)


@pytest.mark.parametrize("seed", [0, 3, 5])
def test_mismatches_do_not_hide_the_second_answer(seed: int) -> None:
    """Flat ground seen in a glide has two answers, also where a fifth of few points is wrong."""
    scene = make_scene(
        np.random.default_rng([77, seed]), points=10, slopes_deg=[0.0] * 9, height_spread=0.0, outliers=0.2
    )
    found = solve_planes(scene.x1, scene.x2, scene.patch).ambiguity
    assert found.status == "unresolved"
    assert found.alternative is not None


@pytest.mark.parametrize("solver", ["ha", "lh"])
def test_closed_forms_tell_the_second_answer_too(solver: str) -> None:
    scene = make_scene(np.random.default_rng(5), slopes_deg=[0.0] * 9, height_spread=0.0)
    solution = solve_planes(scene.x1, scene.x2, scene.patch, solver)  # type: ignore[arg-type]
    other = solution.ambiguity.alternative
    assert solution.ambiguity.status == "unresolved"
    assert other is not None
    near, far = sorted(float(np.degrees(measure_slopes(s, UP).slope_rad.max())) for s in (solution, other))
    assert near < 10.0
    assert far > 30.0
