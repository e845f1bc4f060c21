"""Matrices alone: K.txt, K.npy."""

import io
from pathlib import Path

import numpy as np
import pytest
from camera_factory import BARE_MATRIX, MATRIX, check_pixels, directions, refusal, write

from slopecli.io.cameras import load_camera

SIZE = (1024, 768)


def array_file(array: object) -> bytes:
    file = io.BytesIO()
    np.save(file, np.asarray(array))
    return file.getvalue()


FOUR = np.eye(4)
FOUR[:3, :3] = MATRIX
FORMS = {
    "text": BARE_MATRIX,
    "commas": BARE_MATRIX.replace(" ", ", "),
    "brackets": "# K\n[[800, 0, 511.5],\n [0, 810, 383.5],\n [0, 0, 1]]",
    "numpy's text": "8.0e+02 0.0e+00 5.115e+02\n0.0e+00 8.1e+02 3.835e+02\n0.0e+00 0.0e+00 1.0e+00\n",
    "one line": "800 0 511.5 0 810 383.5 0 0 1",
    "4x4": "800 0 511.5 0\n0 810 383.5 0\n0 0 1 0\n0 0 0 1\n",
    "npy": array_file(MATRIX),
    "npy-float32-4x4": array_file(FOUR.astype(np.float32)),
}


@pytest.mark.parametrize("content", FORMS.values(), ids=FORMS)
def test_a_matrix_is_a_camera_without_distortion(tmp_path: Path, content: str | bytes) -> None:
    x = directions()
    camera = load_camera(write(tmp_path, content), size=SIZE)
    check_pixels(camera, x, 800 * x[:, 0] + 511.5, 810 * x[:, 1] + 383.5)
    assert "no distortion given" in camera.source
    assert "no image size" in camera.note


def test_skew_of_a_matrix_is_kept(tmp_path: Path) -> None:
    x = directions()
    camera = load_camera(write(tmp_path, "800 2.5 511.5\n0 810 383.5\n0 0 1\n"), size=SIZE)
    check_pixels(camera, x, 800 * x[:, 0] + 2.5 * x[:, 1] + 511.5, 810 * x[:, 1] + 383.5)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("800 0 0\n0 810 0\n511.5 383.5 1\n", "transposed"),
        ("1 0 0\n0 1 0\n0 0 1\n", "identity"),
        ("0 0 0\n0 0 0\n0 0 0\n", "all zero"),
        ("800 0 511.5 -40\n0 810 383.5 0\n0 0 1 0\n", "is a projection"),
        ("0.8 0 0.5\n0 0.8 0.5\n0 0 1\n", "field of view"),
        ("800 0 2000\n0 810 383.5\n0 0 1\n", "outside the image"),
        ("nan 0 511\n0 810 383\n0 0 1\n", "no camera"),
        (array_file(np.zeros((5, 5))), "camera that is understood"),
        (array_file(np.array(["x"])), "camera that is understood"),
        (array_file(MATRIX)[:90], "damaged NumPy array"),
        (b"\x93NUMPY", "damaged NumPy array"),
    ],
)
def test_what_is_no_intrinsic_matrix(tmp_path: Path, content: str | bytes, words: str) -> None:
    assert words in refusal(write(tmp_path, content), size=SIZE)
