"""The scene generator: its truth explains its points, and it is reproducible."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from slopecli.errors import InputError
from slopecli.geometry import apply_homography, homography_of_plane, rays_from_pixels, solve_planes
from slopecli.study import field_of_view_camera, make_scene, make_sequence, paper_scene


def test_paper_scene_is_the_papers() -> None:
    scene = paper_scene(np.random.default_rng(0), 45.0, 0.3)
    camera = scene.camera
    assert (camera.width, camera.height, camera.cx) == (1024, 1024, 511.5)
    assert np.degrees(2.0 * np.arctan(512.0 / camera.fx)) == pytest.approx(60.0)
    assert np.bincount(scene.patch).tolist() == [30] * 9
    # baseline 1/5 of the height: depths near 1 height are near 5 baselines
    assert 1.0 / np.linalg.norm(scene.normals, axis=1).mean() == pytest.approx(5.0, rel=0.2)
    assert np.degrees(np.arccos(scene.T[2])) == pytest.approx(45.0)


def test_patches_lie_in_their_windows() -> None:
    scene = paper_scene(np.random.default_rng(1), 0.0, 0.0)
    cell = np.floor((scene.uv1 + 0.5) / (1024 / 3)).astype(int)
    assert np.array_equal(cell[:, 1] * 3 + cell[:, 0], scene.patch)


def test_truth_maps_image_1_to_image_2() -> None:
    scene = make_scene(np.random.default_rng(2), noise_px=0.0)
    for i, N in enumerate(scene.normals):
        inside = scene.patch == i
        H = homography_of_plane(scene.R, scene.T, N)
        assert apply_homography(H, scene.x1[inside]) == pytest.approx(scene.x2[inside], abs=1e-14)


def test_slopes_are_as_asked() -> None:
    wanted = [0.0, 5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 35.0, 40.0]
    scene = make_scene(np.random.default_rng(3), slopes_deg=wanted)
    assert np.degrees(scene.slopes) == pytest.approx(wanted, abs=1e-9)


def test_noise_outliers_and_relief_have_the_size_asked_for() -> None:
    scene = make_scene(np.random.default_rng(4), points=500, noise_px=0.5, noise1_px=0.2, outliers=0.1)
    good = ~scene.outlier
    focal = scene.camera.focal_px
    assert np.std((scene.x2 - scene.x2_clean)[good]) * focal == pytest.approx(0.5, rel=0.05)
    assert np.std(scene.x1 - scene.x1_clean) * focal == pytest.approx(0.2, rel=0.05)
    assert scene.outlier.mean() == pytest.approx(0.1, abs=0.02)


def test_same_seed_same_scene_and_terrain_outlives_its_noise() -> None:
    a, b = (paper_scene(np.random.default_rng(5), 45.0, 0.3) for _ in range(2))
    assert np.array_equal(a.x2, b.x2)
    other = paper_scene(np.random.default_rng(5), 45.0, 0.3, np.random.default_rng(6))
    assert np.array_equal(a.x2_clean, other.x2_clean)
    assert not np.array_equal(a.x2, other.x2)


def test_free_points_are_labelled() -> None:
    scene = make_scene(np.random.default_rng(7), free_points=25)
    assert (scene.patch == -1).sum() == 25


def test_other_cameras() -> None:
    camera = field_of_view_camera(640, 480, 40.0)
    scene = make_scene(np.random.default_rng(8), camera=camera, grid=(4, 3))
    assert scene.uv1.min() >= -0.5
    assert (scene.uv1 <= [639.5, 479.5]).all()


def test_impossible_scenes_are_refused() -> None:
    with pytest.raises(InputError, match="too steep"):
        make_scene(np.random.default_rng(9), slopes_deg=[85.0] * 9)
    with pytest.raises(InputError, match="2 slopes given for 9 patches"):
        make_scene(np.random.default_rng(9), slopes_deg=[1.0, 2.0])


def test_distorted_camera_sees_the_same_scene_through_its_lens() -> None:
    camera = replace(field_of_view_camera(800, 600), model="brown", distortion=(-0.25, 0.08, 0.001, -0.0005))
    scene = make_scene(np.random.default_rng(10), camera=camera, noise_px=0.0)
    cell = np.floor((scene.uv1 + 0.5) / [800 / 3, 200]).astype(int)
    assert np.array_equal(cell[:, 1] * 3 + cell[:, 0], scene.patch)  # windows are those of the image as it is stored
    assert rays_from_pixels(camera, scene.uv2) == pytest.approx(scene.x2, abs=1e-12)
    assert np.abs(scene.uv1 - (scene.x1 * camera.fx + [camera.cx, camera.cy])).max() > 5.0
    solution = solve_planes(scene.x1, scene.x2, scene.patch)
    assert pytest.approx(scene.R, abs=1e-9) == solution.R


def test_heading_turns_the_flight() -> None:
    scene = make_scene(np.random.default_rng(11), trajectory_deg=90.0, heading_deg=90.0)
    assert pytest.approx([0.0, 1.0, 0.0], abs=1e-12) == scene.T


def test_sequence_is_one_ground_seen_from_many_places() -> None:
    places = np.array([[0.1, 0.0, 0.0], [0.2, 0.0, 0.1], [0.3, 0.1, 0.2]])
    scenes = make_sequence(np.random.default_rng(12), places, noise1_px=0.2, grid=(2, 2))
    for scene, place in zip(scenes, places, strict=True):
        assert np.array_equal(scene.x1, scenes[0].x1)  # image 1 was taken once, with its noise
        assert pytest.approx(place / np.linalg.norm(place)) == scene.T
        # lengths in heights, not in baselines, are the same in all
        assert scene.normals / np.linalg.norm(place) == pytest.approx(scenes[0].normals / 0.1)
        for i, N in enumerate(scene.normals):
            inside = scene.patch == i
            H = homography_of_plane(scene.R, scene.T, N)
            assert apply_homography(H, scene.x1_clean[inside]) == pytest.approx(scene.x2_clean[inside], abs=1e-12)


def test_cameras_that_do_not_see_the_ground_are_refused() -> None:
    with pytest.raises(InputError, match="below the ground"):
        make_scene(np.random.default_rng(13), trajectory_deg=0.0, baseline_over_height=1.5)
    with pytest.raises(InputError, match="where camera 1 is"):
        make_sequence(np.random.default_rng(13), np.zeros((1, 3)))
    fold = replace(field_of_view_camera(fov_deg=100.0), model="brown", distortion=(-0.5,))
    with pytest.raises(InputError, match="lens model does not reach"):
        make_scene(np.random.default_rng(13), camera=fold)
