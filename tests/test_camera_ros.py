"""ROS camera_info."""

from collections.abc import Callable
from pathlib import Path

import pytest
from camera_factory import (
    ROS2_ECHO,
    ROS_FILE,
    brown_image,
    check_is_the_sample,
    check_pixels,
    directions,
    fisheye_image,
    refusal,
    write,
)

from slopecli.io.cameras import load_camera

PLUMB_BOB = "distortion_model: plumb_bob\nd: [-0.28, 0.074, 0.0002, 1.0e-05, 0.0]"


@pytest.mark.parametrize(
    ("model", "d", "image_of", "lens"),
    [
        ("plumb_bob", "[-0.28, 0.074, 0.0002, 1e-05, 0.01]", brown_image, (-0.28, 0.074, 0.01, 0.0002, 1e-5)),
        (
            "rational_polynomial",
            "[5.3, 3.2, 0.0003, -0.0002, 0.2, 5.6, 4.8, 0.9]",
            brown_image,
            (5.3, 3.2, 0.2, 0.0003, -0.0002, 5.6, 4.8, 0.9),
        ),
        ("equidistant", "[0.01, -0.02, 0.003, -0.001]", fisheye_image, (0.01, -0.02, 0.003, -0.001)),
        ("''", "[]", brown_image, ()),
    ],
)
def test_ros_pixels(
    tmp_path: Path, model: str, d: str, image_of: Callable[..., tuple], lens: tuple[float, ...]
) -> None:
    """K and D of the raw image; P, that of the rectified one, would put them elsewhere."""
    x = directions()
    across, down = image_of(x, *lens)
    text = ROS2_ECHO.replace(PLUMB_BOB, f"distortion_model: {model}\nd: {d}")
    assert model in text
    check_pixels(load_camera(write(tmp_path, text)), x, 800 * across + 511.5, 810 * down + 383.5)


def test_ros_unknown_model_is_refused_by_name(tmp_path: Path) -> None:
    assert "'thin_prism' is not supported" in refusal(write(tmp_path, ROS_FILE.replace("plumb_bob", "thin_prism")))


def test_a_slip_in_the_name_of_a_model_is_told(tmp_path: Path) -> None:
    told = refusal(write(tmp_path, ROS_FILE.replace("plumb_bob", "plumb_bobb")))
    assert "did you mean 'plumb_bob'?" in told
    assert "mean" not in refusal(write(tmp_path, ROS_FILE.replace("plumb_bob", "inverse_brown_conrady")))
    assert "mean" not in refusal(write(tmp_path, ROS_FILE.replace("plumb_bob", "fisheye62")))


def test_ros_model_without_its_coefficients_is_refused(tmp_path: Path) -> None:
    assert "is missing" in refusal(write(tmp_path, ROS2_ECHO.replace("\nd:", "\nsomething:")))


def test_ros_camera_name_picks(tmp_path: Path) -> None:
    path = write(tmp_path, ROS_FILE)
    check_is_the_sample(load_camera(f"{path}#nadir"))
    assert "no camera 'left'; it holds nadir" in refusal(f"{path}#left")


def test_ros_binning_and_region_of_interest(tmp_path: Path) -> None:
    text = ROS2_ECHO.replace("binning_x: 0", "binning_x: 2").replace("binning_y: 0", "binning_y: 2")
    text = text.replace(
        "{x_offset: 0, y_offset: 0, height: 0, width: 0", "{x_offset: 112, y_offset: 84, height: 600, width: 800"
    )
    camera = load_camera(write(tmp_path, text))
    assert (camera.width, camera.height) == (400, 300)
    # two pixels become one, whose centre is between theirs
    x = directions()
    across, down = brown_image(x, -0.28, 0.074, 0, 0.0002, 1e-5)
    check_pixels(camera, x, (800 * across + 511.5 - 112 - 0.5) / 2, (810 * down + 383.5 - 84 - 0.5) / 2)


def test_uncalibrated_ros_camera(tmp_path: Path) -> None:
    text = ROS2_ECHO.replace("[800.0, 0.0, 511.5, 0.0, 810.0, 383.5, 0.0, 0.0, 1.0]", "[0, 0, 0, 0, 0, 0, 0, 0, 1]")
    assert "not calibrated" in refusal(write(tmp_path, text))
