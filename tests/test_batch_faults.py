"""A batch that is killed, interrupted, out of disk space or given bad files loses nothing and does nothing twice.

Faults at each step of writing a pair are in test_batch_records.py.
"""

from __future__ import annotations

import errno
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import patch

import cv2
import pytest
from batch_factory import SIDE, make_images, tree
from command import slopemap
from fuzzing.checks import WorkerHere
from remembered import remembered

pytestmark = pytest.mark.skipif(
    sys.platform != "linux", reason="looks for processes in /proc, injects faults as Linux has them"
)

N_IMAGES = 8
N_BAD = 9  # images of the folder in which half are bad
QUICK = ("--grid", "1x1", "--no-ply")
Flight = tuple[Path, dict[str, bytes]]
PATIENCE_S = 300.0
SUMMARY = {"summary.csv", "results.jsonl", "index.html"}


def make_flight(folder: Path, n_images: int) -> Flight:
    """A folder of images, and the files of a batch that nothing disturbs, whose pairs are answered in this process."""
    make_images(folder / "views", n_images)
    complete(folder / "views", folder / "undisturbed")
    return folder / "views", tree(folder / "undisturbed")


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Flight:
    return make_flight(tmp_path_factory.mktemp("batch"), N_IMAGES)


@pytest.fixture
def views(flight: Flight) -> Path:
    return flight[0]


@pytest.fixture
def undisturbed(flight: Flight) -> dict[str, bytes]:
    """What everything is compared with."""
    return flight[1]


def command(views: Path, output: Path, *options: str) -> list[str]:
    asked = [str(views), "-o", str(output), "--jobs", "2", "-q", *QUICK, *options]
    return [sys.executable, "-m", "slopecli", "batch", *asked]


def batch(views: Path, output: Path, *options: str, **how: Any) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command(views, output, *options), capture_output=True, text=True, timeout=PATIENCE_S, **how)


def complete(views: Path, output: Path) -> None:
    """Run the command to its end, in this process and with answers that it may have from another test."""
    with patch("slopecli.batch.running.Worker", WorkerHere), patch("slopecli.batch.answer.estimate", remembered):
        done = slopemap("batch", str(views), "-o", str(output), "-q", *QUICK)
    assert done.returncode == 0, done.stderr


@contextmanager
def started(views: Path, output: Path, *options: str) -> Iterator[subprocess.Popen[str]]:
    process = subprocess.Popen(
        command(views, output, *options),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        # where the tests run in the background of a shell, SIGINT would be ignored
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def finished(output: Path) -> dict[str, int]:
    """Pairs that are answered, and when their record was written, ns."""
    records = {path.parent.name: path for path in output.glob("*/pair.json")}
    return {
        name: path.stat().st_mtime_ns
        for name, path in records.items()
        if json.loads(path.read_bytes())["exit_status"] == 0
    }


def wait_for(output: Path, count: int) -> dict[str, int]:
    """Wait until that many pairs are finished."""
    deadline = time.monotonic() + PATIENCE_S
    while len(done := finished(output)) < count:
        assert time.monotonic() < deadline, "the batch does not get on"
        time.sleep(0.02)
    return done


def wait_for_more(process: subprocess.Popen[str], output: Path) -> None:
    """Wait until one more pair is finished, or the batch is."""
    before = len(finished(output))
    while process.poll() is None and len(finished(output)) == before:
        time.sleep(0.02)


def outcomes_of(output: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (output / "results.jsonl").read_text().splitlines()]


def children(pid: int) -> list[int]:
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                state, parent = (entry / "stat").read_text().rpartition(")")[2].split()[:2]
            except OSError:
                continue  # it has just ended
            if int(parent) == pid and state != "Z":
                found.append(int(entry.name))
    return found


# ---- killed ----


def test_killed_at_three_moments_it_comes_to_the_same_bytes(flight: Flight, tmp_path: Path) -> None:
    check_killed(flight, tmp_path / "out", n_kills=3)


@pytest.mark.slow
def test_killed_at_fifty_moments_it_comes_to_the_same_bytes(tmp_path: Path) -> None:
    check_killed(make_flight(tmp_path, 41), tmp_path / "out", n_kills=50)


def check_killed(flight: Flight, output: Path, n_kills: int) -> None:
    (views, undisturbed), rng, kills, seen = flight, random.Random(1), 0, dict[str, int]()
    pairs = [name for name in undisturbed if name.endswith("pair.json")]
    while kills < n_kills:
        with started(views, output) as process:
            if rng.random() < 0.5:  # however slow the machine, it gets on
                wait_for_more(process, output)
            kills += kill_at_random(process, rng, n_kills - kills)
        seen = {**finished(output), **seen}
        if len([*output.glob("*/pair.json")]) < len(pairs):
            assert not SUMMARY & {path.name for path in output.glob("*")}
    assert {"pair.json", "slopes.json"} <= {path.name for path in output.glob("*/*")}
    last = batch(views, output)
    assert last.returncode == 0, last.stderr
    assert tree(output) == undisturbed
    assert len(outcomes_of(output)) == len(pairs)
    assert seen.items() <= finished(output).items(), "a finished pair was done again"


def kill_at_random(process: subprocess.Popen[str], rng: random.Random, most: int) -> int:
    """Kill workers, and in the end the batch itself, each at a random moment; how many were killed."""
    kills, victims = 0, rng.randint(1, 3)
    while kills < min(victims, most):
        time.sleep(rng.uniform(0.1, 1.2))
        if process.poll() is not None:
            return kills  # it was faster
        workers = children(process.pid)
        is_last = kills == min(victims, most) - 1
        victim = rng.choice(workers) if workers and not is_last else process.pid
        try:
            os.kill(victim, signal.SIGKILL)
        except ProcessLookupError:
            continue
        kills += 1
    return kills


def test_a_summary_that_was_cut_off_is_written_again(
    views: Path, undisturbed: dict[str, bytes], tmp_path: Path
) -> None:
    output = Path(shutil.copytree(views.parent / "undisturbed", tmp_path / "out"))
    (output / "results.jsonl").unlink()
    (output / "summary.csv").write_bytes(b"half a")
    (output / ".slopemap-1-index.html").write_bytes(b"half a page")
    complete(views, output)
    assert tree(output) == undisturbed


def test_ctrl_c_leaves_a_summary_of_what_is_done(views: Path, undisturbed: dict[str, bytes], tmp_path: Path) -> None:
    output = tmp_path / "out"
    with started(views, output) as process:
        wait_for(output, 3)
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=PATIENCE_S)
        assert process.returncode == 130
    assert "Traceback" not in said
    before, outcomes = finished(output), outcomes_of(output)
    assert {outcome["name"] for outcome in outcomes} <= set(before)
    # each of the two workers may have stored a pair whose answer was still on its way
    assert 3 - 2 <= len(outcomes) < N_IMAGES - 1
    assert {path.name for path in output.iterdir() if path.is_file()} == SUMMARY
    complete(views, output)
    assert tree(output) == undisturbed
    assert before.items() <= finished(output).items()


