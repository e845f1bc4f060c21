"""What goes to which stream: results to stdout, talk to stderr."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass

import click


@dataclass
class Talk:
    """How much the command says on stderr; errors are said in any case."""

    verbose: bool = False
    quiet: bool = False

    def say(self, line: str) -> None:
        """Say one line on stderr unless -q was given."""
        if not self.quiet:
            click.echo(line, err=True)

    def stage(self, name: str, seconds: float) -> None:
        """Say with -v how long a stage took."""
        if self.verbose:
            click.echo(f"{name:<12s} {seconds:8.3f} s", err=True)

    @contextmanager
    def timed(self, name: str) -> Iterator[None]:
        """Time the body as one stage."""
        start = time.perf_counter()
        yield
        self.stage(name, time.perf_counter() - start)


def print_result(text: str) -> None:
    """Print a result on stdout, in colour only on a terminal and without NO_COLOR (https://no-color.org).

    A reader that has gone (`| head`) has seen what it wanted: the rest is dropped and the exit status stays 0.
    """
    try:
        click.echo(text.rstrip("\n"), color=False if os.environ.get("NO_COLOR") else None)
    except BrokenPipeError:
        drop_stdout()


def drop_stdout() -> None:
    """Send what stdout still holds nowhere: Python flushes it once more at exit, which would complain."""
    with suppress(OSError):  # a stream in memory has no file
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
