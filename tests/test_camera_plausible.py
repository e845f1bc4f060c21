"""Cameras as hardly any are made: warned of, and nothing is called safe; real ones pass without a word."""

from __future__ import annotations

import json
import os
import runpy
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from camera_factory import MATRIX
from command import slopemap
from fuzzing.samples import pair
from report_factory import make_camera

from slopecli.batch import find_pairs
from slopecli.findings import implausible_cameras, unlikely
from slopecli.io.cameras import camera_from_intrinsics, decode_camera
from slopecli.options import Options
from slopecli.patches import Given
from slopecli.pipeline import solve
from slopecli.study import make_scene
from slopecli.types import Camera

ROOT = Path(__file__).resolve().parent.parent
SAMPLE = ROOT / "sample_data" / "descent"
GOOD = Camera(1000, 800, 900.0, 905.0, 510.0, 390.0)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"cx": 230.0}, "cx = 230 is 27 % of the width off"),
        ({"cy": 799.0}, "cy = 799 is 50 % of the height off"),
        ({"cx": 0.5, "cy": 0.5}, "shares of the image"),
        ({"cx": 0.0, "cy": 0.0}, "measured from its middle"),
        ({"cx": -200.0}, "off the middle"),
        ({"fx": 250.0, "fy": 250.0}, "field of view of 127° (is it in millimetres?)"),
        ({"fx": 40_000.0, "fy": 40_000.0}, "radians"),
        ({"fy": 450.0}, "fy = 450 px would be pixels"),
        ({"model": "brown", "distortion": (-2.0, 0.0, 0.0, 0.0)}, "of the image with rays"),
        ({"size_given": False, "cx": 639.5, "cy": 479.5}, "the middle of 1280x960 px, not of 1000x800 px"),
        ({"size_given": False, "cx": 399.0, "cy": 304.0}, "without an image size"),
        ({"size_given": False, "cx": 559.5, "cy": 359.5}, "the middle of 1120x720 px"),
        ({"size_given": False, "cx": 543.5, "cy": 399.5}, "the middle of 1088x800 px"),
        ({"size_given": False, "cx": 690.0}, "without an image size"),
    ],
)
def test_cameras_as_hardly_any_are_made(change: dict[str, Any], words: str) -> None:
    assert words in unlikely(replace(GOOD, **change))


@pytest.mark.parametrize(
    "camera",
    [
        GOOD,
        replace(GOOD, size_given=False),
        replace(GOOD, cx=700.0, cy=250.0),  # a crop, within a quarter
        replace(GOOD, fx=320.0, fy=310.0),
        replace(GOOD, fx=20_000.0, fy=20_000.0),
        replace(GOOD, fx=220.0, fy=220.0, model="fisheye", distortion=(0.0, 0.0, 0.0, 0.0)),
        replace(GOOD, model="brown", distortion=(-0.28, 0.07, 0.0, 0.0)),
        Camera(0, 0, 900.0, 900.0, 0.0, 0.0),
    ],
)
def test_cameras_that_are_made_pass_without_a_word(camera: Camera) -> None:
    assert implausible_cameras(camera, camera) == []


def test_one_camera_of_both_images_is_said_once() -> None:
    odd = replace(GOOD, cx=10.0)
    assert [found.message.split(":")[0] for found in implausible_cameras(odd, odd)] == ["the camera"]
    assert [found.value for found in implausible_cameras(odd, replace(odd, cx=20.0))] == [1.0, 2.0]
    assert [found.message.split(":")[0] for found in implausible_cameras(GOOD, odd)] == ["camera 2"]


