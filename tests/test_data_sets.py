"""The program holds, on whole sets of pairs with known truth, to the accuracy that docs/accuracy.md states.

The pairs are those of `benchmarks/accuracy.py`, below the folder that SLOPEMAP_DATA names; without it these tests are
skipped. Each set is computed once, and in the ordinary run a third of it.
"""

from __future__ import annotations

import json
import os
import re
import runpy
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

import campaign
import numpy as np
import pytest
from command import slopemap

from slopecli.errors import NoAnswer
from slopecli.geometry import pinhole_of
from slopecli.io import load_image, write_outputs
from slopecli.options import Options
from slopecli.pipeline import estimate
from slopecli.products import report_to_json
from slopecli.types import Camera

DATA = Path(os.environ.get("SLOPEMAP_DATA", "."))
ACCURACY = runpy.run_path(str(Path(__file__).resolve().parent.parent / "benchmarks" / "accuracy.py"))

pytestmark = pytest.mark.skipif(
    "SLOPEMAP_DATA" not in os.environ, reason="SLOPEMAP_DATA names no folder of image pairs"
)


def camera_of(numbers: dict[str, Any]) -> Camera:
    K, distortion = numbers["K"], tuple(numbers["distortion"])
    model = "brown" if any(distortion) else "pinhole"
    focal_and_centre = K[0][0], K[1][1], K[0][2], K[1][2]
    return Camera(numbers["width"], numbers["height"], *focal_and_centre, model, distortion if any(distortion) else ())


def answer_of(pair: Any, windows: bool = True) -> dict[str, Any]:
    """The content of slopes.json, for the windows that the truth lists or for the default grid."""
    images = load_image(pair.image1), load_image(pair.image2)
    cameras = camera_of(pair.cameras[0]), camera_of(pair.cameras[1])
    options = Options(windows=tuple(pair.windows) if windows else ())
    return json.loads(report_to_json(estimate(*images, *cameras, options)))


def judge(pair: Any) -> Any:
    try:
        return ACCURACY["judged"](pair, answer_of(pair))
    except NoAnswer as refusal:
        return ACCURACY["unanswered"](pair, refusal.exit_code, str(refusal))


@lru_cache
def results(name: str) -> list[Any]:
    """Pairs of a set with windows of known truth, against it: every third one, and all in `make test-all`."""
    pairs = [pair for pair in ACCURACY["true_pairs"](DATA, name) if pair.windows]
    if campaign.ALL not in os.environ and len(pairs) > 1:
        pairs = pairs[1::3]
    found = [judge(pair) for pair in pairs]
    assert found, f"no pairs of {name} in {DATA}"
    return found


def errors_of(name: str) -> np.ndarray:
    """(n,) angles between normals, degrees; NaN where a window has no answer."""
    return np.concatenate([result.errors_deg for result in results(name)])


def share_within(name: str, limit_deg: float) -> float:
    return float(np.mean(errors_of(name) <= limit_deg))


def names(results_: list[Any], wrong: Callable[[Any], bool]) -> list[str]:
    return [result.pair.name for result in results_ if wrong(result)]


# ---- rough terrain: vertical, gliding and level flight, roll, oblique views, distortion, exposure ----


def test_terrain_every_window_is_answered() -> None:
    assert np.isfinite(errors_of("rendered/A")).all()


def test_terrain_normals() -> None:
    errors = errors_of("rendered/A")
    assert np.median(errors) <= 0.4
    assert np.quantile(errors, 0.9) <= 1.2
    assert errors.max() <= 3


def test_terrain_motion_of_every_pair() -> None:
    assert not names(results("rendered/A"), lambda result: result.rotation_deg > 0.02)
    assert not names(results("rendered/A"), lambda result: result.direction_deg > 0.2)


def test_terrain_is_as_sure_as_it_is_right() -> None:
    assert not names(results("rendered/A"), lambda result: result.overconfident > 0)


# ---- nine planes, weak and repetitive texture included ----


def test_planes_normals() -> None:
    assert np.median(errors_of("rendered/B")) <= 0.12
    assert share_within("rendered/B", 2.0) >= 0.95


def test_planes_is_as_sure_as_it_is_right() -> None:
    assert not names(results("rendered/B"), lambda result: result.overconfident > 0)


