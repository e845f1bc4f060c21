"""What executors call: the jobs themselves, or on a cluster, a process beside its worker, which no job can then end."""

from __future__ import annotations

import threading
from collections.abc import Sequence

from slopecli.batch.engine import ATTEMPTS, failure_of, is_final
from slopecli.batch.jobs import Answer, Job
from slopecli.batch.worker import NO_LIMITS, Limits, Worker, WorkerFailed

_of_thread = threading.local()


def answer_here(jobs: Sequence[Job]) -> list[Answer]:
    """Answer jobs one after the other in this process; whoever only names this function need not load what it takes."""
    from slopecli.batch.answer import answer_jobs

    return answer_jobs(jobs)


def answer_beside(jobs: Sequence[Job], limits: Limits = NO_LIMITS) -> list[Answer]:
    """Answer jobs one after the other in a process beside this one, which is kept for the next call.

    Raises
    ------
    DiskFull : there is no space left.
    BrokenExecutor : no process can be started here.
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


class _Beside:
    """The process beside a thread; let go when the thread ends."""

    def __init__(self, limits: Limits) -> None:
        self.limits, self.worker = limits, Worker(limits)

    def __del__(self) -> None:
        self.worker.shutdown(wait=False)


def _worker(limits: Limits) -> Worker:
    """The process of this thread, with these limits."""
    beside: _Beside | None = getattr(_of_thread, "beside", None)
    if beside is None or beside.limits != limits:
        beside = _of_thread.beside = _Beside(limits)
    return beside.worker
