"""Many views, one set of normals: errors at the bound, honest intervals, and what a third view decides."""

from __future__ import annotations

import numpy as np
import pytest
from campaign import seeds
from view_scenes import Views, views

from slopecli.errors import DegenerateConfiguration, InputError, NoAnswer
from slopecli.geometry import ViewsSolution, cramer_rao_bound, cramer_rao_bound_of_views, normal_angle, solve_planes
from slopecli.geometry import solve_views as solve
from slopecli.types import FloatArray


def solved(scene: Views, **options: object) -> ViewsSolution:
    return solve(scene.x1, scene.x, scene.patch, **options)  # type: ignore[arg-type]


def bound(scene: Views) -> ViewsSolution:
    return cramer_rao_bound_of_views(scene.R, scene.T, scene.normals, scene.x1, scene.patch, scene.noise)


def tilts(solution: ViewsSolution) -> FloatArray:
    """(m, 3, 3) covariance of the unit normals."""
    length = np.linalg.norm(solution.scaled_normals, axis=1)
    n = solution.scaled_normals / length[:, None]
    across = np.eye(3) - n[:, :, None] * n[:, None]
    return np.asarray(across @ solution.normal_covariance @ across / length[:, None, None] ** 2)


def errors(solution: ViewsSolution, scene: Views) -> FloatArray:
    """(m,) squared error of each normal over its covariance: chi-square with two degrees of freedom."""
    unit = [N / np.linalg.norm(N, axis=1, keepdims=True) for N in (solution.scaled_normals, scene.normals)]
    inverse = np.linalg.pinv(tilts(solution), rcond=1e-9, hermitian=True)
    return np.einsum("ma,mab,mb->m", unit[0] - unit[1], inverse, unit[0] - unit[1])


@pytest.mark.parametrize("number", [2, 4, 9])
@pytest.mark.parametrize("trajectory", [0.0, 45.0, 90.0])
def test_errors_are_at_the_bound_and_intervals_cover(number: int, trajectory: float) -> None:
    squared, least, chi2 = [], [], []
    trials = seeds(200, 4 if number < 9 else 2)
    for seed in trials:
        scene = views(seed, number, trajectory)
        found = solved(scene)
        squared.append(normal_angle(found.scaled_normals, scene.normals) ** 2)
        least.append(np.trace(tilts(bound(scene)), axis1=1, axis2=2))
        chi2.append(errors(found, scene))
    ratio, covered = np.sqrt(np.mean(squared) / np.mean(least)), np.mean(np.array(chi2) < 5.99)
    if len(trials) > 100:
        assert ratio < 1.05
        assert 0.94 < covered < 0.96
    assert ratio < 1.4
    assert covered > 0.8


@pytest.mark.slow
@pytest.mark.parametrize("noise_px", [0.1, 1.0])
@pytest.mark.parametrize("trajectory", [0.0, 45.0, 90.0])
def test_errors_are_at_the_bound_whatever_the_noise(noise_px: float, trajectory: float) -> None:
    squared, least, chi2 = [], [], []
    for seed in range(200):
        scene = views(seed, 4, trajectory, noise_px=noise_px)
        found = solved(scene)
        squared.append(normal_angle(found.scaled_normals, scene.normals) ** 2)
        least.append(np.trace(tilts(bound(scene)), axis1=1, axis2=2))
        chi2.append(errors(found, scene))
    assert np.sqrt(np.mean(squared) / np.mean(least)) < 1.05
    assert 0.94 < np.mean(np.array(chi2) < 5.99) < 0.96


def test_one_view_is_the_pair() -> None:
    scene = views(1, 1, 45.0)
    own = solved(scene).pair()
    pair = solve_planes(scene.x1, scene.x[0], scene.patch)
    assert np.degrees(normal_angle(own.scaled_normals, pair.scaled_normals)).max() < 1e-2
    np.testing.assert_allclose(own.normal_covariance, pair.normal_covariance, rtol=0.02, atol=1e-12)
    np.testing.assert_allclose(own.motion_covariance[:3, :3], pair.motion_covariance[:3, :3], rtol=0.02, atol=1e-14)


def test_the_bound_of_one_view_is_that_of_the_pair() -> None:
    scene = views(2, 1, 45.0)
    pair = cramer_rao_bound(scene.R[0], scene.T[0], scene.normals, scene.x1, scene.patch, scene.noise)
    np.testing.assert_allclose(bound(scene).normal_covariance, pair.normal_covariance, rtol=1e-6)


def test_the_bound_falls_with_every_view() -> None:
    scene = views(3, 9, 0.0)
    traces = []
    for number in range(1, 10):
        part = Views(scene.x1, scene.x, scene.patch, scene.R[:number], scene.T[:number], scene.normals, scene.noise)
        traces.append(np.trace(tilts(bound(part)), axis1=1, axis2=2).mean())
    assert (np.diff(traces) < 0.0).all()


