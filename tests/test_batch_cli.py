"""`slopemap batch` as a user meets it: pairs, files, streams, exit status, refusals."""

from __future__ import annotations

import csv
import io
import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import click
import cv2
import pytest
from command import Done, in_a_process, slopemap
from output_names import files_of
from rich.console import Console
from test_cli import DESCENT

from slopecli.batch import Outcome, Progress
from slopecli.cli import BatchProgress, Talk, batch_table, draw_table

SCALE = 0.16
COUNT = 5  # images: two views in turn, so four pairs
SUMMARIES = {"summary.csv", "results.jsonl", "index.html"}
NAMES = [f"view_{number}-view_{number + 1}" for number in range(8, 12)]
Run = tuple[Done, Path]


def make_flight(folder: Path) -> Path:
    """Images view_8 to view_12, small ones of the sample pair in turn, and their camera."""
    folder.mkdir()
    for number in range(COUNT):
        image = cv2.imread(str(DESCENT / f"image{1 + number % 2}.png"), cv2.IMREAD_GRAYSCALE)
        small = cv2.resize(image, None, fx=SCALE, fy=SCALE, interpolation=cv2.INTER_AREA)
        cv2.imwrite(str(folder / f"view_{8 + number}.png"), small)
    shutil.copy(DESCENT / "camera.json", folder)
    return folder


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_flight(tmp_path_factory.mktemp("flight") / "images")


@pytest.fixture(scope="module")
def answer(flight: Path, tmp_path_factory: pytest.TempPathFactory) -> Run:
    """One ordinary run."""
    folder = tmp_path_factory.mktemp("answer") / "new" / "out"
    return in_a_process("batch", str(flight), "-o", str(folder), "--jobs", "2"), folder


def lines_of(folder: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (folder / "results.jsonl").read_text().splitlines()]


