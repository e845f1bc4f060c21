"""Distribute jobs over executors: every job is answered exactly once, even if workers crash or executors break.

`run_batch` runs in the calling program; `answer_here` and `answer_beside` are what executors call for a chunk of jobs.
"""

from __future__ import annotations

import threading
from collections import Counter, deque
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Executor, Future, wait
from dataclasses import dataclass, field

from slopecli.batch.jobs import Answer, Job, Outcome, failure
from slopecli.batch.worker import NO_LIMITS, Limits, Worker, WorkerCrashed, WorkerFailed
from slopecli.errors import DiskFull, InputError

AnswerJobs = Callable[[list[Job]], list[Answer]]  # one answer a job, in their order
OnAnswer = Callable[[int, Answer], None]  # called with the index of a job and its answer
Prepare = Callable[[Job], Job | Answer]

_of_thread = threading.local()  # its `child`: the child process of the thread, see `answer_beside`
ATTEMPTS = 2  # crashes of a worker after which the answer of its job is a failure
REMEDIES = {
    "crashed": "try it alone with slopemap estimate -v; if memory is short, lower --jobs",
    "timeout": "raise --timeout, or try smaller images",
}


@dataclass(eq=False)
class Lane:
    """An executor, the indices start..stop of its next jobs, and whether it is busy with a chunk or lost."""

    executor: Executor
    start: int
    stop: int
    lost: bool = False
    busy: bool = False

    def __len__(self) -> int:
        return self.stop - self.start


