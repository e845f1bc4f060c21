"""Jobs are handed out so that neighbours meet, and each is answered once, whatever its executors do."""

from __future__ import annotations

import random
import threading
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor
from pathlib import Path

import pytest
from batch_factory import make_job

from slopecli.batch import Answer, CameraChoice, Job, Outcome, Pair, WorkerCrashed, WorkerTimeout, run_batch
from slopecli.errors import DiskFull, InputError

CAMERA = CameraChoice(fov_deg=60.0)
PATIENCE_S = 60.0


def make_jobs(count: int) -> list[Job]:
    return [make_job(Pair(f"{k}", f"{k}.png", f"{k + 1}.png", CAMERA, CAMERA), Path("out")) for k in range(count)]


def answer_of(job: Job, exit_status: int = 0) -> Answer:
    return Answer(Outcome(job.pair.name, job.pair.image1, job.pair.image2, exit_status))


def answer_all(jobs: Sequence[Job]) -> list[Answer]:
    return [answer_of(job) for job in jobs]


class Direct(Executor):
    """Calls at once, in this thread; `before` may raise what the call ends in."""

    def __init__(self, before: Callable[[list[int]], object] = lambda numbers: None) -> None:
        self.before, self.chunks = before, list[list[int]]()

    def submit(self, fn: Callable[..., object], /, *args: object, **kwargs: object) -> Future:  # type: ignore[type-arg]
        future: Future[object] = Future()
        numbers = [int(job.pair.name) for job in args[0]]  # type: ignore[attr-defined]
        self.chunks.append(numbers)
        try:
            self.before(numbers)
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


class Gone(Executor):
    """Takes nothing."""

    def submit(self, fn: Callable[..., object], /, *args: object, **kwargs: object) -> Future:  # type: ignore[type-arg]
        raise BrokenExecutor("the pool is gone")


class Book:
    """What was delivered."""

    def __init__(self) -> None:
        self.answers: dict[int, Answer] = {}

    def enter(self, index: int, answer: Answer) -> None:
        assert index not in self.answers, "answered twice"
        self.answers[index] = answer

    def codes(self) -> dict[int, str | None]:
        return {k: answer.outcome.code for k, answer in self.answers.items() if answer.outcome.exit_status}


def run(n_jobs: int, executors: Sequence[Executor], **changes: object) -> Book:
    book = Book()
    arguments = {"on_answer": book.enter, "answer_jobs": answer_all, **changes}
    run_batch(make_jobs(n_jobs), executors, **arguments)  # type: ignore[arg-type]
    assert sorted(book.answers) == list(range(n_jobs))
    assert all(answer.outcome.name == str(k) for k, answer in book.answers.items())
    return book


def flat(chunks: Iterable[Sequence[int]]) -> list[int]:
    return [number for chunk in chunks for number in chunk]


def test_neighbours_are_answered_one_after_the_other_by_the_same_executor() -> None:
    executors = [Direct(), Direct(), Direct()]
    run(30, executors)
    assert [flat(one.chunks) for one in executors] == [list(range(k, k + 10)) for k in (0, 10, 20)]


def test_who_has_finished_takes_over_half_of_what_another_has_left() -> None:
    go_on = threading.Event()
    answered: dict[str, list[int]] = {"slow": [], "quick": []}
    lock = threading.Lock()

    def answer(jobs: Sequence[Job]) -> list[Answer]:
        name = threading.current_thread().name.split("_")[0]
        if name == "slow" and answered["slow"]:
            assert go_on.wait(PATIENCE_S)
        with lock:
            answered[name] += [int(job.pair.name) for job in jobs]
            if sum(map(len, answered.values())) == 39:
                go_on.set()  # all but the one that the slow executor is at
        return answer_all(jobs)

    with ThreadPoolExecutor(1, "slow") as slow, ThreadPoolExecutor(1, "quick") as quick:
        run(40, [slow, quick], answer_jobs=answer)
    assert answered["slow"] == [0, 1]
    steps = [b - a for a, b in zip(answered["quick"], answered["quick"][1:], strict=False)]
    assert steps.count(1) > 0.8 * len(steps)  # still stretches of neighbours


