"""Functions that executors call: answer jobs in the calling process, or in a child process that may crash."""

from __future__ import annotations

import threading
from collections.abc import Sequence

from slopecli.batch.jobs import Answer, Job
from slopecli.batch.scheduler import ATTEMPTS, failure_of, is_final
from slopecli.batch.worker import NO_LIMITS, Limits, Worker, WorkerFailed

_of_thread = threading.local()


def answer_here(jobs: Sequence[Job]) -> list[Answer]:
    """As `answer_jobs`, which is imported on the first call only."""
    from slopecli.batch.answer import answer_jobs

    return answer_jobs(jobs)


def answer_beside(jobs: Sequence[Job], limits: Limits = NO_LIMITS) -> list[Answer]:
    """Answer jobs one after the other in a child process, which is kept for the next call.

    Raises
    ------
    DiskFull : there is no space left.
    BrokenExecutor : no process can be started.
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