def contents_of(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


# ---- an answer ----


def test_every_pair_has_its_line_its_folder_and_its_row(answer: Run) -> None:
    done, folder = answer
    assert done.returncode == 0, done.stderr
    assert [line.split()[0] for line in done.stdout.splitlines()[1:]] == NAMES
    assert SUMMARIES | set(NAMES) == {path.name for path in folder.iterdir() if not path.name.startswith(".")}
    assert [line["name"] for line in lines_of(folder)] == NAMES
    rows = list(csv.DictReader((folder / "summary.csv").open(encoding="utf-8")))
    assert [(row["name"], row["exit_status"]) for row in rows] == [(name, "0") for name in NAMES]


def test_a_pair_has_the_files_that_estimate_writes(answer: Run, flight: Path, tmp_path: Path) -> None:
    """The processes of a batch have one thread each; it must not show."""
    images = [str(flight / f"view_{number}.png") for number in (8, 9)]
    asked = ("estimate", *images, "--camera", str(flight / "camera.json"), "-o", str(tmp_path))
    done = in_a_process(*asked, OPENCV_FOR_THREADS_NUM="3")
    assert done.returncode == 0, done.stderr
    ours = contents_of(answer[1] / NAMES[0])
    ours.pop("pair.json")
    assert ours == contents_of(tmp_path)


def test_table_says_what_the_files_say(answer: Run) -> None:
    done, folder = answer
    for line, outcome in zip(done.stdout.splitlines()[1:], lines_of(folder), strict=True):
        planes = json.loads((folder / outcome["name"] / "slopes.json").read_text())["planes"]
        assert f"{max(plane['slope_deg'] for plane in planes if plane['status'] == 'ok'):.2f} ±" in line
        verdicts = [plane["verdict"] for plane in planes]
        assert [outcome[f"n_{verdict}"] for verdict in ("safe", "unsafe", "undecided")] == [
            verdicts.count(verdict) for verdict in ("safe", "unsafe", "undecided")
        ]


def test_the_camera_found_and_the_outcome_are_said_on_stderr(answer: Run, flight: Path) -> None:
    done, folder = answer
    assert f"camera: {flight / 'camera.json'}, found beside the images" in done.stderr
    assert "4 pairs: 4 answered, 0 without an answer" in done.stderr
    assert str(folder / "index.html") in done.stderr
    assert "camera" not in done.stdout


@pytest.mark.usefixtures("_worker_here")
def test_a_second_run_keeps_everything_as_it_is(answer: Run, flight: Path) -> None:
    done, folder = answer
    before = {path: path.stat().st_mtime_ns for path in folder.glob("*/*")}
    again = slopemap("batch", str(flight), "-o", str(folder))
    assert (again.returncode, again.stdout) == (0, done.stdout)
    assert {path: path.stat().st_mtime_ns for path in folder.glob("*/*")} == before


@pytest.mark.usefixtures("_worker_here")
def test_quiet_says_nothing_and_verbose_every_pair(answer: Run, flight: Path) -> None:
    arguments = ("batch", str(flight), "-o", str(answer[1]))
    assert slopemap(*arguments, "-q").stderr == ""
    verbose = slopemap(*arguments, "-v")
    assert all(f"{name}: answered" in verbose.stderr for name in NAMES)


@pytest.mark.usefixtures("_worker_here")
def test_options_of_estimate_reach_every_pair(flight: Path, tmp_path: Path) -> None:
    options = ("--grid", "1x2", "--tolerance", "30", "--no-overlay", "--no-ply", "--jobs", "1")
    done = slopemap("batch", str(flight), "-o", str(tmp_path), "--pairing", "stride", "--stride", "3", *options)
    assert done.returncode == 0, done.stderr
    for outcome in lines_of(tmp_path):
        result = json.loads((tmp_path / outcome["name"] / "slopes.json").read_text())
        assert (result["options"]["grid"], result["options"]["tolerance_deg"]) == ([1, 2], 30.0)
        assert set(outcome["files"]) == files_of(without=("overlay", "ply"))
    assert [outcome["name"] for outcome in lines_of(tmp_path)] == ["view_8-view_11", "view_9-view_12"]


@pytest.mark.usefixtures("_worker_here")
def test_segment_finds_regions_and_takes_the_largest_as_level(flight: Path, tmp_path: Path) -> None:
    (tmp_path / "pairs.csv").write_text("view_8.png,view_9.png\n")
    arguments = ("--pairing", str(tmp_path / "pairs.csv"), "--command", "segment", "-o", str(tmp_path / "out"))
    done = slopemap("batch", str(flight), *arguments)
    assert done.returncode == 0, done.stderr
    result = json.loads((tmp_path / "out" / NAMES[0] / "slopes.json").read_text())
    assert {plane["source"] for plane in result["planes"]} == {"region"}
    assert result["up"]["source"] == "dominant-plane"
    assert (tmp_path / "out" / NAMES[0] / "patches.glb").exists()


@pytest.mark.skipif(os.name != "posix", reason="needs a shell of POSIX")
@pytest.mark.parametrize("stderr", ["2>&-", pytest.param("2>/dev/full", marks=pytest.mark.slow)])
def test_nobody_who_listens_does_not_end_the_work(stderr: str, answer: Run, flight: Path, tmp_path: Path) -> None:
    (tmp_path / "pairs.csv").write_text("view_8.png,view_9.png\nview_9.png,view_10.png\n")
    output = tmp_path / "out"
    command = [sys.executable, "-m", "slopecli", "batch", str(flight), "-v", "-o", str(output), "--jobs", "1"]
    done = subprocess.run(
        ["sh", "-c", f'"$@" {stderr}', "sh", *command, "--pairing", str(tmp_path / "pairs.csv")],
        capture_output=True,
        encoding="utf-8",
        check=False,
    )
    assert done.returncode == 0
    rows, all_rows = ([line.split() for line in text.splitlines()] for text in (done.stdout, answer[0].stdout))
    assert rows == all_rows[:3]
    for name in NAMES[:2]:
        assert contents_of(output / name) == contents_of(answer[1] / name)
    assert {path.name for path in output.iterdir()} >= SUMMARIES


# ---- pairs without an answer ----


@pytest.mark.usefixtures("_worker_here")
def test_bad_images_are_named_and_the_good_are_answered(tmp_path: Path) -> None:
    flight, output = make_flight(tmp_path / "images"), tmp_path / "out"
    (flight / "view_10.png").write_bytes((flight / "view_10.png").read_bytes()[:2000])
    (flight / "view_13.jpg").mkdir()
    done = slopemap("batch", str(flight), "-o", str(output))
    assert done.returncode == 4
    statuses = {line["name"]: line["exit_status"] for line in lines_of(output)}
    assert statuses == {NAMES[0]: 0, NAMES[1]: 1, NAMES[2]: 1, NAMES[3]: 0, "view_12-view_13": 1}
    for name, reason in ((NAMES[1], "view_10.png: the PNG file is cut short"), ("view_12-view_13", "is a folder")):
        (warning,) = (line for line in done.stderr.splitlines() if line.startswith(f"warning: {name}: "))
        assert reason in warning
    assert "5 pairs: 2 answered, 3 without an answer" in done.stderr
    assert done.stdout.count("failed") == 3
    assert "Traceback" not in done.stderr


@pytest.mark.usefixtures("_worker_here")
def test_a_pair_that_the_scene_leaves_without_an_answer(flight: Path, tmp_path: Path) -> None:
    (tmp_path / "pairs.csv").write_text("view_8.png,view_10.png\nview_8.png,view_9.png\n")  # the first: same image
    done = slopemap("batch", str(flight), "--pairing", str(tmp_path / "pairs.csv"), "-o", str(tmp_path / "out"))
    assert done.returncode == 4
    same, good = lines_of(tmp_path / "out")
    assert (same["exit_status"], good["exit_status"]) == (3, 0)
    assert same["code"]
    assert "no answer" in done.stdout


@pytest.mark.usefixtures("_worker_here")
def test_a_pair_may_be_called_like_a_file_of_an_answer(tmp_path: Path) -> None:
    for name in ("image1.png", "image2.png"):
        (tmp_path / "in" / "overlay.png").mkdir(parents=True, exist_ok=True)
        (tmp_path / "in" / "overlay.png" / name).write_text("no image")
    arguments = ("batch", str(tmp_path / "in"), "--pairing", "folders", "--fov", "60", "-o", str(tmp_path / "out"))
    for _ in range(2):
        done = slopemap(*arguments)
        assert done.returncode == 4
        assert "1 pair: 0 answered, 1 without an answer" in done.stderr


# ---- which pairs there would be ----


def test_dry_run_lists_the_pairs_and_writes_nothing(flight: Path, tmp_path: Path) -> None:
    done = slopemap("batch", str(flight), "--dry-run", "-o", str(tmp_path / "out"))
    assert done.returncode == 0
    rows = [line.split() for line in done.stdout.splitlines()[1:]]
    assert [row[0] for row in rows] == NAMES
    assert rows[0][1:] == [str(flight / name) for name in ("view_8.png", "view_9.png", "camera.json")]
    assert not list(tmp_path.iterdir())
    assert slopemap("batch", str(flight), "--dry-run").stdout == done.stdout


def test_cameras_given_are_shown_by_a_dry_run(flight: Path) -> None:
    assert "60°" in slopemap("batch", str(flight), "--dry-run", "--fov", "60").stdout
    both = slopemap("batch", str(flight), "--dry-run", "--intrinsics", "300,300,160,160", "--camera2", "x.json")
    assert both.returncode == 1
    assert "x.json: no such camera file" in both.stderr


# ---- refusals ----


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((), "give -o DIR, or --dry-run"),
        (("-o", "out", "--pairing", "pairs"), "'pairs' is not consecutive, stride, folders or a file"),
        (("-o", "out", "--pairing", "stride"), "--pairing stride needs --stride N"),
        (("-o", "out", "--stride", "2"), "--stride is for --pairing stride"),
        (("-o", "out", "--stride", "0"), "--stride"),
        (("-o", "out", "--jobs", "0"), "--jobs"),
        (("-o", "out", "--jobs", "2", "--cluster", "tcp://x:1"), "--jobs and --cluster contradict each other"),
        (("-o", "out", "--ship"), "--ship is for --cluster"),
        (("-o", "out", "--timeout", "0"), "--timeout"),
        (("-o", "out", "--camera2", "x.json"), "--camera2 is without --camera"),
        (("-o", "out", "--camera", "x.json", "--fov", "60"), "--camera and --fov contradict each other"),
        (("-o", "out", "--command", "segment", "--grid", "2x2"), "--grid is for --planes windows"),
        (("-o", "out", "--command", "segment", "--planes", "ransac"), "--planes is for --command estimate"),
        (("-o", "out", "--merge-px", "2"), "--merge-px is for --planes regions"),
        (("-o", "out", "--glob", "a*", "--pairing", "x.csv"), "--glob is not for a list of pairs"),
    ],
)
def test_a_wrong_command_line_ends_in_status_2(
    arguments: tuple[str, ...], said: str, flight: Path, tmp_path: Path
) -> None:
    done = slopemap("batch", str(flight), *arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert said in " ".join(done.stderr.split())
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("folder", "arguments", "said"),
    [
        ("gone", ("--fov", "60"), "gone: no such folder"),
        ("empty", ("--fov", "60"), "empty: holds no images"),
        ("images", ("--fov", "60", "--glob", "left_*"), "images is called left_*; check --glob"),
        ("images", ("--camera", "gone.json"), "gone.json: no such camera file"),
        ("images", ("--fov", "60", "-o", "images"), "give another -o"),
        ("images", ("--fov", "60", "-o", "file"), "cannot write results to file: file is not a folder"),
        ("images", ("--pairing", "gone.csv"), "gone.csv: no such list of pairs"),
    ],
)
def test_an_unusable_input_ends_in_status_1_with_one_line(
    folder: str, arguments: tuple[str, ...], said: str, flight: Path, tmp_path: Path
) -> None:
    shutil.copytree(flight, tmp_path / "images")
    (tmp_path / "empty").mkdir()
    (tmp_path / "file").touch()
    before = sorted(tmp_path.rglob("*"))
    done = slopemap("batch", folder, "-o", "out", *arguments, cwd=tmp_path)
    assert done.returncode == 1
    (line,) = (line for line in done.stderr.splitlines() if line.startswith("slopemap: error: "))
    assert said in line
    assert done.stdout == ""
    assert sorted(tmp_path.rglob("*")) == before