def test_more_executors_than_jobs_and_no_jobs_at_all() -> None:
    five, idle = [Direct() for _ in range(5)], Direct()
    assert len(run(2, five).answers) == 2
    assert sorted(flat(chunk for one in five for chunk in one.chunks)) == [0, 1]
    assert not run(0, [idle]).answers
    assert not idle.chunks


def test_chunks_have_the_size_asked_for() -> None:
    one = Direct()
    run(20, [one], chunk=8)
    assert [len(chunk) for chunk in one.chunks] == [8, 8, 4]


# ---- what breaks ----


def breaks_for(bad: int, error: Exception) -> Callable[[list[int]], None]:
    def before(numbers: list[int]) -> None:
        if bad in numbers:
            raise error

    return before


@pytest.mark.parametrize("error", [WorkerCrashed("lost"), OSError("connection reset"), RuntimeError("killed")])
def test_a_chunk_that_breaks_is_tried_one_by_one_and_only_the_guilty_fails(error: Exception) -> None:
    one = Direct(breaks_for(5, error))
    book = run(20, [one], chunk=8)
    assert book.codes() == {5: "crashed"}
    assert str(error) in str(book.answers[5].outcome.message)
    assert [chunk for chunk in one.chunks if 5 in chunk] == [list(range(8)), [5], [5]]


def test_a_job_whose_worker_was_lost_once_is_answered() -> None:
    left = [WorkerCrashed("lost")]

    def before(numbers: list[int]) -> None:
        if 3 in numbers and left:
            raise left.pop()

    assert not run(6, [Direct(before), Direct()]).codes()


def test_a_job_that_takes_too_long_is_not_tried_again() -> None:
    one = Direct(breaks_for(2, WorkerTimeout("no answer within 9 s")))
    outcome = run(5, [one]).answers[2].outcome
    assert (outcome.exit_status, outcome.code, outcome.message) == (1, "timeout", "no answer within 9 s")
    assert "--timeout" in str(outcome.remedy)
    assert flat(one.chunks).count(2) == 1


@pytest.mark.parametrize("seed", range(20))
def test_every_job_is_answered_once_whatever_is_lost_on_the_way(seed: int) -> None:
    rng = random.Random(seed)
    failed: Counter[int] = Counter()

    def before(numbers: list[int]) -> None:
        if rng.random() < 0.3:
            if len(numbers) == 1:
                failed[numbers[0]] += 1
            raise WorkerCrashed("lost")

    book = run(rng.randint(1, 60), [Direct(before) for _ in range(rng.randint(1, 5))], chunk=rng.randint(1, 9))
    assert set(book.codes()) == {number for number, count in failed.items() if count > 1}


def test_an_executor_that_is_gone_leaves_its_jobs_to_the_others() -> None:
    one = Direct()
    run(20, [Gone(), one, Gone()])
    assert sorted(flat(one.chunks)) == list(range(20))


def test_an_executor_that_goes_on_the_way_leaves_its_jobs_to_the_others() -> None:
    going, other = Direct(breaks_for(4, BrokenExecutor("the pool is gone"))), Direct()
    assert not run(20, [going, other]).codes()
    assert 4 in flat(other.chunks)


def test_a_job_refused_at_the_very_end_is_taken_by_who_had_nothing_left_to_do() -> None:
    class Leaving(Direct):
        def submit(self, fn: Callable[..., object], /, *args: object, **kwargs: object) -> Future:  # type: ignore[type-arg]
            if len(self.chunks) == 3:
                raise BrokenExecutor("the pool is gone")
            return super().submit(fn, *args, **kwargs)

    staying, leaving = Direct(), Leaving()
    assert not run(7, [staying, leaving]).codes()
    assert sorted(flat(staying.chunks) + flat(leaving.chunks)) == list(range(7))
    assert len(leaving.chunks) <= 3


