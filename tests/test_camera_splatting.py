"""Cameras of 3D Gaussian splatting."""

import json
from pathlib import Path

import pytest
from camera_factory import SPLATTING, check_pixels, directions, refusal, write

from slopecli.io.cameras import decode_camera, load_camera

ROWS = json.loads(SPLATTING)


def test_the_principal_point_is_the_middle_and_it_is_said(tmp_path: Path) -> None:
    """Half of the image's width from its edge, half a pixel less from the centre of the first pixel."""
    x = directions()
    camera = load_camera(write(tmp_path, SPLATTING))
    check_pixels(camera, x, 800.25 * x[:, 0] + 512 - 0.5, 810.5 * x[:, 1] + 384 - 0.5)
    assert "middle of the image" in camera.note


def test_cameras_are_called_as_their_images() -> None:
    data = json.dumps([ROWS[0], {**ROWS[1], "fx": 900}]).encode()
    assert decode_camera(data, "cameras.json", image="x/00001.png").fx == 900
    assert decode_camera(data, "cameras.json", "00000").fx == 800.25


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"cx": 500}, "cx or cy is given"),
        ({"k1_distortion": 0.1}, "'k1_distortion' is not understood"),
        ({"fx": 0.8}, "field of view"),
        ({"width": 0}, "whole number"),
    ],
)
def test_splatting_refusals(tmp_path: Path, keys: dict, words: str) -> None:
    assert words in refusal(f"{write(tmp_path, json.dumps([{**ROWS[0], **keys}]))}#00000")
    assert "twice" in refusal(write(tmp_path, json.dumps([ROWS[0], ROWS[0]])))