def run_batch(
    jobs: Sequence[Job],
    executors: Sequence[Executor],
    *,
    on_answer: OnAnswer,
    answer_jobs: AnswerJobs,
    chunk: int = 1,
    prepare: Prepare | None = None,
) -> None:
    """Answer every job once.

    Every executor starts with a contiguous range of the jobs, so that neighbours, which share images, are answered in
    the same process. An executor without jobs takes over the second half of the longest range left.

    Parameters
    ----------
    executors : each runs one chunk at a time; one executor may be listed several times.
    on_answer : called in this thread with the index of a job and its answer.
    answer_jobs : called in the executors with the jobs of a chunk.
    chunk : number of jobs in a call. The jobs of a failed chunk are tried again one by one; the answer of a job that
        fails `ATTEMPTS` times is a failure.
    prepare : called in this thread with a job just before it is submitted; returns the job to submit or its answer.

    Raises
    ------
    DiskFull : there is no space left, in a worker or in `on_answer`; raised when all running chunks have ended.
    InputError : all executors are broken, or the workers cannot import slopemap.
    """
    cuts = [len(jobs) * k // len(executors) for k in range(len(executors) + 1)]
    lanes = [Lane(executor, cuts[k], cuts[k + 1]) for k, executor in enumerate(executors)]
    _Run(jobs, on_answer, answer_jobs, chunk, prepare, lanes).run()


@dataclass
class _Run:
    """The state of a running batch."""

    jobs: Sequence[Job]
    on_answer: OnAnswer
    answer_jobs: AnswerJobs
    chunk: int
    prepare: Prepare | None
    lanes: list[Lane]
    again: deque[int] = field(default_factory=deque)  # jobs of failed chunks, to be tried one by one
    failures: Counter[int] = field(default_factory=Counter)  # failed attempts by index of the job
    running: dict[Future[list[Answer]], tuple[Lane, list[int]]] = field(default_factory=dict)
    disk_full: DiskFull | None = None
    loss: BaseException | None = None  # error of the executor that broke last

    def run(self) -> None:
        """Submit all jobs and collect their answers until none is running."""
        try:
            self._submit_all()
            while self.running:
                # a timeout lets Ctrl-C through on Windows
                done, _ = wait(self.running, timeout=1.0, return_when=FIRST_COMPLETED)
                for future in done:
                    lane, indices = self.running.pop(future)
                    lane.busy = False
                    self._collect(future, lane, indices)
                self._submit_all()
        finally:
            for future in self.running:
                future.cancel()
        if self.disk_full is not None:
            raise self.disk_full
        if self.again or any(map(len, self.lanes)):
            raise InputError(f"no worker is left ({_one_line(self.loss)}); repair that and run the same command again")

    # ---- submit jobs ----

    def _submit_all(self) -> None:
        """Give every free lane its next jobs; repeated, as executors may refuse jobs and `prepare` may know answers."""
        while any(self._submit_next(lane) for lane in self.lanes):
            pass

    def _submit_next(self, lane: Lane) -> bool:
        """Give a lane its next jobs; False if it is not free or there are none."""
        if self.disk_full is not None or lane.busy or lane.lost:
            return False
        indices = self._next(lane)
        if indices:
            self._submit(lane, indices)
        return bool(indices)

    def _next(self, lane: Lane) -> list[int]:
        """Indices of the next jobs of a lane: one to be tried again, or a chunk of its range; empty if none is left."""
        if self.again:
            return [self.again.popleft()]
        if not len(lane):
            self._take_over(lane)
        first, lane.start = lane.start, min(lane.start + self.chunk, lane.stop)
        return list(range(first, lane.start))

    def _take_over(self, lane: Lane) -> None:
        """Move the second half of the longest range left to this lane, or all of it if the lane it was of is lost."""
        longest = max(self.lanes, key=len)
        middle = longest.start if longest.lost else (longest.start + longest.stop) // 2
        lane.start, lane.stop, longest.stop = middle, longest.stop, middle

    def _submit(self, lane: Lane, indices: list[int]) -> None:
        jobs = self._prepared(indices)
        if not jobs:
            return
        try:
            future = lane.executor.submit(self.answer_jobs, list(jobs.values()))
        except (BrokenExecutor, RuntimeError) as error:
            self._lose(lane, error)
            self.again.extend(jobs)
        else:
            lane.busy = True
            self.running[future] = lane, list(jobs)

    def _prepared(self, indices: list[int]) -> dict[int, Job]:
        """Jobs by index, without those whose answer is known."""
        jobs = {}
        for index in indices:
            job = self.jobs[index] if self.prepare is None else self.prepare(self.jobs[index])
            if isinstance(job, Answer):
                self._deliver(index, job)
            else:
                jobs[index] = job
        return jobs

    # ---- collect answers ----

    def _collect(self, future: Future[list[Answer]], lane: Lane, indices: list[int]) -> None:
        try:
            answers = future.result()
        except DiskFull as error:
            self.disk_full = error
        except ImportError as error:
            raise InputError(f"the workers cannot run slopemap ({_one_line(error)}); install it there too") from None
        except (BrokenExecutor, CancelledError) as error:
            self._lose(lane, error)
            self.again.extend(indices)
        except Exception as error:
            self._retry(indices, error)
        else:
            for index, answer in zip(indices, answers, strict=True):
                self._deliver(index, answer)

    def _deliver(self, index: int, answer: Answer) -> None:
        try:
            self.on_answer(index, answer)
        except DiskFull as error:
            self.disk_full = error

    def _lose(self, lane: Lane, error: BaseException) -> None:
        """Mark all lanes of a broken executor."""
        self.loss = error
        for other in self.lanes:
            other.lost |= other.executor is lane.executor

    def _retry(self, indices: list[int], error: Exception) -> None:
        """Try the jobs of a failed chunk one by one; a single job is tried again or has failed."""
        if len(indices) > 1:
            self.again.extend(indices)
            return
        index = indices[0]
        self.failures[index] += 1
        if self.failures[index] < ATTEMPTS and not is_final(error):
            self.again.append(index)
        else:
            self._deliver(index, Answer(failure_of(self.jobs[index], error)))


def is_final(error: Exception) -> bool:
    """Whether a job is not tried again after this error: a timeout would happen again."""
    return isinstance(error, WorkerFailed) and not isinstance(error, WorkerCrashed)


def failure_of(job: Job, error: Exception) -> Outcome:
    """The outcome of a job that crashed its worker or exceeded the time limit."""
    code = error.code if isinstance(error, WorkerFailed) else WorkerCrashed.code
    return failure(job, 1, code, _one_line(error), REMEDIES[code])


def _one_line(error: BaseException | None) -> str:
    return " ".join(str(error or "").split()) or type(error).__name__


# ---- what executors call ----


def answer_here(jobs: Sequence[Job]) -> list[Answer]:
    """Answer jobs in this process; `batch.answer`, with the whole pipeline, is imported on the first call only."""
    from slopecli.batch.answer import answer_jobs

    return answer_jobs(jobs)


def answer_beside(jobs: Sequence[Job], limits: Limits = NO_LIMITS) -> list[Answer]:
    """Answer jobs one after the other in a child process, which is kept for the next call.

    Raises DiskFull if there is no space left, BrokenExecutor if no process can be started.
    """
    worker = _worker(limits)
    return [_answer(worker, job) for job in jobs]


def _answer(worker: Worker, job: Job) -> Answer:
    failed: Exception = WorkerFailed()
    for _ in range(ATTEMPTS):
        try:
            return worker.submit(answer_here, [job]).result()[0]
        except WorkerFailed as error:
            failed = error
            if is_final(error):
                break
    return Answer(failure_of(job, failed))


class _Child:
    """The child process of a thread; it ends with the thread."""

    def __init__(self, limits: Limits) -> None:
        self.limits, self.worker = limits, Worker(limits)

    def __del__(self) -> None:
        self.worker.shutdown(wait=False)


def _worker(limits: Limits) -> Worker:
    """The child process of this thread, with these limits."""
    child: _Child | None = getattr(_of_thread, "child", None)
    if child is None or child.limits != limits:
        child = _of_thread.child = _Child(limits)
    return child.worker