def test_a_second_batch_in_the_same_folder_is_refused(
    views: Path, undisturbed: dict[str, bytes], tmp_path: Path
) -> None:
    output = tmp_path / "out"
    with started(views, output) as first:
        wait_for(output, 2)
        first.send_signal(signal.SIGSTOP)  # it cannot end before the second begins
        second = batch(views, output, "--seed", "5")
        first.send_signal(signal.SIGCONT)
        assert second.returncode == 1
        assert "in use by another batch" in second.stderr
        assert len(second.stderr.splitlines()) == 1
        first.communicate(timeout=PATIENCE_S)
        assert first.returncode == 0
    assert tree(output) == undisturbed


def test_other_options_are_other_answers_and_leave_nothing_of_the_first(
    views: Path, undisturbed: dict[str, bytes], tmp_path: Path
) -> None:
    output = tmp_path / "out"
    with started(views, output, "--grid", "2x1", "--no-overlay"):
        wait_for(output, 2)
    complete(views, output)
    assert tree(output) == undisturbed


# ---- pairs that do harm ----

HARM = """
import os, signal, time
import numpy as np
import slopecli.pipeline

real = slopecli.pipeline.estimate

def estimate(image1, *others, **more):
    name = os.path.basename(image1.path)
    if name == "view001.png":
        os.kill(os.getpid(), signal.SIGSEGV)
    if name == "view003.png":
        time.sleep(1000)
    if name == "view005.png":
        np.ones(4 * 10**9, np.uint8)
    return real(image1, *others, **more)

slopecli.pipeline.estimate = estimate
"""


def injected(folder: Path, program: str) -> dict[str, str]:
    """An environment in which every Python process begins with `program`."""
    folder.mkdir()
    (folder / "sitecustomize.py").write_text(program)
    return {**os.environ, "PYTHONPATH": os.pathsep.join([str(folder), os.getcwd()])}


def test_a_crash_a_hang_and_a_glutton_fail_alone(views: Path, undisturbed: dict[str, bytes], tmp_path: Path) -> None:
    output = tmp_path / "out"
    done = batch(views, output, "--timeout", "5", "--memory", "2", env=injected(tmp_path / "harm", HARM))
    assert done.returncode == 4, done.stderr
    outcomes = outcomes_of(output)
    assert [outcome["name"] for outcome in outcomes] == sorted(outcome["name"] for outcome in outcomes)
    failed = {Path(outcome["image1"]).name: outcome["code"] for outcome in outcomes if outcome["exit_status"]}
    assert failed == {"view001.png": "crashed", "view003.png": "timeout", "view005.png": "memory"}
    before = finished(output)
    assert len(before) == N_IMAGES - 4

    # whatever it was, it is over
    complete(views, output)
    assert tree(output) == undisturbed
    assert before.items() <= finished(output).items()


