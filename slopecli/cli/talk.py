"""What goes to which stream: results to stdout, talk to stderr."""

from __future__ import annotations

import errno
import os
import sys
import textwrap
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TextIO

import click

from slopecli.errors import visible

if TYPE_CHECKING:
    from slopecli.products.origin import Origin
    from slopecli.types import Image


@dataclass(eq=False)
class Talk:
    """How much the command says on stderr; errors are said in any case.

    command : the command line, as typed.
    notes : how files were read, as said so far.
    """

    verbose: bool = False
    quiet: bool = False
    command: str = ""
    notes: list[str] = field(default_factory=list)
    _start: float = field(default_factory=time.monotonic)
    _shown: bool = False

    def say(self, line: str) -> None:
        """Say one line on stderr unless -q was given; on a terminal broken between words."""
        self.clear()
        if not self.quiet:
            tell(line, _terminal_width(sys.stderr))

    def note(self, text: str) -> None:
        """Say how a file was read, and keep it for the page."""
        self.notes.append(text)
        self.say(f"info: {text}")

    def stage(self, name: str, seconds: float) -> None:
        """Say with -v how long a stage took; on a terminal show the last one of a run that takes long."""
        if self.verbose:
            tell(f"{name:<12s} {seconds:8.3f} s")
        elif not self.quiet and is_terminal(sys.stderr) and time.monotonic() - self._start > 2.0:  # s
            self._shown = True
            with stderr_may_be_gone():
                click.echo(f"\r\033[Kdone: {visible(name)}", nl=False, err=True)

    def clear(self) -> None:
        """Remove what `stage` shows."""
        if self._shown:
            self._shown = False
            with stderr_may_be_gone():
                click.echo("\r\033[K", nl=False, err=True)

    @contextmanager
    def timed(self, name: str) -> Iterator[None]:
        """Time the body as one stage, seconds of processor time."""
        start = time.process_time()
        yield
        self.stage(name, time.process_time() - start)


def origin_of(talk: Talk, image2: Image | None = None) -> Origin:
    """What report.html says of the command and of how files were read."""
    from slopecli.products.origin import Origin

    return Origin(image2, talk.command, tuple(talk.notes))


def is_terminal(stream: TextIO | None) -> bool:
    """Whether a person reads the stream. None stands for one that is closed, as by 2>&-."""
    return stream is not None and stream.isatty()


def print_result(text: str) -> None:
    """Print a result on stdout. If its reader has gone (`| head`), the rest is dropped and the exit status stays 0."""
    context = click.get_current_context(silent=True)
    if context is not None and isinstance(context.obj, Talk):
        context.obj.clear()
    try:
        click.echo(text.rstrip("\n"))
    except BrokenPipeError:
        drop_stdout()


def check_stdout() -> None:
    """Raise OSError if stdout is closed, where the answer goes nowhere else."""
    if sys.stdout is None:
        raise OSError(errno.EBADF, "it is closed")


def tell(text: str, width: int | None = None) -> None:
    """Print a line on stderr, names in it made `visible`; the work goes on if nothing reads it any more.

    width : characters; longer lines are broken between words. None: they are not.
    """
    shown = visible(text)
    if width is not None and len(shown) > width:
        how: dict[str, Any] = {"subsequent_indent": "  ", "break_long_words": False, "break_on_hyphens": False}
        shown = textwrap.fill(shown, width, **how)
    with stderr_may_be_gone():
        click.echo(shown, err=True)


def print_facts(lines: Sequence[str], indent: int) -> None:
    """Print lines of a name and what is said of it on stdout; on a terminal long ones go on below what is said.

    lines : made `visible` here.
    indent : characters of the column of names.
    """
    lines, width = list(map(visible, lines)), _terminal_width(sys.stdout)
    if width is not None and width > 2 * indent:
        how: dict[str, Any] = {"subsequent_indent": " " * indent, "break_long_words": False, "break_on_hyphens": False}
        lines = [textwrap.fill(line, width, **how) if len(line) > width else line for line in lines]
    print_result("\n".join(lines))


def _terminal_width(stream: TextIO | None) -> int | None:
    """Characters in a line of the terminal that a stream is, as the environment's COLUMNS says or the terminal itself;
    None where it is none."""
    if stream is None or not is_terminal(stream):
        return None
    columns = os.environ.get("COLUMNS", "")
    try:
        wanted = int(columns) if columns.isdecimal() and len(columns) < 9 else 0
        return wanted or os.get_terminal_size(stream.fileno()).columns or None
    except (OSError, ValueError):
        return None


@contextmanager
def stderr_may_be_gone() -> Iterator[None]:
    """Ignore that stderr cannot be written to, and send it nowhere from then on."""
    try:
        yield
    except OSError:
        _drop(sys.stderr)


def drop_stdout() -> None:
    """Discard what stdout still holds: Python flushes it once more at exit, which would fail."""
    _drop(sys.stdout)


def _drop(stream: TextIO | None) -> None:
    if stream is None:
        return
    with suppress(OSError):  # a stream in memory has no file
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)
