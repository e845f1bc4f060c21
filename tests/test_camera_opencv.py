"""Cameras saved by OpenCV or NumPy."""

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from camera_factory import (
    BROWN,
    MATRIX,
    OPENCV_STEREO,
    OPENCV_YAML,
    K,
    brown_image,
    check_is_the_sample,
    check_pixels,
    directions,
    fisheye_image,
    refusal,
    write,
)

from slopecli.errors import InputError
from slopecli.io.cameras import load_camera
from slopecli.types import Camera


@pytest.mark.parametrize("suffix", ["yml", "xml", "json"])
def test_what_opencv_writes_is_read(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"camera.{suffix}"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("image_width", 1024)
    storage.write("image_height", 768)
    storage.write("camera_matrix", np.array(MATRIX))
    storage.write("distortion_coefficients", np.array([*BROWN, 0.0]).reshape(5, 1))
    storage.release()
    check_is_the_sample(load_camera(path))


@pytest.mark.parametrize(
    ("mark", "coefficients", "image_of", "lens"),
    [
        (0, [-0.28, 0.074, 2e-4, 1e-5], brown_image, (-0.28, 0.074, 0, 2e-4, 1e-5)),
        (0, [-0.28, 0.074, 2e-4, 1e-5, 0.01], brown_image, (-0.28, 0.074, 0.01, 2e-4, 1e-5)),
        (
            0,
            [-0.1, 0.02, 3e-4, -2e-4, 0.01, 0.12, 0.03, 0.005, 0, 0, 0, 0],
            brown_image,
            (-0.1, 0.02, 0.01, 3e-4, -2e-4, 0.12, 0.03, 0.005),
        ),
        (1, [0.01, -0.02, 3e-3, -1e-3], fisheye_image, (0.01, -0.02, 3e-3, -1e-3)),
    ],
    ids=["4", "5", "12", "fisheye"],
)
def test_opencv_pixels(
    tmp_path: Path, mark: int, coefficients: list[float], image_of: Callable[..., tuple], lens: tuple[float, ...]
) -> None:
    path, x = tmp_path / "camera.yml", directions()
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("image_width", 1024)
    storage.write("image_height", 768)
    storage.write("fisheye_model", mark)
    storage.write("camera_matrix", np.array(MATRIX))
    storage.write("distortion_coefficients", np.array([coefficients]))
    storage.release()
    across, down = image_of(x, *lens)
    check_pixels(load_camera(path), x, 800 * across + 511.5, 810 * down + 383.5)


@pytest.mark.parametrize(
    ("matrix", "lens"),
    [
        ("camera_matrix", "distortion_coefficients"),
        ("cameraMatrix", "distCoeffs"),
        ("Camera_Matrix", "Distortion_Coefficients"),
        ("camera_matrix", "dist_coeff"),
        ("K", "D"),
        ("mtx", "dist"),
        ("intrinsic_matrix", "distortion_coeffs"),
    ],
)
def test_names_people_give_opencv_matrices(tmp_path: Path, matrix: str, lens: str) -> None:
    tree = {matrix: MATRIX, lens: [list(BROWN)], "image_size": [1024, 768], "rms": 0.2}
    check_is_the_sample(load_camera(write(tmp_path, tree)))


BY_NAME = {
    "intrinsics": {"fx": 800, "fy": 810, "cx": 511.5, "cy": 383.5},
    "distortion": {"k1": BROWN[0], "k2": BROWN[1], "p1": BROWN[2], "p2": BROWN[3], "k3": 0},
    "width": 1024,
    "height": 768,
}


@pytest.mark.parametrize("folder", ["", "cameras", "left"])
def test_numbers_each_by_its_name_below_a_matrix_and_a_lens(tmp_path: Path, folder: str) -> None:
    check_is_the_sample(load_camera(write(tmp_path, {folder: {"a": BY_NAME}} if folder == "cameras" else
                                          {folder: BY_NAME} if folder else BY_NAME)))  # fmt: skip


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"intrinsics": {**BY_NAME["intrinsics"], "k1": 0.1}}, "intrinsics holds 'k1'"),
        ({"intrinsics": {**BY_NAME["intrinsics"], "dist_coeffs": [0.1]}}, "intrinsics holds 'dist_coeffs'"),
        ({"intrinsics": {**BY_NAME["intrinsics"], "skew": 2}}, "skew 2"),
        ({"distortion": {"k1": 0.1, "radial": [0.1, 0.2]}}, "distortion holds 'radial'"),
        ({"distortion": {"k1": 0.1, "k4": 0.1}}, "none of OpenCV's lenses"),
        ({"distortion": {"k1": 0.1, "model": 4}}, "needed the name of a lens model"),
        ({"k1": 0.1}, "'k1' stands alone"),
    ],
)
def test_names_that_are_not_read_are_refused(tmp_path: Path, changes: dict, words: str) -> None:
    assert words in refusal(write(tmp_path, {**BY_NAME, **changes}))


def test_opencv_without_size_takes_the_images(tmp_path: Path) -> None:
    path = write(tmp_path, {"camera_matrix": MATRIX, "dist_coeffs": list(BROWN)})
    check_is_the_sample(load_camera(path, size=(1024, 768)))
    assert "gives no image size" in refusal(path)


def test_a_matrix_alone_is_a_pinhole_and_says_so(tmp_path: Path) -> None:
    camera = load_camera(write(tmp_path, {"camera_matrix": MATRIX}), size=(1024, 768))
    assert camera == Camera(1024, 768, *K, source="OpenCV, no distortion given")


