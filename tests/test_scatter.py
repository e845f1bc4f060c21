"""Errors that parts of the image share enter the sigma of the motion; independent noise leaves it as it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from campaign import seeds

from slopecli.geometry import direction_angle, solve_planes
from slopecli.geometry.solver import MotionPrior, Settled, Sightings, scatter_of, with_scatter
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
    sightings = Sightings(scene.uv1, uv2, scene.patch, np.ones(len(scene.patch)), (CAMERA, CAMERA))
    solution = solve_planes(*sightings.rays(), scene.patch, prior=prior)
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


def test_independent_noise_leaves_the_sigma_nearly_as_it_is() -> None:
    factors = [scatter_of(s, Settled.of(solution)) for s, solution in (seen(scene_of(k), 0.0, k) for k in range(12))]
    assert min(factors) >= 1.0
    assert np.median(factors) < 1.6
    assert max(factors) < 3.0


def test_errors_shared_by_parts_of_the_image_are_in_the_sigma() -> None:
    before, after = pulls(0.2, False), pulls(0.2, True)
    assert np.median(before) > 2.0
    assert np.median(after) < 1.8
    assert np.median(after) < 0.6 * np.median(before)


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
    assert 1.0 <= scatter_of(few, Settled.of(alone)) < 3.0