# ---- stopped on the way ----


@pytest.mark.usefixtures("_worker_here")
@pytest.mark.skipif(os.name != "posix", reason="needs signals of POSIX")
def test_interrupted_it_keeps_what_is_done_and_goes_on(answer: Run, flight: Path, tmp_path: Path) -> None:
    output = tmp_path / "out"
    command = [sys.executable, "-m", "slopecli", "batch", str(flight), "-o", str(output), "--jobs", "1", "-v"]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.PIPE, encoding="utf-8")
    assert process.stderr is not None
    assert any(": answered" in line for line in process.stderr)  # reads up to the first of them
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=60)
    if process.returncode:  # a fast machine may have been done before the signal came
        assert process.returncode == 130
        assert said.splitlines()[-1] == "slopemap: error: interrupted"
        assert "goes on with the rest" in said
        assert "Traceback" not in said
        assert lines_of(output)
    again = slopemap("batch", str(flight), "-o", str(output))
    assert again.returncode == 0
    assert contents_of(output) == contents_of(answer[1])


# ---- progress ----


def progress_of(n_done: int, n_kept: int = 0, failed: bool = False) -> Progress:
    status = {"exit_status": 3, "code": "low-texture", "message": "nothing\nmatches", "remedy": "look elsewhere"}
    latest = Outcome("a-b", "a.png", "b.png", **(status if failed else {"exit_status": 0}))  # type: ignore[arg-type]
    return Progress(100, n_done, int(failed), n_kept, latest)