def test_exact_places_give_the_exact_planes_and_motions() -> None:
    scene = views(4, 3, 45.0, noise_px=0.0)
    found = solved(scene)
    assert found.converged
    assert np.degrees(normal_angle(found.scaled_normals, scene.normals)).max() < 1e-6
    np.testing.assert_allclose(found.T, scene.T, atol=1e-8)
    np.testing.assert_allclose(found.R, scene.R, atol=1e-8)


def test_the_order_of_points_and_of_later_views_does_not_matter() -> None:
    scene = views(5, 3, 45.0)
    order = np.random.default_rng(0).permutation(len(scene.x1))
    turned = solve(scene.x1[order], scene.x[[0, 2, 1]][:, order], scene.patch[order])
    straight = solved(scene)
    np.testing.assert_allclose(turned.scaled_normals, straight.scaled_normals, atol=2e-5)
    np.testing.assert_allclose(turned.T[[0, 2, 1]], straight.T, atol=2e-5)
    np.testing.assert_allclose(turned.inverse_depth, straight.inverse_depth[order], atol=2e-5)


def test_points_that_a_view_does_not_show_are_left_out_of_it() -> None:
    scene = views(6, 4, 45.0)
    x = scene.x.copy()
    x[0, scene.patch == 2] = np.nan
    x[1:, ::3] = np.nan
    found = solve(scene.x1, x, scene.patch)
    assert (errors(found, scene) < 20.0).all()
    assert not found.inlier[0, scene.patch == 2].any()


def test_mismatches_are_left_out() -> None:
    scene = views(7, 3, 45.0)
    rng = np.random.default_rng(0)
    wrong = rng.random(scene.x.shape[:2]) < 0.1
    x = np.where(wrong[..., None], scene.x + rng.uniform(-0.05, 0.05, scene.x.shape), scene.x)
    found = solve(scene.x1, x, scene.patch)
    assert (errors(found, scene) < 20.0).all()
    assert found.inlier[wrong].mean() < 0.05


def test_relief_is_told_from_noise_and_does_not_average_away() -> None:
    """The height of a point is the same in every view, so that a tenth view adds hardly anything on rough ground."""
    relief, noise, growth, chi2 = [], [], [], []
    for seed in range(3):
        scene = views(seed, 6, 45.0, noise_px=0.1, relief=0.01)
        found = solved(scene, relief=True)
        relief.append(found.relief)
        noise.append(found.noise / scene.noise)
        chi2.append(errors(found, scene))
        two = solve(scene.x1, scene.x[[0, 5]], scene.patch, relief=True)
        growth.append(np.trace(tilts(two), axis1=1, axis2=2).mean() / np.trace(tilts(found), axis1=1, axis2=2).mean())
    assert 0.008 < np.mean(relief) < 0.012
    assert 0.9 < np.mean(noise) < 1.1
    assert np.mean(growth) < 1.3
    assert np.mean(np.array(chi2) < 5.99) > 0.8


@pytest.mark.parametrize("trajectory", [0.0, 45.0, 90.0])
def test_a_third_view_off_the_line_decides_between_the_answers_for_one_plane(trajectory: float) -> None:
    decided, trials = [], seeds(1334, 4)  # 4000 in all
    for seed in trials:
        scene = views(seed, 2, trajectory, path=0.4, bend_deg=25.0, one_plane=True, steepest_deg=20.0)
        found = solved(scene)
        decided.append(found.status != "unresolved")
        if decided[-1]:
            assert (errors(found, scene) < 30.0).all(), f"seed {seed}: wrongly decided"
    assert np.mean(decided) >= 0.95


@pytest.mark.parametrize("trajectory", [0.0, 45.0, 90.0])
@pytest.mark.parametrize("steepest", [3.0, 20.0])
def test_what_one_line_of_flight_leaves_open_says_so_and_covers_both(trajectory: float, steepest: float) -> None:
    for seed in seeds(300, 2):
        scene = views(seed, 2, trajectory, one_plane=True, steepest_deg=steepest)
        found = solved(scene)
        answers = [found] if found.status != "unresolved" or found.alternative is None else [found, found.alternative]
        assert min(errors(one, scene).max() for one in answers) < 30.0, f"seed {seed}: {found.status}"


def test_views_without_parallax_have_no_answer() -> None:
    scene = views(8, 2, 45.0, path=1e-12)
    with pytest.raises(NoAnswer):
        solved(scene)


def test_unusable_arrays_are_refused_with_what_was_needed() -> None:
    scene = views(9, 2, 45.0)
    with pytest.raises(InputError, match=r"\(views, points, 2\)"):
        solve(scene.x1, scene.x[0], scene.patch)
    with pytest.raises(InputError, match="labels"):
        solve(scene.x1, scene.x, np.full(len(scene.x1), -1))
    with pytest.raises(DegenerateConfiguration, match="at least 3"):
        solve(scene.x1[:2], scene.x[:, :2], scene.patch[:2])
    with pytest.raises(InputError, match="noise"):
        solved(scene, noise=-1.0)
