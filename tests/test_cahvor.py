"""Lens models that OpenCV does not have: exact both ways, equal to their source."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from command import slopemap

from slopecli.geometry import (
    OUTSIDE_PX,
    pixels_from_rays,
    radial_term,
    rays_from_pixels,
    scale_camera,
    undistortion_maps,
    with_radial_term,
)
from slopecli.types import Camera

TILT = (0.011, -0.007)
CAHVOR = Camera(1024, 1024, 1210.0, 1208.0, 509.0, 520.0, "cahvor", (-3e-4, -0.13, 0.18, *TILT, 1.0, 2e-4))
GENERAL = Camera(1024, 1024, 480.0, 481.0, 505.0, 514.0, "cahvor", (1e-4, -0.03, 0.004, *TILT, 0.46, -1e-4))
FISHEYE = Camera(1024, 1024, 405.0, 405.0, 505.0, 514.0, "cahvor", (0.0, -0.02, -0.003, *TILT, 0.0, 0.0))
SINE = Camera(1024, 1024, 560.0, 560.0, 511.5, 511.5, "cahvor", (0.0, 0.01, 0.0, *TILT, -0.5, 0.0))
ORDER8 = Camera(
    5280, 3956, 3705.9, 3705.4, 2651.2, 1949.7, "polynomial", (-0.0919, -0.0763, 1e-4, -3e-4, 0.1163, -0.0761, -8e-5)
)
SKEW = Camera(640, 480, 500.0, 510.0, 320.0, 240.0, "polynomial", (0.0,) * 6 + (0.02,))
CAMERAS = {"cahvor": CAHVOR, "general": GENERAL, "fisheye": FISHEYE, "sine": SINE, "order-8": ORDER8, "skew": SKEW}
cases = pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)


def pixels_of(camera: Camera, n: int = 500) -> np.ndarray:
    uv = np.random.default_rng(3).uniform((0, 0), (camera.width - 1, camera.height - 1), (n, 2))
    uv[0] = camera.cx, camera.cy
    return uv


def ray_by_bisection(camera: Camera, uv: np.ndarray) -> np.ndarray:
    """X/Z, Y/Z of one pixel by the steps of Gennery's model, roots by halving intervals; NaN behind the camera."""
    r0, r1, r2, tilt_x, tilt_y, linearity, skew = camera.distortion
    y_d = (uv[1] - camera.cy) / camera.fy
    x_d = (uv[0] - camera.cx) / camera.fx - skew * y_d
    axis = np.array([tilt_x, tilt_y, 1.0]) / np.sqrt(1 + tilt_x**2 + tilt_y**2)
    apparent = np.array([x_d, y_d, 1.0])
    zeta = apparent @ axis
    aside = apparent - zeta * axis
    seen = np.linalg.norm(aside) / zeta
    low, high = 0.0, 4.0
    for _ in range(200):
        chi = 0.5 * (low + high)
        low, high = (low, chi) if chi * (1 + r0) + r1 * chi**3 + r2 * chi**5 > seen else (chi, high)
    theta = chi if linearity == 0 else (np.arctan if linearity > 0 else np.arcsin)(linearity * chi) / linearity
    ray = np.sin(theta) * aside / np.linalg.norm(aside) + np.cos(theta) * axis
    return ray[:2] / ray[2] if ray[2] > 0 else np.full(2, np.nan)


@cases
def test_round_trip_is_exact(camera: Camera) -> None:
    uv = pixels_of(camera)
    x = rays_from_pixels(camera, uv)
    seen = np.isfinite(x).all(axis=1)
    assert seen.mean() > 0.75
    np.testing.assert_allclose(pixels_from_rays(camera, x[seen]), uv[seen], atol=1e-8)


@pytest.mark.parametrize("camera", [CAHVOR, GENERAL, FISHEYE], ids=["cahvor", "general", "fisheye"])
def test_rays_are_those_of_the_source(camera: Camera) -> None:
    uv = pixels_of(camera, 40)
    theirs = np.array([ray_by_bisection(camera, one) for one in uv])
    seen = np.hypot(*theirs.T) < 3
    assert seen.mean() > 0.75
    np.testing.assert_allclose(rays_from_pixels(camera, uv)[seen], theirs[seen], rtol=1e-12, atol=1e-13)


def test_a_perspective_axis_without_tilt_is_a_radial_lens() -> None:
    lens = Camera(640, 480, 500, 500, 320, 240, "brown", (-0.2, 0.05))
    same = Camera(640, 480, 500, 500, 320, 240, "cahvor", (0.0, -0.2, 0.05, 0.0, 0.0, 1.0, 0.0))
    uv = pixels_of(lens)
    np.testing.assert_allclose(rays_from_pixels(same, uv), rays_from_pixels(lens, uv), atol=1e-12)


