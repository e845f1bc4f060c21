"""Run a batch: lock the output folder, keep the finished pairs, answer the others, write the summary files."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path

from slopecli.batch.jobs import Answer, Job, Outcome, Pair, Progress, store
from slopecli.batch.scheduler import answer_beside, answer_here, run_batch
from slopecli.batch.summary import FILES, PAGE, RESULTS, SUMMARY, index_html, results_jsonl, summary_csv
from slopecli.batch.worker import Limits, Worker
from slopecli.errors import DiskFull, InputError, SlopemapError
from slopecli.io.files import DISK_FULL, remove_temporary, write_atomically
from slopecli.io.lock import locked
from slopecli.io.outputs import RECORD, check_directory, replaced_input
from slopecli.options import MapOptions, MetadataChoice, Options
from slopecli.products import OUTPUT_NAMES

CHUNK = 8  # jobs in a call on a cluster: neighbours share images, but a lost worker costs a chunk
PER_CORE = 2  # chunks submitted per core, so that no worker waits for the next
MIN_LANES = 32  # chunks submitted to a cluster, as more workers may join later
DASK_LOGS = tuple(f"distributed.{part}" for part in ("client", "core", "comm", "comm.core", "comm.tcp"))

OnProgress = Callable[[Progress], None]


def run(
    pairs: Sequence[Pair],
    options: Options,
    keep: frozenset[str],
    directory: str | Path,
    *,
    wanted: MapOptions | None = None,
    metadata: MetadataChoice | None = None,
    jobs: int | None = None,
    timeout_s: float | None = None,
    memory_gb: float | None = None,
    cluster: str | None = None,
    executor: Executor | None = None,
    ship: bool = False,
    on_progress: OnProgress | None = None,
) -> list[Outcome]:
    """Estimate many pairs and write the results to one folder, in which finished pairs are kept.

    Each pair has a folder in `directory` as `slopemap estimate -o` or `map -o` writes it, beside summary.csv,
    results.jsonl and index.html. The same call continues a stopped run. Returns outcomes in the order of `pairs`.

    Parameters
    ----------
    keep : the user's choices of files, of `PRODUCTS` or `MAP_PRODUCTS`.  wanted : options of maps; None for estimates.
    metadata : what is taken of each pair from the metadata of its own images; None for nothing.
    jobs : worker processes here; None: one a core.  timeout_s, memory_gb : limits of a pair, and of a worker (Linux).
    cluster : scheduler's address of a Dask cluster that is used instead.  executor : any executor, likewise.
    ship : send images, and files back, as workers cannot open the paths here.  on_progress : called after every pair.

    Raises
    ------
    InputError : no pairs, two of one name, the folder is unusable or in use by another batch, or no worker is left.
    DiskFull, KeyboardInterrupt : no space is left, or interrupted; finished pairs are kept and in the summary files.
    """
    if not pairs:
        raise InputError("there are no pairs to compare; needed at least two images")
    if len({pair.name for pair in pairs}) < len(pairs):
        raise InputError("two pairs have the same name; every pair needs a folder of its own")
    folder = Path(directory).absolute()
    for_all = partial(Job, options=options, keep=keep, base=os.getcwd(), wanted=wanted, metadata=metadata)
    work = [for_all(pair, folder=str(folder / pair.name)) for pair in pairs]
    results, limits = _Results(work, on_progress), Limits(timeout_s, memory_gb)
    with _locked(folder, pairs) as lock, _summarised(folder, pairs, results):
        if executor is not None:
            _run_elsewhere(work, executor, limits, ship, results)
        elif cluster is not None:
            _run_on_cluster(work, cluster, limits, ship, results)
        else:
            _run_here(work, jobs, limits, lock, results)
    return results.outcomes


def _check_inputs(folder: Path, pairs: Sequence[Pair]) -> None:
    """Raise InputError if an image or a camera file is one of the files that the batch writes."""
    used = (pair for pair in pairs if os.path.isdir(folder / pair.name))
    outputs = [*(folder / name for name in FILES)]
    outputs += [folder / pair.name / name for pair in used for name in (*OUTPUT_NAMES, RECORD)]
    inputs: dict[str | None, None] = {}
    for pair in pairs:
        cameras = (choice.file for choice in (pair.camera1, pair.camera2) if choice is not None)
        inputs |= dict.fromkeys((pair.image1, pair.image2, *cameras))
    if taken := replaced_input(outputs, inputs):
        raise InputError(f"{taken} is an input, and would be replaced by a result; choose another folder with -o")


@contextmanager
def _locked(folder: Path, pairs: Sequence[Pair]) -> Iterator[int]:
    """Make the output folder, if no input is in the way, and lock it; gives the file descriptor of the lock."""
    check_directory(folder, FILES)
    _check_inputs(folder, pairs)
    with ExitStack() as stack:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            descriptor = stack.enter_context(locked(folder))
        except OSError as error:
            raise _unusable(folder, error) from None
        yield descriptor


@contextmanager
def _summarised(folder: Path, pairs: Sequence[Pair], results: _Results) -> Iterator[None]:
    """Write the summary files at the end, also after an error or an interruption."""
    _remove_unfinished(folder, pairs)
    try:
        yield
    except BaseException as error:
        with suppress(SlopemapError):
            _write_summary(folder, results.outcomes)
        if isinstance(error, DiskFull):
            so_far = f"{len(results.outcomes)} of {len(pairs)} pairs are done and kept"
            raise DiskFull(f"{error}; {so_far}, free some space and run the same command again") from None
        raise
    try:
        _remove_unfinished(folder, pairs)  # of workers that crashed
        _write_summary(folder, results.outcomes)
    except KeyboardInterrupt:
        _write_summary(folder, results.outcomes)  # again, so that its files agree
        raise


def _unusable(folder: Path, error: OSError) -> InputError:
    if error.errno in DISK_FULL:
        return DiskFull(f"disk full while writing to {folder}; free some space and run the same command again")
    return InputError(f"cannot write results to {folder}: {error.strerror or error}; choose another folder with -o")


def _remove_unfinished(folder: Path, pairs: Sequence[Pair]) -> None:
    """Remove temporary files of processes that were killed."""
    for place in (folder, *(folder / pair.name for pair in pairs)):
        remove_temporary(place)


class _Results:
    """Collects answers: stores files that the worker could not store, counts, reports progress."""

    def __init__(self, jobs: Sequence[Job], on_progress: OnProgress | None) -> None:
        self._jobs, self._on_progress = jobs, on_progress
        self._outcomes: list[Outcome | None] = [None] * len(jobs)
        self._done = self._failed = self._kept = 0

    @property
    def outcomes(self) -> list[Outcome]:
        """Outcomes of the pairs that are done, in input order."""
        return [outcome for outcome in self._outcomes if outcome is not None]

    def add(self, index: int, answer: Answer) -> None:
        """Add the answer of a job. Raises DiskFull if its files cannot be stored."""
        outcome, job = answer.outcome, self._jobs[index]
        if answer.contents is not None or outcome.code in ("crashed", "timeout"):
            outcome = store(job, outcome, answer.contents or {})
        self._outcomes[index] = outcome
        self._done += 1
        self._failed += outcome.exit_status != 0
        self._kept += answer.kept
        if self._on_progress is not None:
            self._on_progress(Progress(len(self._jobs), self._done, self._failed, self._kept, outcome))


# ---- on this machine or elsewhere ----


def _run_here(work: list[Job], jobs: int | None, limits: Limits, lock: int, results: _Results) -> None:
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    count = min(jobs or cores, len(work))
    workers: list[Worker] = []
    try:
        workers += [Worker(limits, inherit=(lock,)) for _ in range(count)]
        run_batch(work, workers, on_answer=results.add, answer_jobs=answer_here)
    finally:
        for worker in workers:
            worker.shutdown(wait=False, cancel_futures=True)
        for worker in workers:
            worker.shutdown()


def _run_on_cluster(work: list[Job], address: str, limits: Limits, ship: bool, results: _Results) -> None:
    try:
        from distributed import Client
    except ImportError:
        raise InputError("--cluster needs Dask, which is not installed; try pip install 'slopemap[cluster]'") from None
    with _quiet(DASK_LOGS):
        try:
            client = Client(address, set_as_default=False)
        except (OSError, ValueError) as error:
            raise InputError(f"no Dask cluster answers at {address} ({error}); check the address") from None
        with client:
            _run_elsewhere(work, client.get_executor(pure=False), limits, ship, results, sum(client.ncores().values()))


@contextmanager
def _quiet(names: Sequence[str]) -> Iterator[None]:
    """Disable these loggers: a lost connection is reported in one line instead."""
    enabled = [logger for logger in map(logging.getLogger, names) if not logger.disabled]
    for logger in enabled:
        logger.disabled = True
    try:
        yield
    finally:
        for logger in enabled:
            logger.disabled = False


def _run_elsewhere(
    work: list[Job], executor: Executor, limits: Limits, ship: bool, results: _Results, cores: int | None = None
) -> None:
    cores = cores or getattr(executor, "_max_workers", None) or 1
    chunk = max(1, min(CHUNK, len(work) // (2 * PER_CORE * cores)))
    lanes = PER_CORE * cores if ship else max(PER_CORE * cores, MIN_LANES)
    lanes = min(lanes, -(-len(work) // chunk))
    run_batch(
        work,
        [executor] * lanes,
        on_answer=results.add,
        answer_jobs=partial(answer_beside, limits=limits),
        chunk=chunk,
        prepare=_shipped if ship else None,
    )


def _shipped(job: Job) -> Job | Answer:
    """The job with the contents of its input files, or its answer if that is known."""
    from slopecli.batch.answer import load_inputs

    loaded = load_inputs(job)
    return loaded if isinstance(loaded, Answer) else replace(job, shipped=loaded)


def _write_summary(folder: Path, outcomes: Sequence[Outcome]) -> None:
    contents = {SUMMARY: summary_csv(outcomes), RESULTS: results_jsonl(outcomes), PAGE: index_html(outcomes)}
    try:
        for name, content in contents.items():
            write_atomically(folder / name, content)
    except OSError as error:
        raise _unusable(folder, error) from None
