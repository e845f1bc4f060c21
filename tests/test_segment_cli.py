"""`slopemap segment` and `slopemap estimate --planes` as a user meets them."""

from __future__ import annotations

import json
import re
from collections import Counter
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import trimesh
from command import Done, slopemap
from output_names import files_of
from remembered import forget
from test_cli import ROOT

from slopecli.cli import run
from slopecli.cli import slopemap as commands

URBAN = ROOT / "sample_data" / "urban"
STEPS = {"step1_gradient.png", "step2_components.png", "step3_merged.png"}
FILES = files_of(requires=("found",))
KINDS = ("ground", "wall", "roof")
CLEAR_SHARE, CLEAR_PURITY = 0.01, 0.75  # of image 1, and of a plane's pixels: what should be named as it is
Run = tuple[Done, Path]

pytestmark = pytest.mark.usefixtures("_solved_once")


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, ...]:
    """The urban sample at half its size, which is faster, and its camera."""
    folder = tmp_path_factory.mktemp("pair")
    for name in ("image1.png", "image2.png"):
        image = cv2.imread(str(URBAN / name))
        cv2.imwrite(str(folder / name), cv2.resize(image, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA))
    camera = json.loads((URBAN / "camera.json").read_text())
    half = ",".join(str(camera[key] / 2 - 0.25 * (key[0] == "c")) for key in ("fx", "fy", "cx", "cy"))
    return str(folder / "image1.png"), str(folder / "image2.png"), "--intrinsics", half


@pytest.fixture(scope="module")
def answer(pair: tuple[str, ...], tmp_path_factory: pytest.TempPathFactory) -> Run:
    """One ordinary run, with the pictures of its steps."""
    folder = tmp_path_factory.mktemp("answer") / "out"
    done = slopemap("segment", *pair, "-o", str(folder), "--debug-images", "--all")
    assert done.returncode == 0, done.stderr
    return done, folder


@pytest.fixture(scope="module")
def result(answer: Run) -> dict[str, Any]:
    return json.loads((answer[1] / "slopes.json").read_text())


@pytest.fixture(scope="module")
def labels(answer: Run) -> np.ndarray:
    return cv2.imread(str(answer[1] / "labels.png"), cv2.IMREAD_UNCHANGED)


def rows_of(done: Done) -> list[list[str]]:
    return [row.split() for row in done.stdout.splitlines()[1:]]


# ---- an answer ----


def test_all_files_are_written_and_named(answer: Run) -> None:
    done, folder = answer
    assert {path.name for path in folder.iterdir()} == FILES | STEPS
    assert all(name in done.stderr for name in FILES | STEPS)


def test_table_has_every_plane_the_largest_first(answer: Run, result: dict[str, Any], labels: np.ndarray) -> None:
    every = {int(row[0]): row for row in rows_of(answer[0])}
    assert sorted(every) == sorted(patch["id"] for patch in result["planes"] + result["rejected"])
    rows = [every[plane["id"]] for plane in result["planes"]]
    shares = [100 * float((labels == int(row[0])).mean()) for row in rows]
    assert [row[2] for row in rows] == [f"{share:.1f}" for share in shares]
    assert shares == sorted(shares, reverse=True)
    slopes = [f"{plane['slope_deg']:.2f}" for plane in result["planes"]]
    assert [row[4].rstrip("°") for row in rows] == slopes


def test_without_all_the_table_has_what_matters_and_counts_the_rest(tmp_path: Path, pair: tuple[str, ...]) -> None:
    small = ("--max-sigma", "2", "--no-overlay", "--no-ply", "--no-glb")
    done, with_all = (
        slopemap("segment", *pair, "-o", str(tmp_path / f"{k}"), *small, *more)
        for k, more in enumerate([(), ("--all",)])
    )
    every, shown = rows_of(with_all), rows_of(done)
    assert 2 < len(shown) < len(every)
    assert all(row in every for row in shown)
    (said,) = (line for line in done.stderr.splitlines() if line.startswith("not shown: "))
    assert sum(int(number) for number in re.findall(r"\d+", said)) == len(every) - len(shown)


def test_verbose_prints_the_account_of_the_planes(pair: tuple[str, ...]) -> None:
    forget()
    done = slopemap("segment", *pair, "--json", "-v")
    lines = [line for line in done.stderr.splitlines() if line.startswith("regions: ")]
    for word in ("match", "proposed", "merging", "labelled", "given up"):
        assert any(word in line for line in lines)


