"""A whole batch: the folder is locked, what is finished is kept, the rest is answered, and the summary is written."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path

from slopecli.batch.jobs import Answer, Job, Outcome, Pair, Progress
from slopecli.batch.worker import Limits, Worker
from slopecli.errors import DiskFull, InputError, SlopemapError
from slopecli.options import Options

FILES = SUMMARY, LINES, PAGE = "summary.csv", "results.jsonl", "index.html"
CHUNK = 8  # jobs a cluster is given at a time: enough for neighbours to meet, few enough to lose
PER_CORE = 2  # chunks under way, so that no worker waits for the next
MIN_LANES = 32  # for workers that join a cluster later
CONNECT_S = 30
DASK_LOGS = (
    "distributed.client",
    "distributed.core",
    "distributed.comm",
    "distributed.comm.core",
    "distributed.comm.tcp",
)

OnProgress = Callable[[Progress], None]


def run(
    pairs: Sequence[Pair],
    options: Options,
    keep: frozenset[str],
    directory: str | Path,
    *,
    jobs: int | None = None,
    timeout_s: float | None = None,
    memory_gb: float | None = None,
    cluster: str | None = None,
    executor: Executor | None = None,
    ship: bool = False,
    on_progress: OnProgress | None = None,
) -> list[Outcome]:
    """Answer many pairs into one folder, whose finished pairs are kept.

    Each pair has a folder in `directory` as `slopemap estimate -o` writes it; beside them are summary.csv,
    results.jsonl and index.html. May be stopped in any way and called again.

    Parameters
    ----------
    keep : the user's choices of files, of `slopecli.products.CHOICES`.
    jobs : worker processes on this machine; None: one a core.
    timeout_s : the longest a pair may take.  memory_gb : the most memory a worker may ask for, 1e9 bytes (Linux).
    cluster : address of the scheduler of a Dask cluster that answers instead of this machine.
    executor : any executor to answer instead: of mpi4py, dask-jobqueue, ...
    ship : send images to the workers, and files back: for those that do not see the paths of this machine.
    on_progress : called after every pair.

    Returns
    -------
    The outcomes, in the order of `pairs`.

    Raises
    ------
    InputError : no pairs, two of one name, the folder is unusable or in use by another batch, or no worker is left.
    DiskFull : there is no space left. What was finished is kept.
    KeyboardInterrupt : as it came; the summary then has the pairs that are finished.
    """
    _check(pairs)
    folder = Path(directory).absolute()
    work = [Job(pair, options, keep, str(folder / pair.name), os.getcwd()) for pair in pairs]
    with _held(folder) as lock:
        _clear(folder, pairs)
        book = _Book(work, on_progress)
        limits = Limits(timeout_s, memory_gb)
        try:
            if executor is not None:
                _run_elsewhere(work, executor, limits, ship, book)
            elif cluster is not None:
                _run_on_cluster(work, cluster, limits, ship, book)
            else:
                _run_here(work, jobs, limits, lock, book)
        except DiskFull as error:
            with suppress(SlopemapError):
                _write_summary(folder, book.outcomes)
            raise DiskFull(f"{error}; {book.so_far}, free some space and run the same command again") from None
        except BaseException:
            with suppress(SlopemapError):
                _write_summary(folder, book.outcomes)
            raise
        try:
            _clear(folder, pairs)  # workers may have been lost
            _write_summary(folder, book.outcomes)
        except KeyboardInterrupt:
            _write_summary(folder, book.outcomes)  # its files belong together
            raise
        return book.outcomes


def _check(pairs: Sequence[Pair]) -> None:
    if not pairs:
        raise InputError("there are no pairs to compare; needed at least two images")
    names = {pair.name for pair in pairs}
    if len(names) < len(pairs):
        raise InputError("two pairs have the same name; every pair needs a folder of its own")


@contextmanager
def _held(folder: Path) -> Iterator[int]:
    from slopecli.io.lock import locked
    from slopecli.io.outputs import check_directory

    check_directory(folder, FILES)
    with ExitStack() as stack:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            descriptor = stack.enter_context(locked(folder))
        except OSError as error:
            raise _unusable(folder, error) from None
        yield descriptor


def _unusable(folder: Path, error: OSError) -> InputError:
    from slopecli.io.atomic import DISK_FULL

    if error.errno in DISK_FULL:
        return DiskFull(f"disk full while writing to {folder}; free some space and run the same command again")
    return InputError(f"cannot write results to {folder}: {error.strerror or error}; choose another folder with -o")


def _clear(folder: Path, pairs: Sequence[Pair]) -> None:
    """Remove what killed writers left half done."""
    from slopecli.io.atomic import remove_temporary

    for place in (folder, *(folder / pair.name for pair in pairs)):
        remove_temporary(place)


class _Book:
    """Answers as they come in: stored where the worker could not, counted, told to whoever listens."""

    def __init__(self, jobs: Sequence[Job], on_progress: OnProgress | None) -> None:
        self._jobs, self._on_progress = jobs, on_progress
        self._outcomes: list[Outcome | None] = [None] * len(jobs)
        self._done = self._failed = self._kept = 0

    @property
    def outcomes(self) -> list[Outcome]:
        """Of the pairs that are done, in input order."""
        return [outcome for outcome in self._outcomes if outcome is not None]

    @property
    def so_far(self) -> str:
        return f"{self._done} of {len(self._jobs)} pairs are done and kept"

    def enter(self, index: int, answer: Answer) -> None:
        """Take in the answer of a job. Raises DiskFull where its files do not fit."""
        from slopecli.batch.ledger import store

        outcome, job = answer.outcome, self._jobs[index]
        if answer.contents is not None or outcome.code in ("crashed", "timeout"):
            outcome = store(job, outcome, answer.contents or {})
        self._outcomes[index] = outcome
        self._done += 1
        self._failed += outcome.exit_status != 0
        self._kept += answer.kept
        if self._on_progress is not None:
            self._on_progress(Progress(len(self._jobs), self._done, self._failed, self._kept, outcome))


# ---- where the work is done ----


def _run_here(work: list[Job], jobs: int | None, limits: Limits, lock: int, book: _Book) -> None:
    from slopecli.batch.engine import run_batch
    from slopecli.batch.remote import answer_here

    count = min(jobs or _cores(), len(work))
    workers: list[Worker] = []
    try:
        workers += [Worker(limits, inherit=(lock,)) for _ in range(count)]
        run_batch(work, workers, on_answer=book.enter, answer_jobs=answer_here)
    finally:
        for worker in workers:
            worker.shutdown(wait=False, cancel_futures=True)
        for worker in workers:
            worker.shutdown()


def _cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _run_on_cluster(work: list[Job], address: str, limits: Limits, ship: bool, book: _Book) -> None:
    try:
        from distributed import Client
    except ImportError:
        raise InputError("--cluster needs Dask, which is not installed; try pip install 'slopemap[cluster]'") from None
    with _quiet(DASK_LOGS):
        try:
            client = Client(address, timeout=CONNECT_S, set_as_default=False)
        except (OSError, ValueError) as error:
            raise InputError(f"no Dask cluster answers at {address} ({error}); check the address") from None
        with client:
            _run_elsewhere(work, client.get_executor(pure=False), limits, ship, book, sum(client.ncores().values()))


@contextmanager
def _quiet(names: Sequence[str]) -> Iterator[None]:
    """Without the log lines and tracebacks of a connection that is lost: what it means is said in one line."""
    loggers = [logging.getLogger(name) for name in names]
    before = [logger.disabled for logger in loggers]
    for logger in loggers:
        logger.disabled = True
    try:
        yield
    finally:
        for logger, disabled in zip(loggers, before, strict=True):
            logger.disabled = disabled


def _run_elsewhere(
    work: list[Job],
    executor: Executor,
    limits: Limits,
    ship: bool,
    book: _Book,
    cores: int | None = None,
) -> None:
    from slopecli.batch.engine import run_batch
    from slopecli.batch.remote import answer_beside

    cores = cores or getattr(executor, "_max_workers", None) or 1
    chunk = max(1, min(CHUNK, len(work) // (2 * PER_CORE * cores)))
    lanes = PER_CORE * cores if ship else max(PER_CORE * cores, MIN_LANES)
    lanes = min(lanes, -(-len(work) // chunk))
    run_batch(
        work,
        [executor] * lanes,
        on_answer=book.enter,
        answer_jobs=partial(answer_beside, limits=limits),
        chunk=chunk,
        prepare=_shipped if ship else None,
    )


def _shipped(job: Job) -> Job | Answer:
    """A job with all that its worker needs, or its answer where that is known here."""
    from slopecli.batch.answer import load_inputs

    loaded = load_inputs(job)
    return loaded if isinstance(loaded, Answer) else replace(job, shipped=loaded)


# ---- for all pairs ----


def _write_summary(folder: Path, outcomes: Sequence[Outcome]) -> None:
    from slopecli.io.atomic import write_atomically
    from slopecli.io.batch_files import results_jsonl, summary_csv
    from slopecli.io.batch_page import index_html

    contents = {SUMMARY: summary_csv(outcomes), LINES: results_jsonl(outcomes), PAGE: index_html(outcomes)}
    try:
        for name, content in contents.items():
            write_atomically(folder / name, content)
    except OSError as error:
        raise _unusable(folder, error) from None