def test_opencv_fisheye(tmp_path: Path) -> None:
    text = OPENCV_YAML.replace("fisheye_model: 0", "fisheye_model: 1").replace(", 0. ]\navg", " ]\navg")
    camera = load_camera(write(tmp_path, text.replace("rows: 5", "rows: 4")))
    assert (camera.model, camera.distortion) == ("fisheye", BROWN)


def test_opencv_stereo_file_needs_a_choice(tmp_path: Path) -> None:
    path = write(tmp_path, OPENCV_STEREO)
    said = "holds 2 cameras (1, 2); pick one: add its name to that of the file, for example camera#1"
    assert said in refusal(path, size=(1024, 768))
    check_is_the_sample(load_camera(f"{path}#1", size=(1024, 768)))
    assert load_camera(path, name="2", size=(1024, 768)) == Camera(1024, 768, 900, 900, 500, 380, source="OpenCV")
    assert "no camera '3'" in refusal(f"{path}#3", size=(1024, 768))


def test_rational_and_longer_coefficients(tmp_path: Path) -> None:
    tree = {"K": MATRIX, "D": [5.3, 3.2, 0.0, 0.0, 0.2, 5.6, 4.8, 0.9], "image_size": [1024, 768]}
    assert load_camera(write(tmp_path, tree)).distortion == tuple(tree["D"])
    assert load_camera(write(tmp_path, {**tree, "D": [*tree["D"], 0, 0, 0, 0, 0, 0]})).distortion == tuple(tree["D"])
    assert "thin prism" in refusal(write(tmp_path, {**tree, "D": [*tree["D"], 0.1, 0, 0, 0]}))


@pytest.mark.parametrize(
    ("extra", "words"),
    [
        ({"xi": 1.2}, "omnidirectional camera (xi)"),
        ({"distorsion": [0.1, 0, 0, 0]}, "'distorsion' is not understood"),
        ({"radial_distortion": [0.1, 0]}, "'radial_distortion' is not understood"),
        ({"k1": 0.1}, "'k1' stands alone"),
        ({"model": "double_sphere"}, "'double_sphere' is not supported"),
        ({"dist": [0.1, 0.2, 0.3]}, "found 3 distortion coefficients"),
        ({"dist": [0, 0, 0, 0], "D": [0, 0, 0, 0]}, "both 'dist' and 'D'"),
        ({"dist": {"rows": 1, "cols": 5, "data": [0, 0, 0, 0]}}, "has 4 numbers"),
        ({"image_size": [1024]}, "needed width and height"),
    ],
)
def test_opencv_refusals(tmp_path: Path, extra: dict, words: str) -> None:
    tree = {"camera_matrix": MATRIX, "image_width": 1024, "image_height": 768, **extra}
    assert words in refusal(write(tmp_path, tree))


def test_numpy_archive(tmp_path: Path) -> None:
    path = tmp_path / "calib.npz"
    np.savez(path, mtx=np.array(MATRIX), dist=np.array([BROWN]), rvecs=np.array([1, "a"], dtype=object))
    check_is_the_sample(load_camera(path, size=(1024, 768)))
    assert "damaged zip" in refusal(write(tmp_path, path.read_bytes()[:200], "cut.npz"))


OPENCV_ND = """<?xml version="1.0"?>
<opencv_storage>
<cameraMatrix type_id="opencv-matrix">
  <rows>3</rows><cols>3</cols><dt>d</dt><data>800. 0. 511.5 0. 810. 383.5 0. 0. 1.</data></cameraMatrix>
<distCoeffs type_id="opencv-nd-matrix">
  <sizes>
    5</sizes>
  <dt>d</dt><data>-0.28 7.4e-02 2.0e-04 1e-05 0.</data></distCoeffs>
</opencv_storage>
"""


def test_opencv_xml_with_coefficients_in_an_array_of_one_dimension(tmp_path: Path) -> None:
    (tmp_path / "nd.xml").write_text(OPENCV_ND)
    assert load_camera(tmp_path / "nd.xml", size=(1024, 768)).distortion == pytest.approx((*BROWN, 0))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("    5</sizes>", "    4</sizes>", "distCoeffs has 5 numbers, needed sizes = 4"),
        ("<data>-0.28 7.4e-02 2.0e-04 1e-05 0.</data>", "", "distCoeffs holds sizes, dt"),
        ("distCoeffs", "coeffs", "'coeffs' is not understood"),
        ("distCoeffs", "distCoeffs2", "'distCoeffs2' belongs to no matrix"),
    ],
)
def test_opencv_coefficients_not_understood_are_refused(tmp_path: Path, old: str, new: str, words: str) -> None:
    (tmp_path / "nd.xml").write_text(OPENCV_ND.replace(old, new))
    with pytest.raises(InputError, match=words):
        load_camera(tmp_path / "nd.xml", size=(1024, 768))


def test_opencv_coefficients_as_text_are_refused(tmp_path: Path) -> None:
    (tmp_path / "camera.json").write_text(json.dumps({"camera_matrix": MATRIX, "distCoeffs": "-0.28 0.07 0 0"}))
    with pytest.raises(InputError, match=r"distCoeffs is .* needed a number"):
        load_camera(tmp_path / "camera.json", size=(1024, 768))


def test_pickled_coefficients_of_a_numpy_archive_are_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "camera.npz", mtx=np.array(MATRIX), dist=np.array([None, 0.1], dtype=object))
    with pytest.raises(InputError, match="dist is 'a pickled object'"):
        load_camera(tmp_path / "camera.npz", size=(1024, 768))
