"""Pix4D cameras."""

from pathlib import Path

import numpy as np
import pytest
from camera_factory import PIX4D, brown_image, check_pixels, directions, refusal, write

from slopecli.io.cameras import load_camera


def test_pix4d_pixels_are_those_of_its_formula(tmp_path: Path) -> None:
    """In mm from the upper left corner of the sensor, whose pixels' centres are half a pixel from their corners."""
    x = directions()
    camera = load_camera(write(tmp_path, PIX4D), size=(1024, 768))
    across, down = brown_image(x, -0.28, 0.074, 0.0, 0.0002, 1e-5)
    mm = np.array([10 * across + 6.4, 10 * down + 4.8])
    check_pixels(camera, x, *(mm * 1024 / 12.8 - 0.5))
    assert not camera.size_given
    assert "no image size" in camera.note


def test_pix4d_cameras_of_several_bands(tmp_path: Path) -> None:
    two = PIX4D + PIX4D.replace("file 0", "file 1").replace("F 10.0", "F 11.0")
    path = write(tmp_path, two)
    assert load_camera(f"{path}#1", size=(1024, 768)).fx == pytest.approx(880)
    assert "holds 2 cameras (0, 1)" in refusal(path, size=(1024, 768))


@pytest.mark.parametrize(
    ("old", "new", "size", "words"),
    [
        ("Px 6.4\n", "Px 512\n", (1024, 768), "in millimetres"),  # pixels in place of millimetres
        ("sensor width of 12.8x9.6mm", "", (1024, 768), "sensor's width"),
        ("K1", "C", (1024, 768), "fisheye lenses are not supported"),
        ("F 10.0\n", "", (1024, 768), "F is missing"),
        ("F 10.0", "F 10.0\nF 11.0", (1024, 768), "'F' twice"),
        ("F 10.0", "F ten", (1024, 768), "F is 'ten', needed a number"),
        ("", "", None, "no image size"),
        ("", "", (768, 1024), "neither cropped nor turned"),
        ("", "", (1024, 576), "neither cropped nor turned"),
    ],
)
def test_pix4d_refusals(tmp_path: Path, old: str, new: str, size: tuple[int, int] | None, words: str) -> None:
    assert words in refusal(write(tmp_path, PIX4D.replace(old, new)), size=size)
