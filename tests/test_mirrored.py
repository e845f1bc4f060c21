"""A mirrored image is told by its surfaces, which turn the other way round, and not by a wide turn or a long way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from campaign import seeds
from scenery import make_camera, render, tilted, turn, unit

from slopecli.errors import NoAnswer
from slopecli.findings import refuse_mirrored
from slopecli.geometry import homogeneous, kept_orientation
from slopecli.options import Options
from slopecli.patches import Given
from slopecli.pipeline import estimate, solve
from slopecli.study import make_scene
from slopecli.types import FloatArray, Image, IntArray

ROLLS = (0.0, 30.0, 66.0, 90.0, 120.0, 180.0)
FLIPS = ([-1.0, 1.0], [1.0, -1.0])


def patches_from_afar(
    rng: np.random.Generator, roll_deg: float, baseline: float, m: int = 4, points: int = 12
) -> tuple[FloatArray, FloatArray, IntArray] | None:
    """Matches x1, x2 (n, 2) of m planes at distances of 0.4 to 2, after a sideways move (in the middle distance).

    Camera 2 looks at the middle and is rolled. None where a plane does not show one side clearly to both cameras.
    """
    side = int(np.ceil(np.sqrt(m)))
    heading = rng.uniform(0, 2 * np.pi)
    move = baseline * np.array([np.cos(heading), np.sin(heading), 0.2 * rng.standard_normal()])
    ahead = unit(*(np.array([0.0, 0.0, 1.0]) - move))
    right = unit(*np.cross([0.0, 1.0, 0.0], ahead))
    R = turn(z_deg=roll_deg) @ np.array([right, np.cross(ahead, right), ahead])
    x1, x2 = [], []
    for k in range(m):
        x = np.array([k % side, k // side]) * 1.1 / side - 0.55 + rng.uniform(0, 1.1 / side, (points, 2))
        normal = np.array([*(0.5 * rng.standard_normal(2)), 1.0])
        normal /= homogeneous(x).mean(0) @ normal * rng.uniform(0.4, 2.0)
        inverse_depth = homogeneous(x) @ normal
        seen = (homogeneous(x) - inverse_depth[:, None] * move) @ R.T
        if inverse_depth.min() < 0.05 or seen[:, 2].min() < 0.05 or 1 - normal @ move < 0.2:
            return None
        x1.append(x)
        x2.append(seen[:, :2] / seen[:, 2:])
    return np.concatenate(x1), np.concatenate(x2), np.repeat(np.arange(m), points)


def campaign(baseline: float, count: range) -> list[tuple[FloatArray, FloatArray, IntArray]]:
    drawn = (patches_from_afar(np.random.default_rng(seed), ROLLS[seed % 6], baseline) for seed in count)
    return [one for one in drawn if one is not None]


@pytest.mark.parametrize("baseline", [0.2, 0.7, 1.5])
def test_turns_and_long_ways_are_no_mirror_and_mirrors_are(baseline: float) -> None:
    pairs = campaign(baseline, seeds(1000, 60))
    assert len(pairs) > 15
    for number, (x1, x2, surface) in enumerate(pairs):
        noisy = x2 + 1e-3 * np.random.default_rng(number).standard_normal(x2.shape)
        refuse_mirrored(x1, noisy, surface)
        for flip in FLIPS:
            with pytest.raises(NoAnswer, match=r"^poor-fit: image 2 is mirrored"):
                refuse_mirrored(x1, noisy * flip, surface)


def test_mismatches_are_no_mirror_and_hide_none() -> None:
    for seed, (x1, x2, surface) in enumerate(campaign(0.7, seeds(200, 30))):
        rng = np.random.default_rng(seed)
        wrong = rng.random(len(x1)) < 0.15
        x2 = np.where(wrong[:, None], rng.uniform(-0.5, 0.5, x2.shape), x2)
        refuse_mirrored(x1, x2, surface)
        with pytest.raises(NoAnswer, match="mirrored"):
            refuse_mirrored(x1, x2 * [-1, 1], surface)
        refuse_mirrored(x1, rng.permutation(x2), surface)


def test_points_on_no_surface_and_surfaces_of_two_points_say_nothing() -> None:
    x1 = np.random.default_rng(0).uniform(-0.5, 0.5, (60, 2))
    surface = np.repeat([-1, 3], 30)
    assert kept_orientation(x1, x1 * np.where(surface < 0, -1, 1)[:, None] ** [[1, 0]], surface) == 1.0
    assert np.isnan(kept_orientation(x1, -x1, np.arange(60) // 2))
    refuse_mirrored(x1, x1 * [-1, 1], np.full(60, -1))


def test_rows_of_a_mirrored_image_have_no_answer() -> None:
    scene = make_scene(np.random.default_rng(1), rotation_deg=3.0)
    for flip in FLIPS:
        mirrored = replace(scene, x2=scene.x2 * flip)
        given = Given(mirrored.uv1, mirrored.uv2, scene.patch)
        with pytest.raises(NoAnswer, match="image 2 is mirrored"):
            solve(given, (scene.camera, scene.camera), Options())


@pytest.mark.parametrize("roll", ROLLS)
def test_rows_of_a_wide_turn_are_solved(roll: float) -> None:
    """Two walls of a corner seen from 80 degrees apart: the affine map of all points has a negative determinant."""
    R = turn(z_deg=roll) @ turn(y_deg=-40.0)
    T, rng = unit(0.9, 0.1, 0.3), np.random.default_rng(0)
    planes = [np.array([0.35, 0.0, 0.3]), np.array([-0.35, 0.05, 0.3]), np.array([0.0, -0.4, 0.5])]
    x1 = np.concatenate([low + rng.uniform(0, 0.3, (30, 2)) for low in ([-0.4, -0.2], [0.1, -0.2], [-0.15, 0.15])])
    surface = np.repeat(np.arange(3), 30)
    inverse_depth = (homogeneous(x1) * np.array(planes)[surface]).sum(1)
    seen = (homogeneous(x1) - inverse_depth[:, None] * T) @ R.T
    x2 = seen[:, :2] / seen[:, 2:] + 2e-4 * rng.standard_normal(x1.shape)
    report = solve(Given(x1, x2, surface), None, Options())
    normals = np.array([plane.normal_cam1 for plane in report.planes])
    true = -np.array(planes) / np.linalg.norm(planes, axis=1, keepdims=True)
    assert np.degrees(np.arccos(np.clip((normals * true).sum(1), -1, 1))).max() < 1.0


def test_images_are_mirrored_or_turned() -> None:
    """The features of a mirrored image may match so badly that another reason comes first; an answer it has not."""
    camera, options = make_camera(240, 180), Options(grid=(1, 1))  # larger ones are searched longer
    pair = render(turn(1.0, -2.0, 66.0), unit(0.8, 0.1, 0.2), [tilted(0.1, 0.2, 4.0)], camera1=camera, noise=1.0)
    estimate(Image(pair.grey1), Image(pair.grey2), camera, camera, options)
    with pytest.raises(NoAnswer):
        estimate(Image(pair.grey1), Image(np.ascontiguousarray(pair.grey2[:, ::-1])), camera, camera, options)
