"""The native camera file."""

from collections.abc import Callable
from pathlib import Path

import pytest
from camera_factory import (
    MATRIX,
    NATIVE,
    K,
    brown_image,
    check_is_the_sample,
    check_pixels,
    directions,
    fisheye_image,
    refusal,
    write,
)

from slopecli.io.cameras import load_camera
from slopecli.types import Camera


def test_native_with_matrix_and_null_distortion(tmp_path: Path) -> None:
    for distortion in (None, [], [0, 0, 0, 0, 0]):
        tree = {"width": 1024, "height": 768, "K": MATRIX, "distortion": distortion}
        camera = load_camera(write(tmp_path, tree))
        assert camera == Camera(1024, 768, *K, source="native")


@pytest.mark.parametrize("count", range(1, 9))
def test_native_distortion_of_any_length_is_padded_with_zeros(tmp_path: Path, count: int) -> None:
    given = [0.01 * (i + 1) for i in range(count)]
    camera = load_camera(write(tmp_path, {**NATIVE, "distortion": given}))
    assert camera.distortion[:count] == tuple(given)
    assert not any(camera.distortion[count:])


def test_native_fisheye(tmp_path: Path) -> None:
    camera = load_camera(write(tmp_path, {**NATIVE, "model": "fisheye", "distortion": [0.1, 0.2]}))
    assert (camera.model, camera.distortion) == ("fisheye", (0.1, 0.2, 0.0, 0.0))


@pytest.mark.parametrize(
    ("model", "distortion", "image_of", "lens"),
    [
        (None, [], brown_image, ()),
        ("brown", [-0.28, 0.074, 2e-4, 1e-5, 0.01], brown_image, (-0.28, 0.074, 0.01, 2e-4, 1e-5)),
        (
            "brown",
            [-0.1, 0.02, 3e-4, -2e-4, 0.01, 0.12, 0.03, 0.005],
            brown_image,
            (-0.1, 0.02, 0.01, 3e-4, -2e-4, 0.12, 0.03, 0.005),
        ),
        ("fisheye", [0.01, -0.02, 3e-3, -1e-3], fisheye_image, (0.01, -0.02, 3e-3, -1e-3)),
    ],
)
def test_native_pixels(
    tmp_path: Path, model: str | None, distortion: list, image_of: Callable[..., tuple], lens: tuple
) -> None:
    x = directions()
    across, down = image_of(x, *lens)
    tree = {**NATIVE, "distortion": distortion, **({"model": model} if model else {})}
    check_pixels(load_camera(write(tmp_path, tree)), x, 800 * across + 511.5, 810 * down + 383.5)


PLAIN = {key: value for key, value in NATIVE.items() if key != "distortion"}


@pytest.mark.parametrize(
    ("named", "image_of", "lens"),
    [
        ({"k1": -0.28, "k2": 0.074, "p1": 2e-4, "p2": 1e-5, "k3": 0.01}, brown_image, (-0.28, 0.074, 0.01, 2e-4, 1e-5)),
        ({"k1": -0.1}, brown_image, (-0.1,)),
        ({"k1": -0.1, "k4": 0}, brown_image, (-0.1,)),
        (
            {"k1": -0.1, "k2": 0.02, "k3": 0.01, "k4": 0.12, "k5": 0.03, "k6": 0.005, "p1": 3e-4, "p2": -2e-4},
            brown_image,
            (-0.1, 0.02, 0.01, 3e-4, -2e-4, 0.12, 0.03, 0.005),
        ),
        (
            {"k1": 0.01, "k2": -0.02, "k3": 3e-3, "k4": -1e-3, "model": "fisheye"},
            fisheye_image,
            (0.01, -0.02, 3e-3, -1e-3),
        ),
    ],
)
def test_coefficients_under_names_of_their_own(
    tmp_path: Path, named: dict, image_of: Callable[..., tuple], lens: tuple
) -> None:
    x = directions()
    across, down = image_of(x, *lens)
    check_pixels(load_camera(write(tmp_path, {**PLAIN, **named})), x, 800 * across + 511.5, 810 * down + 383.5)


@pytest.mark.parametrize(
    ("named", "words"),
    [
        ({"k1": 0.01, "k2": -0.02, "k3": 3e-3, "k4": -1e-3}, "of a fisheye lens add"),
        ({"k1": -0.1, "p1": 0, "p2": 0, "k4": 0.1, "model": "brown"}, "none of OpenCV's lenses"),
        ({"k1": 0.01, "p1": 1e-4, "model": "fisheye"}, "p1 = 0.0001"),
        ({"k1": 0.01, "model": "division"}, "list its coefficients as distortion"),
        ({"k1": "x"}, "needed a number"),
        ({"k7": 0.1}, "unknown key 'k7'"),
    ],
)
def test_named_coefficients_of_which_programs_differ(tmp_path: Path, named: dict, words: str) -> None:
    assert words in refusal(write(tmp_path, {**PLAIN, **named}))


