"""`slopemap validate`: an answer against known ground, in every form in which that comes."""

from __future__ import annotations

import csv
import json
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import trimesh
from command import slopemap
from scenery import Pair, Surface, make_camera, pixel_grid, render, tilted, turn, unit

from slopecli import Image, Options, estimate
from slopecli.geometry import homogeneous, rays_from_pixels
from slopecli.io import write_outputs
from slopecli.types import FloatArray

LEFT, RIGHT = tilted(0.2, 0.1), tilted(-0.1, 0.05)
BASELINE_M = 2.5


@lru_cache(maxsize=1)
def pair() -> Pair:
    surfaces = [Surface(LEFT), Surface(RIGHT, (160.0, 0.0, 160.0, 240.0))]
    return render(turn(1, 2, 2), unit(0.9, 0.2, 0.3), surfaces, camera1=make_camera(320, 240))


@lru_cache(maxsize=1)
def depth() -> FloatArray:
    """(h, w) true depth along the axis of camera 1, m."""
    uv = pixel_grid(320, 240).reshape(-1, 2)
    return (BASELINE_M / pair().inverse_depth(uv)).reshape(240, 320)


@pytest.fixture(scope="module")
def answer(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The answer of the pair: windows 1 and 2 on one plane each."""
    folder = tmp_path_factory.mktemp("answer")
    images = [Image(grey, path=f"{k}.png", sha256="0" * 64) for k, grey in enumerate((pair().grey1, pair().grey2), 1)]
    windows = ((70, 60, 80, 120), (170, 60, 110, 120))
    report = estimate(*images, pair().camera1, pair().camera2, Options(windows=windows))
    write_outputs(report, images[0], folder)
    return folder


def compared(answer: Path, *options: str, status: int = 0) -> dict[str, Any]:
    done = slopemap("validate", str(answer), *options, "--json")
    assert done.returncode == status, done.stderr
    result: dict[str, Any] = json.loads(done.stdout)
    return result


def as_npy(path: Path, values: FloatArray) -> str:
    np.save(path, values)
    return str(path)


def test_true_slopes_and_the_scale_are_those_of_the_ground(answer: Path, tmp_path: Path) -> None:
    found = compared(answer, "--depth", as_npy(tmp_path / "d.npy", depth()))
    for one, truth in zip(found["planes"], (LEFT, RIGHT), strict=True):
        slope = np.degrees(np.arccos(truth[2] / np.linalg.norm(truth)))
        assert one["true_slope_deg"] == pytest.approx(slope, abs=1e-4)
        assert one["difference_deg"] == pytest.approx(one["slope_deg"] - slope, abs=1e-4)
        assert one["normal_error_deg"] < 0.3
        assert one["true_rms"] < 1e-5
        assert one["distance_ratio"] == pytest.approx(1.0, abs=0.01)
    assert found["scale"] == pytest.approx(BASELINE_M, rel=0.01)
    assert found["missing"] == []


def pfm(values: FloatArray, order: str) -> bytes:
    scale = -1.0 if order == "<" else 1.0
    height, width = values.shape
    return f"Pf\n{width} {height}\n{scale}\n".encode() + values[::-1].astype(f"{order}f4").tobytes()


@pytest.mark.parametrize("kind", ["npz", "npz of several", "pfm", "big-endian pfm", "png", "tif", "exr", "half size"])
def test_a_depth_is_the_same_in_every_form(answer: Path, tmp_path: Path, kind: str) -> None:
    path, options = tmp_path / f"depth.{kind.split()[-1]}", []
    if kind == "npz":
        np.savez(path, anything=depth())
    elif kind == "npz of several":
        path = tmp_path / "depth.npz"
        np.savez(path, mask=depth() > 0, mine=depth())
        options = ["--key", "mine"]
    elif "pfm" in kind:
        path.write_bytes(pfm(depth(), ">" if "big" in kind else "<"))
    elif kind == "png":
        cv2.imwrite(str(path), np.rint(1000.0 * depth()).astype(np.uint16))
        options = ["--factor", "0.001"]
    elif kind == "half size":
        path = tmp_path / "half.npy"
        np.save(path, 0.25 * (depth()[::2, ::2] + depth()[1::2, ::2] + depth()[::2, 1::2] + depth()[1::2, 1::2]))
    elif kind == "exr":
        exr = pytest.importorskip("OpenEXR")
        header = {"compression": exr.ZIP_COMPRESSION, "type": exr.scanlineimage}
        exr.File(header, {"Z": depth().astype(np.float32)}).write(str(path))
    else:
        cv2.imwrite(str(path), depth().astype(np.float32))
    found = compared(answer, "--depth", str(path), *options)
    exact = compared(answer, "--depth", as_npy(tmp_path / "exact.npy", depth()))
    for one, other in zip(found["planes"], exact["planes"], strict=True):
        assert one["true_slope_deg"] == pytest.approx(other["true_slope_deg"], abs=0.05)
    assert found["scale"] == pytest.approx(exact["scale"], rel=2e-3)


def test_a_disparity_is_a_depth(answer: Path, tmp_path: Path) -> None:
    """z = f b / (d + offset); unmatched pixels are 0, and a mismatch is left out."""
    focal = pair().camera1.fx
    disparity = focal * 0.4 / depth() - 3.0
    disparity[100:110, 200:210] = 0.0
    disparity[120, 180:190] = 200.0
    options = ("--disparity", as_npy(tmp_path / "d.npy", disparity), "--baseline", "0.4", "--offset", "3")
    found = compared(answer, *options)
    for one, truth in zip(found["planes"], (LEFT, RIGHT), strict=True):
        slope = np.degrees(np.arccos(truth[2] / np.linalg.norm(truth)))
        assert one["true_slope_deg"] == pytest.approx(slope, abs=1e-3)
    assert found["scale"] == pytest.approx(BASELINE_M, rel=0.01)


@pytest.mark.parametrize("kind", ["ply", "las", "laz", "npy"])
def test_a_cloud_is_seen_by_camera_1_from_its_pose(answer: Path, tmp_path: Path, kind: str) -> None:
    """Points behind others and behind the camera do not count."""
    rng = np.random.default_rng(0)
    uv = rng.uniform([0, 0], [319, 239], (20000, 2))
    z = BASELINE_M / pair().inverse_depth(uv)
    ground = homogeneous(rays_from_pixels(pair().camera1, uv)) * z[:, None]
    hidden, behind = 1.5 * ground[::5], -ground[::7]
    R, T = turn(20, -10, 40), np.array([5.0, -3.0, 2.0])
    cloud = np.vstack([ground, hidden, behind]) @ R + T  # P1 = R (P - T)
    path = tmp_path / f"cloud.{kind}"
    if kind == "ply":
        trimesh.PointCloud(cloud).export(path)
    elif kind in ("las", "laz"):
        laspy = pytest.importorskip("laspy")
        if kind == "laz":
            pytest.importorskip("lazrs")
        header = laspy.LasHeader(point_format=3, version="1.2")
        header.offsets, header.scales = cloud.min(0), np.full(3, 1e-5)
        las = laspy.LasData(header)
        las.x, las.y, las.z = cloud.T
        las.write(str(path))
    else:
        np.save(path, cloud)
    pose = tmp_path / "pose.json"
    pose.write_text(json.dumps({"R": R.tolist(), "T": T.tolist()}))
    found = compared(answer, "--points", str(path), "--pose", str(pose))
    for one, truth in zip(found["planes"], (LEFT, RIGHT), strict=True):
        slope = np.degrees(np.arccos(truth[2] / np.linalg.norm(truth)))
        assert one["true_slope_deg"] == pytest.approx(slope, abs=0.01)


def test_whole_surfaces_by_their_labels(answer: Path, tmp_path: Path) -> None:
    """A window is compared with all of the surface that it lies on, not with what it shows of it."""
    labels = np.where(np.arange(320) < 160, 3, 7).astype(np.uint8) * np.ones((240, 1), np.uint8)
    cv2.imwrite(str(tmp_path / "labels.png"), labels)
    options = ("--depth", as_npy(tmp_path / "d.npy", depth()), "--labels", str(tmp_path / "labels.png"))
    found = compared(answer, *options)
    assert [one["n_points"] for one in found["planes"]] == pytest.approx([160 * 240, 160 * 240], rel=0.02)
    labels[:] = 0
    cv2.imwrite(str(tmp_path / "none.png"), labels)
    done = slopemap("validate", str(answer), *options[:-1], str(tmp_path / "none.png"))
    assert done.returncode == 1


def test_a_slope_that_is_wrong_is_told(answer: Path, tmp_path: Path) -> None:
    """The ground of another place: a plane 10 degrees steeper."""
    other = BASELINE_M / (homogeneous(rays_from_pixels(pair().camera1, pixel_grid(320, 240).reshape(-1, 2))) @ RIGHT)
    found = compared(answer, "--depth", as_npy(tmp_path / "d.npy", other.reshape(240, 320)))
    first, second = found["planes"]
    angle = np.degrees(np.arccos(LEFT @ RIGHT / np.linalg.norm(LEFT) / np.linalg.norm(RIGHT)))
    assert first["normal_error_deg"] == pytest.approx(angle, abs=0.3)
    assert abs(first["sigmas"]) > 3
    assert second["normal_error_deg"] < 0.3


def test_files_and_table(answer: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    truth = as_npy(tmp_path / "d.npy", depth())
    first = slopemap("validate", str(answer), "--depth", truth, "-o", str(out))
    assert first.returncode == 0
    assert [line.split()[0] for line in first.stdout.splitlines()] == ["id", "1", "2"]
    assert "scale: 1 baseline of the answer is" in first.stderr
    assert {path.name for path in out.iterdir()} == {"validation.csv", "validation.png", "validation.json"}
    rows = list(csv.DictReader((out / "validation.csv").open(encoding="utf-8")))
    numbers = json.loads((out / "validation.json").read_text())
    assert [float(row["true_slope_deg"]) for row in rows] == [one["true_slope_deg"] for one in numbers["planes"]]
    assert cv2.imread(str(out / "validation.png")).std() > 10
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    slopemap("validate", str(answer), "--depth", truth, "-o", str(out))
    assert before == {path.name: path.read_bytes() for path in out.iterdir()}


def test_a_region_needs_its_labels(answer: Path, tmp_path: Path) -> None:
    document = json.loads((answer / "slopes.json").read_text())
    for one in document["planes"]:
        one["source"] = "region"
    (tmp_path / "slopes.json").write_text(json.dumps(document))
    truth = as_npy(tmp_path / "d.npy", depth())
    done = slopemap("validate", str(tmp_path), "--depth", truth)
    assert (done.returncode, len(done.stderr.splitlines())) == (1, 1)
    assert "labels.png" in done.stderr
    (tmp_path / "labels.png").write_bytes((answer / "labels.png").read_bytes())
    found, windows = (compared(one, "--depth", truth)["planes"] for one in (tmp_path, answer))
    for one, other in zip(found, windows, strict=True):
        assert one["true_slope_deg"] == pytest.approx(other["true_slope_deg"], abs=1e-3)


def bad_truths(folder: Path) -> dict[str, tuple[list[str], str]]:
    """Options of a truth that is none, and a part of what is said of it."""
    files = {"wide": np.ones((240, 100)), "empty": np.zeros((240, 320)), "cube": np.ones((3, 240, 320)),
             "flat": np.ones(7), "away": -np.ones((50, 3)), "no rows": np.ones((0, 320))}  # fmt: skip
    for name, values in files.items():
        np.save(folder / f"{name}.npy", values)
    (folder / "junk.pfm").write_bytes(b"Pf\n5 x\n")
    (folder / "junk.npz").write_bytes(b"PK")
    (folder / "junk.ply").write_bytes(b"ply\n")
    (folder / "pose.json").write_text('{"R": [[1,0,0],[0,1,0],[0,0,1]]}')
    cv2.imwrite(str(folder / "grey.png"), np.full((240, 320), 7, np.uint8))
    at = {path.name: str(path) for path in folder.iterdir()}
    return {
        "wide": (["--depth", at["wide.npy"]], "100x240"),
        "empty": (["--depth", at["empty.npy"]], "no positive number"),
        "no rows": (["--depth", at["no rows.npy"]], "320x0"),
        "cube": (["--depth", at["cube.npy"]], "3x240x320"),
        "flat": (["--depth", at["flat.npy"]], "one number for every pixel"),
        "8 bits": (["--depth", at["grey.png"]], "8 bits"),
        "junk pfm": (["--depth", at["junk.pfm"]], "junk.pfm"),
        "junk npz": (["--depth", at["junk.npz"]], "junk.npz"),
        "junk ply": (["--points", at["junk.ply"]], "junk.ply"),
        "missing": (["--depth", str(folder / "no.npy")], "no such file"),
        "other kind": (["--depth", str(folder / "d.docx")], "needed one of"),
        "behind": (["--points", at["away.npy"]], "shows none"),
        "no place": (["--points", at["away.npy"], "--pose", at["pose.json"]], "'T'"),
    }


@pytest.mark.parametrize(
    "kind",
    [
        "wide",
        "empty",
        "no rows",
        "cube",
        "flat",
        "8 bits",
        "junk pfm",
        "junk npz",
        "junk ply",
        "missing",
        "other kind",
        "behind",
        "no place",
    ],
)
def test_what_is_no_truth_is_refused_in_one_line(answer: Path, tmp_path: Path, kind: str) -> None:
    options, said = bad_truths(tmp_path)[kind]
    done = slopemap("validate", str(answer), *options, "-o", str(tmp_path / "out"))
    assert (done.returncode, len(done.stderr.splitlines())) == (1, 1), done.stderr
    assert said in done.stderr
    assert "fault of slopemap" not in done.stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"planes": 3}', "not json"])
def test_what_is_no_answer_is_refused_in_one_line(tmp_path: Path, text: str) -> None:
    (tmp_path / "slopes.json").write_text(text)
    done = slopemap("validate", str(tmp_path), "--depth", as_npy(tmp_path / "d.npy", depth()))
    assert (done.returncode, len(done.stderr.splitlines())) == (1, 1)
    assert "fault of slopemap" not in done.stderr


@pytest.mark.parametrize(("where", "name"), [("motion", "baseline_cam1"), ("up", "vector_cam1")])
def test_an_answer_of_lengths_that_overflow_is_refused_in_one_line(
    answer: Path, tmp_path: Path, where: str, name: str
) -> None:
    document = json.loads((answer / "slopes.json").read_text())
    document[where][name][1] = 1e200
    (tmp_path / "slopes.json").write_text(json.dumps(document))
    done = slopemap("validate", str(tmp_path), "--depth", as_npy(tmp_path / "d.npy", depth()))
    assert (done.returncode, len(done.stderr.splitlines())) == (1, 1), done.stderr
    assert "1e+200" in done.stderr


@pytest.mark.parametrize(("key", "value"), [("height", 0.034), ("width", 96.5), ("height", 0), ("width", -1)])
def test_an_answer_of_images_without_such_a_size_is_refused_in_one_line(
    answer: Path, tmp_path: Path, key: str, value: float
) -> None:
    document = json.loads((answer / "slopes.json").read_text())
    document["cameras"][0][key] = value
    (tmp_path / "slopes.json").write_text(json.dumps(document))
    done = slopemap("validate", str(tmp_path), "--depth", as_npy(tmp_path / "d.npy", depth()))
    assert (done.returncode, len(done.stderr.splitlines())) == (1, 1), done.stderr
    assert "is no answer of slopemap" in done.stderr


@pytest.mark.parametrize(
    "options",
    [
        [],
        ["--depth", "a.npy", "--points", "b.ply"],
        ["--disparity", "a.npy"],
        ["--depth", "a.npy", "--baseline", "1"],
        ["--depth", "a.npy", "--pose", "p.json"],
    ],
)
def test_options_that_do_not_belong_together(answer: Path, options: list[str]) -> None:
    assert slopemap("validate", str(answer), *options).returncode == 2


def test_lens_distortion_is_no_rectified_pair(answer: Path, tmp_path: Path) -> None:
    document = json.loads((answer / "slopes.json").read_text())
    document["cameras"][0] = {**document["cameras"][0], "model": "brown", "distortion": [-0.1]}
    (tmp_path / "slopes.json").write_text(json.dumps(document))
    truth = as_npy(tmp_path / "d.npy", depth())
    done = slopemap("validate", str(tmp_path), "--disparity", truth, "--baseline", "1")
    assert done.returncode == 1
    assert "distortion" in done.stderr