def test_without_any_executor_left_the_batch_ends_in_one_line_and_what_was_answered_counts() -> None:
    book = Book()
    gone = Direct(breaks_for(7, BrokenExecutor("the pool is gone")))
    with pytest.raises(InputError, match=r"no worker is left.*the pool is gone.*same command again"):
        run_batch(make_jobs(20), [gone] * 2, on_answer=book.enter, answer_jobs=answer_all)
    assert book.answers
    assert 7 not in book.answers


def test_workers_without_slopemap_are_named_as_such() -> None:
    broken = Direct(breaks_for(0, ModuleNotFoundError("No module named 'slopecli'")))
    with pytest.raises(InputError, match=r"workers cannot run slopemap.*No module named 'slopecli'"):
        run_batch(make_jobs(5), [broken], on_answer=Book().enter, answer_jobs=answer_all)


# ---- a full disk ----


def test_a_full_disk_ends_the_batch_after_what_is_under_way() -> None:
    book, full = Book(), threading.Event()

    def answer(jobs: Sequence[Job]) -> list[Answer]:
        if jobs[0].pair.name == "0":
            full.set()
            raise DiskFull("disk full while writing to out/0")
        assert full.wait(PATIENCE_S)
        return answer_all(jobs)

    with ThreadPoolExecutor(1) as first, ThreadPoolExecutor(1) as second, pytest.raises(DiskFull, match="out/0"):
        run_batch(make_jobs(20), [first, second], on_answer=book.enter, answer_jobs=answer)
    assert 10 in book.answers
    assert len(book.answers) < 19


def test_a_full_disk_here_ends_the_batch_too() -> None:
    taken: list[int] = []

    def enter(index: int, answer: Answer) -> None:
        taken.append(index)
        if len(taken) == 3:
            raise DiskFull("disk full")

    with pytest.raises(DiskFull):
        run_batch(make_jobs(20), [Direct()], on_answer=enter, answer_jobs=answer_all)
    assert taken == [0, 1, 2]


# ---- what is known beforehand ----


def test_jobs_whose_answer_is_known_are_not_handed_out() -> None:
    one = Direct()

    def prepare(job: Job) -> Job | Answer:
        return answer_of(job) if int(job.pair.name) % 3 else job

    run(20, [one], prepare=prepare, chunk=4)
    assert flat(one.chunks) == list(range(0, 20, 3))


def test_jobs_are_prepared_only_when_their_turn_comes() -> None:
    ahead: list[int] = []
    prepared = answered = 0

    def prepare(job: Job) -> Job:
        nonlocal prepared
        prepared += 1
        ahead.append(prepared - answered)
        return job

    def enter(index: int, answer: Answer) -> None:
        nonlocal answered
        answered += 1

    run_batch(make_jobs(50), [Direct(), Direct()], on_answer=enter, answer_jobs=answer_all, prepare=prepare)
    assert (prepared, answered) == (50, 50)
    assert max(ahead) <= 2  # one a lane: what a job holds does not pile up


def test_ctrl_c_is_passed_on_and_nothing_more_is_handed_out() -> None:
    one = Direct()

    def enter(index: int, answer: Answer) -> None:
        if index == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_batch(make_jobs(20), [one], on_answer=enter, answer_jobs=answer_all)
    assert flat(one.chunks) == [0, 1, 2]


def test_what_waits_when_a_batch_is_interrupted_is_called_off() -> None:
    class Slow(Direct):
        """Answers the first job, and then never."""

        def __init__(self) -> None:
            super().__init__()
            self.waiting: list[Future] = []  # type: ignore[type-arg]

        def submit(self, fn: Callable[..., object], /, *args: object, **kwargs: object) -> Future:  # type: ignore[type-arg]
            if not self.chunks:
                return super().submit(fn, *args, **kwargs)
            self.waiting.append(Future())
            return self.waiting[-1]

    def enter(index: int, answer: Answer) -> None:
        raise KeyboardInterrupt

    one = Slow()
    with pytest.raises(KeyboardInterrupt):
        run_batch(make_jobs(9), [one] * 3, on_answer=enter, answer_jobs=answer_all)
    assert len(one.waiting) == 2
    assert all(future.cancelled() for future in one.waiting)
