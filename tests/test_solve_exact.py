"""solve_planes without noise: the right answer to rounding, or one clear sentence."""

from __future__ import annotations

import numpy as np
import pytest
from campaign import seeds

from slopecli.errors import DegenerateConfiguration, InputError, NoAnswer
from slopecli.geometry import (
    direction_angle,
    homogeneous,
    normal_angle,
    rotation_angle,
    rotation_from_vector,
    solve_planes,
)
from slopecli.geometry.solver import observe, starting_states
from slopecli.study import Scene, make_scene
from slopecli.types import Solution

EXACT = 1e-9


def errors(solution: Solution, scene: Scene) -> tuple[float, float, float]:
    return (
        float(rotation_angle(solution.R, scene.R)),
        float(direction_angle(solution.T, scene.T)),
        float(np.abs(solution.scaled_normals - scene.normals).max()),
    )


def clean(seed: int, **options: object) -> Scene:
    return make_scene(np.random.default_rng(seed), noise_px=0.0, **options)  # type: ignore[arg-type]


@pytest.mark.parametrize("solver", ["mle", "lh"])
@pytest.mark.parametrize("trajectory", [0.0, 45.0, 90.0, 135.0, 180.0])
def test_recovers_motion_and_planes_exactly(trajectory: float, solver: str) -> None:
    scene = clean(1, trajectory_deg=trajectory)
    solution = solve_planes(scene.x1, scene.x2, scene.patch, solver)
    assert max(errors(solution, scene)) < EXACT
    assert solution.converged
    assert solution.inlier.all()
    assert solution.rms < 1e-12


@pytest.mark.parametrize("trajectory", [45.0, 90.0])
def test_alignment_is_exact_without_noise(trajectory: float) -> None:
    scene = clean(1, trajectory_deg=trajectory)
    assert max(errors(solve_planes(scene.x1, scene.x2, scene.patch, "ha"), scene)) < EXACT


@pytest.mark.parametrize("solver", ["mle", "ha", "lh"])
def test_vertical_descent_over_level_ground(solver: str) -> None:
    """T parallel to N, singular values (1, 1, 0.8): the nominal landing is valid and the two roots coincide."""
    scene = clean(2, trajectory_deg=0.0, slopes_deg=[0.0] * 9, height_spread=0.0)
    solution = solve_planes(scene.x1, scene.x2, scene.patch, solver)  # type: ignore[arg-type]
    assert max(errors(solution, scene)) < EXACT
    assert solution.ambiguity.status == "none"


@pytest.mark.parametrize("trajectory", [20.0, 45.0])
def test_coplanar_windows_report_both_roots(trajectory: float) -> None:
    scene = clean(3, trajectory_deg=trajectory, slopes_deg=[0.0] * 9, height_spread=0.0)
    solution = solve_planes(scene.x1, scene.x2, scene.patch)
    assert solution.ambiguity.status == "unresolved"
    assert solution.ambiguity.alternative is not None
    both = (solution, solution.ambiguity.alternative)
    assert min(max(errors(root, scene)) for root in both) < EXACT
    assert np.degrees(normal_angle(both[0].scaled_normals, both[1].scaled_normals)).min() > 1.0


def test_single_patch_reports_both_roots() -> None:
    scene = clean(4, trajectory_deg=30.0, grid=(1, 1), slopes_deg=[10.0])
    solution = solve_planes(scene.x1, scene.x2, scene.patch)
    assert solution.ambiguity.status == "unresolved"
    assert solution.ambiguity.alternative is not None
    assert min(max(errors(root, scene)) for root in (solution, solution.ambiguity.alternative)) < EXACT


def test_points_on_no_plane_resolve_a_single_patch() -> None:
    scene = clean(4, trajectory_deg=30.0, grid=(1, 1), slopes_deg=[10.0], free_points=40)
    solution = solve_planes(scene.x1, scene.x2, scene.patch)
    assert max(errors(solution, scene)) < EXACT
    assert solution.ambiguity.status in ("none", "resolved")


def test_three_points_a_patch_suffice() -> None:
    scene = clean(5, points=3)
    assert max(errors(solve_planes(scene.x1, scene.x2, scene.patch), scene)) < EXACT


def test_labels_in_any_order() -> None:
    scene = clean(6)
    shuffle = np.random.default_rng(0).permutation(len(scene.x1))
    relabel = np.random.default_rng(1).permutation(9)
    solution = solve_planes(scene.x1[shuffle], scene.x2[shuffle], relabel[scene.patch[shuffle]])
    assert float(np.abs(solution.scaled_normals[relabel] - scene.normals).max()) < EXACT