@pytest.mark.parametrize(
    "intrinsics",
    [
        "692.8,692.8,150,399.5",
        *(pytest.param(f"692.8,692.8,{centre}", marks=pytest.mark.slow) for centre in ("300,300", "0,0")),
    ],
)
def test_nothing_is_safe_under_a_camera_that_can_hardly_be(intrinsics: str) -> None:
    images = str(SAMPLE / "image1.png"), str(SAMPLE / "image2.png")
    done = slopemap("estimate", *images, "--intrinsics", intrinsics, "--json")
    assert done.returncode in (0, 3)
    if done.returncode == 0:
        result = json.loads(done.stdout)
        assert "implausible-camera" in [found["code"] for found in result["diagnostics"]]
        assert "safe" not in [plane["verdict"] for plane in result["planes"]]


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        (("--intrinsics", "24,24,399.5,399.5"), "a field of view of 173 deg"),
        (("--intrinsics", "0.866,0.866,0.5,0.5"), "units of the image width"),
        (("--fov", "1.047"), "1.047 radians are 59.99 degrees"),
    ],
)
def test_units_that_cannot_be_are_refused_by_every_command(flags: tuple[str, str], words: str) -> None:
    images = str(SAMPLE / "image1.png"), str(SAMPLE / "image2.png")
    for command in ("estimate", "segment"):
        done = slopemap(command, *images, *flags, "--json")
        assert (done.returncode, done.stdout) == (1, "")
        assert words in done.stderr
        assert len(done.stderr.splitlines()) == 1
    assert words in slopemap("plan", *flags, "--size", "800x800", "--trajectory", "45", "--height", "80").stderr


def test_rows_of_your_own_are_never_safe_under_a_focal_length_in_millimetres(tmp_path: Path) -> None:
    scene = make_scene(np.random.default_rng(1), noise_px=0.1)
    rows = np.column_stack([scene.uv1, scene.uv2, scene.patch])
    np.savetxt(tmp_path / "rows.csv", rows, delimiter=",", header="x1,y1,x2,y2,patch", comments="", fmt="%.6g")
    centre = f"{scene.camera.cx},{scene.camera.cy}"
    for focal, doubted in ((scene.camera.fx, False), (35.0, True)):
        done = slopemap("solve", str(tmp_path / "rows.csv"), "--intrinsics", f"{focal},{focal},{centre}", "--json")
        if done.returncode == 0:
            result = json.loads(done.stdout)
            assert ("implausible-camera" in [found["code"] for found in result["diagnostics"]]) == doubted
            assert not doubted or "safe" not in [plane["verdict"] for plane in result["planes"]]
        else:
            assert doubted


@pytest.mark.parametrize(
    ("moved", "centre", "doubted"),
    [
        ((0.0, 0.0), None, False),
        ((0.0, 0.0), (0.0, 0.0), True),  # measured from the middle, of points that are not
        ((0.0, 0.0), (None, 0.5), True),
        ("middle", (0.0, 0.0), False),  # both measured from the middle
        ((500.0, 0.0), (None, None), False),  # points in a corner of a larger image
    ],
)
def test_a_principal_point_in_the_middle_of_no_image_of_the_rows_is_never_safe(
    moved: tuple[float, float] | str, centre: tuple[float | None, float | None] | None, doubted: bool
) -> None:
    scene = make_scene(np.random.default_rng(1), noise_px=0.1)
    middle = np.array([scene.camera.cx, scene.camera.cy])
    by = -middle if isinstance(moved, str) else np.array(moved)
    true = middle + by
    given = [true[k] if centre is None or centre[k] is None else centre[k] for k in (0, 1)]
    camera = Camera(0, 0, scene.camera.fx, scene.camera.fy, float(given[0]), float(given[1]))
    report = solve(Given(scene.uv1 + by, scene.uv2 + by, scene.patch), (camera, camera), Options())
    assert ("implausible-camera" in {found.code for found in report.diagnostics}) == doubted
    assert not doubted or "safe" not in {plane.verdict for plane in report.planes}


def test_how_a_file_is_read_is_said_once(tmp_path: Path) -> None:
    camera = make_camera(800, 800)
    K = camera.K.tolist()
    (tmp_path / "c.json").write_text(json.dumps({"K": K, "D": [0.01, 0, 0, 0]}))
    images = str(SAMPLE / "image1.png"), str(SAMPLE / "image2.png")
    done = slopemap("estimate", *images, "--camera", str(tmp_path / "c.json"), "--json")
    said = [line for line in done.stderr.splitlines() if "c.json" in line]
    assert len(said) == 1
    assert "four coefficients" in said[0]
    assert "no image size" in said[0]


# ---- batches ----


