"""CamOdoCal and VINS cameras."""

from pathlib import Path

import pytest
from camera_factory import (
    CAMODOCAL,
    KANNALA_BRANDT,
    brown_image,
    check_pixels,
    directions,
    fisheye_image,
    refusal,
    write,
)

from slopecli.io.cameras import load_camera


def test_kannala_brandt_counts_its_coefficients_from_2(tmp_path: Path) -> None:
    x = directions(widest=1.0)
    camera = load_camera(write(tmp_path, KANNALA_BRANDT))
    across, down = fisheye_image(x, -0.0076, 0.0425, -0.0404, 0.0075)
    check_pixels(camera, x, 286.1 * across + 420.4, 286.3 * down + 401.9)
    assert (camera.model, camera.source) == ("fisheye", "CamOdoCal")


def test_camodocal_pinholes(tmp_path: Path) -> None:
    x = directions()
    across, down = brown_image(x, -0.28, 0.074, 0, 0.0002, 1e-5)
    check_pixels(load_camera(write(tmp_path, CAMODOCAL)), x, 800 * across + 511.5, 810 * down + 383.5)
    full = CAMODOCAL.replace("PINHOLE", "PINHOLE_FULL").replace(
        "   p1:", "   k3: 0.01\n   k4: 0.12\n   k5: 0.03\n   k6: 0.005\n   p1:"
    )
    across, down = brown_image(x, -0.28, 0.074, 0.01, 0.0002, 1e-5, 0.12, 0.03, 0.005)
    check_pixels(load_camera(write(tmp_path, full)), x, 800 * across + 511.5, 810 * down + 383.5)


@pytest.mark.parametrize(
    ("text", "old", "new", "words"),
    [
        (
            KANNALA_BRANDT,
            "k2: -0.0076\n   k3: 0.0425\n   k4: -0.0404\n   k5",
            "k1: -0.0076\n   k2: 0.04\n   k3: -0.04\n   k4",
            "k5",
        ),
        (CAMODOCAL, "PINHOLE", "MEI", "mirror"),
        (CAMODOCAL, "PINHOLE", "SCARAMUZZA", "'SCARAMUZZA' is not supported"),
        (CAMODOCAL, "p1: 2.0e-04", "k3: 0.1\n   p1: 2.0e-04", "'k3' is not a parameter"),
        (CAMODOCAL, "   p2: 1e-05\n", "", "p2 is missing"),
        (CAMODOCAL, "fx: 800.", "fx: 0.8", "field of view"),
        (CAMODOCAL, "distortion_parameters:", "distortion_parameters: 5\nother:", "needed names with values"),
    ],
)
def test_camodocal_refusals(tmp_path: Path, text: str, old: str, new: str, words: str) -> None:
    assert old in text
    assert words in refusal(write(tmp_path, text.replace(old, new)))
