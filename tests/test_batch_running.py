"""A whole batch through its Python entry point: order, progress, summary, and what is refused before it begins."""

from __future__ import annotations

import json
import os
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from batch_factory import make_images, make_job, make_pairs, tree

from slopecli.batch import Keep, Pair, Progress, Worker, answer_here, run
from slopecli.errors import InputError
from slopecli.io import write_atomically
from slopecli.options import Options

SUMMARY = {"summary.csv", "results.jsonl", "index.html"}
OPTIONS, KEEP = Options(grid=(1, 1)), Keep(overlay=False, ply=False)


@pytest.fixture(scope="module")
def pairs(tmp_path_factory: pytest.TempPathFactory) -> list[Pair]:
    """Four that have an answer and, last, one that is known at once to have none."""
    good = make_pairs(make_images(tmp_path_factory.mktemp("views"), 5))
    return [*good, Pair("odd", "odd", "", None, None, problem="odd: holds three images, needed two")]


@pytest.fixture(scope="module")
def alone(pairs: list[Pair], tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """What one process comes to."""
    folder = tmp_path_factory.mktemp("alone")
    run(pairs, OPTIONS, KEEP, folder, jobs=1)
    return tree(folder)


def test_two_processes_come_to_the_same_bytes_and_outcomes_are_in_input_order(
    pairs: list[Pair], alone: dict[str, bytes], tmp_path: Path
) -> None:
    seen: list[Progress] = []
    outcomes = run(pairs, OPTIONS, KEEP, tmp_path, jobs=2, on_progress=seen.append)
    assert tree(tmp_path) == alone
    names = [pair.name for pair in pairs]
    assert [outcome.name for outcome in outcomes] == names
    assert [progress.latest.name for progress in seen] != names  # two processes, one of them at "odd" early
    lines = (tmp_path / "results.jsonl").read_text().splitlines()
    assert [json.loads(line)["name"] for line in lines] == names
    assert [outcome.exit_status for outcome in outcomes] == [0, 0, 0, 0, 1]
    assert outcomes[-1].message == pairs[-1].problem


@pytest.mark.usefixtures("_worker_here")
def test_progress_counts_what_is_done_failed_and_kept(pairs: list[Pair], tmp_path: Path) -> None:
    for n_kept in (0, 4):
        seen: list[Progress] = []
        run(pairs, OPTIONS, KEEP, tmp_path, jobs=1, on_progress=seen.append)
        assert [progress.n_done for progress in seen] == [1, 2, 3, 4, 5]
        last = seen[-1]
        assert (last.n_pairs, last.n_failed, last.n_kept) == (5, 1, n_kept)


@pytest.mark.usefixtures("_worker_here")
def test_ctrl_c_while_the_summary_is_written_leaves_a_whole_one(
    pairs: list[Pair], alone: dict[str, bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run(pairs[:2], OPTIONS, KEEP, tmp_path, jobs=1)
    calls = list[Path]()

    def interrupted(path: Path, content: bytes) -> None:
        calls.append(path)
        if len(calls) == 2:
            raise KeyboardInterrupt
        write_atomically(path, content)

    monkeypatch.setattr("slopecli.batch.running.write_atomically", interrupted)
    with pytest.raises(KeyboardInterrupt):
        run(pairs, OPTIONS, KEEP, tmp_path, jobs=1)
    assert tree(tmp_path) == alone


@pytest.mark.usefixtures("_worker_here")
def test_more_pairs_later_keep_those_that_are_there(pairs: list[Pair], alone: dict[str, bytes], tmp_path: Path) -> None:
    run(pairs[1:3], OPTIONS, KEEP, tmp_path, jobs=1)
    seen: list[Progress] = []
    run(pairs, OPTIONS, KEEP, tmp_path, jobs=1, on_progress=seen.append)
    assert seen[-1].n_kept == 2
    assert tree(tmp_path) == alone


@pytest.mark.usefixtures("_worker_here")
def test_the_folder_may_be_relative_and_is_made(
    pairs: list[Pair], alone: dict[str, bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    run(pairs, OPTIONS, KEEP, "a/b", jobs=1)
    assert tree(tmp_path / "a" / "b") == alone


def test_processes_take_their_paths_from_where_the_batch_was_started(
    pairs: list[Pair], alone: dict[str, bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(Path(pairs[0].image1).parent)
    short = [replace(pair, image1=Path(pair.image1).name, image2=Path(pair.image2).name) for pair in pairs[:2]]
    outcomes = run(short, OPTIONS, KEEP, tmp_path, jobs=1)
    assert [outcome.exit_status for outcome in outcomes] == [0, 0]
    assert outcomes[0].image1 == "view000.png"


def one_line(error: pytest.ExceptionInfo[InputError]) -> str:
    assert "\n" not in str(error.value)
    return str(error.value)


def test_no_pairs_and_pairs_of_one_name_are_refused(pairs: list[Pair], tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no pairs") as none:
        run([], OPTIONS, KEEP, tmp_path)
    assert one_line(none)
    with pytest.raises(InputError, match="same name"):
        run([pairs[0], pairs[0]], OPTIONS, KEEP, tmp_path)
    assert not list(tmp_path.iterdir())


def test_a_folder_that_cannot_be_written_to_is_refused(pairs: list[Pair], tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("a file")
    (tmp_path / "folder" / "results.jsonl").mkdir(parents=True)
    for place in ("taken", "taken/below", "folder"):
        with pytest.raises(InputError, match=rf"cannot write results to .*{place}.*-o") as refused:
            run(pairs, OPTIONS, KEEP, tmp_path / place)
        assert one_line(refused)


@pytest.mark.skipif(os.name != "posix", reason="needs symbolic links")
@pytest.mark.usefixtures("_worker_here")
def test_a_pair_whose_folder_cannot_be_entered_fails_alone(pairs: list[Pair], tmp_path: Path) -> None:
    place = tmp_path / pairs[1].name
    place.symlink_to(place)
    outcomes = run(pairs, OPTIONS, KEEP, tmp_path, jobs=1)
    assert [outcome.code for outcome in outcomes] == [None, "output", None, None, "unreadable"]
    assert place.name in str(outcomes[1].message)


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_without_permission_is_refused(pairs: list[Pair], tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(InputError, match="Permission denied"):
        run(pairs, OPTIONS, KEEP, tmp_path)


def test_a_cluster_without_dask_says_what_to_install(
    pairs: list[Pair], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"pip install 'slopemap\[cluster\]'") as refused:
        run(pairs, OPTIONS, KEEP, tmp_path, cluster="tcp://head:8786")
    assert one_line(refused)


def peak_memory_mb() -> float:
    """Of this process only; what getrusage tells includes the process that it was forked from."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM")) / 1024


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_memory_does_not_grow_with_the_number_of_pairs(tmp_path: Path) -> None:
    jobs = [make_job(pair, tmp_path / "out", OPTIONS) for pair in make_pairs(make_images(tmp_path / "views", 61))]
    worker = Worker()
    worker.submit(answer_here, jobs[:10]).result()
    after_ten = worker.submit(peak_memory_mb).result()
    worker.submit(answer_here, jobs[10:]).result()
    at_the_end = worker.submit(peak_memory_mb).result()
    assert at_the_end < after_ten + 15
    worker.shutdown()