def test_labels_hold_the_planes_of_the_answer(result: dict[str, Any], labels: np.ndarray) -> None:
    assert labels.dtype == np.uint16
    assert labels.shape == (300, 400)
    assert set(np.unique(labels)) - {0} == {plane["id"] for plane in result["planes"]}
    assert {plane["source"] for plane in result["planes"]} == {"region"}


def test_what_no_plane_explains_is_said(answer: Run, result: dict[str, Any], labels: np.ndarray) -> None:
    (found,) = (one for one in result["diagnostics"] if one["code"] == "unexplained")
    assert found["severity"] == "info"
    assert found["value"] == pytest.approx((labels == 0).mean(), abs=0.01)
    assert f"info: unexplained: {100 * found['value']:.0f} % of image 1" in answer[0].stderr


def test_planes_are_called_what_they_are(answer: Run, labels: np.ndarray) -> None:
    """Against the sample's truth, for planes that are large and nearly all of one kind in truth too."""
    truth = json.loads((URBAN / "truth.json").read_text())["planes"]
    kinds = {plane["id"]: next(kind for kind in KINDS if kind in plane["name"]) for plane in truth}
    true_labels = cv2.imread(str(URBAN / "labels.png"), cv2.IMREAD_UNCHANGED)[::2, ::2]
    named: Counter[str] = Counter()
    for row in rows_of(answer[0]):
        inside = true_labels[labels == int(row[0])].tolist() or ["rejected"]
        kind, count = Counter(kinds.get(label, "other") for label in inside).most_common(1)[0]
        if len(inside) > CLEAR_SHARE * labels.size and count > CLEAR_PURITY * len(inside):
            assert row[1] == kind, row
            named[kind] += 1
    assert set(named) == set(KINDS)
    assert named.total() >= 5


def test_level_is_the_largest_plane_unless_told_otherwise(answer: Run, result: dict[str, Any]) -> None:
    assert result["up"]["source"] == "dominant-plane"
    assert result["planes"][0]["slope_deg"] == pytest.approx(0, abs=1e-6)
    assert "the largest plane taken as level; if it is a wall, give --up X,Y,Z" in answer[0].stderr
    up = json.loads((URBAN / "truth.json").read_text())["up_cam1"]
    assert np.degrees(np.arccos(np.dot(up, result["up"]["vector_cam1"]))) < 0.5


def test_textured_model_has_every_plane(answer: Run, result: dict[str, Any]) -> None:
    scene = trimesh.load(answer[1] / "patches.glb")
    names = {int(name.split()[1]): name for name in scene.geometry if name.startswith("plane ")}
    assert set(names) == {plane["id"] for plane in result["planes"]}
    for plane in result["planes"]:
        mesh = scene.geometry[names[plane["id"]]]
        assert mesh.visual.kind == "texture"
        assert len(mesh.faces) > 10


def test_coloured_mesh_has_every_plane(answer: Run, result: dict[str, Any]) -> None:
    mesh = trimesh.load(answer[1] / "patches.ply", process=False)
    assert mesh.visual.kind == "vertex"
    ids = mesh.metadata["_ply_raw"]["vertex"]["data"]["scalar_patch_id"]
    assert set(np.unique(ids).astype(int)) - {0} == {plane["id"] for plane in result["planes"]}


def test_step_pictures_can_be_opened(answer: Run) -> None:
    for name in STEPS:
        assert cv2.imread(str(answer[1] / name)).shape[1] >= 400


@pytest.mark.slow
def test_estimate_with_regions_is_the_same(pair: tuple[str, ...], answer: Run) -> None:
    done = slopemap("estimate", *pair, "--planes", "regions", "--up", "dominant-plane", "--json", "-q")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == (answer[1] / "slopes.json").read_text()


# ---- options ----


