"""Middlebury cameras."""

from pathlib import Path

import pytest
from camera_factory import MIDDLEBURY, check_pixels, directions, refusal, write

from slopecli.io.cameras import decode_camera, load_camera


@pytest.mark.parametrize(("name", "cx"), [("cam0", 1176.728), ("cam1", 1307.839)])
def test_middlebury_matrices(tmp_path: Path, name: str, cx: float) -> None:
    x = directions(widest=0.2)
    camera = load_camera(f"{write(tmp_path, MIDDLEBURY)}#{name}")
    check_pixels(camera, x, 3997.684 * x[:, 0] + cx, 3997.684 * x[:, 1] + 1011.728)
    assert (camera.width, camera.height, camera.model) == (2964, 1988, "pinhole")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("doffs=131.111", "doffs=-131.111", "are the cameras exchanged"),
        ("doffs=131.111", "doffs=65.5555", "of another size"),
        ("0 0 1]\ncam1", "0 0]\ncam1", "8 numbers"),
        ("width=2964\n", "", "width"),
        ("doffs", "width=5\ndoffs", "'width' twice"),
        (
            "cam0=[3997.684 0 1176.728; 0 3997.684 1011.728; 0 0 1]",
            "cam0=[3997 0 0; 0 3997 0; 1176 1011 1]",
            "transposed",
        ),
    ],
)
def test_middlebury_refusals(tmp_path: Path, old: str, new: str, words: str) -> None:
    assert words in refusal(f"{write(tmp_path, MIDDLEBURY.replace(old, new))}#cam0")


def test_middlebury_needs_a_choice(tmp_path: Path) -> None:
    assert "holds 2 cameras (cam0, cam1)" in refusal(write(tmp_path, MIDDLEBURY))


@pytest.mark.parametrize(("image", "cx"), [("Piano/im0.png", 1176.728), ("Piano/im1.png", 1307.839)])
def test_the_images_of_the_data_set_find_their_cameras(image: str, cx: float) -> None:
    camera = decode_camera(MIDDLEBURY.encode(), "calib.txt", image=image)
    assert camera.cx == cx
    assert f"is that of {image}" in camera.note