def frames_of(names: list[str]) -> str:
    return json.dumps(
        {
            "camera_model": "PINHOLE",
            "frames": [
                {"file_path": f"images/{name}", "w": 64, "h": 48, "fl_x": 60 + k, "cx": 32, "cy": 24}
                for k, name in enumerate(names)
            ],
        }
    )


def fill(folder: Path, names: list[str], frames: list[str]) -> str:
    folder.mkdir()
    for name in names:
        cv2.imwrite(str(folder / name), np.zeros((48, 64), np.uint8))
    (folder / "transforms.json").write_text(frames_of(frames))
    return str(folder)


def test_a_batch_gives_every_image_the_camera_of_its_name_and_says_so(tmp_path: Path) -> None:
    folder = fill(tmp_path / "flight", ["a.png", "b.png", "c.png"], ["a.png", "b.png", "c.png"])
    found = find_pairs(folder)
    picked = [(pair.camera1, pair.camera2) for pair in found.pairs]
    names = [tuple(str(choice and choice.file).partition("#")[2] for choice in both) for both in picked]
    assert names == [("images/a.png", "images/b.png"), ("images/b.png", "images/c.png")]
    assert any("each image has that of its name" in note for note in found.notes)


def test_an_image_without_a_camera_of_its_name_fails_alone(tmp_path: Path) -> None:
    folder = fill(tmp_path / "flight", ["a.png", "b.png", "x.png"], ["a.png", "b.png", "c.png"])
    first, second = find_pairs(folder).pairs
    assert str(first.camera2 and first.camera2.file).endswith("transforms.json#images/b.png")
    assert str(second.camera2 and second.camera2.file).endswith("transforms.json")


def test_an_image_that_fits_two_cameras_is_a_problem_of_its_pair(tmp_path: Path) -> None:
    folder = fill(tmp_path / "flight", ["a.png", "b.png", "c.png"], ["b.png", "c.png", "1/a.png", "2/a.png"])
    first, second = find_pairs(folder).pairs
    assert "2 cameras for this image" in str(first.problem)
    assert second.problem is None


# ---- real cameras ----


@pytest.mark.skipif("SLOPEMAP_DATA" not in os.environ, reason="SLOPEMAP_DATA names no folder of image pairs")
def test_cameras_of_all_data_sets_pass_without_a_word() -> None:
    accuracy = runpy.run_path(str(ROOT / "benchmarks" / "accuracy.py"))
    data, cameras = Path(os.environ["SLOPEMAP_DATA"]), 0
    for path in [*data.glob("**/truth.json"), *data.glob("**/*.truth.json")]:
        truth = json.loads(path.read_text(encoding="utf-8"))
        if not truth.get("K") and not truth.get("K1"):
            continue
        for which in "12" if "image1" in truth else ():
            pixels = cv2.imread(str(path.parent / truth[f"image{which}"]), 0 | cv2.IMREAD_IGNORE_ORIENTATION)
            numbers = accuracy["_camera"](truth, which, pixels.shape)
            camera = decode_camera(json.dumps(numbers).encode(), path)
            assert camera.note == ""
            assert unlikely(camera) == ""
            given = camera_from_intrinsics((camera.fx, camera.fy, camera.cx, camera.cy), camera.width, camera.height)
            assert unlikely(given) == ""
            cameras += 1
    assert cameras > 100


def test_a_lens_that_has_no_rays_for_most_of_the_image_ends_in_an_answer(tmp_path: Path) -> None:
    """Small images, whose windows are matched pixel by pixel, under tangential distortion as no lens has it."""
    for name in ("image1.png", "image2.png"):
        (tmp_path / name).write_bytes(pair()[name])
    tree = {"width": 1024, "height": 1024, "K": MATRIX, "distortion": [0.1, 0.0, 5, 1]}
    (tmp_path / "camera.json").write_text(json.dumps(tree))
    images = [str(tmp_path / name) for name in ("image1.png", "image2.png")]
    done = slopemap("estimate", *images, "--camera", str(tmp_path / "camera.json"), "--grid", "1x1", "--json")
    assert done.returncode == 0, done.stderr
    assert "implausible-camera" in done.stderr
    assert json.loads(done.stdout)["planes"][0]["verdict"] != "safe"
