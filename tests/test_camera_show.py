"""`slopemap camera show`: what was understood of a camera, as a user reads it."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from camera_factory import BOUGUET, KALIBR, KANNALA_BRANDT, METASHAPE, MIDDLEBURY, PDS3, PIX4D, VICAR, write
from command import slopemap
from metadata_factory import FOCAL_35, gimbal, gps_tags, photograph, xmp_packet
from PIL import Image as PilImage

from slopecli.geometry import rays_from_pixels
from slopecli.io.cameras import load_camera
from slopecli.report import camera_facts
from slopecli.types import Camera

DIVISION = "1 DIVISION 1024 768 700 710 512 384 -0.1\n"
SHOWN = {
    "pinhole": (MIDDLEBURY, "#cam0"),
    "brown": (KALIBR, "#cam0"),
    "fisheye": (KANNALA_BRANDT, ""),
    "polynomial": (BOUGUET, ""),
    "cahvor": (PDS3, ""),
    "cahvore": (VICAR, ""),
    "division": (DIVISION, ""),
}


def test_numbers_of_a_camera_are_right() -> None:
    """A camera of 800 px over 1000x500 px, its principal point 10 px right of the middle."""
    facts = camera_facts(Camera(1000, 500, 800, 800, 509.5, 249.5, "brown", (-0.1,)))
    assert facts.focal_widths == pytest.approx(0.8)
    assert facts.offset_px == pytest.approx((10, 0))
    plain = camera_facts(Camera(1000, 500, 800, 800, 509.5, 249.5))
    wide = np.degrees(np.arctan(510 / 800) + np.arctan(490 / 800))
    assert plain.horizontal_deg == pytest.approx(wide)
    assert plain.vertical_deg == pytest.approx(2 * np.degrees(np.arctan(250 / np.hypot(800, 10))))
    assert plain.corner_shift_px == ((0, 0),) * 4
    x = rays_from_pixels(facts.camera, np.array([[0.0, 0.0]]))[0]
    inward = np.array([0.0, 0.0]) - (800 * x + (509.5, 249.5))  # towards the centre, by -k1 r^3 f
    assert facts.corner_shift_px[0] == pytest.approx(inward)
    assert np.hypot(*inward) == pytest.approx(0.1 * np.hypot(*x) ** 3 * 800, rel=1e-9)
    assert facts.coefficients[0] == ("k1", -0.1)


@pytest.mark.parametrize(("content", "picked"), SHOWN.values(), ids=SHOWN)
def test_the_native_file_is_the_same_camera(tmp_path: Path, content: str, picked: str) -> None:
    path = f"{write(tmp_path, content)}{picked}"
    done = slopemap("camera", "show", path, "-o", str(tmp_path / "out"))
    assert (done.returncode, "wrote" in done.stderr) == (0, True)
    ours, native = load_camera(path), load_camera(tmp_path / "out" / "camera.json")
    for name in ("width", "height", "fx", "fy", "cx", "cy", "model", "distortion"):
        assert getattr(ours, name) == getattr(native, name)
    picture = cv2.imread(str(tmp_path / "out" / "camera.png"))
    assert picture.shape[1] >= 1200
    assert picture.std() > 5


def test_what_is_said_of_a_camera(tmp_path: Path) -> None:
    done = slopemap("camera", "show", f"{write(tmp_path, KALIBR)}#cam0")
    said = " ".join(done.stdout.split())
    for words in (
        "format Kalibr",
        "image 1024x768 px",
        "field of view 72.67° wide, 53.89° high",
        "focal length 800 x 810 px",
        "principal point 511.5, 383.5 px, in the middle of the image",
        "k1 -0.28, k2 0.074",
        "upper left 167.3 px at 45.1°",
    ):
        assert words in said
    converted = slopemap("camera", "show", str(write(tmp_path, METASHAPE))).stdout
    assert "half a pixel; p1 and p2 change places; cx and cy from the middle" in converted


def test_what_has_no_rays_is_said(tmp_path: Path) -> None:
    said = " ".join(slopemap("camera", "show", str(write(tmp_path, KANNALA_BRANDT))).stdout.split())
    assert "172.3° high; no rays at the left or right edge and the corners" in said
    assert "no corner has a ray" in said
    assert "with rays 67.5 % of the image" in said


def test_json_has_the_numbers(tmp_path: Path) -> None:
    done = slopemap("camera", "show", str(write(tmp_path, KANNALA_BRANDT)), "--json")
    shown = json.loads(done.stdout)
    assert shown["camera"]["model"] == "fisheye"
    assert shown["coefficients"]["k1"] == -0.0076
    assert len(shown["corner_deg"]) == 4
    assert shown["diagonal_deg"] is None or shown["diagonal_deg"] > 150


def test_several_cameras_are_listed(tmp_path: Path) -> None:
    done = slopemap("camera", "show", str(write(tmp_path, KALIBR)))
    lines = done.stdout.splitlines()
    assert [line.split()[0] for line in lines] == ["camera", "cam0", "cam1", "cam2"]
    assert "'omni' is not supported" in lines[3]
    assert "#cam0" in done.stderr
    for option in (["-o", str(tmp_path / "out")], ["--json"]):
        picked = slopemap("camera", "show", str(tmp_path / "camera"), *option)
        assert (picked.returncode, picked.stdout) == (1, "")
        assert "holds 3 cameras" in picked.stderr
    assert not (tmp_path / "out").exists()


def test_a_frame_is_picked_by_the_name_of_its_image(tmp_path: Path) -> None:
    known = {"fl_y": 600.0, "cx": 320.0, "cy": 240.0, "w": 640, "h": 480}
    frames = [{**known, "fl_x": fx, "file_path": path} for path, fx in (("left/1.png", 600.0), ("right/1.png", 500.0))]
    path = write(tmp_path, json.dumps({"frames": frames}))
    assert "500 x 600 px" in slopemap("camera", "show", f"{path}#right/1.png").stdout
    assert "pick one of them: left/1.png, right/1.png" in slopemap("camera", "show", f"{path}#1.png").stderr


def test_files_without_a_size_take_that_of_the_image_or_the_option(tmp_path: Path) -> None:
    path = str(write(tmp_path, PIX4D))
    refused = slopemap("camera", "show", path).stderr
    assert "no image size" in refused
    assert "--size WxH -o DIR" in refused
    by_size = slopemap("camera", "show", path, "--size", "1024x768")
    assert "1024x768 px, which the file does not say" in by_size.stdout
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((768, 1024), np.uint8))
    by_image = slopemap("camera", "show", path, "--image", str(tmp_path / "a.png"))
    assert by_image.stdout.startswith(by_size.stdout)
    converted = slopemap("camera", "show", path, "--size", "1024x768", "-o", str(tmp_path / "out"))
    assert converted.returncode == 0
    assert load_camera(str(tmp_path / "out" / "camera.json")).width == 1024
    assert "lens stated no focal length" in " ".join(by_image.stdout.split())


def test_an_image_of_another_size_scales_the_camera(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "half.png"), np.zeros((384, 512), np.uint8))
    path = f"{write(tmp_path, KALIBR)}#cam0"
    done = slopemap("camera", "show", path, "--image", str(tmp_path / "half.png"))
    assert "400 x 405 px" in done.stdout
    assert "intrinsics scaled by 0.5" in done.stdout


def test_metadata_of_an_image_are_shown_and_compared(tmp_path: Path) -> None:
    """24 mm equivalent on an image 1024 px wide is 682.7 px."""
    exif = PilImage.Exif()
    exif[271] = "maker"
    exif.get_ifd(0x8769)[41989] = 24
    PilImage.new("RGB", (1024, 768)).save(tmp_path / "a.jpg", exif=exif)
    alone = slopemap("camera", "show", "--image", str(tmp_path / "a.jpg"), "-o", str(tmp_path / "out"))
    assert alone.returncode == 0
    assert "EXIF" in alone.stdout
    assert slopemap("camera", "show", str(tmp_path / "a.jpg")).stdout == alone.stdout
    stated = load_camera(tmp_path / "out" / "camera.json")
    both = slopemap("camera", "show", f"{write(tmp_path, KALIBR)}#cam0", "--image", str(tmp_path / "a.jpg"))
    ratio = np.sqrt(800 * 810) / stated.focal_px
    assert f"{ratio:.4g} times that of the metadata" in both.stdout


def test_all_that_an_image_states_is_shown(tmp_path: Path) -> None:
    xmp = xmp_packet(gimbal(35.2, -80.0, RelativeAltitude="+80.10"))
    exif = {FOCAL_35: 24}
    image = photograph((1024, 768), exif, gps_tags(47.3769, -8.5417, 512.3), {271: "DJI", 272: "FC3582"}, xmp)
    (tmp_path / "DJI_0001.JPG").write_bytes(image)
    done = slopemap("camera", "show", str(tmp_path / "DJI_0001.JPG"))
    said = " ".join(done.stdout.split())
    for words in (
        "taken with DJI FC3582; 1024x768 px as stored",
        "pitch -80.00°, roll 0.00°, heading 35.20° of the camera",
        "up is (0.0000, -0.1736, -0.9848) in camera axes",  # against gravity: 10 degrees off the line of sight
        "47.3769000° N 8.5417000° W, 512.3 m up",
        "above take-off 80.10 m",
    ):
        assert words in said
    shown = json.loads(slopemap("camera", "show", str(tmp_path / "DJI_0001.JPG"), "--json").stdout)
    assert shown["metadata"]["attitude"]["pitch_deg"] == -80


@pytest.mark.parametrize(
    ("arguments", "status", "words"),
    [
        ([], 2, "give a camera FILE, or --image IMG"),
        (["c.json", "--size", "10x10", "--image", "a.png"], 2, "contradict each other"),
        (["none.json"], 1, "no such camera file"),
        (["."], 1, "calibrateCamera"),
    ],
)
def test_show_refusals(tmp_path: Path, arguments: list[str], status: int, words: str) -> None:
    done = slopemap("camera", "show", *arguments, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (status, "")
    assert words in done.stderr
    assert not list(tmp_path.iterdir())


def test_an_input_is_never_overwritten(tmp_path: Path) -> None:
    path = write(tmp_path, KANNALA_BRANDT, "camera.json")
    before = path.read_bytes()
    done = slopemap("camera", "show", str(path), "-o", str(tmp_path))
    assert done.returncode == 1
    assert path.read_bytes() == before