class Clock:
    """Seconds that pass when told."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now = 1000.0
        monkeypatch.setattr("time.monotonic", lambda: self.now)


def test_progress_has_rate_time_left_and_failures(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    clock = Clock(monkeypatch)
    progress = BatchProgress(Talk(verbose=True))
    clock.now += 20.0
    progress(progress_of(50, n_kept=40, failed=True))
    progress.interrupted()
    assert capsys.readouterr().err.splitlines() == [
        "warning: a-b: low-texture: nothing matches; look elsewhere",
        "50 of 100 pairs, 40 kept from before, 1 without an answer, 30.0 pairs/min, 1 min 40 s left",
        "50 of 100 pairs done and kept; the same command again goes on with the rest",
    ]


def test_a_log_has_no_progress_and_with_v_a_line_now_and_then(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    clock = Clock(monkeypatch)
    for talk, tenths in ((Talk(), []), (Talk(verbose=True), list(range(10, 101, 10)))):
        progress = BatchProgress(talk)
        for done in range(1, 101):
            clock.now += 1.0
            progress(progress_of(done))
        lines = capsys.readouterr().err.splitlines()
        assert [int(one.split()[0]) for one in lines if " of 100 pairs" in one] == tenths
        assert all(one == "a-b: answered" or " of 100 pairs" in one for one in lines)


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def terminal_on(monkeypatch: pytest.MonkeyPatch) -> Terminal:
    """In place of stderr, 60 columns wide."""
    screen = Terminal()
    monkeypatch.setattr("sys.stderr", screen)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "60")
    monkeypatch.delenv("NO_COLOR", raising=False)
    return screen


def test_a_terminal_has_one_line_that_is_written_over(monkeypatch: pytest.MonkeyPatch) -> None:
    clock, terminal = Clock(monkeypatch), terminal_on(monkeypatch)
    with BatchProgress(Talk()) as progress:
        for done in range(1, 4):
            clock.now += 0.2
            progress(progress_of(done, failed=done == 2))
    shown = click.unstyle(terminal.getvalue())
    assert [done for done in range(1, 4) if f" {done} of 100 pairs" in shown] == [1, 2, 3]
    assert shown.count("\n") == 2  # the warning, and the end of the bar's line, which is then erased
    assert "warning: a-b: low-texture: nothing matches; look elsewhere\n" in shown
    assert terminal.getvalue().rstrip().endswith("\x1b[2K")


def test_a_terminal_that_is_gone_does_not_end_the_work(monkeypatch: pytest.MonkeyPatch) -> None:
    clock, terminal = Clock(monkeypatch), terminal_on(monkeypatch)
    refused: list[str] = []

    def gone(text: str) -> int:
        refused.append(text)
        raise OSError(5, "Input/output error")

    with BatchProgress(Talk(verbose=True)) as progress:
        monkeypatch.setattr(terminal, "write", gone)
        for done in range(1, 4):
            clock.now += 0.2
            progress(progress_of(done))
    assert refused  # the terminal was written to, and its refusal ended nothing


def test_quiet_has_no_progress(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = terminal_on(monkeypatch)
    with BatchProgress(Talk(quiet=True)) as progress:
        progress(progress_of(1, failed=True))
    assert terminal.getvalue() == ""


def test_a_word_of_the_titles_is_no_verdict() -> None:
    screen = io.StringIO()
    draw_table(batch_table([Outcome("a-b", "a.png", "b.png", 0)]), [], Console(file=screen, force_terminal=True))
    header, row, *_ = screen.getvalue().splitlines()
    assert header == click.unstyle(header)
    assert row != click.unstyle(row)


# ---- help ----


def test_help_answers_without_loading_anything_heavy() -> None:
    command = [sys.executable, "-X", "importtime", "-m", "slopecli", "batch", "--help"]
    done = subprocess.run(command, capture_output=True, encoding="utf-8", check=True)
    for heavy in ("numpy", "cv2", "yaml", "PIL", "distributed"):
        assert f"| {heavy}\n" not in done.stderr
    assert "--dry-run" in done.stdout


def test_exit_status_4_is_in_the_help() -> None:
    assert "4    a batch finished, and some pairs have no answer" in slopemap("--help").stdout


def test_the_table_has_both_answers_of_a_pair() -> None:
    outcome = Outcome(
        "a-b", "a.png", "b.png", 0, steepest_deg=51.1, steepest_sigma_deg=0.04, steepest_other_deg=13.07,
        steepest_other_sigma_deg=0.03, ambiguity="unresolved",
    )  # fmt: skip
    _, row = batch_table([outcome]).lines()
    assert "  13.07 ± 0.03° or 51.10 ± 0.04°  " in row
    assert row.endswith("two answers")
