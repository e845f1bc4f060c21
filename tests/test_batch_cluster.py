"""Beyond one machine: a Dask cluster, or any executor, comes to the same bytes as the processes of this machine."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import pytest
from batch_factory import make_images, make_pairs, tree
from campaign import seeds

from slopecli.batch import Keep, Outcome, Pair, Progress, run
from slopecli.errors import InputError
from slopecli.options import Options

N_IMAGES = len(seeds(9, 3))  # a worker that is lost half way must leave some to do
OPTIONS, KEEP = Options(grid=(1, 1)), Keep(overlay=False, ply=False)


@pytest.fixture(scope="module")
def pairs(tmp_path_factory: pytest.TempPathFactory) -> list[Pair]:
    return make_pairs(make_images(tmp_path_factory.mktemp("views"), N_IMAGES))


@pytest.fixture(scope="module")
def here(pairs: list[Pair], tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """What the processes of this machine come to."""
    folder = tmp_path_factory.mktemp("here")
    answer(pairs, folder, jobs=1)
    return tree(folder)


@contextmanager
def started_cluster() -> Iterator[Any]:
    """Two worker processes of Dask on this machine."""
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
    ) as local:
        yield local


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    with started_cluster() as started:
        yield started


@pytest.fixture
def own_cluster() -> Iterator[Any]:
    """For a test that harms it."""
    with started_cluster() as started:
        yield started


def answer(pairs: list[Pair], folder: Path, **how: Any) -> list[Outcome]:
    outcomes = run(pairs, OPTIONS, KEEP, folder, **how)
    assert [outcome.exit_status for outcome in outcomes] == [0] * len(pairs)
    return outcomes


@pytest.mark.parametrize("ship", [False, True], ids=["shared paths", "shipped"])
def test_a_cluster_comes_to_the_same_bytes(
    cluster: Any, pairs: list[Pair], here: dict[str, bytes], tmp_path: Path, ship: bool
) -> None:
    answer(pairs, tmp_path, cluster=cluster.scheduler_address, ship=ship)
    assert tree(tmp_path) == here
    seen: list[Progress] = []
    answer(pairs, tmp_path, cluster=cluster.scheduler_address, ship=ship, on_progress=seen.append)
    assert seen[-1].n_kept == len(pairs)
    assert tree(tmp_path) == here


@pytest.mark.slow
@pytest.mark.parametrize("ship", [False, True], ids=["shared paths", "shipped"])
def test_a_worker_killed_half_way_changes_nothing(
    own_cluster: Any, pairs: list[Pair], here: dict[str, bytes], tmp_path: Path, ship: bool
) -> None:
    victims = [nanny.pid for nanny in own_cluster.workers.values()]
    assert os.getpid() not in victims

    def kill(progress: Progress) -> None:
        if progress.n_done >= len(pairs) // 2 and victims:
            os.kill(victims[0], signal.SIGKILL)
            victims.clear()

    answer(pairs, tmp_path, cluster=own_cluster.scheduler_address, ship=ship, on_progress=kill)
    assert not victims
    assert tree(tmp_path) == here


@pytest.mark.slow
def test_the_command_runs_on_a_cluster(cluster: Any, pairs: list[Pair], here: dict[str, bytes], tmp_path: Path) -> None:
    folder = Path(pairs[0].image1).parent
    program = [sys.executable, "-m", "slopecli", "batch", str(folder), "-o", str(tmp_path), "-q"]
    program += ["--grid", "1x1", "--no-overlay", "--no-ply"]
    done = subprocess.run(
        [*program, "--cluster", cluster.scheduler_address], capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stderr
    assert not done.stderr
    assert tree(tmp_path) == here


def test_a_cluster_that_is_not_there_is_one_line(pairs: list[Pair], tmp_path: Path) -> None:
    pytest.importorskip("distributed")
    import dask

    soon = dask.config.set({"distributed.comm.timeouts.connect": "1s"})
    with soon, pytest.raises(InputError, match=r"no Dask cluster answers at tcp://127.0.0.1:9") as refused:
        run(pairs, OPTIONS, KEEP, tmp_path, cluster="tcp://127.0.0.1:9")
    assert "\n" not in str(refused.value)


def thread_pool() -> Executor:
    return ThreadPoolExecutor(2)


def process_pool() -> Executor:
    return ProcessPoolExecutor(2, mp_context=get_context("spawn"))


@pytest.mark.parametrize("make", [thread_pool, pytest.param(process_pool, marks=pytest.mark.slow)])
def test_any_executor_will_do(
    make: Callable[[], Executor], pairs: list[Pair], here: dict[str, bytes], tmp_path: Path
) -> None:
    with make() as executor:
        answer(pairs, tmp_path, executor=executor)
    assert tree(tmp_path) == here