def test_options_reach_the_answer(pair: tuple[str, ...], tmp_path: Path) -> None:
    thresholds = ("--min-region", "4", "--gradient-threshold", "2.5", "--merge-px", "3", "--up", "0,-0.6,-0.8")
    out = ("-o", str(tmp_path), "--no-overlay", "--no-ply", "--no-glb")
    done = slopemap("segment", *pair, *thresholds, *out)
    assert done.returncode == 0, done.stderr
    assert {path.name for path in tmp_path.iterdir()} == files_of(without=("overlay", "ply", "glb"))
    result = json.loads((tmp_path / "slopes.json").read_text())
    used = {key: result["options"][key] for key in ("planes", "min_region_percent", "gradient_threshold", "merge_px")}
    assert used == {"planes": "regions", "min_region_percent": 4, "gradient_threshold": 2.5, "merge_px": 3}
    assert result["up"]["source"] == "given"
    assert all(float(row[2]) >= 3.9 for row in rows_of(done))


@pytest.mark.slow
def test_ransac_finds_planes_among_the_matches(pair: tuple[str, ...], tmp_path: Path) -> None:
    done = slopemap(
        "estimate", *pair, "--planes", "ransac", "--up", "dominant-plane", "--min-region", "1", "-o", str(tmp_path)
    )
    assert done.returncode == 0, done.stderr
    assert {path.name for path in tmp_path.iterdir()} == FILES
    rows, result = rows_of(done), json.loads((tmp_path / "slopes.json").read_text())
    assert {plane["source"] for plane in result["planes"]} == {"ransac"}
    assert {"ground", "roof"} <= {row[1] for row in rows}


def test_no_plane_as_large_as_asked_for_is_no_answer(pair: tuple[str, ...], tmp_path: Path) -> None:
    done = slopemap("segment", *pair, "--min-region", "95", "-o", str(tmp_path / "out"))
    assert (done.returncode, done.stdout) == (3, "")
    (line,) = done.stderr.splitlines()
    assert "no plane explains 95 % of image 1" in line
    assert "--min-region" in line
    assert not list(tmp_path.iterdir())


# ---- usage errors: exit 2, said before any file is looked at ----

USAGE = {
    "grid of segment": (["segment", "--grid", "2x2"], "No such option"),
    "planes of segment": (["segment", "--planes", "ransac"], "No such option"),
    "unknown planes": (["estimate", "--planes", "boxes"], "'windows', 'ransac', 'regions'"),
    "grid and regions": (["estimate", "--planes", "regions", "--grid", "2x2"], "--grid is for --planes windows"),
    "window and ransac": (["estimate", "--planes", "ransac", "--window", "1,2,30,40"], "not for ransac"),
    "min region and windows": (["estimate", "--min-region", "1"], "--min-region is for --planes ransac or regions"),
    "merging and windows": (["estimate", "--merge-px", "1"], "--merge-px is for --planes regions, not for windows"),
    "merging and ransac": (["estimate", "--planes", "ransac", "--merge-px", "1"], "not for ransac"),
    "threshold and ransac": (["estimate", "--planes", "ransac", "--gradient-threshold", "1"], "not for ransac"),
    "steps of windows": (["estimate", "--debug-images"], "--debug-images is for --planes regions"),
    "no region": (["segment", "--min-region", "0"], "0<x<=100"),
    "more than the image": (["segment", "--min-region", "101"], "0<x<=100"),
    "no gradient": (["segment", "--gradient-threshold", "0"], "x>0"),
    "gradient nan": (["segment", "--gradient-threshold", "nan"], "not a finite number"),
    "negative merging": (["segment", "--merge-px", "-1"], "x>0"),
    "two cameras": (["segment", "--camera", "c.json"], "--camera and --fov contradict each other"),
}


@pytest.mark.parametrize(("arguments", "said"), USAGE.values(), ids=USAGE)
def test_usage_errors_name_the_option_and_a_way_out(
    arguments: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command, *options = arguments
    out = tmp_path / "out"
    assert run(commands, [command, "no1.png", "no2.png", "--fov", "60", *options, "-o", str(out)]) == 2
    stdout, stderr = capsys.readouterr()
    assert stdout == ""
    assert said in stderr
    assert not out.exists()


@pytest.mark.parametrize("options", [(), ("--fov", "60")], ids=["camera", "output"])
def test_camera_and_output_are_asked_for(options: tuple[str, ...], capsys: pytest.CaptureFixture[str]) -> None:
    assert run(commands, ["segment", "no1.png", "no2.png", *options]) == 2
    assert ("-o DIR, or --json" if options else "--camera FILE") in capsys.readouterr().err
