"""RealSense cameras."""

from pathlib import Path

import pytest
from camera_factory import REALSENSE, brown_image, check_pixels, directions, fisheye_image, refusal, write

from slopecli.io.cameras import load_camera


@pytest.mark.parametrize("model", ["distortion.brown_conrady", "Brown Conrady", "RS2_DISTORTION_BROWN_CONRADY", 4])
def test_realsense_pixels(tmp_path: Path, model: str | int) -> None:
    x = directions()
    across, down = brown_image(x, -0.28, 0.074, 0.0, 0.0002, 1e-5)
    camera = load_camera(write(tmp_path, {**REALSENSE, "model": model}))
    check_pixels(camera, x, 800 * across + 511.5, 810 * down + 383.5)


def test_realsense_fisheye(tmp_path: Path) -> None:
    x = directions(widest=1.0)
    tree = {
        **REALSENSE,
        "fx": 286,
        "fy": 287,
        "model": "Kannala Brandt4",
        "coeffs": [-0.0076, 0.0425, -0.04, 0.0075, 0],
    }
    across, down = fisheye_image(x, -0.0076, 0.0425, -0.04, 0.0075)
    check_pixels(load_camera(write(tmp_path, tree)), x, 286 * across + 511.5, 287 * down + 383.5)


@pytest.mark.parametrize("model", ["distortion.inverse_brown_conrady", "modified_brown_conrady", "None", "ftheta"])
def test_coefficients_of_zero_are_none(tmp_path: Path, model: str) -> None:
    camera = load_camera(write(tmp_path, {**REALSENSE, "model": model, "coeffs": [0.0] * 5}))
    assert (camera.model, camera.source) == ("pinhole", "RealSense")


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"model": "distortion.inverse_brown_conrady"}, "in opposite directions"),
        ({"model": "modified_brown_conrady"}, "has coefficients that are not 0"),
        ({"model": "F-Theta"}, "has coefficients that are not 0"),
        ({"model": "none"}, "pinhole without distortion"),
        ({"model": "other"}, "'other' is not known"),
        ({"model": "kannala_brandt4", "coeffs": [0.1, 0, 0, 0, 0.1]}, "takes four and zeros"),
        ({"coeffs": None}, "contradict"),
        ({"ppx": "left"}, "ppx is 'left'"),
        ({"distortion_coefficients": [0.1]}, "'distortion_coefficients' is not understood"),
    ],
)
def test_realsense_refusals(tmp_path: Path, keys: dict, words: str) -> None:
    tree = {**REALSENSE, **keys}
    if keys == {"coeffs": None}:
        del tree["coeffs"]
        words = "coeffs, the distortion, is missing"
    assert words in refusal(write(tmp_path, tree))
