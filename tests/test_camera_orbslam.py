"""Settings of ORB-SLAM and stella_vslam."""

from pathlib import Path

import pytest
from camera_factory import (
    ORBSLAM,
    ORBSLAM_STEREO,
    brown_image,
    check_is_the_sample,
    check_pixels,
    directions,
    fisheye_image,
    refusal,
    write,
)

from slopecli.io.cameras import load_camera

RECTIFIED = """%YAML:1.0
Camera.fx: 435.2
Camera.fy: 435.2
Camera.cx: 367.45
Camera.cy: 252.2
Camera.k1: 0.0
Camera.k2: 0.0
Camera.p1: 0.0
Camera.p2: 0.0
Camera.width: 752
Camera.height: 480
LEFT.height: 480
LEFT.width: 752
LEFT.D: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data: [-0.28, 0.074, 0.0002, 1.76e-05, 0.0]
LEFT.K: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [458.654, 0.0, 367.215, 0.0, 457.296, 248.375, 0.0, 0.0, 1.0]
"""


def test_orbslam_pinhole(tmp_path: Path) -> None:
    x = directions()
    camera = load_camera(write(tmp_path, ORBSLAM + "Camera.k3: 0.01\n"))
    across, down = brown_image(x, -0.28, 0.074, 0.01, 0.0002, 1e-5)
    check_pixels(camera, x, 800 * across + 511.5, 810 * down + 383.5)


def test_orbslam_stereo_fisheye(tmp_path: Path) -> None:
    x = directions(widest=1.5)
    camera = load_camera(f"{write(tmp_path, ORBSLAM_STEREO)}#Camera2")
    across, down = fisheye_image(x, 0.0040, 0.0001, -0.0018, 0.0003)
    check_pixels(camera, x, 190.44 * across + 252.59, 190.43 * down + 254.91)
    assert (camera.width, camera.height) == (512, 512)


def test_cameras_of_rectified_and_of_recorded_images_need_a_choice(tmp_path: Path) -> None:
    path = write(tmp_path, RECTIFIED)
    assert "holds 2 cameras (Camera, LEFT)" in refusal(path)
    assert load_camera(f"{path}#Camera").model == "pinhole"
    x = directions()
    across, down = brown_image(x, -0.28, 0.074, 0, 0.0002, 1.76e-5)
    check_pixels(load_camera(f"{path}#LEFT"), x, 458.654 * across + 367.215, 457.296 * down + 248.375)


def test_names_without_a_space_after_the_colon_are_read_as_opencv_does(tmp_path: Path) -> None:
    """As in the settings for stereo that ORB-SLAM comes with, which YAML does not allow."""
    tight = RECTIFIED.replace("data: [-0.28", "data:[-0.28").replace("LEFT.width: ", "LEFT.width:")
    assert tight.count(":[") == 1
    camera = load_camera(f"{write(tmp_path, tight)}#LEFT")
    assert camera == load_camera(f"{write(tmp_path, RECTIFIED, 'usual')}#LEFT")
    assert (camera.width, camera.distortion[0]) == (752, -0.28)
    assert "YAML" in refusal(write(tmp_path, tight.removeprefix("%YAML:1.0\n")))


RECTIFIER = """
Camera:
  model: perspective
  fx: 435.2
  fy: 435.2
  cx: 367.45
  cy: 252.2
  cols: 752
  rows: 480
StereoRectifier:
  model: fisheye
  K_left: [458.654, 0.0, 367.215, 0.0, 457.296, 248.375, 0.0, 0.0, 1.0]
  D_left: [0.0034, 0.0007, -0.0020, 0.0002]
  K_right: [457.587, 0.0, 379.999, 0.0, 456.134, 255.238, 0.0, 0.0, 1.0]
  D_right: [0.0040, 0.0001, -0.0018, 0.0003]
"""


@pytest.mark.parametrize("dotted", [False, True])
def test_cameras_before_stella_vslam_rectifies_need_a_choice(tmp_path: Path, dotted: bool) -> None:
    text, x = RECTIFIER, directions(widest=1.0)
    if dotted:  # as its files were before
        for name in ("Camera", "StereoRectifier"):
            block = text.partition(f"\n{name}:\n")[2]
            block = (
                "".join(line for line in block.splitlines(True) if line.startswith("  "))
                if name != "Camera"
                else (block.partition("StereoRectifier")[0])
            )
            text = text.replace(f"{name}:\n{block}", block.replace("  ", f"{name}."))
        assert "StereoRectifier.K_left: [458" in text
    path = write(tmp_path, text)
    assert "holds 3 cameras (Camera, K_left, K_right)" in refusal(path)
    across, down = fisheye_image(x, 0.0040, 0.0001, -0.0018, 0.0003)
    camera = load_camera(f"{path}#K_right")
    check_pixels(camera, x, 457.587 * across + 379.999, 456.134 * down + 255.238)
    assert (camera.width, camera.height) == (752, 480)
    assert load_camera(f"{path}#Camera").model == "pinhole"
    missing = write(tmp_path, RECTIFIER.replace("D_left", "other"), "missing")
    assert "D, the distortion that belongs to K, is missing" in refusal(f"{missing}#K_left")


def test_stella_vslam_has_them_below_camera(tmp_path: Path) -> None:
    lines = [
        "Camera:",
        *(f"  {line.removeprefix('Camera.')}" for line in ORBSLAM.splitlines() if line.startswith("Cam")),
    ]
    text = (
        "\n".join(lines)
        .replace('type: "PinHole"', 'model: "perspective"')
        .replace("width", "cols")
        .replace("height", "rows")
    )
    check_is_the_sample(load_camera(write(tmp_path, text)))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('"PinHole"', '"KannalaBrandt8"', "p1 is not a coefficient of a KannalaBrandt8 camera"),
        ('"PinHole"', '"Rectified"', "k1 is not a coefficient of a Rectified camera"),
        ('"PinHole"', '"equirectangular"', "'equirectangular' is not supported"),
        ('"PinHole"', '"radial_division"', "'radial_division' is not supported"),
        ("Camera.cy: 383.5\n", "", "Camera.cy is missing"),
        ('Camera.type: "PinHole"\n', "Camera.k3: 0.1\nCamera.k4: 0.1\n", None),
    ],
)
def test_orbslam_refusals(tmp_path: Path, old: str, new: str, words: str | None) -> None:
    text = ORBSLAM.replace(old, new)
    if words is None:  # four coefficients without a word of which
        text, words = text.replace("Camera.p1: 0.0002\nCamera.p2: 1.0e-05\n", ""), "PinHole or KannalaBrandt8"
    assert words in refusal(write(tmp_path, text))
