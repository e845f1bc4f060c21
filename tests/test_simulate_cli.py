"""`slopemap simulate` as a user meets it: files, bytes, verdicts, and what it refuses."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path

import cv2
import numpy as np
import pytest

from slopecli.cli import run as run_command
from slopecli.cli import slopemap
from slopecli.io import FIGURES, STUDY_NAMES, TIMED

ROOT = Path(__file__).resolve().parent.parent
QUICK = ["--terrains", "2", "--noise", "0,0.3", "--solvers", "mle,ha", "--most-windows", "0"]


def run(*arguments: str) -> int:
    return run_command(slopemap, ["simulate", *arguments])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small study, on one process, time left out."""
    place = tmp_path_factory.mktemp("study")
    assert run("-o", str(place), *QUICK, "--jobs", "1", "-q") == 0
    return place


@pytest.fixture
def _no_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """For what is not of the figures: they take most of the time of a small study."""
    monkeypatch.setattr("slopecli.io.study_files.draw_figures", lambda *_: {})


def test_every_file_is_there_and_is_what_its_name_says(folder: Path) -> None:
    assert {path.name for path in folder.iterdir()} == set(STUDY_NAMES) - set(TIMED)
    for name in FIGURES:
        if name.endswith(".png"):
            assert min(cv2.imread(str(folder / name)).shape[:2]) > 400
        else:
            assert (folder / name).read_text("utf-8").rstrip().endswith("</svg>")


def test_tables_hold_every_trial_and_scene(folder: Path) -> None:
    with open(folder / "trials.csv", encoding="utf-8") as file:
        trials = list(csv.DictReader(file))
    assert len(trials) == 3 * 2 * 2 * 2
    assert {row["solver"] for row in trials} == {"mle", "ha"}
    exact = [row for row in trials if float(row["noise_px"]) == 0.0 and row["solver"] == "mle"]
    assert max(float(row["rotation_error_deg"]) for row in exact) < 1e-6
    with open(folder / "scenes.csv", encoding="utf-8") as file:
        scenes = list(csv.DictReader(file))
    assert len(scenes) == 12
    assert all(0.0 <= float(row["true_slope_deg_window_8"]) <= 40.0 for row in scenes)
    assert [float(row["rotation_bound_deg"]) > 0.0 for row in scenes] == [
        float(row["noise_px"]) > 0.0 for row in scenes
    ]


def test_summary_judges_every_claim_and_agrees_with_the_table_of_trials(folder: Path) -> None:
    summary = json.loads((folder / "summary.json").read_text("ascii"))
    claims = {claim["name"]: claim for claim in summary["claims"]}
    assert claims["all-answered"]["held"] is True
    assert claims["one-epipolar-geometry"]["held"] is True
    assert claims["twice-as-accurate"] | {"statement": ""} == {
        "name": "twice-as-accurate",
        "source": "Fig. 4",
        "statement": "",
        "measured": None,
        "limit": "> 2",
        "held": None,
        "reason": "solver lh was not run",
    }
    with open(folder / "trials.csv", encoding="utf-8") as file:
        vertical = [
            float(row["rotation_error_deg"])
            for row in csv.DictReader(file)
            if (row["solver"], float(row["trajectory_deg"]), float(row["noise_px"])) == ("ha", 0.0, 0.3)
        ]
    assert summary["solvers"]["ha"]["mean"]["rotation_deg"][0][1] == pytest.approx(np.mean(vertical), rel=1e-6)
    assert summary["solvers"]["ha"]["answered"] == summary["solvers"]["ha"]["trials"] == 12


@pytest.mark.slow
def test_same_seed_same_bytes_on_any_number_of_workers(folder: Path, tmp_path: Path) -> None:
    assert run("-o", str(tmp_path), *QUICK, "--jobs", "3", "-q") == 0
    for name in sorted(set(STUDY_NAMES) - set(TIMED)):
        assert (tmp_path / name).read_bytes() == (folder / name).read_bytes(), name


@pytest.mark.usefixtures("_no_figures")
def test_another_seed_is_another_study(folder: Path, tmp_path: Path) -> None:
    assert run("-o", str(tmp_path), *QUICK, "--seed", "1", "--jobs", "1", "-q") == 0
    assert (tmp_path / "trials.csv").read_bytes() != (folder / "trials.csv").read_bytes()


@pytest.mark.usefixtures("_no_figures")
def test_times_have_files_of_their_own_which_a_study_without_them_takes_away(tmp_path: Path) -> None:
    small = ["--terrains", "1", "--noise", "0.3", "--solvers", "mle", "--jobs", "1", "-q", "-o", str(tmp_path)]
    assert run(*small, "--most-windows", "64") == 0
    assert {path.name for path in tmp_path.iterdir()} == set(STUDY_NAMES) - set(FIGURES)
    timing = json.loads((tmp_path / "timing.json").read_text("ascii"))
    assert [entry["windows"] for entry in timing["timings"]] == [4, 16, 64]
    assert run(*small, "--most-windows", "0") == 0
    assert not {path.name for path in tmp_path.iterdir()} & set(TIMED)


