"""A worker is one process of its own: what it computes comes back, and whatever ends it ends nothing else."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import BrokenExecutor, Future

import pytest
from worker_calls import (
    PATIENCE_S,
    add,
    end_like,
    fill_memory,
    own_facts,
    print_much,
    raise_disk_full,
    raise_what_cannot_be_pickled,
    sleep_holding_on,
)

from slopecli.batch import Limits, Worker, WorkerCrashed, WorkerTimeout
from slopecli.errors import DiskFull, InputError

on_linux = pytest.mark.skipif(sys.platform != "linux", reason="memory can be limited on Linux only")


@pytest.fixture
def _bare(monkeypatch: pytest.MonkeyPatch) -> None:
    """Workers that do not load the pipeline first, which takes most of the time of their start."""
    start = "import sys; from slopecli.batch import worker; worker._warm_up = int; worker.serve(int(sys.argv[1]))"
    monkeypatch.setattr("slopecli.batch.worker.SERVE", start)


@pytest.fixture
def worker(_bare: None) -> Iterator[Worker]:
    one = Worker()
    yield one
    one.shutdown()


def result_of(future: Future[object]) -> object:
    return future.result(PATIENCE_S)


def test_calls_come_back_in_order_from_one_process(worker: Worker) -> None:
    futures = [worker.submit(add, k, b=2) for k in range(20)]
    assert [future.result(PATIENCE_S) for future in futures] == [k + 2 for k in range(20)]
    first, second = (worker.submit(own_facts).result(PATIENCE_S) for _ in range(2))
    assert first == second
    assert first["pid"] != os.getpid()


def test_the_process_has_one_thread_of_computation_and_leaves_ctrl_c_to_its_parent(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "OPENCV_FOR_THREADS_NUM"):
        monkeypatch.setenv(name, "3")
    worker = Worker()
    facts = worker.submit(own_facts).result(PATIENCE_S)
    worker.shutdown()
    assert facts["threads"] == ("1", 1)
    assert facts["interrupt"]
    assert facts["main"] is None  # a script that uses workers is not run again in each


def test_what_is_printed_does_not_get_among_the_replies(worker: Worker) -> None:
    assert worker.submit(print_much).result(PATIENCE_S) == "said"


def test_exceptions_come_back_as_they_are(worker: Worker) -> None:
    with pytest.raises(DiskFull, match="disk full") as failure:
        worker.submit(raise_disk_full).result(PATIENCE_S)
    assert "raise_disk_full" in failure.value.__notes__[0]  # where it arose, for whoever prints the traceback
    with pytest.raises(RuntimeError, match="NoAnswer: pure-rotation"):
        worker.submit(raise_what_cannot_be_pickled).result(PATIENCE_S)
    assert worker.submit(add, 1).result(PATIENCE_S) == 2


@pytest.mark.parametrize("sent", [signal.SIGKILL, signal.SIGSEGV, signal.SIGABRT])
def test_a_crash_fails_its_call_only(worker: Worker, sent: signal.Signals) -> None:
    crash, after = worker.submit(end_like, sent), worker.submit(add, 1)
    with pytest.raises(WorkerCrashed, match=sent.name):
        crash.result(PATIENCE_S)
    assert after.result(PATIENCE_S) == 2


def test_a_worker_killed_between_calls_is_started_again(worker: Worker) -> None:
    pid = worker.submit(own_facts).result(PATIENCE_S)["pid"]
    os.kill(int(str(pid)), signal.SIGKILL)
    for _ in range(2):  # the loss may be noticed by the next call, but by no more than that
        try:
            assert worker.submit(add, 1).result(PATIENCE_S) == 2
        except WorkerCrashed:
            continue
        break
    else:
        pytest.fail("the worker did not come back")


@pytest.mark.usefixtures("_bare")
def test_a_call_that_takes_too_long_is_ended_and_the_next_is_not() -> None:
    worker = Worker(Limits(timeout_s=1.0))
    slow, after = worker.submit(sleep_holding_on, PATIENCE_S), worker.submit(add, 1)
    with pytest.raises(WorkerTimeout, match="1 s"):
        slow.result(PATIENCE_S)
    assert after.result(PATIENCE_S) == 2
    worker.shutdown()


@on_linux
def test_a_call_that_wants_too_much_memory_fails_alone() -> None:
    worker = Worker(Limits(memory_gb=1.0))
    greedy, after = worker.submit(fill_memory, 3 * 10**9), worker.submit(fill_memory, 10**6)
    with pytest.raises(MemoryError):
        greedy.result(PATIENCE_S)
    assert after.result(PATIENCE_S) == 10**6
    worker.shutdown()


@on_linux
def test_a_crash_where_memory_is_limited_says_what_it_may_lack() -> None:
    worker = Worker(Limits(memory_gb=2.0))
    with pytest.raises(WorkerCrashed, match=r"SIGSEGV.*--memory 2 may be too little"):
        worker.submit(end_like, signal.SIGSEGV).result(PATIENCE_S)
    worker.shutdown()


@on_linux
def test_too_little_memory_to_begin_with_is_said() -> None:
    worker = Worker(Limits(memory_gb=1e-4))
    with pytest.raises(BrokenExecutor, match=r"--memory 0\.0001 may be too little"):
        worker.submit(add, 1).result(PATIENCE_S)
    worker.shutdown()


@on_linux
@pytest.mark.usefixtures("_bare")
def test_limits_beyond_all_bounds_are_none() -> None:
    worker = Worker(Limits(timeout_s=1e300, memory_gb=1e300))
    assert worker.submit(add, 1).result(PATIENCE_S) == 2
    worker.shutdown()


def test_memory_is_limited_on_linux_only(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "darwin")
    with pytest.raises(InputError, match=r"--memory.*Linux"):
        Limits(memory_gb=1.0)


@pytest.mark.usefixtures("_bare")
def test_shutdown_at_once_ends_the_call_under_way() -> None:
    worker = Worker()
    worker.submit(add, 1).result(PATIENCE_S)
    futures = [worker.submit(sleep_holding_on, PATIENCE_S) for _ in range(2)]
    while not futures[0].running():
        time.sleep(0.01)
    worker.shutdown(cancel_futures=True)
    assert all(future.done() and future.exception() is not None for future in futures)
    with pytest.raises(RuntimeError):
        worker.submit(add, 1)


PARENT = """
import sys
sys.path[:0] = {path!r}
from worker_calls import own_facts, sleep_holding_on
from slopecli.batch.worker import Worker
worker = Worker()
print(worker.submit(own_facts).result()["pid"], flush=True)
worker.submit(sleep_holding_on, 600).result()
"""


@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_workers_end_with_their_parent_even_if_it_is_killed() -> None:
    program = PARENT.format(path=[os.path.dirname(__file__)])
    with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        pid = int(parent.stdout.readline())
        assert runs(pid)
        parent.kill()
        parent.wait()
    deadline = time.monotonic() + PATIENCE_S
    while runs(pid) and time.monotonic() < deadline:
        time.sleep(0.02)
    assert not runs(pid)


def runs(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return not is_zombie(pid)


def is_zombie(pid: int) -> bool:
    try:
        with open(f"/proc/{pid}/stat", encoding="ascii") as file:
            return file.read().rpartition(")")[2].split()[0] == "Z"
    except OSError:
        return False


@pytest.mark.usefixtures("_bare")
def test_workers_of_several_threads_do_not_hold_each_other_open() -> None:
    workers, answers = [Worker() for _ in range(3)], []
    threads = [threading.Thread(target=lambda w: answers.append(w.submit(add, 1).result()), args=(w,)) for w in workers]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for worker in workers:
        worker.shutdown()  # would wait for ever if another process held the pipe
    assert answers == [add(1)] * 3