def test_the_radial_terms_are_about_the_tilted_axis() -> None:
    """Half a degree of tilt moves pixels by tenths: about A instead the rays would be wrong."""
    straight = Camera(
        *(getattr(CAHVOR, name) for name in ("width", "height", "fx", "fy", "cx", "cy")),
        "cahvor",
        (*CAHVOR.distortion[:3], 0.0, 0.0, *CAHVOR.distortion[5:]),
    )
    uv = pixels_of(CAHVOR)
    moved = pixels_from_rays(CAHVOR, rays_from_pixels(straight, uv)) - uv
    assert np.nanmax(np.hypot(*moved.T)) > 0.3


def test_order_8_and_skew_are_the_published_formula() -> None:
    x, y = np.random.default_rng(1).uniform(-0.6, 0.6, (2, 50))
    k1, k2, p1, p2, k3, k4, skew = ORDER8.distortion
    r2 = x * x + y * y
    g = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3 + k4 * r2**4
    x_d, y_d = x * g + 2 * p1 * x * y + p2 * (r2 + 2 * x * x), y * g + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    u, v = ORDER8.fx * (x_d + skew * y_d) + ORDER8.cx, ORDER8.fy * y_d + ORDER8.cy
    np.testing.assert_allclose(pixels_from_rays(ORDER8, np.column_stack([x, y])), np.column_stack([u, v]), atol=1e-9)


@pytest.mark.parametrize("coefficients", [(0.0, -0.4, 0.0), (0.0, -0.5, 0.11), (-1.0, 0.0, 0.0), (0.0, 1e-320, 0.0)])
def test_beyond_the_fold_there_is_no_ray(coefficients: tuple[float, ...]) -> None:
    camera = Camera(640, 480, 200, 200, 320, 240, "cahvor", (*coefficients, *TILT, 1.0, 0.0))
    with np.errstate(over="raise", divide="raise"):
        x = rays_from_pixels(camera, pixels_of(camera))
    seen = np.isfinite(x).all(axis=1)
    assert seen.mean() < 1 or coefficients[1] == 1e-320
    assert seen.any() or coefficients[0] == -1
    np.testing.assert_allclose(pixels_from_rays(camera, x[seen]), pixels_of(camera)[seen], atol=1e-6)


@cases
def test_directions_behind_the_camera_and_nothing_have_no_image(camera: Camera) -> None:
    assert (
        np.isnan(pixels_from_rays(camera, np.array([[1e4, 0.0], [np.nan, 0.0]]))).all() or camera.model == "polynomial"
    )
    assert rays_from_pixels(camera, np.empty((0, 2))).shape == (0, 2)


@cases
def test_a_resized_image_shows_the_same_rays(camera: Camera) -> None:
    half = scale_camera(camera, camera.width // 2, camera.height // 2)
    uv = pixels_of(camera)
    np.testing.assert_allclose(
        rays_from_pixels(half, (uv + 0.5) / 2 - 0.5), rays_from_pixels(camera, uv), atol=1e-9, equal_nan=True
    )


@cases
def test_maps_to_an_ideal_image_are_the_projection(camera: Camera) -> None:
    ideal = Camera(96, 72, 60.0, 61.0, 47.5, 35.5)
    maps = undistortion_maps(camera, ideal)
    uv = np.array([[0.0, 0.0], [95.0, 71.0], [20.0, 65.0], [48.0, 36.0]])
    wanted = pixels_from_rays(camera, rays_from_pixels(ideal, uv))
    found = np.array([[one[int(v), int(u)] for one in maps] for u, v in uv])
    np.testing.assert_allclose(found, np.where(np.isfinite(wanted), wanted, OUTSIDE_PX), atol=1e-2)


@cases
def test_the_radial_term_can_be_changed(camera: Camera) -> None:
    changed = with_radial_term(camera, radial_term(camera) + 0.01)
    moved = pixels_from_rays(changed, np.array([[0.3, 0.1]])) - pixels_from_rays(camera, np.array([[0.3, 0.1]]))
    r3 = 0.01 * np.hypot(0.3, 0.1) ** 3 * camera.focal_px
    assert np.hypot(*moved[0]) == pytest.approx(r3, rel=0.2)


SAMPLES = Path(__file__).parent.parent / "sample_data"


@pytest.mark.parametrize(
    ("model", "distortion"),
    [("polynomial", [-0.06, 0.012, 0, 0, 0, 1e-12, 1e-12]), ("cahvor", [0, -0.06, 0.012, 0, 0, 1, 0])],
)
def test_slopes_with_the_same_lens_in_another_model_are_the_same(
    tmp_path: Path, model: str, distortion: list[float]
) -> None:
    brown = json.loads((SAMPLES / "descent" / "camera.json").read_text())
    slopes = {}
    for name, keys in (("brown", {}), (model, {"model": model, "distortion": distortion})):
        (tmp_path / f"{name}.json").write_text(json.dumps({**brown, **keys}))
        done = slopemap("solve", str(SAMPLES / "matches.csv"), "--camera", str(tmp_path / f"{name}.json"), "--json")
        answer = json.loads(done.stdout)
        assert answer["cameras"][0]["model"] == name
        slopes[name] = [plane["slope_deg"] for plane in answer["planes"]]
    assert slopes[model] == pytest.approx(slopes["brown"], abs=1e-6)
