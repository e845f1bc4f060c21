"""COLMAP cameras."""

import struct
from pathlib import Path

import numpy as np
import pytest
from camera_factory import (
    BROWN,
    COLMAP_TEXT,
    check_is_the_sample,
    check_pixels,
    directions,
    fisheye_image,
    refusal,
    write,
)

from slopecli.geometry import rays_from_pixels
from slopecli.io.cameras import load_camera
from slopecli.types import Camera


def test_colmap_text(tmp_path: Path) -> None:
    path = write(tmp_path, COLMAP_TEXT)
    camera = load_camera(f"{path}#1")
    check_is_the_sample(camera)
    assert camera.source == "COLMAP"
    other = load_camera(path, name="7")
    assert other == Camera(640, 480, 500, 500, 319.5, 239.5, "brown", (0.1,) + (0.0,) * 7, source="COLMAP")
    assert "holds 2 cameras (1, 7)" in refusal(path)


def test_colmap_binary(tmp_path: Path) -> None:
    first = struct.pack("<IiQQ8d", 1, 4, 1024, 768, 800, 810, 512, 384, *BROWN)
    second = struct.pack("<IiQQ3d", 2, 0, 640, 480, 500, 320, 240)
    path = write(tmp_path, struct.pack("<Q", 2) + first + second, "cameras.bin")
    check_is_the_sample(load_camera(f"{path}#1"))
    assert load_camera(f"{path}#2") == Camera(640, 480, 500, 500, 319.5, 239.5, source="COLMAP")
    assert "binary" in refusal(write(tmp_path, path.read_bytes()[:-4], "cut.bin"))


def test_half_a_pixel_between_colmap_and_us(tmp_path: Path) -> None:
    camera = load_camera(write(tmp_path, "1 SIMPLE_PINHOLE 4 2 10 2 1\n"))
    assert (camera.cx, camera.cy) == (1.5, 0.5)  # the middle of a 4x2 image with pixel centres at integers


@pytest.mark.parametrize(
    ("line", "model", "distortion"),
    [
        ("1 PINHOLE 640 480 500 510 320 240", "pinhole", ()),
        ("1 RADIAL 640 480 500 320 240 0.1 0.2", "brown", (0.1, 0.2, 0, 0, 0, 0, 0, 0)),
        ("1 FULL_OPENCV 640 480 500 510 320 240 1 2 3 4 5 6 7 8", "brown", (1, 2, 3, 4, 5, 6, 7, 8)),
        ("1 OPENCV_FISHEYE 640 480 500 510 320 240 1 2 3 4", "fisheye", (1, 2, 3, 4)),
        ("1 SIMPLE_RADIAL_FISHEYE 640 480 500 320 240 0.1", "fisheye", (0.1, 0, 0, 0)),
        ("1 RADIAL_FISHEYE 640 480 500 320 240 0.1 0.2", "fisheye", (0.1, 0.2, 0, 0)),
    ],
)
def test_colmap_models(tmp_path: Path, line: str, model: str, distortion: tuple) -> None:
    camera = load_camera(write(tmp_path, line + "\n"))
    assert (camera.model, camera.distortion) == (model, distortion)
    assert (camera.fx, camera.cx, camera.cy) == (500, 319.5, 239.5)


def test_fisheye_models_of_colmap_4_and_their_ids(tmp_path: Path) -> None:
    x = directions(widest=1.0)
    across, down = fisheye_image(x)
    text = "1 SIMPLE_FISHEYE 1024 768 500 512.5 384.25\n2 FISHEYE 1024 768 500 510 512.5 384.25\n"
    simple = struct.pack("<IiQQ3d", 1, 14, 1024, 768, 500, 512.5, 384.25)
    both = struct.pack("<IiQQ4d", 2, 15, 1024, 768, 500, 510, 512.5, 384.25)
    others = struct.pack("<IiQQ5d", 3, 13, 1024, 768, 500, 510, 512, 384, -0.1)
    for path in (write(tmp_path, text), write(tmp_path, struct.pack("<Q", 3) + simple + both + others, "cameras.bin")):
        check_pixels(load_camera(f"{path}#1"), x, 500 * across + 512.5 - 0.5, 500 * down + 384.25 - 0.5)
        check_pixels(load_camera(f"{path}#2"), x, 500 * across + 512.5 - 0.5, 510 * down + 384.25 - 0.5)
    assert load_camera(tmp_path / "cameras.bin", name="3").model == "division"


