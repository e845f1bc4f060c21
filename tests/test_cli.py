"""`slopemap estimate` as a user meets it: streams, files, exit status, refusals."""

from __future__ import annotations

import itertools
import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import cv2
import pytest
from command import Done, in_a_process, slopemap
from output_names import files_of

from slopecli import __version__
from slopecli.cli import slopemap as commands

ROOT = Path(__file__).resolve().parent.parent
DESCENT = ROOT / "sample_data" / "descent"
PAIR = (str(DESCENT / "image1.png"), str(DESCENT / "image2.png"))
CAMERA = ("--camera", str(DESCENT / "camera.json"))
FILES = files_of()


@pytest.fixture(scope="module")
def answer(tmp_path_factory: pytest.TempPathFactory) -> tuple[Done, Path]:
    """One ordinary run, and its output folder, which did not exist before."""
    folder = tmp_path_factory.mktemp("answer") / "new" / "out"
    done = in_a_process("estimate", *PAIR, *CAMERA, "-o", str(folder))
    assert done.returncode == 0, done.stderr
    return done, folder


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Arguments for the pair at a sixth of its size, for processes of which it does not matter what they answer."""
    folder = tmp_path_factory.mktemp("small")
    for name in ("image1.png", "image2.png"):
        image = cv2.imread(str(DESCENT / name))
        cv2.imwrite(str(folder / name), cv2.resize(image, (128, 128), interpolation=cv2.INTER_AREA))
    return [str(folder / "image1.png"), str(folder / "image2.png"), *CAMERA]


# ---- help ----


def test_version() -> None:
    assert in_a_process("--version").stdout == f"slopemap {__version__}\n"


@pytest.mark.parametrize(
    "arguments", [["--help"], ["--version"], ["estimate", "--help"], ["segment", "--help"]], ids=" ".join
)
def test_help_answers_at_once(arguments: list[str]) -> None:
    def seconds() -> float:
        before = os.times()
        assert in_a_process(*arguments).returncode == 0
        after = os.times()  # of the processor, not of the clock: other work on the machine is not our slowness
        return after.children_user + after.children_system - before.children_user - before.children_system

    assert any(seconds() < 0.2 for _ in range(7))


COMMANDS = [name for name in commands.commands if name != "camera"] + ["camera show"]


@pytest.mark.parametrize("command", COMMANDS)
def test_help_is_in_groups_and_no_longer_than_a_person_reads(command: str) -> None:
    lines = slopemap(*command.split(), "--help", COLUMNS="80").stdout.splitlines()
    headings = [line for line in lines if re.fullmatch(r"[A-Z][a-z ]+:", line)]
    assert headings[-1] == "General:"
    assert {"Input:", "Output:", "Windows and planes:", "Frame and scale:"} & set(headings)
    longest = max(len(list(lines_of_option)) for is_option, lines_of_option in option_lines(lines) if is_option)
    assert longest <= 4
    assert max(map(len, lines)) <= 80
    assert len(lines) <= (70 if command != "batch" else 90)


def option_lines(lines: list[str]) -> Iterator[tuple[bool, Iterator[str]]]:
    """Lines of a help text, those of one option together."""
    number = itertools.accumulate(line.startswith("  -") for line in lines)
    numbered = itertools.groupby(zip(number, lines, strict=True), key=lambda pair: pair[0])
    for _, group in numbered:
        block = [line for _, line in group]
        yield block[0].startswith("  -"), itertools.takewhile(bool, block)


@pytest.mark.parametrize(("value", "warned"), [("", False), ("two", True)])
def test_a_number_of_threads_that_is_none_is_ignored(value: str, warned: bool) -> None:
    done = in_a_process("estimate", "gone.png", "gone.png", "--fov", "60", "--json", OPENCV_FOR_THREADS_NUM=value)
    *warning, error = done.stderr.splitlines()
    assert error.startswith("slopemap: error: gone.png")
    assert [line for line in warning if "not a number of threads; it is ignored" in line] == warning * warned


def test_a_misspelt_command_is_a_usage_error() -> None:
    done = in_a_process("estimat")
    assert (done.returncode, done.stdout) == (2, "")
    assert "estimat" in done.stderr


def test_every_command_named_in_a_document_exists() -> None:
    texts = [path.read_text("utf-8") for path in (*ROOT.glob("docs/*.md"), *ROOT.glob("sample_data/*.md"))]
    assert {word for text in texts for word in re.findall(r"`slopemap (\w+)", text)} <= set(commands.commands)


# ---- usage errors: exit 2, said before any file is looked at ----

USAGE = {
    "empty camera": (["--camera", ""], "'--camera': it is empty"),
    "empty second camera": (["--fov", "60", "--camera2", ""], "'--camera2': it is empty"),
    "no camera": ([], "--camera FILE, --intrinsics FX,FY,CX,CY or --fov DEG"),
    "two cameras": (["--camera", "c.json", "--fov", "60"], "--camera and --fov contradict each other"),
    "camera and intrinsics": (["--camera", "c.json", "--intrinsics", "8,8,4,4"], "contradict each other"),
    "field of view 0": (["--fov", "0"], "'--fov'"),
    "field of view nan": (["--fov", "nan"], "not a finite number"),
    "three intrinsics": (["--intrinsics", "800,800,512"], "FX,FY,CX,CY (4 numbers)"),
    "negative focal length": (["--intrinsics", "-800,800,512,512"], "FX, FY must be > 0"),
    "focal lengths that differ": (["--intrinsics", "800,1e-300,512,512"], "within a factor of 10 of each other"),
    "focal length of nothing": (["--intrinsics", "1e-200,1e-200,0,0"], "0.001 to 1e6 px"),
    "window of three": (["--fov", "60", "--window", "1,2,3"], "X,Y,W,H (4 whole numbers)"),
    "window of words": (["--fov", "60", "--window", "a,b,c,d"], "for example 100,100,200,150"),
    "window of fractions": (["--fov", "60", "--window", "1.5,2,30,40"], "whole numbers"),
    "empty window": (["--fov", "60", "--window", "1,2,0,40"], "W, H 1 or more"),
    "window left of the image": (["--fov", "60", "--window", "-5,2,30,40"], "X, Y must be 0 or more"),
    "grid without rows": (["--fov", "60", "--grid", "3x0"], "COLUMNSxROWS"),
    "grid of nothing": (["--fov", "60", "--grid", "3"], "COLUMNSxROWS"),
    "grid and window": (["--fov", "60", "--grid", "3x3", "--window", "1,2,30,40"], "--grid and --window contradict"),
    "tolerance 0": (["--fov", "60", "--tolerance", "0"], "0<x<90"),
    "tolerance 90": (["--fov", "60", "--tolerance", "90"], "0<x<90"),
    "confidence in per cent": (["--fov", "60", "--confidence", "99"], "0.5<x<1"),
    "confidence of a coin": (["--fov", "60", "--confidence", "0.5"], "0.5<x<1"),
    "negative baseline": (["--fov", "60", "--baseline", "-1"], "x>0"),
    "infinite altitude": (["--fov", "60", "--altitude", "inf"], "not a finite number"),
    "two scales": (["--fov", "60", "--baseline", "1", "--altitude", "9"], "--baseline and --altitude contradict"),
    "no direction": (["--fov", "60", "--up", "0,0,0"], "must not be zero"),
    "unknown up": (["--fov", "60", "--up", "sky"], "camera, dominant-plane or X,Y,Z"),
    "negative up sigma": (["--fov", "60", "--up-sigma", "-1"], "0<=x<90"),
    "unknown solver": (["--fov", "60", "--solver", "magic"], "'mle', 'ha', 'lh'"),
    "unknown features": (["--fov", "60", "--features", "orb"], "'sift', 'foerstner'"),
    "negative seed": (["--fov", "60", "--seed", "-1"], "'--seed'"),
    "loud and quiet": (["--fov", "60", "-v", "-q"], "-v and -q contradict"),
}


@pytest.mark.parametrize(("arguments", "said"), USAGE.values(), ids=USAGE)
def test_usage_errors_name_the_option_and_a_way_out(arguments: list[str], said: str, tmp_path: Path) -> None:
    done = slopemap("estimate", "no1.png", "no2.png", *arguments, "-o", "out", cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert said in done.stderr
    assert "Traceback" not in done.stderr
    assert not list(tmp_path.iterdir())


def test_an_answer_must_go_somewhere() -> None:
    done = slopemap("estimate", "no1.png", "no2.png", "--fov", "60")
    assert done.returncode == 2
    assert "-o DIR, or --json" in done.stderr


def test_a_file_cannot_be_the_output_folder(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    done = slopemap("estimate", *PAIR, *CAMERA, "-o", str(tmp_path / "notes.txt"))
    assert done.returncode == 1
    assert "notes.txt is not a folder; choose another folder with -o" in done.stderr
    assert (tmp_path / "notes.txt").read_text() == "mine"


# ---- an answer ----


def test_table_has_a_line_for_every_window(answer: tuple[Done, Path]) -> None:
    header, *rows = answer[0].stdout.splitlines()
    assert header.split()[:2] == ["id", "slope"]
    assert [int(row.split()[0]) for row in rows] == list(range(1, 10))
    assert all(re.search(r"\d+\.\d\d ± \d+\.\d\d° .* (safe|unsafe|undecided) ", row) for row in rows)


def test_table_says_what_the_json_says(answer: tuple[Done, Path]) -> None:
    done, folder = answer
    for row, plane in zip(
        done.stdout.splitlines()[1:], json.loads((folder / "slopes.json").read_text())["planes"], strict=True
    ):
        assert row.split()[1] == f"{plane['slope_deg']:.2f}"
        assert plane["verdict"] in row.split()


def test_all_files_are_written_and_named(answer: tuple[Done, Path]) -> None:
    done, folder = answer
    assert {path.name for path in folder.iterdir()} == FILES
    assert all(name in done.stderr for name in FILES)


def test_stderr_tells_what_slopes_refer_to(answer: tuple[Done, Path]) -> None:
    assert "camera 1 taken to look straight down" in answer[0].stderr


def test_piped_output_has_no_escape_codes(answer: tuple[Done, Path]) -> None:
    assert "\x1b" not in answer[0].stdout + answer[0].stderr


def test_json_on_stdout_is_slopes_json_and_stands_alone(answer: tuple[Done, Path], tmp_path: Path) -> None:
    done = slopemap("estimate", *PAIR, *CAMERA, "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == json.loads((answer[1] / "slopes.json").read_text())
    assert not list(tmp_path.iterdir())


def test_quiet_says_nothing_and_verbose_gives_times(small: list[str]) -> None:
    quiet = in_a_process("estimate", *small, "--json", "-q")
    assert (quiet.returncode, quiet.stderr) == (0, "")
    verbose = slopemap("estimate", *small, "--json", "-v")
    assert verbose.stdout == quiet.stdout
    assert len(re.findall(r"^\w[\w ]* +\d+\.\d{3} s$", verbose.stderr, re.MULTILINE)) >= 3


def test_windows_keep_their_order_as_ids(tmp_path: Path) -> None:
    windows = ["--window", "500,500,200,200", "--window", "50,60,220,200"]
    done = slopemap("estimate", *PAIR, *CAMERA, *windows, "-o", str(tmp_path), "--no-overlay", "--no-ply")
    assert done.returncode == 0, done.stderr
    assert {path.name for path in tmp_path.iterdir()} == files_of(without=("overlay", "ply"))
    first, second = json.loads((tmp_path / "slopes.json").read_text())["planes"]
    assert (first["id"], second["id"]) == (1, 2)
    assert min(u for u, _ in first["polygon_px"]) > max(u for u, _ in second["polygon_px"])


def test_options_reach_the_answer(small: list[str]) -> None:
    up = ("--up", "0.1,0,-2", "--up-sigma", "0.5", "--altitude", "13", "--tolerance", "1", "--confidence", "0.9")
    done = slopemap("estimate", *small, "--json", "--solver", "lh", *up)
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert result["fit"]["solver"] == "lh"
    assert result["up"]["source"] == "given"
    assert result["up"]["sigma_deg"] == 0.5
    assert sum(x * x for x in result["up"]["vector_cam1"]) == pytest.approx(1)
    assert result["scale"] == {"unit": "m", "source": "altitude", "sigma": 0.0}
    assert {"unsafe"} <= {plane["verdict"] for plane in result["planes"]}


def test_field_of_view_and_intrinsics_stand_in_for_a_file(small: list[str]) -> None:
    done = slopemap("estimate", *small[:2], "--intrinsics", "110.5,111,63.5,63.5", "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["cameras"][0]["fx"] == 110.5
    assert slopemap("estimate", *small[:2], "--fov", "60", "--json").returncode == 0


def test_second_camera_is_for_image_2(small: list[str], tmp_path: Path) -> None:
    camera = json.loads((DESCENT / "camera.json").read_text())
    (tmp_path / "second.json").write_text(json.dumps({**camera, "cx": camera["cx"] + 1}))
    done = slopemap("estimate", *small, "--camera2", str(tmp_path / "second.json"), "--json")
    assert done.returncode == 0, done.stderr
    first, second = json.loads(done.stdout)["cameras"]
    assert second["cx"] == pytest.approx(first["cx"] + 0.16)  # of the intrinsics, which are scaled with the image


def test_a_reader_that_leaves_is_no_failure(small: list[str]) -> None:
    process = subprocess.Popen(
        [sys.executable, "-m", "slopecli", "estimate", *small, "--json"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    process.stdout.close()
    stderr = process.stderr.read().decode()
    process.stderr.close()
    assert process.wait() == 0
    assert "Error" not in stderr


def check_demo(slopes: Path) -> Done:
    script = ROOT / "sample_data" / "check_demo.py"
    command = [sys.executable, str(script), str(slopes), str(DESCENT / "truth.json")]
    return subprocess.run(command, capture_output=True, text=True, encoding="utf-8", check=False)


def test_demo_agrees_with_the_truth(answer: tuple[Done, Path]) -> None:
    done = check_demo(answer[1] / "slopes.json")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "9 of 9 windows" in done.stdout


def test_demo_check_finds_a_wrong_and_a_missing_slope(answer: tuple[Done, Path], tmp_path: Path) -> None:
    result = json.loads((answer[1] / "slopes.json").read_text())
    result["planes"][0]["slope_deg"] += 5 * result["planes"][0]["slope_sigma_deg"]
    del result["planes"][1]
    (tmp_path / "slopes.json").write_text(json.dumps(result))
    done = check_demo(tmp_path / "slopes.json")
    assert done.returncode == 1
    assert "7 of 9 windows" in done.stdout
    assert "WRONG" in done.stdout.splitlines()[1]
    assert "no answer" in done.stdout.splitlines()[2]


# ---- no answer: one line, the right status, nothing written ----


def refused(tmp_path: Path, exit_code: int, *arguments: str) -> str:
    """The one line on stderr of a run that must end with `exit_code` and leave no file behind."""
    done = slopemap("estimate", *arguments, "-o", str(tmp_path / "out"))
    assert (done.returncode, done.stdout) == (exit_code, ""), done.stderr
    (line,) = done.stderr.splitlines()
    assert line.startswith("slopemap: error: ")
    assert not (tmp_path / "out" / "slopes.json").exists()
    return line


def test_missing_image(tmp_path: Path) -> None:
    assert "gone.png" in refused(tmp_path, 1, PAIR[0], "gone.png", *CAMERA)


def test_missing_camera_file(tmp_path: Path) -> None:
    assert "gone.json" in refused(tmp_path, 1, *PAIR, "--camera", "gone.json")


def test_truncated_image(tmp_path: Path) -> None:
    (tmp_path / "half.png").write_bytes(Path(PAIR[1]).read_bytes()[:50_000])
    assert "half.png" in refused(tmp_path, 1, PAIR[0], str(tmp_path / "half.png"), *CAMERA)


def test_camera_of_another_image_size(tmp_path: Path) -> None:
    camera = json.loads((DESCENT / "camera.json").read_text())
    (tmp_path / "wide.json").write_text(json.dumps({**camera, "width": 2 * camera["width"]}))
    line = refused(tmp_path, 1, *PAIR, "--camera", str(tmp_path / "wide.json"))
    assert str(2 * camera["width"]) in line
    assert PAIR[0] in line
    assert "wide.json" in line


def test_scaled_intrinsics_are_told_as_information(small: list[str]) -> None:
    done = slopemap("estimate", *small, "--json")
    (line,) = (line for line in done.stderr.splitlines() if f"{small[0]} with " in line)
    assert line.startswith("info: ")
    assert line.endswith("intrinsics scaled by 0.16")


def test_an_empty_output_is_a_usage_error(tmp_path: Path) -> None:
    done = slopemap("estimate", *PAIR, *CAMERA, "--output=", cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert "'--output': it is empty" in done.stderr
    assert not list(tmp_path.iterdir())


def test_an_empty_image_name_is_a_usage_error(tmp_path: Path) -> None:
    done = slopemap("estimate", "", PAIR[1], *CAMERA, "-o", str(tmp_path / "out"))
    assert (done.returncode, done.stdout) == (2, "")
    assert "'IMAGE1': it is empty" in done.stderr


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="root may read everything")
@pytest.mark.parametrize("kind", ["image", "camera"])
def test_what_may_not_be_read_is_an_unusable_input(kind: str, tmp_path: Path) -> None:
    locked = tmp_path / "locked"
    shutil.copy(PAIR[0] if kind == "image" else CAMERA[1], locked)
    locked.chmod(0)
    arguments = (str(locked), PAIR[1], *CAMERA) if kind == "image" else (*PAIR, "--camera", str(locked))
    assert "locked: cannot be read" in refused(tmp_path, 1, *arguments)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
@pytest.mark.parametrize("what", ["json", "help"])
def test_a_full_disk_under_stdout_is_no_fault_of_ours(what: str, small: list[str]) -> None:
    arguments = ["--help"] if what == "help" else ["estimate", *small, "--json", "-q"]
    with open("/dev/full", "w") as full:
        command = [sys.executable, "-m", "slopecli", *arguments]
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 1
    (line,) = done.stderr.splitlines()
    assert line.startswith("slopemap: error: cannot write to stdout: No space left on device")
    assert "fault" not in line


def test_window_outside_the_image(tmp_path: Path) -> None:
    assert "9000" in refused(tmp_path, 1, *PAIR, *CAMERA, "--window", "9000,10,50,50")


def test_identical_images(tmp_path: Path) -> None:
    assert "identical" in refused(tmp_path, 3, PAIR[0], PAIR[0], *CAMERA)


def test_output_folder_that_cannot_be_made_is_said_before_the_images_are_read(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    done = slopemap("estimate", "no1.png", "no2.png", *CAMERA, "-o", str(tmp_path / "notes.txt" / "out"))
    assert (done.returncode, done.stdout) == (1, "")
    (line,) = done.stderr.splitlines()
    assert "notes.txt" in line


def test_an_earlier_answer_survives_a_failed_run(tmp_path: Path) -> None:
    shutil.copy(DESCENT / "camera.json", tmp_path / "slopes.json")
    done = slopemap("estimate", PAIR[0], "gone.png", *CAMERA, "-o", str(tmp_path))
    assert done.returncode == 1
    assert (tmp_path / "slopes.json").read_bytes() == (DESCENT / "camera.json").read_bytes()


# ---- colour ----


@pytest.mark.parametrize("declined", [False, True], ids=["terminal", "NO_COLOR"])
def test_colour_on_a_terminal_unless_declined(declined: bool, small: list[str], tmp_path: Path) -> None:
    pty = pytest.importorskip("pty")
    reader, writer = pty.openpty()
    environment = {key: value for key, value in os.environ.items() if key != "NO_COLOR"} | {"TERM": "xterm"}
    done = subprocess.run(
        [sys.executable, "-m", "slopecli", "estimate", *small, "-o", str(tmp_path), "-q"],
        stdout=writer,
        env={**environment, "NO_COLOR": "1"} if declined else environment,
        check=False,
    )
    os.close(writer)
    assert done.returncode == 0
    shown = os.read(reader, 65536).decode()
    assert ("\x1b[" in shown) is not declined
    assert [line.split()[0] for line in shown.splitlines()] == ["id", *map(str, range(1, 10))]


def test_a_pipe_needs_no_library_for_terminals(small: list[str]) -> None:
    command = [sys.executable, "-X", "importtime", "-m", "slopecli", "estimate", *small, "--json"]
    done = subprocess.run(command, capture_output=True, text=True, encoding="utf-8", check=True)
    assert "slopecli.pipeline\n" in done.stderr
    assert not re.search(r"\| +rich", done.stderr)
