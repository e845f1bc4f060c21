"""COLMAP cameras."""

import struct
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from camera_factory import (
    BROWN,
    COLMAP_TEXT,
    brown_image,
    check_is_the_sample,
    check_pixels,
    directions,
    fisheye_image,
    refusal,
    write,
)

from slopecli.batch import find_pairs
from slopecli.errors import InputError
from slopecli.geometry import rays_from_pixels
from slopecli.io import load_image
from slopecli.io.cameras import camera_for, colmap, load_camera
from slopecli.options import CameraChoice
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
    ("model", "numbers", "fy", "image_of", "lens"),
    [
        ("SIMPLE_PINHOLE", "500 512.5 384.25", 500, brown_image, ()),
        ("PINHOLE", "500 510 512.5 384.25", 510, brown_image, ()),
        ("SIMPLE_RADIAL", "500 512.5 384.25 -0.1", 500, brown_image, (-0.1,)),
        ("RADIAL", "500 512.5 384.25 -0.1 0.02", 500, brown_image, (-0.1, 0.02)),
        ("OPENCV", "500 510 512.5 384.25 -0.1 0.02 3e-4 -2e-4", 510, brown_image, (-0.1, 0.02, 0, 3e-4, -2e-4)),
        (
            "FULL_OPENCV",
            "500 510 512.5 384.25 -0.1 0.02 3e-4 -2e-4 0.01 0.12 0.03 0.005",
            510,
            brown_image,
            (-0.1, 0.02, 0.01, 3e-4, -2e-4, 0.12, 0.03, 0.005),
        ),
        (
            "OPENCV_FISHEYE",
            "500 510 512.5 384.25 0.01 -0.02 3e-3 -1e-3",
            510,
            fisheye_image,
            (0.01, -0.02, 3e-3, -1e-3),
        ),
        ("SIMPLE_RADIAL_FISHEYE", "500 512.5 384.25 0.01", 500, fisheye_image, (0.01,)),
        ("RADIAL_FISHEYE", "500 512.5 384.25 0.01 -0.02", 500, fisheye_image, (0.01, -0.02)),
    ],
)
def test_colmap_pixels_are_those_of_the_models_formula(
    tmp_path: Path, model: str, numbers: str, fy: float, image_of: Callable[..., tuple], lens: tuple
) -> None:
    """Centres of COLMAP's pixels are at (0.5, 0.5)."""
    x = directions()
    across, down = image_of(x, *lens)
    ours = "fisheye" if image_of is fisheye_image else "brown" if lens else "pinhole"
    text = write(tmp_path, f"1 {model} 1024 768 {numbers}\n")
    values = [float(word) for word in numbers.split()]
    identity = list(colmap.MODELS).index(model)
    record = struct.pack(f"<QIiQQ{len(values)}d", 1, 1, identity, 1024, 768, *values)
    for path in (text, write(tmp_path, record, "cameras.bin")):
        camera = load_camera(path)
        assert camera.model == ours
        check_pixels(camera, x, 500 * across + 512.5 - 0.5, fy * down + 384.25 - 0.5)


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


# ---- images.txt and images.bin beside the file ----

IMAGES = {"left/0001.png": 7, "right/0001.png": 1, "a day, 2.png": 7}
POSE = "1 0 0 0 0.1 -2e-3 3"


def image_list(images: dict[str, int]) -> str:
    """images.txt: of every other image, no point was seen."""
    lines = ["# Image list with two lines of data per image:"]
    for number, (name, camera) in enumerate(images.items(), 11):
        lines += [f"{number} {POSE} {camera} {name}", "" if number % 2 else "12 34 5 640.5 3.25 -1"]
    return "\n".join(lines) + "\n"


def image_records(images: dict[str, int]) -> bytes:
    """images.bin with the same."""
    data = struct.pack("<Q", len(images))
    for number, (name, camera) in enumerate(images.items(), 11):
        data += struct.pack("<I7dI", number, *map(float, POSE.split()), camera) + name.encode() + b"\0"
        points = number % 2
        data += struct.pack("<Q", points) + struct.pack("<ddQ", 1.0, 2.0, 3) * points
    return data


def pair_in(folder: Path) -> Path:
    for name in IMAGES:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(folder / name), np.zeros((480, 640), np.uint8))
    return folder


@pytest.mark.parametrize("binary", [False, True])
def test_the_list_of_images_picks_the_camera_and_it_is_said(tmp_path: Path, binary: bool) -> None:
    path = write(tmp_path, COLMAP_TEXT.replace("1024 768", "1280 960"), "cameras.txt")
    (tmp_path / ("images.bin" if binary else "images.txt")).write_bytes(
        image_records(IMAGES) if binary else image_list(IMAGES).encode()
    )
    folder = pair_in(tmp_path / "photographs")
    for name, number in IMAGES.items():
        camera, notes = camera_for(load_image(folder / name), CameraChoice(file=str(path)))
        assert camera.fx == (500 if number == 7 else 400)  # that of camera 1 is for images of twice the size
        assert f"of its 2 cameras, {number} is that of" in notes[0]
    with pytest.raises(InputError, match="images called so of 2 cameras; pick one"):
        camera_for(replace(load_image(folder / "a day, 2.png"), path="0001.png"), CameraChoice(file=str(path)))
    with pytest.raises(InputError, match="holds 2 cameras"):
        camera_for(replace(load_image(folder / "a day, 2.png"), path="0002.png"), CameraChoice(file=str(path)))


@pytest.mark.parametrize("damage", [lambda data: data[:-3], lambda data: b"\xff" * 90, lambda data: b""])
def test_a_damaged_list_of_images_picks_nothing(tmp_path: Path, damage: Callable[[bytes], bytes]) -> None:
    path = write(tmp_path, COLMAP_TEXT, "cameras.txt")
    (tmp_path / "images.bin").write_bytes(damage(image_records(IMAGES)))
    image = load_image(pair_in(tmp_path) / "left/0001.png")
    with pytest.raises(InputError, match="holds 2 cameras"):
        camera_for(image, CameraChoice(file=str(path)))


def test_a_batch_gives_every_image_the_camera_of_the_list(tmp_path: Path) -> None:
    folder = tmp_path / "flight"
    folder.mkdir()
    write(folder, COLMAP_TEXT, "cameras.txt")
    (folder / "images.txt").write_text(image_list({"a.png": 7, "b.png": 1}))
    for name in ("a.png", "b.png"):
        cv2.imwrite(str(folder / name), np.zeros((48, 64), np.uint8))
    found = find_pairs(str(folder))
    assert [(pair.camera1, pair.camera2) for pair in found.pairs] == [
        tuple(CameraChoice(file=f"{folder / 'cameras.txt'}#{number}") for number in (7, 1))
    ]
    assert any("each image has that of its name" in note for note in found.notes)
