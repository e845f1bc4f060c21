"""Patches on one plane found and solved as one: what it gains, what it leaves alone, and that its sigmas hold."""

from __future__ import annotations

import numpy as np
import pytest
from solution_factory import make_patch, make_solution, with_second_root

from slopecli.geometry import measure_slopes, solve_planes
from slopecli.geometry.solver import AT, MotionPrior, chi2_quantile, merge_coplanar
from slopecli.look import Matches
from slopecli.patches import Joined, MergedGroup, merge_patches
from slopecli.study import UP, Scene, make_scene, project
from slopecli.types import FloatArray, Solution
from slopecli.windows import grid_windows

EVERY = np.arange(9)


def flat(rng: np.random.Generator, trajectory_deg: float) -> Scene:
    return make_scene(rng, trajectory_deg=trajectory_deg, slopes_deg=[0.0] * 9, height_spread=0.0, noise_px=0.3)


def true_root(scene: Scene) -> Solution:
    """The root near the truth: which of two it is, images alone do not tell over level ground."""
    solution = solve_planes(scene.x1, scene.x2, scene.patch)
    other = solution.ambiguity.alternative
    roots = [solution] if other is None else [solution, other]
    return min(roots, key=lambda root: float(np.abs(leans(root, scene)).max()))


def leans(solution: Solution, scene: Scene) -> FloatArray:
    """(m, 2) errors of the tilts, rad."""
    lean = lambda N: N[:, :2] / N[:, 2:]  # noqa: E731
    return np.asarray(lean(solution.scaled_normals) - lean(scene.normals))


def rms(values: list[FloatArray]) -> float:
    return float(np.degrees(np.sqrt(np.mean(np.square(values)))))


@pytest.mark.parametrize("trajectory_deg", [45, 90])
def test_level_ground_is_known_several_times_better(trajectory_deg: float) -> None:
    """At least four times, over 40 scenes; squared errors in sigmas have mean 1 within 0.45 (3 values a scene)."""
    rng = np.random.default_rng(7)
    alone, together, squares, whole = [], [], [], 0
    for _ in range(40):
        scene = flat(rng, trajectory_deg)
        solution = true_root(scene)
        merged, groups = merge_coplanar(solution, EVERY)
        if [(group.members, group.shares) for group in groups] == [(tuple(EVERY), "plane")]:
            whole += 1
            assert np.ptp(merged.scaled_normals, axis=0).max() < 1e-9
        alone.append(leans(solution, scene))
        together.append(leans(merged, scene)[:1])
        off = merged.scaled_normals[0] - scene.normals[0]
        squares.append(off @ np.linalg.solve(merged.normal_covariance[0], off) / 3)
    assert whole >= 38
    assert rms(alone) > 4 * rms(together)
    assert np.mean(squares) == pytest.approx(1.0, abs=0.45)


def test_with_a_rotation_known_a_vertical_descent_gains_as_well() -> None:
    rng = np.random.default_rng(8)
    alone, together = [], []
    for _ in range(30):
        scene = flat(rng, 0.0)
        solution = solve_planes(scene.x1, scene.x2, scene.patch, prior=MotionPrior.checked(scene.R, 1e-4))
        alone.append(leans(solution, scene))
        together.append(leans(merge_coplanar(solution, EVERY)[0], scene))
    assert rms(together) < 0.9 * rms(alone)


def test_where_two_answers_run_into_each_other_nothing_is_merged_into_nonsense() -> None:
    rng = np.random.default_rng(9)
    for _ in range(10):
        scene = flat(rng, 0.0)
        solution = solve_planes(scene.x1, scene.x2, scene.patch)
        merged, _ = merge_coplanar(solution, EVERY)
        assert (
            np.degrees(np.abs(leans(merged, scene))).max() < 1.5 * np.degrees(np.abs(leans(solution, scene))).max() + 2
        )


def test_two_answers_that_run_into_each_other_are_known_as_such_and_left_alone() -> None:
    rng, joined = np.random.default_rng(9), 0
    for trajectory_deg in (0.0,) * 10 + (45.0,) * 5:
        scene = flat(rng, trajectory_deg)
        solution = solve_planes(scene.x1, scene.x2, scene.patch)
        joined += solution.ambiguity.joined
        assert not (solution.ambiguity.joined and trajectory_deg)
        if solution.ambiguity.joined:
            merged, groups = merge_coplanar(solution, EVERY)
            assert merged is solution
            assert groups == []
    assert joined >= 5


def test_doubt_stays_in_the_answer_that_has_nothing_to_merge() -> None:
    """Level in one answer; in the other every patch faces its own way, and keeps the doubt about its matches."""
    level, doubt = with_second_root(make_solution([0, 0, 0]), [25, 40, 55]), np.radians([1.0, 1.0, 1.0])
    merged, groups = merge_coplanar(level, np.arange(3), doubt)
    assert [group.members for group in groups] == [(0, 1, 2)]
    assert merged.ambiguity.alternative is not None
    assert level.ambiguity.alternative is not None
    before, after = (measure_slopes(one, UP) for one in (level.ambiguity.alternative, merged.ambiguity.alternative))
    assert after.slope_rad == pytest.approx(before.slope_rad)
    assert after.sigma_rad == pytest.approx(np.hypot(before.sigma_rad, doubt), rel=1e-3)


