"""The command as a user meets it, run in a process of its own or, far quicker, within that of the tests."""

from __future__ import annotations

import contextlib
import io
import os
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import IO
from unittest.mock import patch

from slopecli.cli import run
from slopecli.cli import slopemap as commands

Done = subprocess.CompletedProcess[str]


def in_a_process(*arguments: str, cwd: Path | None = None, **environment: str) -> Done:
    """For what is of the process itself: its start, its memory and time, signals, what is printed as it ends."""
    return subprocess.run(
        [sys.executable, "-m", "slopecli", *arguments],
        capture_output=True,
        text=True,
        encoding="utf-8",
        cwd=cwd,
        env={**os.environ, **environment},
        check=False,
    )


def slopemap(*arguments: str, cwd: Path | None = None, **environment: str) -> Done:
    """The same, without the second that a process takes to load what it needs.

    stdout and stderr are real files, as in a process: what OpenCV and the libraries below it say there is caught too,
    and so are warnings, which Python would print.
    """
    with tempfile.TemporaryFile() as stdout, tempfile.TemporaryFile() as stderr:
        with (
            _redirected("stdout", stdout),
            _redirected("stderr", stderr),
            _warnings_said(),
            patch.dict(os.environ, environment),
            contextlib.chdir(cwd or os.curdir),
        ):
            status = run(commands, arguments)
        return subprocess.CompletedProcess(arguments, status, _text(stdout), _text(stderr))


@contextlib.contextmanager
def _redirected(name: str, file: IO[bytes]) -> Iterator[None]:
    """Send sys.stdout or sys.stderr, and the descriptor below it, to a file."""
    number = {"stdout": 1, "stderr": 2}[name]
    getattr(sys, name).flush()
    kept = os.dup(number)
    os.dup2(file.fileno(), number)
    try:
        with open(number, "w", encoding="utf-8", closefd=False) as stream, patch.object(sys, name, stream):
            yield
    finally:
        os.dup2(kept, number)
        os.close(kept)


@contextlib.contextmanager
def _warnings_said() -> Iterator[None]:
    """Print the warnings that a process would print; pytest keeps them for itself."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("ignore")
        for kind in (UserWarning, RuntimeWarning):
            warnings.simplefilter("always", kind)
        yield
    for one in caught:
        sys.stderr.write(warnings.formatwarning(one.message, one.category, one.filename, one.lineno))


def _text(file: IO[bytes]) -> str:
    file.seek(0)
    return io.TextIOWrapper(file, encoding="utf-8").read()
