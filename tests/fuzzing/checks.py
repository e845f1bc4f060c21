"""Run a case in this process and say what is wrong with what it did."""

from __future__ import annotations

import contextlib
import json
import os
import re
import signal
import stat
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from functools import cache
from pathlib import Path
from typing import Any
from unittest.mock import patch
from zlib import crc32

import command
from jsonschema import Draft202012Validator

from fuzzing.case import Case
from slopecli.io import load_schema

STATUSES = {0, 1, 2, 3, 4}
MOST_S = 10  # processor time of an input
QUICK_S, ONE_IN = 0.02, 5  # of those that take longer, this share is run again
MOST_BYTES = 2_000_000_000
# what a library says on stderr, or a fault; lines of slopemap itself begin in lower case: "warning: ..."
FOREIGN = re.compile(
    r"Traceback|fault of slopemap|Warning\b|\bWARN\b|not enough memory|^lib|^TIFF|Corrupt|Premature|"
    r"terminate called|OpenCV\(",
    re.MULTILINE,
)
CONTROL = re.compile(r"[\x00-\x09\x0b-\x1f\x7f-\x9f]")


class TooSlow(BaseException):
    """Ends a run that takes longer than it may; no `except Exception` takes it for a fault of the input."""


class WorkerHere(Executor):
    """Stands for the worker process of a batch: runs the calls in this one."""

    def __init__(self, *_: object, **__: object) -> None: ...

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


def run_command(arguments: list[str], folder: Path) -> command.Done:
    """`slopemap` in this process with a limit on its time; a batch answers its pairs in it too."""
    with patch("slopecli.batch.running.Worker", WorkerHere), _limited():
        return command.slopemap(*arguments, cwd=folder)


@contextlib.contextmanager
def _limited() -> Iterator[None]:
    def stop(*_: object) -> None:
        raise TooSlow

    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, MOST_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)


def tree_of(folder: Path) -> dict[str, bytes]:
    """Every file below a folder by its path, hidden ones too; those that are no regular file by their kind."""
    found = {}
    for path in sorted(folder.rglob("*")):
        mode = path.lstat().st_mode
        if stat.S_ISREG(mode):
            found[str(path.relative_to(folder))] = path.read_bytes()
        elif not stat.S_ISDIR(mode):
            found[str(path.relative_to(folder))] = f"of mode {mode:o}".encode()
    return found


def complaints(case: Case, folder: Path) -> list[str]:
    """What is wrong with the run of a case in a folder, which is made anew; nothing if all is well."""
    case.lay_out(folder)
    before = tree_of(folder)
    try:
        start = time.process_time()
        done = run_command(case.arguments, folder)
        seconds, after = time.process_time() - start, tree_of(folder)
        found = [*_of_streams(done), *_of_files(case, done, before, after)]
        if seconds > QUICK_S and crc32(repr(sorted(case.files.items())).encode()) % ONE_IN:
            return found
        again = run_command(case.arguments, folder)
    except TooSlow:
        return [f"took more than {MOST_S} s of processor time"]
    except Exception as error:
        return [f"{type(error).__name__} left the command: {error}"]
    if (again.returncode, again.stdout) != (done.returncode, done.stdout) or tree_of(folder) != after:
        found.append(
            f"another outcome the second time: {done.returncode}, then {again.returncode}: {again.stderr[-500:]}"
        )
    return found


def _of_streams(done: command.Done) -> Iterator[str]:
    errors = [line for line in done.stderr.splitlines() if line.startswith("slopemap: error: ")]
    if done.returncode not in STATUSES:
        yield f"exit status {done.returncode}"
    if FOREIGN.search(done.stderr) or FOREIGN.search(done.stdout):
        yield f"said: {done.stderr[-1500:]}{done.stdout[-500:] if FOREIGN.search(done.stdout) else ''}"
    if done.returncode in (1, 3) and (len(errors) != 1 or done.stdout):
        yield f"exit status {done.returncode} without one line: {done.stderr[-500:]}"
    if done.returncode == 1 and len(done.stderr) > 2000:
        yield f"a message of {len(done.stderr)} characters: {done.stderr[:500]}"
    for name, text in (("stdout", done.stdout), ("stderr", done.stderr)):
        if control := CONTROL.search(text):
            around = text[max(0, control.start() - 200) : control.end() + 50]
            yield f"a control character {control[0]!r} on {name}: {around!r}"


def _of_files(case: Case, done: command.Done, before: dict[str, bytes], after: dict[str, bytes]) -> Iterator[str]:
    new = {name: content for name, content in after.items() if before.get(name) != content or name.startswith("out")}
    if case.kind != "record" and (lost := set(before) - set(after)):
        yield f"removed {sorted(lost)}"
    if odd := [name for name in new if ".slopemap" in name or not name.startswith("out")]:
        yield f"left or changed {odd}"
    if new and done.returncode not in (0, 4):
        yield f"exit status {done.returncode}, but wrote {sorted(new)}"
    for name, content in new.items():
        if name.endswith("slopes.json"):
            yield from (f"{name}: {error.message[:300]}" for error in _validator().iter_errors(_strict(content)))
        if name.endswith("index.html") and content.count(b"<script") != 1:
            yield f"{name} has a script of others"
    if case.expected:
        others = {name for name in set(new) | set(case.expected) if not _same(new.get(name), case.expected.get(name))}
        if others:
            yield f"other files than undisturbed: {sorted(others)}; {done.stderr[-500:]}"


def _same(one: bytes | None, other: bytes | None) -> bool:
    """Whether two files are the same, or records that say the same."""
    try:
        return one == other or json.loads(one or b"") == json.loads(other or b"")
    except ValueError:
        return False


def _strict(content: bytes) -> Any:
    def refuse(text: str) -> Any:
        raise ValueError(f"{text} in slopes.json")

    return json.loads(content, parse_constant=refuse)


@cache
def _validator() -> Draft202012Validator:
    return Draft202012Validator(load_schema())


def gist(complaints: list[str]) -> str:
    """What failures of one cause have in common: the fault or the foreign line, without its numbers and names."""
    lines = [line for complaint in complaints for line in complaint.splitlines()]
    telling = [line for line in lines if FOREIGN.search(line) or CONTROL.search(line)] or lines
    return re.sub(r"\d+|'[^']*'|\"[^\"]*\"", "_", ascii(telling[0]))[:110]


def limit_memory() -> None:
    """No more than `MOST_BYTES` for this process from now on (Linux)."""
    if os.path.exists("/proc"):
        import resource

        resource.setrlimit(resource.RLIMIT_DATA, (MOST_BYTES, MOST_BYTES))
