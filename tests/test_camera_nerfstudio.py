"""nerfstudio cameras."""

import math
from pathlib import Path

import pytest
from camera_factory import (
    NERF,
    NERFSTUDIO,
    brown_image,
    check_is_the_sample,
    check_pixels,
    directions,
    fisheye_image,
    refusal,
    write,
)

from slopecli.io.cameras import load_camera


def test_nerfstudio_fisheye_and_per_frame_cameras(tmp_path: Path) -> None:
    fisheye = {**NERFSTUDIO, "camera_model": "OPENCV_FISHEYE", "k3": 0.1, "k4": 0.2, "p1": 0, "p2": 0}
    assert load_camera(write(tmp_path, fisheye)).distortion == (-0.28, 0.074, 0.1, 0.2)
    shared = {key: value for key, value in NERFSTUDIO.items() if key not in ("fl_x", "frames")}
    frames = [{"file_path": f"images/{name}.jpg", "fl_x": focal} for name, focal in (("a", 800), ("b", 900))]
    path = write(tmp_path, {**shared, "frames": frames})
    check_is_the_sample(load_camera(f"{path}#a.jpg"))
    assert load_camera(f"{path}#b.jpg").fx == 900


def test_nerfstudio_pixels(tmp_path: Path) -> None:
    """Centres of its pixels are at (0.5, 0.5)."""
    x = directions()
    across, down = brown_image(x, -0.28, 0.074, 0.01, 0.0002, 1e-5)
    camera = load_camera(write(tmp_path, {**NERFSTUDIO, "cx": 509.25, "k3": 0.01}))
    check_pixels(camera, x, 800 * across + 509.25 - 0.5, 810 * down + 384 - 0.5)
    lens = {"k1": 0.01, "k2": -0.02, "k3": 0.003, "k4": -0.001}
    across, down = fisheye_image(x, *lens.values())
    mark: dict
    for mark in (
        {"camera_model": "OPENCV_FISHEYE"},
        {"camera_model": None, "is_fisheye": True},
    ):  # the second: instant-ngp
        camera = load_camera(write(tmp_path, {**NERFSTUDIO, **lens, "p1": 0, "p2": 0, **mark}))
        check_pixels(camera, x, 800 * across + 512 - 0.5, 810 * down + 384 - 0.5)


def test_nerfstudio_terms_we_lack_are_refused(tmp_path: Path) -> None:
    assert "k4 = 0.1" in refusal(write(tmp_path, {**NERFSTUDIO, "k4": 0.1}))
    assert "'EQUIRECTANGULAR'" in refusal(write(tmp_path, {**NERFSTUDIO, "camera_model": "EQUIRECTANGULAR"}))


def test_camera_angle_x_is_the_field_of_view_in_radians(tmp_path: Path) -> None:
    x = directions(widest=0.3)
    focal = 0.5 * 800 / math.tan(0.5 * NERF["camera_angle_x"])
    check_pixels(load_camera(write(tmp_path, NERF)), x, focal * x[:, 0] + 399.5, focal * x[:, 1] + 399.5)
    synthetic = {key: value for key, value in NERF.items() if key not in ("w", "h")}
    camera = load_camera(write(tmp_path, synthetic), size=(400, 400))
    assert camera.fx == pytest.approx(focal / 2)
    both = {**NERF, "camera_angle_y": 0.6}
    assert load_camera(write(tmp_path, both)).fy == pytest.approx(400 / math.tan(0.3))


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"camera_angle_x": 39.6}, "in radians"),
        ({"camera_angle_x": 0}, "in radians"),
        ({"fl_x": 555.6}, "contradict each other"),  # that of images of half the size
        ({"k1": 0.1, "camera_model": "OPENCV", "coeffs": [1]}, "'coeffs' is not understood"),
    ],
)
def test_camera_angle_refusals(tmp_path: Path, keys: dict, words: str) -> None:
    assert words in refusal(write(tmp_path, {**NERF, **keys}))
