"""KITTI cameras."""

from pathlib import Path

import pytest
from camera_factory import KITTI_ODOMETRY, KITTI_RAW, brown_image, check_pixels, directions, refusal, write

from slopecli.io.cameras import decode_camera, load_camera


def test_kitti_rectified_images_have_the_first_columns_of_p(tmp_path: Path) -> None:
    """P X of a point seen from the camera itself, which is beside camera 0."""
    x = directions()
    camera = load_camera(f"{write(tmp_path, KITTI_ODOMETRY)}#P2", size=(1241, 376))
    check_pixels(camera, x, 718.856 * x[:, 0] + 607.1928, 718.856 * x[:, 1] + 185.2157)
    assert load_camera(tmp_path / "camera", size=(1241, 376)).fx == 718.856  # both are the same


def test_kitti_recorded_images_have_k_and_d(tmp_path: Path) -> None:
    x = directions()
    path = write(tmp_path, KITTI_RAW)
    camera = load_camera(f"{path}#K_00")
    across, down = brown_image(x, -0.28, 0.074, 0.0, 0.0002, 1e-5)
    check_pixels(camera, x, 800 * across + 511.5, 810 * down + 383.5)
    assert (camera.width, camera.height) == (1024, 768)
    rectified = load_camera(f"{path}#P_rect_00")
    assert (rectified.width, rectified.height, rectified.fx, rectified.model) == (1000, 700, 720, "pinhole")


def test_kitti_recorded_and_rectified_images_are_never_taken_for_each_other(tmp_path: Path) -> None:
    assert "holds 2 cameras (K_00, P_rect_00)" in refusal(write(tmp_path, KITTI_RAW))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("D_00:", "E_00:", "D_00, the distortion that belongs to K_00, is missing"),
        ("S_00: 1.024000e+03 7.680000e+02", "S_00: 1024", "a size has 1 numbers"),
        ("K_00: 8.000000e+02 0.000000e+00", "K_00: 8.000000e+02", "8 numbers, needed a 3x3"),
        ("K_00: 8.000000e+02 0.000000e+00", "K_00: 8.000000e+02 5", "skew"),
        ("K_00: 8.000000e+02", "K_00: big", "needed a number"),
        ("calib_time", "K_00: 1 2 3\ncalib_time", "'K_00' twice"),
    ],
)
def test_kitti_refusals(tmp_path: Path, old: str, new: str, words: str) -> None:
    assert words in refusal(f"{write(tmp_path, KITTI_RAW.replace(old, new))}#K_00")


def test_the_folder_of_an_image_finds_its_camera() -> None:
    differing = KITTI_ODOMETRY.replace("P2: 7.188560e+02", "P2: 7.180000e+02").encode()
    for folder, focal in (("image_2", 718), ("image_0", 718.856)):
        image = f"05/{folder}/000017.png"
        assert decode_camera(differing, "calib.txt", size=(1241, 376), image=image).fx == focal