# ---- photographs ----


@pytest.mark.slow
def test_photographs_are_answered() -> None:
    assert np.isfinite(errors_of("real")).mean() >= 0.90


@pytest.mark.slow
@pytest.mark.parametrize(("limit_deg", "least"), [(1, 0.48), (2, 0.65), (5, 0.78)])
def test_photographs_normals(limit_deg: float, least: float) -> None:
    assert share_within("real", limit_deg) >= least


@pytest.mark.slow
def test_photographs_are_seldom_surer_than_right() -> None:
    overconfident = sum(result.overconfident for result in results("real"))
    assert overconfident <= 0.02 * len(errors_of("real"))


# ---- `slopemap validate` against the same truth as depths and disparities ----


def errors_by_validate(pair: Any, folder: Path, *truth: str) -> tuple[np.ndarray, np.ndarray]:
    """Angles between normals as `judged` has them, and as `validate` has them from the files of the truth, degrees."""
    images = load_image(pair.image1), load_image(pair.image2)
    cameras = camera_of(pair.cameras[0]), camera_of(pair.cameras[1])
    report = estimate(*images, *cameras, Options(windows=tuple(pair.windows)))
    write_outputs(report, images[0], folder)
    done = slopemap("validate", str(folder), *truth, "--json")
    assert done.returncode == 0, done.stderr
    known = {one["id"]: one["normal_error_deg"] for one in json.loads(done.stdout)["planes"]}
    judged = ACCURACY["judged"](pair, json.loads(report_to_json(report))).errors_deg
    assert set(known) == set(np.flatnonzero(np.isfinite(judged)) + 1)
    return judged[np.isfinite(judged)], np.array([known[id] for id in sorted(known)])


@pytest.mark.parametrize(
    "name", ["Pipes", *(pytest.param(name, marks=pytest.mark.slow) for name in ("Jadeplant", "Piano", "Shelves"))]
)
def test_validate_finds_the_errors_from_a_disparity_and_its_surfaces(name: str, tmp_path: Path) -> None:
    (pair,) = ACCURACY["true_pairs"](DATA, f"/{name}.truth")
    stem = str(pair.path).removesuffix(".truth.json")
    truth = ("--disparity", f"{stem}_disp0GT.npz", "--baseline", str(np.linalg.norm(pair.T)))
    errors, found = errors_by_validate(pair, tmp_path, *truth, "--labels", f"{stem}_planes.png")
    assert found == pytest.approx(errors, abs=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["A01_vertical", "A08_horizontal", "B02_strong", "B04_weak", "C04_suburb"])
def test_validate_finds_the_errors_from_a_rendered_depth(name: str, tmp_path: Path) -> None:
    (pair,) = ACCURACY["true_pairs"](DATA, f"rendered/{name}")
    errors, found = errors_by_validate(pair, tmp_path, "--depth", str(pair.path.parent / "depth.npz"))
    assert found == pytest.approx(errors, abs=0.1)


# ---- hostile pairs ----


def hostile(name: str) -> Any:
    (pair,) = ACCURACY["true_pairs"](DATA, f"rendered/{name}")
    return pair


@pytest.mark.parametrize(
    ("name", "code"),
    [
        # of the others test_pipeline.py has one each
        *(
            pytest.param(name, code, marks=pytest.mark.slow)
            for name, code in (
                ("D01_pure_rotation", "pure-rotation"),
                ("D03_no_overlap", "no-overlap"),
                ("D05_textureless", "low-texture"),
            )
        ),
        ("D04_identical", "pure-rotation"),
    ],
)
def test_a_pair_without_an_answer_is_refused(name: str, code: str) -> None:
    with pytest.raises(NoAnswer) as refusal:
        answer_of(hostile(name))
    assert refusal.value.code == code
    assert refusal.value.remedy


def diagnostics_of(answer: dict[str, Any]) -> set[str]:
    return {diagnostic["code"] for diagnostic in answer["diagnostics"]}


