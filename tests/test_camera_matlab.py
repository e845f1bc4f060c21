"""Cameras of MATLAB."""

import io
from pathlib import Path

import numpy as np
import pytest
import scipy.io
from camera_factory import BOUGUET, MATLAB, brown_image, check_pixels, directions, refusal, write

from slopecli.io.cameras import load_camera

K = [[800, 0, 512.5], [0, 810, 384.5], [0, 0, 1]]
WITHOUT = {key: value for key, value in MATLAB.items() if key != "IntrinsicMatrix"}


def mat_file(compressed: bool = True, **variables: object) -> bytes:
    file = io.BytesIO()
    scipy.io.savemat(file, variables, do_compression=compressed)
    return file.getvalue()


TOOLBOX = {
    "json": MATLAB,
    "json-K": {**WITHOUT, "K": K},
    "json-intrinsics": {**WITHOUT, "FocalLength": [800, 810], "PrincipalPoint": [512.5, 384.5], "Skew": 0},
    "json-object": {
        **{key: MATLAB[key] for key in ("RadialDistortion", "TangentialDistortion")},
        "Intrinsics": {**WITHOUT, "FocalLength": [800, 810], "PrincipalPoint": [512.5, 384.5]},
    },
    "json-below": {"cameraParams": MATLAB},
    "mat": mat_file(cameraParams={key: np.array(value) for key, value in MATLAB.items() if key != "Version"}),
    "mat-fields": mat_file(False, **{key: np.array(value) for key, value in MATLAB.items() if key != "Version"}),
}


@pytest.mark.parametrize("content", TOOLBOX.values(), ids=TOOLBOX)
def test_the_toolbox_counts_pixels_from_1_and_rows_first(tmp_path: Path, content: dict | bytes) -> None:
    x = directions()
    across, down = brown_image(x, -0.28, 0.074, 0.0, 0.0002, 1e-5)
    camera = load_camera(write(tmp_path, content))
    check_pixels(camera, x, 800 * across + 512.5 - 1, 810 * down + 384.5 - 1)
    assert (camera.width, camera.height, camera.note) == (1024, 768, "")


@pytest.mark.parametrize("terms", [3, 2])
def test_skew_and_a_third_radial_term_of_the_toolbox(tmp_path: Path, terms: int) -> None:
    x = directions()
    tree = {**WITHOUT, "RadialDistortion": [-0.28, 0.074, 0.01][:terms], "K": [[800, 1.5, 512.5], *K[1:]]}
    across, down = brown_image(x, -0.28, 0.074, 0.01 * (terms == 3), 0.0002, 1e-5)
    check_pixels(load_camera(write(tmp_path, tree)), x, 800 * across + 1.5 * down + 511.5, 810 * down + 383.5)


BOUGUETS = {
    "script": BOUGUET,
    "mat": mat_file(
        fc=np.array([[800.0], [810.0]]),
        cc=np.array([[511.5], [383.5]]),
        kc=np.array([[-0.28], [0.074], [0.0002], [1e-5], [0.0]]),
        alpha_c=0.0005,
        nx=1024,
        ny=768,
        I_1=np.zeros((768, 1024)),
    ),
}


@pytest.mark.parametrize("content", BOUGUETS.values(), ids=BOUGUETS)
def test_bouguets_toolbox_counts_from_0(tmp_path: Path, content: str | bytes) -> None:
    x = directions()
    across, down = brown_image(x, -0.28, 0.074, 0.0, 0.0002, 1e-5)
    camera = load_camera(write(tmp_path, content))
    check_pixels(camera, x, 800 * (across + 0.0005 * down) + 511.5, 810 * down + 383.5)
    assert (camera.width, camera.height) == (1024, 768)


def test_two_cameras_of_bouguets_toolbox(tmp_path: Path) -> None:
    both = BOUGUET.replace("fc =", "fc_left =").replace("cc =", "cc_left =").replace("kc =", "kc_left =")
    right = both.replace("_left", "_right").replace("800.0", "900.0").replace("alpha_c", "alpha_c_right")
    both = both.replace("alpha_c", "alpha_c_left") + right.partition("nx")[0]
    path = write(tmp_path, both)
    assert load_camera(f"{path}#right").fx == 900
    assert "holds 2 cameras (left, right)" in refusal(path)


def test_a_stereo_pair_of_the_toolbox(tmp_path: Path) -> None:
    second = {**WITHOUT, "K": [[900, 0, 512.5], *K[1:]]}
    path = write(tmp_path, {"stereoParams": {"CameraParameters1": MATLAB, "CameraParameters2": second, "Version": "1"}})
    assert load_camera(f"{path}#CameraParameters2").fx == 900
    assert "holds 2 cameras (CameraParameters1, CameraParameters2)" in refusal(path)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ({**WITHOUT, "IntrinsicMatrix": K}, "not the transpose of K"),
        ({**WITHOUT, "K": np.transpose(K).tolist()}, "transposed"),
        (WITHOUT, "are missing"),
        ({**MATLAB, "RadialDistortion": [0.1]}, "needed 2 or 3 and 2"),
        ({"Intrinsics": {"MappingCoefficients": [1, 2, 3, 4], "ImageSize": [768, 1024]}}, "fisheyeParameters"),
        (BOUGUET.replace("cc =", "c ="), "cc is missing"),
        (BOUGUET.replace("fc = [ 800.0 ; 810.0 ]", "fc = [ 800.0 ]"), "needed two each"),
        (BOUGUET + "fc = [ 1 ; 2 ];\n", "'fc' twice"),
        (b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(600, b"\0"), "version 7.3"),
        (mat_file(fc=np.ones(2), cc=np.ones(2))[:200], "damaged MATLAB file"),
        (mat_file(x=np.ones(2)), "looks like a MATLAB file"),
    ],
)
def test_matlab_refusals(tmp_path: Path, content: str | dict | bytes, words: str) -> None:
    assert words in refusal(write(tmp_path, content))


def test_an_image_size_with_the_columns_first_is_told_by_the_principal_point(tmp_path: Path) -> None:
    camera = load_camera(write(tmp_path, {**MATLAB, "ImageSize": [1024, 768]}))
    assert (camera.width, camera.height) == (1024, 768)
    assert "rows first in MATLAB" in camera.note
