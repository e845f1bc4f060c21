"""Autoware cameras."""

from pathlib import Path

import pytest
from camera_factory import AUTOWARE, brown_image, check_pixels, directions, fisheye_image, refusal, write

from slopecli.io.cameras import load_camera


def test_autoware_pixels(tmp_path: Path) -> None:
    x = directions()
    across, down = brown_image(x, -0.28, 0.074, 0.0, 0.0002, 1e-5)
    check_pixels(load_camera(write(tmp_path, AUTOWARE)), x, 800 * across + 511.5, 810 * down + 383.5)
    fisheye = (
        AUTOWARE.replace("plumb_bob", "equidistant").replace("cols: 5", "cols: 4").replace("1e-05, 0. ]", "1e-05 ]")
    )
    across, down = fisheye_image(x, -0.28, 0.074, 0.0002, 1e-5)
    check_pixels(load_camera(write(tmp_path, fisheye)), x, 800 * across + 511.5, 810 * down + 383.5)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("DistCoeff", "Dist_Coeff_", "'Dist_Coeff_' is not understood"),
        ("DistCoeff", "Coefficients", "'Coefficients' is not understood"),
        ("plumb_bob", "omnidirectional", "'omnidirectional' is not supported"),
        ("[ 1024, 768 ]", "[ 1024 ]", "ImageSize has 1 numbers"),
        ("800., 0., 511.5, 0., 810., 383.5, 0., 0., 1.", "800., 0., 0., 0., 810., 0., 511.5, 383.5, 1.", "transposed"),
    ],
)
def test_autoware_refusals(tmp_path: Path, old: str, new: str, words: str) -> None:
    assert words in refusal(write(tmp_path, AUTOWARE.replace(old, new)))


def test_autoware_without_distortion_is_refused(tmp_path: Path) -> None:
    start, end = AUTOWARE.index("DistCoeff"), AUTOWARE.index("ImageSize")
    assert "DistCoeff, the distortion that belongs" in refusal(write(tmp_path, AUTOWARE[:start] + AUTOWARE[end:]))