@pytest.mark.parametrize("windows", [True, pytest.param(False, marks=pytest.mark.slow)], ids=["one window", "grid"])
def test_one_plane_leaves_both_answers_open(windows: bool) -> None:
    pair = hostile("D02_single_plane")
    answer = answer_of(pair, windows)
    assert answer["ambiguity"]["status"] == "unresolved"
    assert "single-plane" in diagnostics_of(answer)
    alternative = {plane["id"]: plane for plane in answer["ambiguity"]["alternative"]["planes"]}
    for plane in answer["planes"]:
        either = (plane["normal_cam1"], alternative[plane["id"]]["normal_cam1"])
        assert min(ACCURACY["angle_deg"](np.array(normal), pair.normals[0]) for normal in either) < 0.5
        assert plane["verdict"] != "safe" or max(plane["slope_deg"], alternative[plane["id"]]["slope_deg"]) < 15


@pytest.mark.slow  # test_pipeline.py names that of the sample
def test_the_window_the_camera_moves_towards_is_named() -> None:
    assert "foe-in-window" in diagnostics_of(answer_of(hostile("D06_forward_foe_in_window")))


def test_little_parallax_is_warned_of_and_yet_right() -> None:
    pair = hostile("D07_weak_baseline_2pct")
    answer = answer_of(pair)
    assert "low-parallax" in diagnostics_of(answer)
    truth = json.loads(pair.path.read_text(encoding="utf-8"))["windows_3x3"]
    for plane in answer["planes"]:
        outward = -np.array(truth[plane["id"] - 1]["n_visible_fit"])
        # its terrain is rough: the plane of what image 2 sees is known to about two degrees
        assert ACCURACY["angle_deg"](np.array(plane["normal_cam1"]), outward) < 2 + 3 * plane["slope_sigma_deg"]


def test_a_shadow_that_moved_is_told_and_the_windows_it_touches() -> None:
    answer = answer_of(hostile("D08_moving_shadow"), windows=False)
    (warning,) = (d for d in answer["diagnostics"] if d["code"] == "dense-shadow-or-motion")
    assert "window 5 (" in warning["message"]
    assert 0.02 < warning["value"] < 0.06


@pytest.mark.slow
@pytest.mark.parametrize("name", ["rendered/A", "rendered/B", "rendered/C", "rendered/D09", "real"])
def test_nothing_is_suspected_of_pairs_as_they_should_be(name: str) -> None:
    """Vehicles that drive over less than a hundredth of the image are left to the robust solution."""
    suspicions = {"dense-shadow-or-motion", "suspect-distortion"}
    assert [pair.name for pair in ACCURACY["true_pairs"](DATA, name) if suspicions & said_of(pair)] == []


@pytest.mark.parametrize(
    "name", ["A04_marsyard", *(pytest.param(name, marks=pytest.mark.slow) for name in ("A08_horizontal", "C06_suburb"))]
)
def test_a_distortion_that_is_not_given_is_suspected(name: str) -> None:
    (pair,) = ACCURACY["true_pairs"](DATA, f"rendered/{name}")
    images = load_image(pair.image1), load_image(pair.image2)
    cameras = [pinhole_of(camera_of(numbers)) for numbers in pair.cameras]
    report = estimate(*images, *cameras, Options())
    (warning,) = (d for d in report.diagnostics if d.code == "suspect-distortion")
    stated = re.search(r"\((\d+\.\d) ± \d+\.\d px \d+ px off the centre, as far as matches reach\)", warning.message)
    # a descent has no matches near the corners: there the size is told where they end, and none at the corner
    assert (warning.value if stated is None else float(stated[1])) > 10
    assert (warning.value is None) == (stated is not None)


def said_of(pair: Any) -> set[str]:
    try:
        return diagnostics_of(answer_of(pair, windows=False))
    except NoAnswer as refusal:
        return {refusal.code}


def test_moving_vehicles_do_not_move_the_ground() -> None:
    (result,) = results("rendered/D09")
    assert result.errors_deg.max() < 0.2
    assert result.rotation_deg < 0.02


def test_boulder_fields_are_called_what_they_are() -> None:
    answer = answer_of(hostile("D10_nonplanar"), windows=False)
    marked = [plane for plane in answer["planes"] if plane["reason"] == "non-planar-patch"]
    assert "non-planar-patch" in diagnostics_of(answer)
    assert len(marked) >= 3
    assert all(plane["status"] == "poor" and plane["verdict"] != "safe" for plane in marked)