@pytest.mark.parametrize("k", [-0.3, -0.05, 0.1])
def test_division_models_of_colmap_4(tmp_path: Path, k: float) -> None:
    """The ray of (x_d, y_d) is along (x_d, y_d, 1 + k r_d^2)."""
    text = f"1 SIMPLE_DIVISION 1024 768 500 512.5 384.25 {k}\n2 DIVISION 1024 768 500 510 512.5 384.25 {k}\n"
    simple = struct.pack("<IiQQ4d", 1, 12, 1024, 768, 500, 512.5, 384.25, k)
    both = struct.pack("<IiQQ5d", 2, 13, 1024, 768, 500, 510, 512.5, 384.25, k)
    distorted = directions(widest=0.9)
    rays = distorted / (1 + k * (distorted**2).sum(axis=1, keepdims=True))
    for path in (write(tmp_path, text), write(tmp_path, struct.pack("<Q", 2) + simple + both, "cameras.bin")):
        for name, fy in (("1", 500), ("2", 510)):
            u, v = 500 * distorted[:, 0] + 512.5 - 0.5, fy * distorted[:, 1] + 384.25 - 0.5
            check_pixels(load_camera(f"{path}#{name}"), rays, u, v)


def test_a_division_lens_ends_where_its_image_turns_back(tmp_path: Path) -> None:
    camera = load_camera(write(tmp_path, "1 SIMPLE_DIVISION 1000 1000 500 500 500 1.0\n"))
    seen = np.isfinite(
        rays_from_pixels(camera, np.array([[499.5, 499.5], [990.0, 499.5], [1000.5, 499.5], [1200, 499.5]]))
    )
    assert seen.all(axis=1).tolist() == [True, True, False, False]
    ideal = load_camera(write(tmp_path, "1 SIMPLE_DIVISION 1000 1000 500 500 500 0\n"))
    assert (ideal.model, ideal.distortion) == ("pinhole", ())


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("1 FOV 640 480 500 510 320 240 0.9", "COLMAP model FOV is not supported"),
        ("1 THIN_PRISM_FISHEYE 640 480 1 2 3 4 5 6 7 8 9 10 11 12", "THIN_PRISM_FISHEYE is not supported"),
        ("1 SIMPLE_DIVISION 640 480 500 500 320 240 -0.1", "has 5 parameters, needed 4"),
        ("1 DIVISION 640 480 500 320 240 -0.1", "has 4 parameters, needed 5"),
        ("1 DIVISION 640 480 500 500 320 240 inf", "finite"),
        ("1 EUCM 640 480 500 500 320 240 0.6 1.1", "EUCM is not supported"),
        ("1 EQUIRECTANGULAR 640 480 640 480", "EQUIRECTANGULAR is not supported"),
        ("1 SIMPLE_FISHEYE 640 480 500 510 320 240", "has 4 parameters, needed 3"),
        ("1 BRAND_NEW 640 480 1 2 3", "COLMAP model BRAND_NEW is not supported"),
        ("1 PINHOLE 640 480 500 320 240", "has 3 parameters, needed 4"),
        ("1 PINHOLE 640 480 500 510 320 nan", "finite"),
    ],
)
def test_colmap_refusals(tmp_path: Path, line: str, words: str) -> None:
    assert words in refusal(write(tmp_path, line + "\n"))
