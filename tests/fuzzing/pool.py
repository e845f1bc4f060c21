"""Run many cases in processes of their own, so that one that crashes or hangs is known and the others go on."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import NamedTuple

from fuzzing.case import Case
from fuzzing.checks import MOST_S, complaints, limit_memory

CURRENT = "case.pickle"  # in the folder of a process: what it runs, should it die of it
PATIENCE_S = 120.0  # without a word from a process, unless it was given no processor time
THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "OPENCV_FOR_THREADS_NUM")


class Failure(NamedTuple):
    """number : of the case, or of the block it was drawn in."""

    number: int
    case: Case
    complaints: list[str]


@dataclass(eq=False)
class _Process:
    process: BaseProcess
    pipe: Connection
    folder: Path
    number: int = -1
    used_s: float = 0.0  # processor time at its last word

    def is_stuck(self) -> bool:
        """Whether it waits for nothing, or used more time than an input may; on a busy machine it may just be slow."""
        state, used_s = state_of(self.process.pid or 0)
        return state != "R" or used_s - self.used_s > 2 * MOST_S


def state_of(pid: int) -> tuple[str, float]:
    """State of a process, "R" where it runs or would run, and its processor time, s; ("", 0) where nothing says so."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(") ")[2].split()
    except OSError:
        return "", 0.0
    return fields[0], sum(map(int, fields[11:13])) / os.sysconf("SC_CLK_TCK")


class Pool:
    """`jobs` processes that run blocks of cases; `failures` as they come."""

    def __init__(self, seed: int, jobs: int, kinds: list[str] | None = None) -> None:
        self.seed, self.jobs, self.kinds = seed, jobs, kinds
        self.done = 0  # cases so far
        self.tally: dict[str, tuple[int, float]] = {}  # cases of a kind, and their processor time, s

    def failures(self, numbers: Iterator[int], size: int) -> Iterator[Failure]:
        """Run blocks of `size` cases of these numbers; an iterator over the failures."""
        with tempfile.TemporaryDirectory(prefix="fuzzing-") as place:
            running = [self._start(Path(place, str(k))) for k in range(self.jobs)]
            try:
                for one in list(running):
                    self._give(one, numbers, size, running)
                while running:
                    yield from self._collect(running, numbers, size)
            finally:
                for one in running:
                    one.process.kill()

    def _start(self, folder: Path) -> _Process:
        context = multiprocessing.get_context("spawn")
        here, there = context.Pipe()
        for name in THREADS:
            os.environ.setdefault(name, "1")
        process = context.Process(target=_serve, args=(there, self.seed, self.kinds, folder), daemon=True)
        process.start()
        there.close()
        return _Process(process, here, folder)

    def _give(self, one: _Process, numbers: Iterator[int], size: int, running: list[_Process]) -> None:
        one.number = next(numbers, -1)
        if one.number < 0:
            running.remove(one)
            one.pipe.close()
        else:
            one.pipe.send((one.number, size))

    def _collect(self, running: list[_Process], numbers: Iterator[int], size: int) -> Iterator[Failure]:
        ready = wait([one.pipe for one in running], PATIENCE_S)
        silent = [] if ready else [one for one in running if one.is_stuck()]
        for one in [*(one for one in running if one.pipe in ready), *silent]:
            try:
                if one in silent:
                    raise EOFError
                message = one.pipe.recv()
            except (EOFError, OSError):
                yield self._lost(one, one in silent)
                running.remove(one)
                running.append(self._start(one.folder))
                self._give(running[-1], numbers, size, running)
                continue
            if message is None:
                self._give(one, numbers, size, running)
            elif isinstance(message, Exception):
                raise message
            elif isinstance(message, Failure):
                yield message
            else:
                self.done += 1
                one.used_s = state_of(one.process.pid or 0)[1]
                if self.done % 1000 == 0:
                    print(f"{self.done} inputs", file=sys.stderr, flush=True)
                kind, seconds = message
                count, total = self.tally.get(kind, (0, 0.0))
                self.tally[kind] = count + 1, total + seconds

    def _lost(self, one: _Process, silent: bool) -> Failure:
        one.process.kill() if silent else None
        one.process.join()
        code = one.process.exitcode or 0
        how = (
            f"hung for {PATIENCE_S:g} s"
            if silent
            else f"the process died: {signal.Signals(-code).name if code < 0 else code}"
        )
        case = pickle.loads((one.folder / CURRENT).read_bytes())
        shutil.rmtree(one.folder)
        return Failure(one.number, case, [how])


def _serve(pipe: Connection, seed: int, kinds: list[str] | None, folder: Path) -> None:
    """In a process: run the blocks that the pipe brings; say each kind, each failure, and None after a block."""
    from fuzzing.blocks import block

    limit_memory()
    folder.mkdir()
    while True:
        try:
            number, size = pipe.recv()
        except EOFError:
            return

        def run(case: Case, number: int = number) -> list[str]:
            (folder / CURRENT).write_bytes(pickle.dumps(case))
            start = time.process_time()
            found = complaints(case, folder / "case")
            pipe.send((case.kind, time.process_time() - start))
            return found

        try:
            for case, found in block(seed, number, size, kinds, run):
                pipe.send(Failure(number, case, found))
        except Exception as error:  # of the campaign itself: inputs could not be made
            pipe.send(error)
            return
        pipe.send(None)
