"""What the whole image says of depths and planes, from matches of which some are wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scenery import Surface, make_camera, render, tilted, turn, unit

from slopecli.geometry import homogeneous, normal_angle, rays_from_pixels
from slopecli.look import Evidence, Matches, gather_evidence, scene_planes
from slopecli.types import FloatArray

CAMERA = make_camera()
FOCAL = CAMERA.focal_px
R, T, GROUND = turn(1, -2, 3), unit(0.8, 0.2, 0.4), tilted(0.2, -0.1)
LEFT, TOP = Surface(tilted(-0.4, 0.1, 5.0), (0, 60, 120, 180)), Surface(tilted(0.3, 0.5, 5.0), (0, 0, 320, 60))


def evidence_of(
    surfaces: list[Surface | FloatArray], n: int = 1000, wrong: float = 0.0, noise_px: float = 0.1, seed: int = 0
) -> tuple[Evidence, FloatArray]:
    """Evidence of n noisy matches, the first `wrong` of them mismatches, and the true inverse depths of all (n,)."""
    rng = np.random.default_rng(seed)
    scene = render(R, T, surfaces)
    uv1 = rng.uniform([0, 0], [319, 239], (n, 2))
    x2 = scene.rays2(uv1) + noise_px / FOCAL * rng.standard_normal((n, 2))
    k = round(wrong * n)
    x2[:k] = rng.uniform([-0.57, -0.43], [0.57, 0.43], (k, 2))
    x1 = rays_from_pixels(CAMERA, uv1)
    return gather_evidence(Matches(uv1, uv1, x1, x2), uv1[:, 0], R, T, FOCAL), scene.inverse_depth(uv1)


def apart_deg(a: FloatArray, b: FloatArray) -> float:
    return float(np.degrees(normal_angle(a, b)))


def test_right_matches_are_kept_with_their_depths() -> None:
    evidence, w = evidence_of([GROUND], noise_px=0.1)
    assert len(evidence) == 1000
    assert np.abs(evidence.w - w).max() / w.mean() < 0.02
    assert np.array_equal(evidence.grey, evidence.uv1[:, 0])


def test_mismatches_off_their_epipolar_lines_and_behind_the_camera_are_dropped() -> None:
    evidence, _ = evidence_of([GROUND], wrong=0.4)
    wrong = np.abs(evidence.w - homogeneous(evidence.x1) @ GROUND) * evidence.leverage * FOCAL > 2
    assert 590 <= (~wrong).sum() <= 610
    assert wrong.sum() < 0.03 * 400  # those that lie on their lines by chance
    assert (evidence.w > 0).all()


def test_near_is_the_window_grown_by_its_longer_side() -> None:
    evidence, _ = evidence_of([GROUND])
    u, v = evidence.uv1.T
    window = (100, 80, 60, 40)
    assert np.array_equal(evidence.near(window, 0.0), (u >= 100) & (u < 160) & (v >= 80) & (v < 120))
    assert np.array_equal(evidence.near(window, 0.5), (u >= 70) & (u < 190) & (v >= 50) & (v < 150))


def test_the_plane_through_a_region_is_the_one_there() -> None:
    evidence, _ = evidence_of([GROUND, LEFT, TOP])
    for surface, box in (
        (LEFT.normal, (10, 70, 100, 160)),
        (GROUND, (130, 70, 180, 160)),
        (TOP.normal, (0, 0, 320, 60)),
    ):
        found = evidence.plane_through(evidence.near(box, 0.0))
        assert found is not None
        assert apart_deg(found, surface) < 0.2


def test_five_matches_make_no_plane() -> None:
    evidence, _ = evidence_of([GROUND])
    which = np.arange(len(evidence)) < 5
    assert evidence.plane_through(which) is None
    assert evidence.plane_through(np.arange(len(evidence)) < 6) is not None


def test_misfit_is_in_pixels_of_image_2() -> None:
    evidence, _ = evidence_of([GROUND], noise_px=0.0)
    assert evidence.misfit_px(GROUND).max() < 1e-6
    other = render(R, T, [1.01 * GROUND])
    truth = render(R, T, [GROUND])
    moved = np.linalg.norm(other.transfer(evidence.uv1) - truth.transfer(evidence.uv1), axis=1)
    np.testing.assert_allclose(evidence.misfit_px(1.01 * GROUND), moved, rtol=0.01)


@pytest.mark.parametrize("wrong", [0.0, 0.4])
def test_the_planes_of_the_scene_are_found_largest_first(wrong: float) -> None:
    evidence, _ = evidence_of([GROUND, LEFT, TOP], wrong=wrong)
    planes = scene_planes(evidence)
    for found, true in zip(planes, (GROUND, LEFT.normal, TOP.normal), strict=False):
        assert apart_deg(found, true) < 0.7
    assert 3 <= len(planes) <= 4


def test_a_flat_scene_is_one_plane() -> None:
    (plane,) = scene_planes(evidence_of([GROUND])[0])
    assert apart_deg(plane, GROUND) < 0.05


def test_same_evidence_same_planes() -> None:
    evidence, _ = evidence_of([GROUND, LEFT, TOP], wrong=0.2)
    assert np.array_equal(scene_planes(evidence), scene_planes(evidence))


def test_little_evidence_makes_no_planes() -> None:
    assert scene_planes(evidence_of([GROUND], n=39)[0]) == []
    assert scene_planes(evidence_of([GROUND], n=0)[0]) == []


def test_matches_all_over_the_depths_make_no_plane() -> None:
    rng = np.random.default_rng(0)
    evidence, _ = evidence_of([GROUND])
    scattered = replace(evidence, w=rng.uniform(0.05, 0.5, 1000))
    largest = [(scattered.misfit_px(plane) < 1).mean() for plane in scene_planes(scattered)]
    assert max(largest, default=0.0) < 0.1


@pytest.mark.parametrize("shape", ["point", "line"])
def test_matches_in_one_place_or_on_a_line_raise_nothing(shape: str) -> None:
    uv1 = np.tile([[100.0, 80.0]], (60, 1))
    if shape == "line":
        uv1[:, 0] = np.linspace(10, 300, 60)
    x1 = rays_from_pixels(CAMERA, uv1)
    x2 = render(R, T, [GROUND]).rays2(uv1)
    for plane in scene_planes(gather_evidence(Matches(uv1, uv1, x1, x2), uv1[:, 0], R, T, FOCAL)):
        assert np.isfinite(plane).all()
