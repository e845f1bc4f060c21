"""Homography alignment as printed (Cheng, eqs. 9-17, steps 1-8), and the averaged Longuet-Higgins motion."""

from __future__ import annotations

import numpy as np
import pytest

from slopecli.errors import DegenerateConfiguration
from slopecli.geometry import (
    align_homographies,
    direction_angle,
    homography_of_plane,
    reprojection_error,
    rotation_angle,
    solve_base_homography,
    solve_delta_normals,
    solve_planes,
)
from slopecli.geometry.solver import observe
from slopecli.study import make_scene, paper_scene


def jacobian_rank(m: int) -> int:
    """Rank of d(homographies up to scale) / d(H1 with last entry 1, K, delta normals)."""
    rng = np.random.default_rng(m)
    start = np.r_[np.eye(3).ravel()[:8], 0.3, -0.2, 0.9, 0.2 * rng.standard_normal(3 * (m - 1))]

    def homographies(parameters: np.ndarray) -> np.ndarray:
        H1, K = np.r_[parameters[:8], 1.0].reshape(3, 3), parameters[8:11]
        each = [H1] + [H1 + np.outer(K, d) for d in parameters[11:].reshape(-1, 3)]
        return np.concatenate([(H / H[2, 2]).ravel() for H in each])

    step = 1e-6
    J = [(homographies(start + step * e) - homographies(start - step * e)) / (2 * step) for e in np.eye(len(start))]
    singular = np.linalg.svd(np.array(J), compute_uv=False)
    return int((singular > 1e-6 * singular[0]).sum())


def test_erratum_equation_10_scales_by_s1_over_si() -> None:
    """The text prints s_i / s_1; only s_1 / s_i satisfies the equation."""
    scene = make_scene(np.random.default_rng(0))
    s1, si = 1.7, 0.6
    H1 = s1 * homography_of_plane(scene.R, scene.T, scene.normals[0])
    Hi = si * homography_of_plane(scene.R, scene.T, scene.normals[1])
    right = np.outer(scene.R @ scene.T, s1 * (scene.normals[0] - scene.normals[1]))
    assert np.abs(s1 / si * Hi - H1 - right).max() < 1e-15
    assert np.abs(si / s1 * Hi - H1 - right).max() > 0.5


@pytest.mark.parametrize(("m", "rank"), [(2, 13), (3, 16), (5, 22), (9, 34)])
def test_alternation_lives_on_7_plus_3m_freedoms(m: int, rank: int) -> None:
    """Not the 5 + 3m of the text: the sweeps know nothing of the calibrated motion."""
    assert jacobian_rank(m) == rank == 7 + 3 * m


def test_both_linear_steps_are_exact_at_the_truth() -> None:
    scene = make_scene(np.random.default_rng(1), noise_px=0.0)
    H1 = homography_of_plane(scene.R, scene.T, scene.normals[0])
    s1 = 1.0 / H1[2, 2]
    K = scene.R @ scene.T
    observations = observe(scene.x1, scene.x2, scene.patch)
    delta_normals = solve_delta_normals(observations, 0, s1 * H1, K)
    assert delta_normals == pytest.approx(s1 * (scene.normals[0] - scene.normals), abs=1e-12)
    again, epipole2 = solve_base_homography(observations, delta_normals, K)
    assert again == pytest.approx(s1 * H1, abs=1e-11)
    assert epipole2 == pytest.approx(K, abs=1e-11)
    assert reprojection_error(observations, again, epipole2, delta_normals) < 1e-12


