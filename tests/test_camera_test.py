"""A wrong camera is told from the matches alone, a right one is not suspected, and one plane tells nothing."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from campaign import seeds

from slopecli import load_camera, load_image
from slopecli.geometry import solve_planes
from slopecli.geometry.solver import Settled, Sightings, changed, free_focal, free_parameter, score_camera
from slopecli.options import Options
from slopecli.patches import Given
from slopecli.pipeline import estimate, solve
from slopecli.study import Scene, field_of_view_camera, make_scene
from slopecli.types import Camera, Report, Solution

SAMPLE = Path(__file__).parent.parent / "sample_data" / "descent"
PINHOLE = field_of_view_camera()
LENS = replace(PINHOLE, model="brown", distortion=(-0.15, 0.03, 0.001, -0.0005, 0.0))


def scene_of(seed: int = 0, camera: Camera = PINHOLE, **options: object) -> Scene:
    values: dict[str, object] = {"trajectory_deg": 45.0, "noise_px": 0.1, "points": 60, "camera": camera}
    return make_scene(np.random.default_rng(seed), **{**values, **options})  # type: ignore[arg-type]


def seen_through(scene: Scene, camera: Camera, relief: bool = False) -> tuple[Sightings, Solution]:
    sightings = Sightings(scene.uv1, scene.uv2, scene.patch, np.ones(len(scene.patch)), (camera, camera))
    solution = solve_planes(*sightings.rays(), scene.patch, relief=relief)
    return sightings.take(solution.inlier), solution


def report_of(scene: Scene, camera: Camera, **options: object) -> Report:
    given = Given(scene.uv1, scene.uv2, scene.patch)
    return solve(given, (camera, camera), Options(**options))  # type: ignore[arg-type]


@pytest.mark.parametrize("factor", [0.6, 0.9, 1.3])
@pytest.mark.parametrize("camera", [PINHOLE, LENS], ids=["pinhole", "distorted"])
def test_a_false_focal_length_is_recovered_exactly_without_noise(camera: Camera, factor: float) -> None:
    false = changed(camera, "f", np.log(factor))
    sightings, solution = seen_through(scene_of(camera=camera, noise_px=0.0), false)
    freed = free_focal(sightings, Settled.of(solution))
    assert freed is not None
    assert factor * np.exp(freed.value) == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize(("parameter", "by"), [("cx", 0.05), ("cy", -0.03), ("k1", 0.05)])
def test_other_parameters_are_recovered_exactly_without_noise(parameter: str, by: float) -> None:
    sightings, solution = seen_through(scene_of(camera=LENS, noise_px=0.0), changed(LENS, parameter, by))
    freed = free_parameter(sightings, Settled.of(solution), parameter)
    assert freed is not None
    assert freed.value == pytest.approx(-by, abs=1e-5)


def test_the_normals_follow_the_focal_length_as_the_score_says() -> None:
    scene = scene_of(1)
    sightings, solution = seen_through(scene, PINHOLE)
    score, step = score_camera(sightings, Settled.of(solution)), 0.01
    near = [seen_through(scene, changed(PINHOLE, "f", side * step))[1] for side in (1, -1)]
    slope = (near[0].scaled_normals - near[1].scaled_normals) / (2 * step)
    np.testing.assert_allclose(score.normals, slope, atol=0.03 * np.abs(slope).max())


def test_its_sigma_is_that_of_its_errors() -> None:
    pulls = []
    for seed in seeds(200, 40):
        sightings, solution = seen_through(scene_of(seed, noise_px=0.3), PINHOLE)
        score = score_camera(sightings, Settled.of(solution))
        pulls.append(score.step / score.sigma)
    # the largest of three sigmas is on average too large by a little
    assert (np.sqrt((np.array(pulls) ** 2).mean(axis=0)) < 1.3).all()
    assert (np.sqrt((np.array(pulls) ** 2).mean(axis=0)) > 0.5).all()


@pytest.mark.parametrize("trajectory_deg", [0.0, 45.0, 90.0])
def test_a_right_camera_is_not_suspected_on_rough_ground(trajectory_deg: float) -> None:
    for seed in seeds(60, 5):
        scene = scene_of(seed, trajectory_deg=trajectory_deg, noise_px=0.1, relief=0.005)
        assert "suspect-camera" not in {d.code for d in report_of(scene, PINHOLE).diagnostics}


@pytest.mark.parametrize("factor", [0.6, 0.8, 1.3])
def test_a_false_focal_length_is_named_and_no_verdict_is_safe(factor: float) -> None:
    report = report_of(scene_of(2), changed(PINHOLE, "f", np.log(factor)))
    (warning,) = (d for d in report.diagnostics if d.code == "suspect-camera")
    assert warning.value == pytest.approx(1.0 / factor, rel=0.02)
    assert report.fit.focal_factor == warning.value
    assert "fit a focal length of" in warning.message
    assert "slopes are off by up to" in warning.message
    assert "--free-focal" in (warning.remedy or "")
    assert all(plane.verdict != "safe" for plane in report.planes)


def test_a_false_principal_point_is_named() -> None:
    report = report_of(scene_of(3), changed(PINHOLE, "cx", 0.08))
    (warning,) = (d for d in report.diagnostics if d.code == "suspect-camera")
    assert "principal point with cx" in warning.message


def test_one_plane_tells_no_focal_length() -> None:
    scene = scene_of(4, slopes_deg=[0.0] * 9, height_spread=0.0)
    report = report_of(scene, changed(PINHOLE, "f", np.log(0.7)))
    assert report.fit.focal_factor is None
    assert report.fit.focal_factor_sigma is None
    assert "suspect-camera" not in {d.code for d in report.diagnostics}


def test_rays_and_few_rows_tell_none() -> None:
    scene = scene_of(5)
    camera_less = Given(*(scene.uv1 / 700.0 - 0.5, scene.uv2 / 700.0 - 0.5), scene.patch)
    assert solve(camera_less, None, Options()).fit.focal_factor is None


@cache
def sample_with(focal_px: float | None) -> Report:
    images = (load_image(SAMPLE / "image1.png"), load_image(SAMPLE / "image2.png"))
    camera = load_camera(SAMPLE / "camera.json")
    camera = camera if focal_px is None else replace(camera, fx=focal_px, fy=focal_px)
    return estimate(*images, camera, camera, Options())


def test_the_sample_is_right_and_said_to_be() -> None:
    report = sample_with(None)
    assert report.fit.focal_factor == pytest.approx(1.0, abs=0.005)
    assert [d.code for d in report.diagnostics if d.code.startswith("suspect")] == []


def test_the_sample_with_a_focal_length_of_400_px_is_suspect() -> None:
    report = sample_with(400.0)
    assert [d.code for d in report.diagnostics if d.code.startswith("suspect")] == ["suspect-camera"]
    assert 400.0 * (report.fit.focal_factor or 0.0) == pytest.approx(692.8, rel=0.05)
    assert all(plane.verdict != "safe" for plane in report.planes)
