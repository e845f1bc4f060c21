"""A lens that is not that of the camera file is told from the matches alone; a right one is not suspected."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scenery import make_camera, render, tilted, turn, unit

from slopecli.findings import check_lens
from slopecli.geometry import LensMisfit, find_lens_misfit, fit_lens_misfit, rays_from_pixels, refine_motion
from slopecli.options import Options
from slopecli.pipeline import estimate
from slopecli.study import Scene, field_of_view_camera, make_scene
from slopecli.types import Camera, FloatArray, Image

PINHOLE = field_of_view_camera()
FOCAL = PINHOLE.focal_px
FLOOR = 0.02 / FOCAL


def lens(k1: float) -> Camera:
    return replace(PINHOLE, model="brown", distortion=(k1,)) if k1 else PINHOLE


def scene_with(k1: float, seed: int = 0, **options: object) -> Scene:
    values: dict[str, object] = {"trajectory_deg": 45.0, "noise_px": 0.1, "points": 100, "camera": lens(k1)}
    return make_scene(np.random.default_rng(seed), **{**values, **options})  # type: ignore[arg-type]


def seen_through(scene: Scene, believed: Camera) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """The motion that fits best, and the matches, if the lens were the one believed."""
    x1, x2 = rays_from_pixels(believed, scene.uv1), rays_from_pixels(believed, scene.uv2)
    motion = refine_motion(scene.R, scene.T, x1, x2, (FLOOR, 2.0 / FOCAL))
    return motion.R, motion.T, x1, x2


@pytest.mark.parametrize(
    ("trajectory_deg", "true_k1"), [(0.0, -0.1), (0.0, -0.05), (0.0, 0.05), (45.0, -0.05), (45.0, 0.05)]
)
def test_the_missing_distortion_is_measured(trajectory_deg: float, true_k1: float) -> None:
    scene = scene_with(true_k1, trajectory_deg=trajectory_deg)
    misfit = find_lens_misfit(*seen_through(scene, PINHOLE), FLOOR)
    assert misfit is not None
    # the inverse of a lens has its term with the other sign, and terms of higher order that go into it
    assert misfit.term == pytest.approx(-true_k1, rel=0.3)
    assert misfit.after < 0.15 / FOCAL


def test_a_distortion_that_the_images_no_longer_have_is_measured() -> None:
    misfit = find_lens_misfit(*seen_through(scene_with(0.0), lens(-0.1)), FLOOR)
    assert misfit is not None
    assert misfit.term == pytest.approx(-0.1, rel=0.2)


@pytest.mark.parametrize("noise_px", [0.03, 0.3, 1.0])
@pytest.mark.parametrize("trajectory_deg", [0.0, 45.0, 90.0])
@pytest.mark.parametrize("k1", [0.0, -0.1])
def test_a_right_lens_is_not_suspected(noise_px: float, trajectory_deg: float, k1: float) -> None:
    for seed in range(5):
        scene = scene_with(k1, seed, noise_px=noise_px, trajectory_deg=trajectory_deg, outliers=0.1)
        assert find_lens_misfit(*seen_through(scene, lens(k1)), FLOOR) is None


def test_its_sigma_is_that_of_its_errors() -> None:
    found = [
        fit_lens_misfit(*seen_through(scene_with(0.0, seed, noise_px=0.3), PINHOLE), FLOOR)[0] for seed in range(60)
    ]
    pulls = np.array([misfit.term / misfit.sigma for misfit in found])
    # robust weights lose some; 60 values tell the scatter to a tenth
    assert 0.7 < np.sqrt((pulls**2).mean()) < 1.4


def test_few_matches_say_nothing_of_the_lens() -> None:
    R, T, x1, x2 = seen_through(scene_with(-0.1), PINHOLE)
    assert find_lens_misfit(R, T, x1[:40], x2[:40], FLOOR) is None


# ---- what is said ----


def test_the_warning_has_the_size_at_the_corner() -> None:
    (warning,) = check_lens(LensMisfit(0.1, 1e-4, 1e-3, 1e-4), PINHOLE)
    corner = 0.1 * (2 * (511.5 / FOCAL) ** 2) ** 1.5 * FOCAL
    assert (warning.code, warning.severity) == ("suspect-distortion", "warning")
    assert warning.value == pytest.approx(corner)
    assert "k1 = -0.1 which the camera file does not have" in warning.message
    assert f"{corner:.1f} ± 0.05 px at the corner" in warning.message
    assert "calibrate" in str(warning.remedy)


def test_no_size_is_stated_where_no_match_is() -> None:
    """Matches in the middle of the image: what they measure is stated, and not what it might be at the corner."""
    (warning,) = check_lens(LensMisfit(0.1, 1e-3, 1e-3, 1e-4, reach=0.4), PINHOLE)
    assert warning.value is None
    assert "corner" not in warning.message
    assert f"{0.1 * 0.4**3 * FOCAL:.1f} ± " in warning.message
    assert f"{0.4 * FOCAL:.0f} px off the centre" in warning.message
    assert check_lens(LensMisfit(0.1, 1e-3, 1e-3, 1e-4, reach=0.1), PINHOLE) == []
    # the largest term allowed is a limit, not a measurement
    (limit,) = check_lens(LensMisfit(1.0, 1e-3, 1e-3, 1e-4), PINHOLE)
    assert (limit.value, "k1 =" in limit.message) == (None, False)
    scene = scene_with(-0.1)
    middle = np.linalg.norm(scene.x1, axis=1) < 0.35
    R, T, x1, x2 = seen_through(scene, PINHOLE)
    assert fit_lens_misfit(R, T, x1[middle], x2[middle], FLOOR)[0].reach < 0.6


def test_a_misfit_below_a_pixel_is_not_worth_a_word() -> None:
    assert check_lens(LensMisfit(0.001, 1e-6, 1e-3, 1e-4), PINHOLE) == []
    assert check_lens(None, PINHOLE) == []


@pytest.mark.parametrize(("term", "says"), [(-0.1, "taken out of the images already"), (0.1, "calibrate the lens")])
def test_distortion_taken_out_twice_is_told_from_a_wrong_one(term: float, says: str) -> None:
    (warning,) = check_lens(LensMisfit(term, 1e-4, 1e-3, 1e-4), lens(-0.1))
    assert "besides that of the camera file" in warning.message
    assert says in str(warning.remedy)


# ---- images ----


@pytest.mark.parametrize(
    ("true_k1", "believed_k1"),
    [(-0.15, 0.0), (0.0, -0.15), (-0.15, -0.15), pytest.param(0.0, 0.0, marks=pytest.mark.slow)],
)
def test_images_tell_a_wrong_camera_file(true_k1: float, believed_k1: float) -> None:
    def camera(k1: float) -> Camera:
        return make_camera(480, 360, **({"model": "brown", "distortion": (k1,)} if k1 else {}))

    pair = render(
        turn(1.0, -1.0, 2.0), unit(0.7, 0.1, 0.7), [tilted(0.1, 0.2, 5.0)], camera1=camera(true_k1), noise=1.0
    )
    believed = camera(believed_k1)
    report = estimate(Image(pair.grey1), Image(pair.grey2), believed, believed, Options())
    found = [d for d in report.diagnostics if d.code == "suspect-distortion"]
    assert len(found) == (true_k1 != believed_k1)
    if found:
        assert ("already" in str(found[0].remedy)) == (true_k1 == 0.0)
