"""Cameras from files by path and name, from numbers, and fitted to an image."""

from pathlib import Path

import pytest
from camera_factory import NATIVE, K, check_is_the_sample, refusal, write

from slopecli.errors import InputError
from slopecli.io.cameras import camera_from_fov, camera_from_intrinsics, fit_camera_to_image, load_camera
from slopecli.types import Camera


def test_paths_that_cannot_be_read(tmp_path: Path) -> None:
    assert "no such camera file" in refusal(tmp_path / "none.json")
    assert "no such camera file" in refusal(f"{tmp_path / 'none.json'}#cam0")
    assert "is a folder" in refusal(tmp_path)
    assert "not a regular file" in refusal("/dev/zero")
    assert "cannot be read" in refusal(tmp_path / ("x" * 5000))


def test_a_hash_in_a_file_name_is_no_choice(tmp_path: Path) -> None:
    check_is_the_sample(load_camera(write(tmp_path, NATIVE, "rig#2.json")))


def test_a_name_for_a_nameless_camera(tmp_path: Path) -> None:
    assert "without a name; leave the name out" in refusal(f"{write(tmp_path, NATIVE)}#cam0")


def test_from_intrinsics() -> None:
    assert camera_from_intrinsics(K, 1024, 768) == Camera(1024, 768, *K)
    with pytest.raises(InputError, match="negative"):
        camera_from_intrinsics((-1, 1, 1, 1), 1024, 768)


@pytest.mark.parametrize(("which", "extent"), [("h", 1024), ("v", 768), ("d", 1280)])
def test_from_field_of_view(which: str, extent: float) -> None:
    camera = camera_from_fov(90, 1024, 768, which)
    assert camera.fx == camera.fy == pytest.approx(extent / 2)
    assert (camera.cx, camera.cy) == (511.5, 383.5)
    assert camera.source == "field of view"


@pytest.mark.parametrize("deg", [0, -5, 180, 400, float("nan")])
def test_impossible_field_of_view(deg: float) -> None:
    with pytest.raises(InputError, match="field of view"):
        camera_from_fov(deg, 1024, 768)


def test_the_same_size_is_left_alone() -> None:
    camera = Camera(1024, 768, *K)
    assert fit_camera_to_image(camera, 1024, 768) == (camera, None)


@pytest.mark.parametrize(("width", "height"), [(512, 384), (2048, 1536), (683, 512), (300, 225), (1000, 750)])
def test_a_resized_image_scales_the_camera(width: int, height: int) -> None:
    camera, message = fit_camera_to_image(Camera(1024, 768, *K), width, height)
    assert (camera.width, camera.height) == (width, height)
    assert (camera.cx, camera.cy) == pytest.approx(((width - 1) / 2, (height - 1) / 2))
    assert camera.fx == pytest.approx(800 * width / 1024)
    assert message is not None
    assert f"{width}x{height}" in message
    assert "1024x768" in message


@pytest.mark.parametrize(("width", "height"), [(1024, 767), (1024, 700), (1000, 768), (640, 640), (1920, 1080)])
def test_a_cropped_image_is_refused(width: int, height: int) -> None:
    with pytest.raises(InputError, match=rf"1024x768 px.*{width}x{height} px"):
        fit_camera_to_image(Camera(1024, 768, *K), width, height)


@pytest.mark.parametrize(("width", "height"), [(768, 1024), (384, 512)])
def test_a_turned_image_is_refused_with_a_hint(width: int, height: int) -> None:
    with pytest.raises(InputError, match="EXIF orientation"):
        fit_camera_to_image(Camera(1024, 768, *K), width, height)


def test_a_folder_of_images_is_not_calibrated(tmp_path: Path) -> None:
    message = refusal(tmp_path)
    assert "calibrateCamera" in message
    assert "Kalibr" in message