def test_native_fisheye_without_coefficients_is_no_pinhole(tmp_path: Path) -> None:
    assert load_camera(write(tmp_path, {**NATIVE, "model": "fisheye", "distortion": None})).model == "fisheye"


def test_our_own_output_is_read_back(tmp_path: Path) -> None:
    tree = {**NATIVE, "model": "brown", "source": "OpenCV"}
    check_is_the_sample(load_camera(write(tmp_path, tree)))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"distorsion": [0.1]}, "unknown key 'distorsion'"),
        ({"k1": 0.1}, "both distortion and k1 are given"),
        ({"K1": 0.1}, "unknown key 'K1'"),
        ({"fx": 0}, "not calibrated"),
        ({"fy": -800}, "negative"),
        ({"fx": float("nan")}, "finite"),
        ({"fx": float("inf")}, "finite"),
        ({"fx": "eight"}, "needed a number"),
        ({"fx": True}, "needed a number"),
        ({"fx": 8.8}, "not in millimetres"),
        ({"cx": 1e6}, "far outside"),
        ({"width": 0}, "whole number"),
        ({"width": 10.5}, "whole number"),
        ({"width": None}, "width is None"),
        ({"distortion": [0.1] * 12}, "thin prism or tilt"),
        ({"distortion": [0.1] * 9}, "found 9 distortion coefficients"),
        ({"distortion": ["a"]}, "needed a number"),
        ({"distortion": [[0.1], [float("nan")]]}, "finite"),
        ({"model": "omni"}, "'omni' is not supported"),
        ({"model": "eucm"}, "'eucm' is not supported"),
        ({"model": "pinhole"}, "name the lens model"),
        ({"model": "fisheye", "distortion": [0.1] * 5}, "a fisheye lens takes 4"),
        ({"K": MATRIX}, "both K and"),
    ],
)
def test_native_refusals(tmp_path: Path, change: dict, words: str) -> None:
    assert words in refusal(write(tmp_path, {**NATIVE, **change}))


def test_native_with_a_missing_number(tmp_path: Path) -> None:
    tree = {key: value for key, value in NATIVE.items() if key != "cy"}
    assert "cy is missing" in refusal(write(tmp_path, tree))


@pytest.mark.parametrize(
    ("matrix", "words"),
    [
        ([[800, 0.5, 511.5], [0, 810, 383.5], [0, 0, 1]], "skew 0.5"),
        ([[800, 0, 0], [0, 810, 0], [511.5, 383.5, 1]], "transposed"),
        ([800, 810, 511.5, 383.5], "has 4 numbers"),
    ],
)
def test_matrices_that_are_no_intrinsics(tmp_path: Path, matrix: list, words: str) -> None:
    assert words in refusal(write(tmp_path, {"width": 1024, "height": 768, "K": matrix}))


def test_the_documented_native_file_is_read(tmp_path: Path) -> None:
    page = (Path(__file__).parents[1] / "docs" / "cameras.md").read_text(encoding="utf-8")
    camera = load_camera(write(tmp_path, page.split("```json")[1].split("```")[0]))
    assert camera == Camera(1024, 768, 800, 800, 511.5, 383.5, "brown", (-0.28, 0.07, 0.0002, 1e-5, 0), "native")


@pytest.mark.parametrize(
    ("model", "given", "full"),
    [
        ("polynomial", [-0.1, 0.01, 0, 0, 0, 0.002], (-0.1, 0.01, 0, 0, 0, 0.002, 0)),
        ("cahvor", [1e-4, -0.1, 0.02, 0.01, -0.02, 1], (1e-4, -0.1, 0.02, 0.01, -0.02, 1, 0)),
        ("division", [-0.2], (-0.2,)),
    ],
)
def test_native_lenses_beside_opencvs(tmp_path: Path, model: str, given: list, full: tuple) -> None:
    camera = load_camera(write(tmp_path, {**NATIVE, "model": model, "distortion": given}))
    assert (camera.model, camera.distortion) == (model, full)
    assert f"takes {len(full)}" in refusal(write(tmp_path, {**NATIVE, "model": model, "distortion": [0.01] * 8}))
