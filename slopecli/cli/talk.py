"""What goes to which stream: results to stdout, talk to stderr."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import TextIO

import click


@dataclass(eq=False)
class Talk:
    """How much the command says on stderr; errors are said in any case."""

    verbose: bool = False
    quiet: bool = False

    def say(self, line: str) -> None:
        """Say one line on stderr unless -q was given."""
        if not self.quiet:
            tell(line)

    def stage(self, name: str, seconds: float) -> None:
        """Say with -v how long a stage took."""
        if self.verbose:
            tell(f"{name:<12s} {seconds:8.3f} s")

    @contextmanager
    def timed(self, name: str) -> Iterator[None]:
        """Time the body as one stage."""
        start = time.process_time()
        yield
        self.stage(name, time.process_time() - start)


def print_result(text: str) -> None:
    """Print a result on stdout, in colour only on a terminal and without NO_COLOR (https://no-color.org).

    A reader that has gone (`| head`) has seen what it wanted: the rest is dropped and the exit status stays 0.
    """
    try:
        click.echo(text.rstrip("\n"), color=False if os.environ.get("NO_COLOR") else None)
    except BrokenPipeError:
        drop_stdout()


def tell(text: str, *, end_line: bool = True) -> None:
    """Write to stderr. If nobody listens any more (`2>&1 | head`, a terminal that is gone), the work goes on."""
    try:
        click.echo(text, nl=end_line, err=True)
    except OSError:
        _drop(sys.stderr)


def drop_stdout() -> None:
    """Send what stdout still holds nowhere: Python flushes it once more at exit, which would complain."""
    _drop(sys.stdout)


def _drop(stream: TextIO) -> None:
    with suppress(OSError):  # a stream in memory has no file
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)
