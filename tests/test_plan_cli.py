"""`slopemap plan` as a user meets it: table, JSON, files, refusals."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from command import slopemap

from slopecli.plan import PlanOptions, draw_plan, make_plan, sigma_colours
from slopecli.study import field_of_view_camera
from slopecli.windows import grid_windows

ROOT = Path(__file__).resolve().parent.parent
CAMERA = ("--camera", str(ROOT / "sample_data" / "descent" / "camera.json"))
PAPER = ("--fov", "60", "--size", "1024x1024", "--trajectory", "45")
FLIGHT = (*PAPER, "--height", "80", "--baseline", "16")


def planned(*arguments: str) -> dict[str, Any]:
    done = slopemap("plan", *arguments, "--json")
    assert done.returncode == 0, done.stderr
    answer: dict[str, Any] = json.loads(done.stdout)
    return answer


# ---- what is printed and written ----


def test_table_has_a_line_per_window_and_what_holds_for_all() -> None:
    done = slopemap("plan", *FLIGHT)
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert lines[0].split() == ["id", "sigma", "parallax", "in", "image", "2", "note"]
    assert [line.split()[0] for line in lines[1:10]] == [str(number) for number in range(1, 10)]
    assert re.fullmatch(r" 5 +0\.\d+° +[\d.]+ px +100 %", lines[5])
    assert lines[10] == "baseline: 16 m, 0.2 of the height of 80 m"
    assert re.fullmatch(r"sigma: [\d.]+° in the worst window, [\d.]+° in the median", lines[11])
    assert re.fullmatch(r"parallax: [\d.]+ px in the median", lines[12])
    assert lines[13] == "two answers: unlikely (0 % of simulated pairs)"


def test_json_is_the_table_for_programs() -> None:
    answer, table = planned(*FLIGHT), slopemap("plan", *FLIGHT).stdout
    shown = [float(line.split()[1].rstrip("°")) for line in table.splitlines()[1:10]]
    assert [window["slope_sigma_deg"] for window in answer["windows"]] == pytest.approx(shown, rel=0.1)
    assert answer["worst_sigma_deg"] == max(window["slope_sigma_deg"] for window in answer["windows"])
    assert (answer["unit"], answer["height"], answer["baseline"], answer["wanted"]) == ("m", 80, 16, None)
    assert [window["window"] for window in answer["windows"]] == [list(w) for w in grid_windows(3, 3, 1024, 1024)]


def test_files_are_the_plan_and_its_map_and_the_same_every_time(tmp_path: Path) -> None:
    for name in ("one", "two"):
        done = slopemap("plan", *FLIGHT, "-o", str(tmp_path / name))
        assert done.returncode == 0, done.stderr
        assert f"wrote {tmp_path / name / 'plan.json'}, {tmp_path / name / 'plan.png'}" in done.stderr
        assert sorted(os.listdir(tmp_path / name)) == ["plan.json", "plan.png"]
    for name in ("plan.json", "plan.png"):
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()
    assert json.loads((tmp_path / "one" / "plan.json").read_text("ascii")) == planned(*FLIGHT)
    picture = cv2.imread(str(tmp_path / "one" / "plan.png"))
    assert picture.shape[1] == 1024
    assert picture.shape[0] > 1024  # the legend


def test_answers_of_estimate_in_the_same_folder_stay(tmp_path: Path) -> None:
    (tmp_path / "slopes.json").write_text("{}")
    assert slopemap("plan", *FLIGHT, "-o", str(tmp_path)).returncode == 0
    assert sorted(os.listdir(tmp_path)) == ["plan.json", "plan.png", "slopes.json"]


def test_baseline_for_a_sigma() -> None:
    answer = planned(*PAPER, "--height", "80", "--sigma", "0.5")
    assert answer["wanted"] == {"sigma_deg": 0.5, "of": "worst"}
    assert answer["worst_sigma_deg"] == pytest.approx(0.5, rel=1e-3)
    again = planned(*PAPER, "--height", "80", "--baseline", str(answer["baseline"]))
    assert again["worst_sigma_deg"] == pytest.approx(0.5, rel=1e-3)
    median = planned(*PAPER, "--height", "80", "--sigma", "0.5", "--of", "median")
    assert median["baseline"] < answer["baseline"]
    assert median["median_sigma_deg"] == pytest.approx(0.5, rel=1e-3)
    share = slopemap("plan", *PAPER, "--sigma", "0.5").stdout
    assert f"baseline: {answer['baseline'] / 80:.3g} of the height\n" in share


def test_height_alone_is_in_baselines() -> None:
    answer = planned(*PAPER, "--height", "5")
    assert (answer["unit"], answer["height"], answer["baseline"]) == ("baseline", 5, 1)
    assert answer["windows"] == planned(*FLIGHT)["windows"]


def test_camera_files_windows_and_directions() -> None:
    one = planned(*CAMERA, "--direction", "1,0,0", "--height", "5", "--window", "100,100,200,150")
    assert (one["camera"]["width"], one["camera"]["model"]) == (800, "brown")
    assert [window["window"] for window in one["windows"]] == [[100, 100, 200, 150]]
    assert one["direction_cam1"] == [1, 0, 0]
    half = slopemap("plan", *CAMERA, "--direction", "1,0,0", "--height", "5", "--size", "400x400")
    assert half.returncode == 0
    assert "intrinsics scaled by 0.5" in half.stderr
    four = planned("--intrinsics", "800,800,511.5,383.5", "--size", "1024x768", "--trajectory", "60", "--height", "5")
    assert (four["camera"]["fx"], four["camera"]["height"]) == (800, 768)


def test_ground_and_up_are_those_asked_for() -> None:
    up = ("--up", "0,-0.5,-0.8", "--up-sigma", "0.5", "--ground-slope", "8", "--aspect", "90", "--uneven", "2")
    answer = planned(*FLIGHT, *up, "--north", "1,0,0")
    assert answer["ground"] == {"slope_deg": 8, "aspect_deg": 90, "uneven_deg": 2, "roughness": PlanOptions.roughness}
    assert (answer["up"]["source"], answer["up"]["sigma_deg"]) == ("given", 0.5)
    assert answer["worst_sigma_deg"] > 0.5


def test_a_window_whose_middle_is_on_the_horizon_is_refused_without_a_word_of_numpy() -> None:
    flight = ("--trajectory", "90", "--height", "80", "--baseline", "8")
    done = slopemap("plan", *CAMERA, *flight, "--up", "0,-1,0")
    assert done.returncode == 0
    assert "no answer" in done.stdout.splitlines()[1]
    assert "Warning" not in done.stderr


def test_windows_refused_and_second_answers_are_said() -> None:
    far = slopemap("plan", "--fov", "60", "--size", "1024x1024", "--trajectory", "90", "--height", "2")
    assert re.search(r"^ 1 +- +- +\d+ %  no answer: image 2 does not show its ground$", far.stdout, re.MULTILINE)
    flat = slopemap("plan", *FLIGHT, "--roughness", "0")
    assert re.search(
        r"^sigma: .* in the median, if it is known which of two answers is right$", flat.stdout, re.MULTILINE
    )
    assert re.search(r"^two answers: likely \(.*\); the first by itself is off by \d\d°$", flat.stdout, re.MULTILINE)
    assert "warning: single-plane: two answers are likely" in flat.stderr
    assert "this baseline gives" not in flat.stderr
    wanted = slopemap("plan", *PAPER, "--height", "80", "--sigma", "0.2", "--roughness", "0")
    assert wanted.returncode == 0
    assert "sigmas hold for who knows which is right, the first by itself is off by" in wanted.stderr
    assert "and this baseline gives 0.2° to no one else; give estimate the motion" in wanted.stderr
    assert slopemap("plan", *FLIGHT, "--roughness", "0", "-q").stderr == ""


def test_windows_shown_in_part_say_what_the_rest_adds() -> None:
    level = ["plan", *CAMERA, "--trajectory", "90", "--height", "1", "--baseline", "0.2"]
    lines = slopemap(*level).stdout.splitlines()
    assert re.search(r"± \d\.\d° for the rest of it$", lines[1])
    assert re.search(r"100 %$", lines[2])
    assert lines[-1] == (
        "the rest: sigma is for the part of a window that image 2 shows; estimate adds uncertainty for the rest"
    )
    assert "the rest" not in slopemap(*level[:-1], "0.005").stdout


# ---- refusals ----

USAGE = {
    "no camera": (["--trajectory", "0", "--height", "5"], "No camera: give --camera FILE"),
    "two cameras": ([*FLIGHT, *CAMERA], "contradict each other"),
    "no size": (["--fov", "60", "--trajectory", "0", "--height", "5"], "No image size"),
    "bad size": (["--fov", "60", "--size", "1024", "--height", "5"], "not WIDTHxHEIGHT in px, for example 1024x768"),
    "no direction": (["--fov", "60", "--size", "100x100", "--height", "5"], "No direction of motion"),
    "two directions": ([*FLIGHT, "--direction", "1,0,0"], "contradict each other"),
    "no height": (list(PAPER), "No height"),
    "baseline and sigma": ([*FLIGHT, "--sigma", "1"], "--baseline and --sigma contradict each other"),
    "sigma 0": ([*PAPER, "--sigma", "0"], "'--sigma'"),
    "of without sigma": ([*FLIGHT, "--of", "median"], "--of is for --sigma"),
    "aspect without slope": ([*FLIGHT, "--aspect", "20"], "--aspect is for --ground-slope"),
    "dominant plane": ([*FLIGHT, "--up", "dominant-plane"], "no plane is known before the flight"),
    "direction zero": ([*FLIGHT, "--direction", "0,0,0"], "must not be zero"),
    "height nan": ([*PAPER, "--height", "nan"], "'--height'"),
    "few points": ([*FLIGHT, "--points", "3"], "'--points'"),
    "no noise": ([*FLIGHT, "--noise", "0"], "'--noise'"),
    "grid and window": ([*FLIGHT, "--grid", "2x2", "--window", "0,0,50,50"], "contradict each other"),
    "empty output": ([*FLIGHT, "-o", ""], "it is empty"),
}


@pytest.mark.parametrize(("arguments", "message"), USAGE.values(), ids=USAGE)
def test_a_wrong_command_line_is_one_line(arguments: list[str], message: str) -> None:
    done = slopemap("plan", *arguments)
    assert (done.returncode, done.stdout) == (2, "")
    assert message in done.stderr
    assert "Traceback" not in done.stderr


REFUSED = {
    "no such camera": (["--camera", "none.json", "--trajectory", "9", "--height", "5"], 1, "no such camera file"),
    "another shape": ([*CAMERA, "--size", "400x300", "--trajectory", "9", "--height", "5"], 1, "not the same view"),
    "window outside": ([*FLIGHT, "--window", "1000,0,100,100"], 1, "is not inside image 1"),
    "north vertical": ([*FLIGHT, "--north", "0,0,1"], 1, "north is vertical"),
    "output is a file": ([*FLIGHT, "-o", __file__], 1, "is not a folder"),
    "no parallax": ([*PAPER, "--height", "100000"], 3, "pure-rotation"),
    "no overlap": ([*PAPER, "--height", "0.3"], 3, "no-overlap"),
    "up hardly known": ([*PAPER, "--sigma", "0.5", "--up-sigma", "1"], 3, "up itself is known to 1 deg; ask for"),
    "no such sigma": ([*PAPER, "--sigma", "0.001"], 3, "no baseline reaches 0.001 deg in the worst window"),
}


@pytest.mark.parametrize(("arguments", "status", "message"), REFUSED.values(), ids=REFUSED)
def test_what_cannot_be_planned_is_one_line(arguments: list[str], status: int, message: str) -> None:
    done = slopemap("plan", *arguments)
    assert (done.returncode, done.stdout) == (status, "")
    assert message in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_nothing_is_written_where_there_is_no_plan(tmp_path: Path) -> None:
    assert slopemap("plan", *PAPER, "--height", "100000", "-o", str(tmp_path / "out")).returncode == 3
    assert not (tmp_path / "out").exists()


# ---- the map ----


def test_windows_of_the_map_have_the_colour_of_their_sigma() -> None:
    camera = field_of_view_camera()
    plan = make_plan(camera, grid_windows(3, 3, 1024, 1024), PlanOptions(trajectory_deg=90.0, height=4.0))
    picture = draw_plan(plan)[:1024, :, ::-1]
    for one in plan.windows:
        x, y, w, h = one.window
        assert one.slope_sigma_deg is not None
        assert (picture[y + h // 5, x + w // 2] == sigma_colours(np.array([one.slope_sigma_deg]))[0]).all()


def test_colours_of_sigmas_are_fixed_and_ordered() -> None:
    colours = sigma_colours(np.array([0.001, 0.03, 0.3, 3.0, 10.0, 100.0])).astype(int)
    assert (colours[0] == colours[1]).all()
    assert (colours[-1] == colours[-2]).all()
    assert (np.diff(colours[1:5].sum(axis=1)) > 0).all()


# ---- the command line ----


def test_help_loads_nothing_heavy() -> None:
    script = "import sys; from slopecli.cli import slopemap; slopemap(['plan', '--help'], standalone_mode=False)\n"
    script += "sys.exit(any(name in sys.modules for name in ('numpy', 'cv2', 'PIL', 'yaml')))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert done.returncode == 0
    assert "--trajectory" in done.stdout
