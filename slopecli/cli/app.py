"""The `slopemap` command, its sub-commands by name, and where exceptions become a line on stderr and an exit status."""

from __future__ import annotations

import errno
import os
import re
import shlex
import sys
from collections import UserDict
from collections.abc import Sequence
from importlib import import_module
from io import StringIO
from typing import Any

import click

from slopecli import __version__
from slopecli.cli.interruption import was_interrupted
from slopecli.cli.opencv_wheels import explain_opencv
from slopecli.cli.talk import Talk, drop_stdout, tell
from slopecli.errors import ExitStatus, SlopemapError

# where a command stands: module:name
PLACE_OF = {
    "estimate": "pair:estimate",
    "map": "pair:slope_map",
    "segment": "pair:segment",
    **{name: f"{name}:{name}" for name in ("batch", "sequence", "solve", "plan", "camera", "simulate")},
    **{name: f"{name}:{name}" for name in ("validate", "demo")},
}
EPILOG = """\b
Every command takes --config FILE: options from a TOML file.

\b
Exit status:
  0    an answer was written
  1    an input was unusable
  2    the command line was wrong
  3    the inputs were read, but the scene gives no answer
  4    a batch finished, and some pairs have no answer
  130  interrupted"""
OPENCV_THREADS = "OPENCV_FOR_THREADS_NUM"  # environment variable that OpenCV reads
CANNOT_PRINT = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EBADF)
NO_MEMORY = re.compile(
    "[Cc]annot allocate memory|[Ii]nsufficient memory|failed to map segment|can't start new thread|bad_alloc"
)
NO_MEMORY_LINE = "not enough memory for images of this size; try smaller images or fewer windows"


class _Commands(UserDict[str, Any]):
    """The commands by name; the module of one is loaded when the command is looked up."""

    def __getitem__(self, name: str) -> click.Command:
        module, function = self.data[name].split(":")
        command: click.Command = getattr(import_module(f"slopecli.cli.{module}"), function)
        return command


@click.group(commands=_Commands(PLACE_OF), epilog=EPILOG, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="slopemap", message="%(prog)s %(version)s")
def slopemap() -> None:
    """How steep is the ground, and how sure are we?

    Finds one relative motion and one normal per window or plane from two overlapping images, all consistent with a
    single epipolar geometry, and reports each slope with its uncertainty.
    """


def run(command: click.Command, arguments: Sequence[str]) -> int:
    """Run `command` and return the exit status; no exception leaves, and bad input never ends in a traceback."""
    talk = Talk(command=shlex.join(["slopemap", *arguments]))
    _prepare_process()
    try:
        return command.main(list(arguments), prog_name="slopemap", standalone_mode=False, obj=talk) or 0
    except click.ClickException as error:
        return _misused(error)
    except SlopemapError as error:
        return _end(str(error), error.exit_code)
    except (click.Abort, KeyboardInterrupt):
        return _end("interrupted", ExitStatus.INTERRUPTED)
    except MemoryError:
        return _end(NO_MEMORY_LINE, ExitStatus.UNUSABLE)
    except Exception as error:
        if was_interrupted():  # while an extension module was loaded, which made another error of it
            return _end("interrupted", ExitStatus.INTERRUPTED)
        if NO_MEMORY.search(str(error)):  # of OpenCV, of the loader of libraries, of threads
            return _end(NO_MEMORY_LINE, ExitStatus.UNUSABLE)
        if isinstance(error, FileNotFoundError) and _folder_is_gone():
            return _end("the working folder no longer exists; change to another one", ExitStatus.UNUSABLE)
        if isinstance(error, OSError) and error.errno in CANNOT_PRINT:
            drop_stdout()  # files of -o answer for themselves, so what could not be written is stdout
            return _end(
                f"cannot write to stdout: {error.strerror}; free some space or write elsewhere", ExitStatus.UNUSABLE
            )
        return _unexpected(error, talk)
    finally:
        talk.clear()


def _misused(error: click.ClickException) -> int:
    """Say how the command line is to be used; returns the exit status."""
    usage = StringIO()
    error.show(usage)
    for line in usage.getvalue().rstrip("\n").split("\n"):
        tell(line)
    if isinstance(error, click.NoSuchOption) and isinstance(getattr(error.ctx, "command", None), click.Group):
        tell(f"Options of a command follow it: slopemap COMMAND {error.option_name} ...")
    return error.exit_code


def _prepare_process() -> None:
    for number in range(3):  # a closed stream's number would be given to the next file, which then gets the talk
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
    # a pool of BLAS threads costs more than it gives on 3x3 systems, and must be declined before numpy is loaded
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    threads = os.environ.get(OPENCV_THREADS, "1")
    if not threads.isdecimal():  # OpenCV would end the run in the middle
        del os.environ[OPENCV_THREADS]
        if threads:
            tell(f"warning: {OPENCV_THREADS} is {threads!r}, not a number of threads; it is ignored")
    # a terminal that cannot show a character of a file name or a degree sign shall not end the run
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")


def _folder_is_gone() -> bool:
    try:
        os.getcwd()
    except OSError:
        return True
    return False


def _end(message: str, exit_code: int) -> int:
    tell(f"slopemap: error: {' '.join(message.split())}")
    return exit_code


def _unexpected(error: Exception, talk: Talk) -> int:
    if (line := explain_opencv(error)) is not None:
        return _end(line, ExitStatus.UNUSABLE)
    if talk.verbose:
        import traceback

        traceback.print_exception(error)
    hint = "" if talk.verbose else "; run again with -v for the traceback"
    return _end(f"unexpected {type(error).__name__}: {error}; this is a fault of slopemap{hint}", ExitStatus.UNUSABLE)
