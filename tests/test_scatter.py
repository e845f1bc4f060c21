"""Errors that parts of the image share enter the sigma of the motion; independent noise leaves it as it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from campaign import seeds

from slopecli.geometry import direction_angle, solve_planes
from slopecli.geometry.solver import MotionPrior, Settled, Sightings, amplitude_of, linearised, scatter_of, with_scatter
from slopecli.study import Scene, field_of_view_camera, make_scene
from slopecli.types import FloatArray, Solution

CAMERA = field_of_view_camera()


def scene_of(seed: int) -> Scene:
    return make_scene(np.random.default_rng(seed), trajectory_deg=45.0, noise_px=0.1, points=60, camera=CAMERA)


def seen(scene: Scene, shared_px: float, seed: int, prior: MotionPrior | None = None) -> tuple[Sightings, Solution]:
    """The scene with errors that all points of a sixth of the image have in common, and its solution."""
    side = max(CAMERA.width, CAMERA.height) / 6
    error = shared_px * np.random.default_rng(seed + 1).standard_normal((8, 8, 2))
    column, row = np.floor(scene.uv1 / side).astype(int).T
    uv2 = scene.uv2 + error[np.clip(row, 0, 7), np.clip(column, 0, 7)]
    sightings = Sightings(scene.uv1, uv2, scene.patch, np.ones(len(scene.patch)), (CAMERA, CAMERA), 1.0)
    solution = solve_planes(*sightings.rays(), scene.patch, prior=prior)
    return sightings.take(solution.inlier), solution


def warped(scene: Scene, most_px: float, seed: int) -> tuple[Sightings, Solution]:
    """The scene with image 2 displaced by a smooth field, as a lens that is not as modelled does, and its solution."""
    place = 2.0 * scene.uv2 / (CAMERA.width, CAMERA.height) - 1.0
    terms = np.polynomial.polynomial.polyvander2d(*place.T, (2, 2))
    uv2 = scene.uv2 + most_px * terms @ np.random.default_rng(seed).uniform(-1.0, 1.0, (9, 2))
    sightings = Sightings(scene.uv1, uv2, scene.patch, np.ones(len(scene.patch)), (CAMERA, CAMERA), 1.0)
    solution = solve_planes(*sightings.rays(), scene.patch)
    return sightings.take(solution.inlier), solution


def sigma(solution: Solution) -> float:
    return float(np.sqrt(np.linalg.eigvalsh(solution.direction_covariance)[-1]))


def pulls(shared_px: float, widened: bool) -> FloatArray:
    """(n,) errors of the direction over their sigma."""
    found = []
    for seed in seeds(60, 16):
        scene = scene_of(seed)
        sightings, solution = seen(scene, shared_px, seed)
        solution = with_scatter(solution, sightings) if widened else solution
        found.append(direction_angle(solution.T, scene.T) / sigma(solution))
    return np.array(found)


def scatter(sightings: Sightings, solution: Solution) -> float:
    linear = linearised(sightings, Settled.of(solution))
    return 1.0 if linear is None else scatter_of(linear, sightings)


def test_independent_noise_leaves_the_sigma_nearly_as_it_is() -> None:
    factors = [scatter(*seen(scene_of(k), 0.0, k)) for k in range(12)]
    assert min(factors) >= 1.0
    assert np.median(factors) < 1.6
    assert max(factors) < 3.0


def test_errors_shared_by_parts_of_the_image_are_in_the_sigma() -> None:
    before, after = pulls(0.2, False), pulls(0.2, True)
    assert np.median(before) > 2.0
    assert np.median(after) < 1.8
    assert np.median(after) < 0.6 * np.median(before)


def test_smooth_errors_over_the_whole_image_are_in_the_sigma() -> None:
    before, after = [], []
    for seed in seeds(60, 16):
        scene = scene_of(seed)
        sightings, solution = warped(scene, 0.1, seed)
        wider = with_scatter(solution, sightings)
        error = direction_angle(solution.T, scene.T)
        before.append(error / sigma(solution))
        after.append(error / sigma(wider))
    assert np.median(before) > 5.0
    assert np.median(after) < 0.5 * np.median(before)


def test_the_amplitude_of_smooth_errors_is_told() -> None:
    found = {}
    for most_px in (0.0, 0.1, 1.0):
        cases = [(scene_of(seed), seed) for seed in range(5)]
        solved = [warped(scene, most_px, seed) for scene, seed in cases]
        found[most_px] = np.median([amplitude_of(linearised(s, Settled.of(solution))) for s, solution in solved])
    assert found[0.0] < 0.01
    assert 0.01 < found[0.1] < 0.2
    assert 0.1 < found[1.0] <= 1.0


def test_normals_follow_the_motion() -> None:
    sightings, solution = seen(scene_of(3), 0.3, 3)
    wider = with_scatter(solution, sightings)
    grown = np.linalg.eigvalsh(wider.normal_covariance - solution.normal_covariance)
    assert sigma(wider) > 1.3 * sigma(solution)
    assert (grown > -1e-12 * np.abs(grown).max()).all()
    assert np.array_equal(wider.scaled_normals, solution.scaled_normals)


def test_a_motion_held_by_a_prior_keeps_its_sigma() -> None:
    scene = scene_of(0)
    prior = MotionPrior(rotation=scene.R, rotation_sigma=1e-3)
    sightings, solution = seen(scene, 0.3, 0, prior)
    assert with_scatter(solution, sightings) is solution


@pytest.mark.parametrize("kept", [12, 30])
def test_few_points_change_nothing_or_little(kept: int) -> None:
    sightings, _ = seen(scene_of(0), 0.0, 0)
    some = np.flatnonzero(sightings.patch < 2)[:kept]
    few = replace(sightings.take(some), patch=sightings.patch[some])
    alone = solve_planes(*few.rays(), few.patch)
    assert 1.0 <= scatter(few, alone) < 3.0
