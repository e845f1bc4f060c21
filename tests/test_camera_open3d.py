"""Open3D cameras."""

from pathlib import Path

import pytest
from camera_factory import OPEN3D, check_pixels, directions, refusal, write

from slopecli.io.cameras import load_camera

PARAMETERS = {"class_name": "PinholeCameraParameters", "extrinsic": [1.0] * 16, "version_major": 1, "version_minor": 0}


@pytest.mark.parametrize("tree", [OPEN3D, {**PARAMETERS, "intrinsic": OPEN3D}], ids=["intrinsic", "parameters"])
def test_open3d_lists_its_matrix_by_columns(tmp_path: Path, tree: dict) -> None:
    x = directions()
    camera = load_camera(write(tmp_path, tree))
    check_pixels(camera, x, 800 * x[:, 0] + 511.5, 810 * x[:, 1] + 383.5)
    assert camera.source == "Open3D"


def test_a_matrix_by_rows_is_refused_where_open3d_says_its_name(tmp_path: Path) -> None:
    by_rows = {**OPEN3D, "intrinsic_matrix": [800, 0, 511.5, 0, 810, 383.5, 0, 0, 1]}
    assert "row by row" in refusal(write(tmp_path, {**by_rows, "class_name": "PinholeCameraIntrinsic"}))
    assert "row by row" in refusal(write(tmp_path, {**PARAMETERS, "intrinsic": by_rows}))
    assert load_camera(write(tmp_path, by_rows)).source.startswith("OpenCV")  # other programs list it so


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"intrinsic_matrix": [800, 5, 0, 0, 810, 0, 511.5, 383.5, 1]}, "not an intrinsic matrix"),
        ({"dist_coeffs": [0.1, 0, 0, 0]}, "'dist_coeffs' is not understood"),
        ({"height": None}, "height is None"),
    ],
)
def test_open3d_refusals(tmp_path: Path, keys: dict, words: str) -> None:
    assert words in refusal(write(tmp_path, {**OPEN3D, **keys}))
