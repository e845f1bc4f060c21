"""AliceVision and Meshroom cameras."""

from pathlib import Path

import pytest
from camera_factory import ALICEVISION, brown_image, check_pixels, directions, fisheye_image, refusal, write

from slopecli.io.cameras import load_camera

NEW = ALICEVISION["intrinsics"][0]
OLD = {
    **{key: NEW[key] for key in ("intrinsicId", "width", "height", "serialNumber")},
    "type": "radial3",
    "pxFocalLength": "800",
    "principalPoint": ["511.5", "383.5"],
    "distortionParams": ["-0.28", "0.074", "0.001"],
}


def sfm(version: str, camera: dict, **changed: object) -> dict:
    return {"version": version.split("."), "intrinsics": [{**camera, **changed}]}


@pytest.mark.parametrize(
    ("tree", "focal"),
    [
        (sfm("1.0.0", OLD), (800, 800)),
        (sfm("1.2.0", OLD, pxFocalLength=["800", "810"]), (800, 810)),
        (sfm("1.2.1", OLD, pxFocalLength=["800", "810"], principalPoint=["-0.5", "-0.5"]), (800, 810)),
        # the ratio of the focal lengths before 1.2.5, of the pixels since
        (
            sfm("1.2.4", NEW, pixelRatio=str(800 / 810), type="radial3", distortionParams=OLD["distortionParams"]),
            (800, 810),
        ),
        (sfm("1.2.8", NEW, distortionType="radialk3", distortionParams=OLD["distortionParams"]), (800, 810)),
        (
            sfm(
                "1.2.8",
                NEW,
                principalPoint={"x": -0.5, "y": -0.5},
                distortionType="radialk3",
                distortionParams=[-0.28, 0.074, 0.001],
            ),
            (800, 810),
        ),
    ],
    ids=["1.0.0", "1.2.0", "1.2.1", "1.2.4", "1.2.8", "1.2.8-xy"],
)
def test_numbers_mean_what_the_version_says(tmp_path: Path, tree: dict, focal: tuple[float, float]) -> None:
    x = directions()
    across, down = brown_image(x, -0.28, 0.074, 0.001, 0, 0)
    check_pixels(load_camera(write(tmp_path, tree)), x, focal[0] * across + 511.5, focal[1] * down + 383.5)


def test_alicevision_brown_and_without_distortion(tmp_path: Path) -> None:
    """Five coefficients: radial, then tangential ones; (w/2, h/2) is the middle, and pixel centres at integers."""
    x = directions()
    camera = load_camera(write(tmp_path, sfm("1.2.8", NEW, principalPoint=["3", "-2"])))
    across, down = brown_image(x, -0.28, 0.074, 0, 0.0002, 1e-5)
    check_pixels(camera, x, 800 * across + 512 + 3, 810 * down + 384 - 2)
    plain = sfm("1.2.8", NEW, distortionType="none", distortionParams="")
    check_pixels(load_camera(write(tmp_path, plain)), x, 800 * x[:, 0] + 511.5, 810 * x[:, 1] + 383.5)


def test_alicevision_fisheye(tmp_path: Path) -> None:
    x = directions()
    across, down = fisheye_image(x, 0.01, -0.02, 0.003, 0.0)
    tree = sfm("1.0.0", OLD, type="fisheye4", distortionParams=["0.01", "-0.02", "0.003", "0"])
    check_pixels(load_camera(write(tmp_path, tree)), x, 800 * across + 511.5, 800 * down + 383.5)


@pytest.mark.parametrize(
    ("tree", "words"),
    [
        ({"intrinsics": [OLD]}, "version is missing"),
        (sfm("1.0.0", NEW), "pxFocalLength is None"),  # millimetres under the version of pixels
        (sfm("1.2.8", OLD), "focalLength is None"),
        (sfm("1.0.0", OLD, type="3deradial4"), "'3deradial4' is not supported"),
        (sfm("1.0.0", OLD, type="equidistant_r3"), "'equidistant_r3' is not supported"),
        (sfm("1.2.8", NEW, distortionType="radialk3pt"), "'radialk3pt' is not supported"),
        (sfm("1.2.8", NEW, undistortionParams=["0.1", "0"]), "undistortionParams"),
        (sfm("1.2.8", NEW, sensorWidth="-1"), "sensorWidth = -1"),
        (sfm("1.2.8", NEW, distortionParams=["0.1"]), "1 numbers"),
        (sfm("1.0.0", OLD, type="pinhole"), "without distortion"),
        (sfm("1.2.8", NEW, principalPoint=["511.5", "383.5"]), "version 1.2.8 measure it from there"),
        (sfm("1.0.0", OLD, principalPoint=["-0.5", "-0.5"]), "version 1.0.0 measure it from a corner"),
    ],
)
def test_alicevision_refusals(tmp_path: Path, tree: dict, words: str) -> None:
    assert words in refusal(write(tmp_path, tree))
