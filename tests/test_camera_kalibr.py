"""Kalibr and EuRoC cameras."""

from pathlib import Path

import pytest
from camera_factory import EUROC_SENSOR, KALIBR, check_is_the_sample, refusal, write

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
