"""ROS camera_info."""

from pathlib import Path

import pytest
from camera_factory import ROS2_ECHO, ROS_FILE, check_is_the_sample, refusal, write

from slopecli.io.cameras import load_camera


def test_ros_models(tmp_path: Path) -> None:
    rational = ROS2_ECHO.replace("plumb_bob", "rational_polynomial").replace(
        "d: [-0.28, 0.074, 0.0002, 1.0e-05, 0.0]", "d: [5.3, 3.2, 0.0003, -0.0002, 0.2, 5.6, 4.8, 0.9]"
    )
    assert len(load_camera(write(tmp_path, rational)).distortion) == 8
    fisheye = ROS2_ECHO.replace("plumb_bob", "equidistant").replace(", 1.0e-05, 0.0]", ", 1.0e-05]")
    assert load_camera(write(tmp_path, fisheye)).model == "fisheye"
    undistorted = ROS2_ECHO.replace("plumb_bob", "''").replace("[-0.28, 0.074, 0.0002, 1.0e-05, 0.0]", "[]")
    assert load_camera(write(tmp_path, undistorted)).model == "pinhole"


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
    # the principal point is the middle of the sensor and of the region alike
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == pytest.approx((400, 405, 199.5, 149.5))


def test_uncalibrated_ros_camera(tmp_path: Path) -> None:
    text = ROS2_ECHO.replace("[800.0, 0.0, 511.5, 0.0, 810.0, 383.5, 0.0, 0.0, 1.0]", "[0, 0, 0, 0, 0, 0, 0, 0, 1]")
    assert "not calibrated" in refusal(write(tmp_path, text))