@pytest.mark.usefixtures("_no_figures")
def test_verdicts_are_printed_and_talk_is_apart(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("-o", str(tmp_path), *QUICK, "--jobs", "1", "-v") == 0
    out, err = capsys.readouterr()
    assert re.search(r"^yes +no trial fails", out, re.MULTILINE)
    assert re.search(r"^- +at least twice as accurate", out, re.MULTILINE)
    assert "wrote" in err
    assert "trials" in err


@pytest.mark.usefixtures("_no_figures")
def test_other_scenes_through_a_lens(tmp_path: Path) -> None:
    camera = tmp_path / "camera.json"
    camera.write_text(
        json.dumps(
            {"width": 800, "height": 600, "fx": 700, "fy": 700, "cx": 399.5, "cy": 299.5, "distortion": [-0.2, 0.05]}
        )
    )
    wild = ["--trajectories", "30", "--grid", "4x2", "--relief", "0.01", "--outliers", "0.1", "--noise1", "0.1"]
    wild += ["--heading", "120", "--noise", "0.2", "--terrains", "2", "--most-windows", "0", "--solvers", "mle"]
    assert run("-o", str(tmp_path / "out"), "--camera", str(camera), *wild, "-q", "--jobs", "1") == 0
    summary = json.loads((tmp_path / "out" / "summary.json").read_text("ascii"))
    assert summary["camera"]["model"] == "brown"
    assert np.shape(summary["solvers"]["mle"]["rms"]["slopes_deg"]) == (1, 1, 8)
    # a tenth of the points are wrong by up to 40 px, and yet:
    assert summary["solvers"]["mle"]["rms"]["rotation_deg"][0][0] < 0.2


@pytest.mark.parametrize(
    ("arguments", "status", "said"),
    [
        (["--noise", "0.1,x"], 2, "is not a list of numbers"),
        (["--noise", "0.1,0.1"], 2, "a number twice"),
        (["--noise", "-1"], 2, "not between"),
        (["--noise", "nan"], 2, "not between"),
        (["--solvers", "mle,guess"], 2, "is not a list of mle, ha, lh"),
        (["--size", "1024"], 2, "is not WIDTHxHEIGHT"),
        (["--camera", "missing.json", "--fov", "50"], 2, "contradict"),
        (["--camera", "missing.json"], 1, "missing.json"),
        (["--max-slope", "89", "--terrains", "5"], 1, "too steep"),
        (["--baseline-over-height", "2"], 1, "below the ground"),
    ],
)
def test_what_cannot_be_is_refused_in_a_line(
    arguments: list[str], status: int, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("-o", str(tmp_path / "out"), *QUICK[:2], *arguments, "--jobs", "1") == status
    err = capsys.readouterr().err
    assert said in err
    assert "Traceback" not in err
    assert not (tmp_path / "out").exists()


def test_folder_that_cannot_be_written_is_said_before_the_work(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("")
    assert run("-o", str(tmp_path / "file" / "out")) == 1  # the whole study would take a minute
    assert "is not a folder" in capsys.readouterr().err


# ---- docs/simulate.md ----

PAGE = (ROOT / "docs" / "simulate.md").read_text(encoding="utf-8")


def test_page_shows_the_verdicts_there_are(folder: Path) -> None:
    shown = PAGE.split("<!-- study: begin -->")[1].split("<!-- study: end -->")[0]
    for claim in json.loads((folder / "summary.json").read_text("ascii"))["claims"]:
        assert re.search(rf"^(yes|no) +{re.escape(claim['statement'])} +\S+ +{claim['limit']}", shown, re.MULTILINE)


def test_pictures_of_the_page_are_small() -> None:
    pictures = [ROOT / "docs" / name for name in re.findall(r"\((images/simulate_\w+\.png)\)", PAGE)]
    assert len(pictures) == 4
    assert all(picture.stat().st_size < 150_000 for picture in pictures)


def test_page_names_every_file(folder: Path) -> None:
    for name in STUDY_NAMES:
        assert name in PAGE or name.rpartition(".")[0] in PAGE


def test_code_of_the_page_runs() -> None:
    (code,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    names: dict[str, object] = {}
    exec(code, names)
    assert len(names["flight"]) == 2  # type: ignore[arg-type]


@pytest.mark.usefixtures("_no_figures")
def test_three_points_in_a_window_are_enough_for_mle_and_the_others_say_why_not(tmp_path: Path) -> None:
    few = ["--points", "3", "--terrains", "1", "--noise", "0.3", "--solvers", "mle,ha", "--most-windows", "16"]
    assert run("-o", str(tmp_path), *few, "--jobs", "1", "-q") == 0
    with open(tmp_path / "trials.csv", encoding="utf-8") as file:
        trials = list(csv.DictReader(file))
    assert {row["solver"] for row in trials if row["reason"]} == {"ha"}
    with open(tmp_path / "timing.csv", encoding="utf-8") as file:
        assert {row["solver"] for row in csv.DictReader(file)} == {"mle"}