# ---- bad files ----


def spoil(folder: Path) -> dict[str, str]:
    """Make half of the images bad in every way a file can be; what its message must say, by name."""
    paths = sorted(folder.glob("view*.png"))
    cut = paths[2].read_bytes()[:5000]
    paths[2].write_bytes(cut)
    paths[3].write_bytes(b"")
    paths[4].write_text("a text, whatever the name says\n" * 50)
    paths[6].unlink()
    paths[6].mkdir()
    cv2.imwrite(str(paths[7]), cv2.imread(str(paths[7]))[:100])
    paths[8].unlink()
    paths[8].symlink_to(folder / "nowhere.png")
    said = {2: "cut short", 3: "empty", 4: "text", 6: "is a folder", 7: f"{SIDE}x100", 8: "no such image file"}
    if os.geteuid() != 0:  # root reads everything
        paths[5].chmod(0)
        said[5] = "cannot be read"
    return {paths[k].name: words for k, words in said.items()}


def test_every_bad_file_is_named_and_every_good_pair_answered(
    views: Path, undisturbed: dict[str, bytes], tmp_path: Path
) -> None:
    folder, output = tmp_path / "views", tmp_path / "out"
    make_images(folder, N_BAD)
    bad = spoil(folder)
    with patch("slopecli.batch.running.Worker", WorkerHere):
        done = slopemap("batch", str(folder), "-o", str(output), "-q", *QUICK)
    assert done.returncode == 4, done.stderr
    outcomes = outcomes_of(output)
    assert len(outcomes) == N_BAD - 1
    for outcome in outcomes:
        names = [Path(outcome[key]).name for key in ("image1", "image2")]
        guilty = [name for name in names if name in bad]
        assert (outcome["exit_status"] != 0) == bool(guilty), outcome
        assert all(name in outcome["message"] and bad[name] in outcome["message"] for name in guilty)
    for name in finished(output):
        assert not set(os.listdir(output / name)) ^ {Path(path).name for path in undisturbed if path.startswith(name)}


# ---- a full disk ----

FULL = """
import errno, glob, os
real = os.fsync

def fsync(descriptor):
    if len(glob.glob({output!r} + "/*/pair.json")) >= 3:
        raise OSError(errno.{code}, os.strerror(errno.{code}))
    real(descriptor)

os.fsync = fsync
"""


@pytest.mark.parametrize("code", ["ENOSPC", pytest.param("EDQUOT", marks=pytest.mark.slow)])
def test_a_full_disk_is_one_line_and_what_was_done_stays(
    views: Path, undisturbed: dict[str, bytes], tmp_path: Path, code: str
) -> None:
    output = tmp_path / "out"
    done = batch(views, output, env=injected(tmp_path / "harm", FULL.format(output=str(output), code=code)))
    check_disk_full(done, output)
    before = finished(output)
    complete(views, output)
    assert tree(output) == undisturbed
    assert before.items() <= finished(output).items()


def check_disk_full(done: subprocess.CompletedProcess[str], output: Path) -> None:
    assert done.returncode == 1
    assert len(done.stderr.splitlines()) == 1
    assert "disk full" in done.stderr
    assert "run the same command again" in done.stderr
    assert 3 <= len(finished(output)) < N_IMAGES - 1
    assert not list(output.rglob(".slopemap*"))


@pytest.fixture
def small_disk(undisturbed: dict[str, bytes], tmp_path: Path) -> Iterator[Path]:
    """A file system for about two thirds of the files of a batch."""
    size = f"size={sum(map(len, undisturbed.values())) * 2 // 3}"
    folder = tmp_path / "disk"
    folder.mkdir()
    mount = shutil.which("mount")
    if mount is None or subprocess.run([mount, "-t", "tmpfs", "-o", size, "tmpfs", folder], check=False).returncode:
        pytest.skip("a small file system cannot be mounted here")
    yield folder
    subprocess.run(["umount", "--lazy", folder], check=True)


@pytest.mark.slow
def test_a_small_disk_fills_and_goes_on_when_it_has_grown(
    views: Path, undisturbed: dict[str, bytes], small_disk: Path
) -> None:
    output = small_disk / "out"
    check_disk_full(batch(views, output), output)
    before = finished(output)
    subprocess.run(["mount", "-o", "remount,size=400m", small_disk], check=True)
    complete(views, output)
    assert tree(output) == undisturbed
    assert before.items() <= finished(output).items()


def test_a_disk_that_is_full_from_the_start_is_one_line(views: Path, tmp_path: Path) -> None:
    program = f"""
import os
def full(*_, **__):
    raise OSError({errno.ENOSPC}, os.strerror({errno.ENOSPC}))
os.fsync = full
"""
    done = batch(views, tmp_path / "out", "--jobs", "1", env=injected(tmp_path / "harm", program))
    assert done.returncode == 1
    assert len(done.stderr.splitlines()) == 1
    assert "disk full" in done.stderr
