"""Many jobs on many executors: handed out so that neighbours meet, each answered once, whatever breaks on the way."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Executor, Future, wait
from dataclasses import dataclass

from slopecli.batch.jobs import Answer, Job, Outcome
from slopecli.batch.ledger import failure
from slopecli.batch.worker import WorkerCrashed, WorkerFailed
from slopecli.errors import DiskFull, InputError

AnswerJobs = Callable[[list[Job]], list[Answer]]
OnAnswer = Callable[[int, Answer], None]
Prepare = Callable[[Job], Job | Answer]

ATTEMPTS = 2  # a job that loses its worker this often is to blame itself
REMEDIES = {
    "crashed": "try it alone with slopemap estimate -v; if memory is short, lower --jobs",
    "timeout": "raise --timeout, or try smaller images",
}


@dataclass(eq=False)
class Lane:
    """An executor with at most one chunk of jobs under way, and the stretch start..stop of jobs that come next."""

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

    The jobs are cut into as many contiguous stretches as there are executors, so that neighbours, which share images,
    meet in the same process; whoever has finished takes over the second half of the longest stretch left.

    Parameters
    ----------
    executors : one lane each; the same executor may stand for several.
    on_answer : called in this thread with the index of a job and its answer, as answers come in.
    answer_jobs : what the executors call.
    chunk : how many jobs are handed out at a time. A chunk that breaks is tried again one by one; a job that breaks
        `ATTEMPTS` times is answered by a failure.
    prepare : applied to a job just before it is handed out, in this thread; may know the answer already.

    Raises
    ------
    DiskFull : there is no space left, from a worker or from `on_answer`; what was under way has been waited for.
    InputError : no executor takes jobs any more, or the workers cannot run slopemap.
    """
    _Run(jobs, executors, on_answer, answer_jobs, chunk, prepare).run()


class _Run:
    """The state of one batch under way."""

    def __init__(
        self,
        jobs: Sequence[Job],
        executors: Sequence[Executor],
        on_answer: OnAnswer,
        answer_jobs: AnswerJobs,
        chunk: int,
        prepare: Prepare | None,
    ) -> None:
        self._jobs, self._on_answer, self._answer_jobs = jobs, on_answer, answer_jobs
        self._chunk, self._prepare = chunk, prepare
        cuts = [len(jobs) * k // len(executors) for k in range(len(executors) + 1)]
        self._lanes = [Lane(executor, cuts[k], cuts[k + 1]) for k, executor in enumerate(executors)]
        self._again: deque[int] = deque()  # of broken chunks, one by one
        self._breaks: Counter[int] = Counter()
        self._under_way: dict[Future[list[Answer]], tuple[Lane, list[int]]] = {}
        self._disk_full: DiskFull | None = None
        self._loss: BaseException | None = None

    def run(self) -> None:
        try:
            self._hand_out()
            while self._under_way:
                # a timeout lets Ctrl-C through on Windows
                done, _ = wait(self._under_way, timeout=1.0, return_when=FIRST_COMPLETED)
                for future in done:
                    lane, indices = self._under_way.pop(future)
                    lane.busy = False
                    self._take_in(future, lane, indices)
                self._hand_out()
        finally:
            for future in self._under_way:
                future.cancel()
        if self._disk_full is not None:
            raise self._disk_full
        if self._left():
            raise InputError(f"no worker is left ({_line(self._loss)}); mend that and run the same command again")

    def _left(self) -> int:
        return len(self._again) + sum(map(len, self._lanes))

    # ---- out ----

    def _hand_out(self) -> None:
        """Give every lane that waits its next jobs; once more after each that was refused or known already."""
        while any(self._serve(lane) for lane in self._lanes):
            pass

    def _serve(self, lane: Lane) -> bool:
        """Give one lane its next jobs; False if it has some, or there are none."""
        if self._disk_full is not None or lane.busy or lane.lost:
            return False
        indices = self._next(lane)
        if indices:
            self._submit(lane, indices)
        return bool(indices)

    def _next(self, lane: Lane) -> list[int]:
        if self._again:
            return [self._again.popleft()]
        if not len(lane):
            self._take_over(lane)
        first, lane.start = lane.start, min(lane.start + self._chunk, lane.stop)
        return list(range(first, lane.start))

    def _take_over(self, lane: Lane) -> None:
        """The second half of the longest stretch left; all of it where its own lane is lost."""
        longest = max(self._lanes, key=len)
        middle = longest.start if longest.lost else (longest.start + longest.stop) // 2
        lane.start, lane.stop, longest.stop = middle, longest.stop, middle

    def _submit(self, lane: Lane, indices: list[int]) -> None:
        jobs = self._prepared(indices)
        if not jobs:
            return
        try:
            future = lane.executor.submit(self._answer_jobs, list(jobs.values()))
        except (BrokenExecutor, RuntimeError) as error:
            self._lose(lane, error)
            self._again.extend(jobs)
        else:
            lane.busy = True
            self._under_way[future] = lane, list(jobs)

    def _prepared(self, indices: list[int]) -> dict[int, Job]:
        """Jobs by index, without those whose answer is known already."""
        jobs = {}
        for index in indices:
            job = self._jobs[index] if self._prepare is None else self._prepare(self._jobs[index])
            if isinstance(job, Answer):
                self._deliver(index, job)
            else:
                jobs[index] = job
        return jobs

    # ---- in ----

    def _take_in(self, future: Future[list[Answer]], lane: Lane, indices: list[int]) -> None:
        try:
            answers = future.result()
        except DiskFull as error:
            self._disk_full = error
        except ImportError as error:
            raise InputError(f"the workers cannot run slopemap ({_line(error)}); install it there too") from None
        except (BrokenExecutor, CancelledError) as error:
            self._lose(lane, error)
            self._again.extend(indices)
        except Exception as error:
            self._try_again(indices, error)
        else:
            for index, answer in zip(indices, answers, strict=True):
                self._deliver(index, answer)

    def _deliver(self, index: int, answer: Answer) -> None:
        try:
            self._on_answer(index, answer)
        except DiskFull as error:
            self._disk_full = error

    def _lose(self, lane: Lane, error: BaseException) -> None:
        """An executor that is broken is so for all of its lanes."""
        self._loss = error
        for other in self._lanes:
            other.lost |= other.executor is lane.executor

    def _try_again(self, indices: list[int], error: Exception) -> None:
        """One by one: then it is known which of them breaks."""
        if len(indices) > 1:
            self._again.extend(indices)
            return
        index = indices[0]
        self._breaks[index] += 1
        if self._breaks[index] < ATTEMPTS and not is_final(error):
            self._again.append(index)
        else:
            self._deliver(index, Answer(failure_of(self._jobs[index], error)))


def is_final(error: Exception) -> bool:
    """Whether a job that failed like this is not tried again: a timeout would come again."""
    return isinstance(error, WorkerFailed) and not isinstance(error, WorkerCrashed)


def failure_of(job: Job, error: Exception) -> Outcome:
    """The outcome of a job that has ended its worker."""
    code = error.code if isinstance(error, WorkerFailed) else WorkerCrashed.code
    return failure(job, 1, code, _line(error), REMEDIES[code])


def _line(error: BaseException | None) -> str:
    return " ".join(str(error or "").split()) or type(error).__name__