def test_each_linear_step_leaves_a_zero_gradient() -> None:
    """Eqs. (13) and (17) are least squares: their residual is orthogonal to every direction they may move in."""
    scene = paper_scene(np.random.default_rng(2), 45.0, 1.0)
    observations = observe(scene.x1, scene.x2, scene.patch)
    H1 = homography_of_plane(scene.R, scene.T, scene.normals[0])
    H1, K = H1 / H1[2, 2], scene.R @ scene.T
    p = np.column_stack([scene.x1, np.ones(len(scene.x1))])

    def algebraic(H1: np.ndarray, K: np.ndarray, delta_normals: np.ndarray) -> np.ndarray:
        y = p @ H1.T + np.sum(delta_normals[scene.patch] * p, axis=1)[:, None] * K
        return (y[:, :2] - scene.x2 * y[:, 2:]).ravel()

    delta_normals = solve_delta_normals(observations, 0, H1, K)
    residual = algebraic(H1, K, delta_normals)
    for i in range(1, 9):
        for axis in np.eye(3):
            moved = delta_normals + axis * (np.arange(9) == i)[:, None]
            change = algebraic(H1, K, moved) - residual
            assert abs(change @ residual) < 1e-10 * np.linalg.norm(change)
    H1, K = solve_base_homography(observations, delta_normals, K)
    residual = algebraic(H1, K, delta_normals)
    for e in np.eye(11):
        moved = algebraic(H1 + np.r_[e[:8], 0.0].reshape(3, 3), K + e[8:], delta_normals) - residual
        assert abs(moved @ residual) < 1e-10 * np.linalg.norm(moved)


@pytest.mark.parametrize("trajectory", [0.0, 45.0, 90.0])
def test_smaller_reprojection_error_comes_first(trajectory: float) -> None:
    scene = paper_scene(np.random.default_rng(3), trajectory, 0.3)
    roots = align_homographies(scene.x1, scene.x2, scene.patch)
    assert [root.error for root in roots] == sorted(root.error for root in roots)
    assert rotation_angle(roots[0].R, scene.R) < np.radians(0.5)


def test_coplanar_patches_keep_the_epipole() -> None:
    """All normal offsets are null: eq. (17) cannot tell K, and the closed form alone decides."""
    scene = make_scene(np.random.default_rng(4), slopes_deg=[0.0] * 9, height_spread=0.0, noise_px=0.0)
    roots = align_homographies(scene.x1, scene.x2, scene.patch)
    assert min(float(rotation_angle(root.R, scene.R)) for root in roots) < 1e-9


def test_points_on_no_plane_play_no_part() -> None:
    scene = make_scene(np.random.default_rng(5), free_points=40)
    on_plane = scene.patch >= 0
    with_all = align_homographies(scene.x1, scene.x2, scene.patch)[0]
    without = align_homographies(scene.x1[on_plane], scene.x2[on_plane], scene.patch[on_plane])[0]
    assert np.array_equal(with_all.R, without.R)


def test_base_patch_is_the_one_with_most_points() -> None:
    """A base patch of three points has no homography; any other order of sizes works."""
    scene = make_scene(np.random.default_rng(6), noise_px=0.0)
    keep = np.ones(270, dtype=bool)
    keep[:27] = False
    solution = solve_planes(scene.x1[keep], scene.x2[keep], scene.patch[keep], "ha")
    assert rotation_angle(solution.R, scene.R) < 1e-9
    few = np.concatenate([np.flatnonzero(scene.patch == i)[:3] for i in range(9)])
    with pytest.raises(DegenerateConfiguration, match="at least 4"):
        solve_planes(scene.x1[few], scene.x2[few], scene.patch[few], "ha")


def test_averaged_motion_survives_patches_of_three_points() -> None:
    scene = make_scene(np.random.default_rng(7), noise_px=0.0)
    keep = np.flatnonzero(scene.patch != 2).tolist() + np.flatnonzero(scene.patch == 2)[:3].tolist()
    solution = solve_planes(scene.x1[keep], scene.x2[keep], scene.patch[keep], "lh")
    assert np.abs(solution.scaled_normals - scene.normals).max() < 1e-9


def test_averaged_motion_of_many_patches_is_that_of_what_most_agree_on() -> None:
    """Most patches have a second reading; of 144 patches only some are asked which one is meant."""
    scene = make_scene(np.random.default_rng(8), grid=(12, 12), trajectory_deg=30.0, noise_px=0.0)
    solution = solve_planes(scene.x1, scene.x2, scene.patch, "lh")
    assert rotation_angle(solution.R, scene.R) < 1e-6
    assert direction_angle(solution.T, scene.T) < 1e-6
