"""Nearly two hundred inputs of the campaign (`make fuzz`), and that it notices what it is for."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import Executor
from pathlib import Path
from unittest.mock import patch

import command
import pytest
from campaign import seeds
from fuzzing import checks
from fuzzing.blocks import block
from fuzzing.case import FIFO, Case, read_case
from fuzzing.kinds import KINDS
from fuzzing.pool import state_of
from fuzzing.samples import camera_binaries, camera_texts, pair

from slopecli.io.cameras import CAMERA_FORMATS, CameraFileContent

# kind: inputs in the ordinary run; 0.02 s of processor time each, for images and batches 0.1 to 0.4 s
HOW_MANY = {
    "camera": 50,
    "metadata": 20,
    "matches": 15,
    "match_file": 15,
    "pose": 15,
    "list": 15,
    "folder": 5,
    "image": 12,
    "record": 2,
    "truth": 15,
    "drawn": 20,
}
PARTS = [(kind, k) for kind in HOW_MANY for k in seeds(10, 1)]


@pytest.mark.parametrize(("kind", "part"), PARTS)
def test_odd_inputs_end_in_an_answer_or_in_one_line(kind: str, part: int, tmp_path: Path) -> None:
    """Each: no traceback, no warning, a documented exit status, whole files or none, the same outcome again."""

    def run(case: Case) -> list[str]:
        return checks.complaints(case, tmp_path / "case")

    for case, found in block(1, part, HOW_MANY[kind], [kind], run):
        case.keep(tmp_path / "failure", found)
        pytest.fail(f"slopemap {' '.join(case.arguments)} in {tmp_path}/failure/files: {found}")


def test_every_kind_of_input_has_its_part() -> None:
    assert set(HOW_MANY) == {*KINDS, "drawn"}


def test_every_camera_format_has_a_sample() -> None:
    contents = [text.encode() for text in camera_texts()] + camera_binaries()
    missing = {form.name for form in CAMERA_FORMATS}
    for content in contents:
        found = (form.name for form in CAMERA_FORMATS if form.module.find(CameraFileContent(content)))
        missing.discard(next(found, ""))
    assert not missing


# ---- what the campaign notices ----


CASE = Case("camera", ["solve", "matches.csv", "--json"], {**pair(), "pipe": FIFO})


def complaints_when(folder: Path, does: Callable[[], command.Done], case: Case = CASE) -> str:
    with patch("command.slopemap", lambda *_, **__: does()):
        return "\n".join(checks.complaints(case, folder / "case"))


def done(status: int = 0, out: str = "", err: str = "") -> command.Done:
    return command.Done([], status, out, err)


@pytest.mark.parametrize(
    ("outcome", "said"),
    [
        (done(1, err="Traceback (most recent call last):\n"), "Traceback"),
        (done(1, err="slopemap: error: unexpected KeyError: 'x'; this is a fault of slopemap\n"), "fault"),
        (done(0, err="a.py:3: RuntimeWarning: overflow encountered in exp\n"), "RuntimeWarning"),
        (done(0, err="libpng warning: x\n"), "libpng"),
        (done(139), "exit status 139"),
        (done(1), "without one line"),
        (done(0, out="\x1b[31m"), "control character"),
        (done(1, err="slopemap: error: " + 3000 * "x"), "characters"),
    ],
)
def test_what_is_said_wrongly_is_noticed(outcome: command.Done, said: str, tmp_path: Path) -> None:
    assert said in complaints_when(tmp_path, lambda: outcome)


def test_good_outcomes_are_no_failures(tmp_path: Path) -> None:
    for outcome in (done(0, "{}"), done(1, err="slopemap: error: a.csv: x\n"), done(2, err="Usage: x\n")):
        assert complaints_when(tmp_path, lambda outcome=outcome: outcome) == ""


def test_what_is_left_or_changed_is_noticed(tmp_path: Path) -> None:
    folder = tmp_path / "case"
    for name, status in (("matches.csv", 0), ("out/.slopemap-1/x", 0), ("out/slopes.json", 1), ("other", 0)):

        def write(name: str = name, status: int = status) -> command.Done:
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text("{}")
            return done(status, err="slopemap: error: x\n" * (status == 1))

        assert name in complaints_when(tmp_path, write)


def test_another_outcome_of_the_same_input_is_noticed(tmp_path: Path) -> None:
    answers = iter((done(0, "1"), done(0, "2")))
    assert "another outcome" in complaints_when(tmp_path, lambda: next(answers))


def test_too_long_is_noticed(tmp_path: Path) -> None:
    def forever() -> command.Done:
        while True:
            pass

    with patch.object(checks, "MOST_S", 0.05):
        assert "processor time" in complaints_when(tmp_path, forever)


def test_a_case_is_kept_and_read_again(tmp_path: Path) -> None:
    case = Case("x", ["solve", "\udcff\x1b"], {"a/b": b"\0\xff", "\udce9": FIFO}, {"out": b"1"})
    case.keep(tmp_path, ["why \udce9"])
    assert read_case(tmp_path) == case
    assert (tmp_path / "files/a/b").read_bytes() == b"\0\xff"


@pytest.mark.slow
def test_a_process_that_dies_is_known_by_its_input(tmp_path: Path) -> None:
    """An answer of a worker that never comes: the case it had is the failure, and the others go on."""
    script = (
        "import os, fuzzing.__main__ as m, fuzzing.checks as c\n"
        "run = c.run_command\n"
        "c.run_command = lambda a, f: os.kill(os.getpid(), 9) if '--json' in a else run(a, f)\n"
        "if __name__ == '__main__': m.sys.argv = ['f', '-n', '50', '--jobs', '1', '--only', 'pose']; m.main()\n"
    )
    (tmp_path / "main.py").write_text(script)
    tests = Path(__file__).parent
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join((str(tests), str(tests.parent)))}
    ended = subprocess.run(
        [sys.executable, "main.py"], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert "the process died: SIGKILL" in ended.stdout
    assert list((tmp_path / "fuzz_failures").glob("pose-0-*/case.json"))


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_a_process_without_processor_time_is_not_taken_for_stuck() -> None:
    loops = subprocess.Popen([sys.executable, "-c", "while True: pass"])
    program = "print(flush=True); input()"
    waits = subprocess.Popen([sys.executable, "-c", program], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    try:
        assert waits.stdout is not None
        waits.stdout.readline()  # it has started, and only input() is left
        while state_of(loops.pid)[1] == 0.0 or state_of(waits.pid)[0] == "R":
            pass
        assert state_of(loops.pid)[0] == "R"
        assert state_of(waits.pid)[0] == "S"
        assert state_of(2**30) == ("", 0.0)
    finally:
        for process in (loops, waits):
            process.kill()
            process.communicate()


def test_a_worker_of_a_batch_is_stood_for_in_this_process() -> None:
    assert issubclass(checks.WorkerHere, Executor)
    assert checks.WorkerHere().submit(abs, -1).result() == 1


@pytest.mark.skipif(sys.platform != "linux", reason="limits memory as Linux does")
def test_reading_small_files_reserves_little_memory(tmp_path: Path) -> None:
    """Of an input no more is reserved than it holds, whatever could be read of a larger one."""
    for name, content in pair().items():
        (tmp_path / name).write_bytes(content)
    script = (
        "import resource, sys\n"
        "from slopecli.io import load_image, read_correspondences\n"
        "from slopecli.io.cameras import load_camera\n"
        "load_image('image2.png')\n"  # with what is loaded once
        "limit = 400_000_000\n"
        "resource.setrlimit(resource.RLIMIT_DATA, (limit, limit))\n"
        "load_image('image1.png'), load_camera('camera.json'), read_correspondences('matches.csv')\n"
    )
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1]), "OPENCV_FOR_THREADS_NUM": "1"}
    ended = subprocess.run(
        [sys.executable, "-c", script], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert ended.returncode == 0, ended.stderr