@pytest.mark.parametrize("factor", [1.0, -3.0])
def test_rotated_camera_frames_rotate_the_answer(factor: float) -> None:
    """Turning camera 1's axes about its own centre changes the frame of the answer and nothing else."""
    scene = clean(7)
    turn = rotation_from_vector(np.radians([4.0, -6.0, 40.0]) * factor)
    rays = homogeneous(scene.x1) @ turn.T
    solution = solve_planes(rays[:, :2] / rays[:, 2:], scene.x2, scene.patch)
    assert float(rotation_angle(solution.R, scene.R @ turn.T)) < EXACT
    assert float(direction_angle(solution.T, turn @ scene.T)) < EXACT
    assert float(np.abs(solution.scaled_normals - scene.normals @ turn.T).max()) < EXACT


def test_swapped_axes_swap_the_answer() -> None:
    scene = clean(8)
    solution = solve_planes(scene.x1[:, ::-1], scene.x2[:, ::-1], scene.patch)
    # a swap of two axes mirrors the world, so the rotation is conjugated by it
    mirror = np.eye(3)[[1, 0, 2]]
    assert float(np.abs(mirror @ solution.R @ mirror - scene.R).max()) < EXACT
    assert float(np.abs(solution.T @ mirror - scene.T).max()) < EXACT


@pytest.mark.parametrize("rotation_deg", [0.0, 3.0, 20.0])
@pytest.mark.parametrize("noise_px", [0.0, 0.3])
@pytest.mark.parametrize("known", [False, True])
def test_pure_rotation_has_no_answer(rotation_deg: float, noise_px: float, known: bool) -> None:
    rng = np.random.default_rng(9)
    scene = make_scene(rng, noise_px=0.0)
    rays = homogeneous(scene.x1) @ rotation_from_vector(np.radians([0.0, 0.0, rotation_deg])).T
    noise = noise_px / scene.camera.focal_px
    x2 = rays[:, :2] / rays[:, 2:] + noise * rng.standard_normal(scene.x1.shape)
    with pytest.raises(NoAnswer, match="pure-rotation"):
        solve_planes(scene.x1, x2, scene.patch, noise=noise if known and noise else None)


def test_patch_with_two_points_is_named() -> None:
    scene = clean(10)
    keep = np.flatnonzero(scene.patch != 4).tolist() + np.flatnonzero(scene.patch == 4)[:2].tolist()
    with pytest.raises(DegenerateConfiguration, match="patch 4 has 2 correspondences"):
        solve_planes(scene.x1[keep], scene.x2[keep], scene.patch[keep])


def test_collinear_patch_is_named() -> None:
    scene = clean(11)
    x1 = scene.x1.copy()
    x1[scene.patch == 3, 1] = 0.5 * x1[scene.patch == 3, 0] + 0.1
    with pytest.raises(DegenerateConfiguration, match="patch 3 are collinear"):
        solve_planes(x1, scene.x2, scene.patch)


def test_missing_label_is_named() -> None:
    scene = clean(12)
    with pytest.raises(DegenerateConfiguration, match="patch 8 has 0 correspondences"):
        solve_planes(scene.x1, scene.x2, np.where(scene.patch == 8, 10, scene.patch))


def test_too_few_measurements() -> None:
    scene = clean(13, grid=(1, 1), points=3, slopes_deg=[5.0])
    with pytest.raises(DegenerateConfiguration, match="need 9 measurements, found 6"):
        solve_planes(scene.x1, scene.x2, scene.patch)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"x1": np.zeros((5, 3))}, "x1 has shape"),
        ({"x2": np.zeros((5, 2))}, "needed one of each"),
        ({"x1": np.full((270, 2), np.nan)}, "not finite"),
        ({"patch": np.full(270, 0.5)}, "whole numbers"),
        ({"patch": np.full(270, -1)}, "at least one patch"),
        ({"patch": np.full(270, -2)}, "at least one patch"),
        ({"noise": -1.0}, "noise is -1.0"),
        ({"solver": "magic"}, "solver 'magic' is unknown"),
        ({"weights": np.ones(3)}, "weights must be"),
        ({"noise_gain": 0.0}, "noise_gain is 0.0"),
        ({"initial": [(np.ones((3, 3)), np.ones(3))]}, "initial motion"),
    ],
)
def test_unusable_input_is_one_clear_line(change: dict[str, object], message: str) -> None:
    scene = clean(14)
    arguments: dict[str, object] = {"x1": scene.x1, "x2": scene.x2, "patch": scene.patch} | change
    with pytest.raises(InputError, match=message) as caught:
        solve_planes(**arguments)  # type: ignore[arg-type]
    assert "\n" not in str(caught.value)


def test_rounding_below_zero_leaves_a_start() -> None:
    """Three points are fitted exactly, and a chi-square that is a difference of sums may then come out negative."""
    for seed in seeds(300, 60):
        scene = make_scene(np.random.default_rng(seed), noise_px=0.3, trajectory_deg=60.0)
        few = np.flatnonzero(scene.patch == 4)[:3]
        states = starting_states(observe(scene.x1[few], scene.x2[few], np.zeros(3, np.int64)), [])
        assert len(states.R) > 0
