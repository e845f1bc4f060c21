"""Kalibr and EuRoC cameras."""

from pathlib import Path

import pytest
from camera_factory import (
    EUROC_SENSOR,
    KALIBR,
    brown_image,
    check_is_the_sample,
    check_pixels,
    directions,
    fisheye_image,
    refusal,
    write,
)

from slopecli.io.cameras import load_camera
from slopecli.types import Camera


def test_kalibr_camchain(tmp_path: Path) -> None:
    path = write(tmp_path, KALIBR)
    check_is_the_sample(load_camera(f"{path}#cam0"))
    fisheye = load_camera(path, name="cam1")
    assert fisheye == Camera(
        752, 480, 461.5, 460.1, 356.4, 231.2, "fisheye", (-0.0016, 0.024, -0.036, 0.02), source="Kalibr"
    )
    assert "camera_model 'omni' is not supported" in refusal(f"{path}#cam2")
    assert "holds 3 cameras (cam0, cam1, cam2)" in refusal(path)


def test_kalibr_pixels(tmp_path: Path) -> None:
    """radtan is k1 k2 p1 p2, equidistant the same polynomial as OpenCV's fisheye; EuRoC writes radtan in full."""
    x, path = directions(), write(tmp_path, KALIBR)
    across, down = brown_image(x, -0.28, 0.074, 0, 0.0002, 1e-5)
    for camera in (load_camera(f"{path}#cam0"), load_camera(write(tmp_path, EUROC_SENSOR, "sensor"))):
        check_pixels(camera, x, 800 * across + 511.5, 810 * down + 383.5)
    x = directions(widest=1.0)
    across, down = fisheye_image(x, -0.0016, 0.024, -0.036, 0.02)
    check_pixels(load_camera(f"{path}#cam1"), x, 461.5 * across + 356.4, 460.1 * down + 231.2)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("radial-tangential", "fov", "'fov' is not supported"),
        ("camera_model: pinhole", "camera_model: eucm", "'eucm' is not supported"),
        ("camera_model: pinhole", "camera_model: ds", "'ds' is not supported"),
        ("[800.0, 810.0, 511.5, 383.5]", "[800.0, 810.0, 511.5]", "intrinsics has 3 numbers"),
        ("[1024, 768]", "[1024]", "resolution has 1 numbers"),
        ("distortion_coefficients", "something_else", "distortion_coeffs are missing"),
        ("1e-05", ".nan", "finite"),
    ],
)
def test_kalibr_refusals(tmp_path: Path, old: str, new: str, words: str) -> None:
    assert words in refusal(write(tmp_path, EUROC_SENSOR.replace(old, new)))


def test_a_yaml_directive_before_a_camchain_is_skipped(tmp_path: Path) -> None:
    check_is_the_sample(load_camera(f"{write(tmp_path, '%YAML:1.0' + chr(10) + KALIBR)}#cam0"))