def test_slopes_that_differ_are_left_alone() -> None:
    rng = np.random.default_rng(10)
    slopes = [0.0, 8.0, 16.0, 24.0, 32.0, 40.0, 4.0, 12.0, 20.0]
    for _ in range(10):
        scene = make_scene(rng, trajectory_deg=60, slopes_deg=slopes, noise_px=0.3)
        solution = solve_planes(scene.x1, scene.x2, scene.patch)
        merged, groups = merge_coplanar(solution, EVERY)
        for group in groups:  # by chance, planes that cannot be told apart
            assert np.degrees(np.abs(leans(merged, scene)[list(group.members)])).max() < 3
        assert sum(len(group.members) for group in groups) <= 4


def test_terraces_face_one_way_and_are_not_one_plane() -> None:
    rng = np.random.default_rng(11)
    scene = make_scene(rng, trajectory_deg=90, slopes_deg=[0.0] * 9, height_spread=0.0, noise_px=0.2)
    heights = np.repeat([1.0, 1.1, 1.2], 3)
    normals = scene.normals / heights[:, None]
    x2 = project(scene.R, scene.T, scene.x1, np.einsum("ni,ni->n", normals[scene.patch], np.c_[scene.x1, np.ones(270)]))
    x2 += rng.normal(size=x2.shape) * scene.noise
    solution = solve_planes(scene.x1, x2, scene.patch)
    merged, groups = merge_coplanar(solution, EVERY)
    planes = {group.members for group in groups if group.shares == "plane"}
    assert planes == {(0, 1, 2), (3, 4, 5), (6, 7, 8)}
    assert [group.members for group in groups if group.shares == "normal"] == [tuple(EVERY)]
    facing = merged.scaled_normals / np.linalg.norm(merged.scaled_normals, axis=1, keepdims=True)
    assert np.ptp(facing, axis=0).max() < 1e-6
    assert 1 / np.linalg.norm(merged.scaled_normals, axis=1) == pytest.approx(
        heights / np.linalg.norm(scene.normals, axis=1), rel=0.005
    )


def test_only_candidates_are_merged_and_doubt_keeps_a_patch_from_deciding() -> None:
    scene = flat(np.random.default_rng(20), 90)
    solution = true_root(scene)
    merged, groups = merge_coplanar(solution, np.array([0, 1, 2]))
    assert [group.members for group in groups] == [(0, 1, 2)]
    assert np.ptp(merged.scaled_normals[3:], axis=0).max() > 1e-6
    doubt = np.zeros(9)
    doubt[0] = np.radians(20)
    doubtful, _ = merge_coplanar(solution, EVERY, doubt)
    others, _ = merge_coplanar(solution, EVERY[1:])
    assert np.abs(leans(doubtful, scene)[1] - leans(others, scene)[1]).max() < np.radians(0.02)


def test_slopes_against_one_of_the_merged_planes_are_exactly_level() -> None:
    scene = flat(np.random.default_rng(13), 90)
    merged, _ = merge_coplanar(true_root(scene), EVERY)
    slopes = measure_slopes(merged, up_plane=4)
    assert np.degrees(slopes.slope_rad).max() < 1e-6
    assert np.degrees(slopes.sigma_rad).max() < 1e-3


def test_the_quantile_is_that_of_chi_square() -> None:
    special = pytest.importorskip("scipy.special")
    for dof in (2, 3, 6, 24, 200):
        for share, at in ((0.999, AT["plane"]), (0.95, AT["normal"])):
            assert chi2_quantile(dof, at) == pytest.approx(special.chdtri(dof, 1.0 - share), rel=0.03)


# ---- patches, with what speaks against them ----


def merged_windows(*doubts_deg: tuple[float, float]) -> tuple[Joined, list[MergedGroup]]:
    """The windows of a level scene, merged; doubts_deg: of each, all of it and what is owed to parts not seen."""
    scene = make_scene(
        np.random.default_rng(3), slopes_deg=[0.0] * 9, height_spread=0.0, noise_px=0.3, trajectory_deg=90
    )
    solution = true_root(scene)
    windows = grid_windows(3, 3, 640, 480)
    sigmas = [{"tilt_sigma_rad": np.radians(a), "unmatched_sigma_rad": np.radians(b)} for a, b in doubts_deg]
    patches = [
        make_patch(window, number, normal, solution, **sigma)
        for number, (window, normal, sigma) in enumerate(zip(windows, solution.scaled_normals, sigmas, strict=True), 1)
    ]
    found, _, groups = merge_patches(Joined.of(patches, Matches.none(), np.empty(0)), solution)
    return found, groups


def test_a_window_in_much_doubt_does_not_lie_on_the_plane_of_others() -> None:
    """Something stands in window 3: it agrees with any plane, and would be level and sure by the others."""
    found, (group,) = merged_windows((0.1, 0.0), (0.1, 0.0), (20.0, 20.0), *[(0.1, 0.0)] * 6)
    assert (group.ids, group.shares) == ((1, 2, 4, 5, 6, 7, 8, 9), "plane")
    assert np.degrees(found.patches[2].tilt_sigma_rad) == pytest.approx(20.0)


def test_what_no_window_shows_stays_in_doubt_when_they_are_merged() -> None:
    found, (group,) = merged_windows(*[(0.5, 0.3)] * 9)
    assert (group.ids, group.shares) == (tuple(range(1, 10)), "plane")
    assert [np.degrees(patch.tilt_sigma_rad) for patch in found.patches] == pytest.approx([0.3] * 9)
