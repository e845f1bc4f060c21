"""The one place where an exception becomes a line on stderr and an exit status."""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Sequence

import click

from slopecli.cli.talk import Talk, drop_stdout, tell
from slopecli.errors import SlopemapError

UNEXPECTED = 1
INTERRUPTED = 130
DISK_TROUBLE = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)


def run(command: click.Command, arguments: Sequence[str]) -> int:
    """Run `command` and return the exit status; no exception leaves, and bad input never ends in a traceback."""
    talk = Talk()
    _prepare_process()
    try:
        return command.main(list(arguments), prog_name="slopemap", standalone_mode=False, obj=talk) or 0
    except click.ClickException as error:
        error.show()
        return error.exit_code
    except SlopemapError as error:
        return _end(str(error), error.exit_code)
    except (click.Abort, KeyboardInterrupt):
        return _end("interrupted", INTERRUPTED)
    except MemoryError:
        return _end("not enough memory for images of this size; try smaller images or fewer windows", UNEXPECTED)
    except OSError as error:
        return _disk_trouble(error) if error.errno in DISK_TROUBLE else _unexpected(error, talk)
    except Exception as error:
        return _unexpected(error, talk)


def _prepare_process() -> None:
    # a pool of BLAS threads costs more than it gives on 3x3 systems, and must be declined before numpy is loaded
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # a terminal that cannot show a character of a file name or a degree sign shall not end the run
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")


def _end(message: str, exit_code: int) -> int:
    tell(f"slopemap: error: {' '.join(message.split())}")
    return exit_code


def _disk_trouble(error: OSError) -> int:
    # files of -o answer for themselves, so what could not be written is stdout
    drop_stdout()
    return _end(f"cannot write to stdout: {error.strerror}; free some space or write elsewhere", UNEXPECTED)


def _unexpected(error: Exception, talk: Talk) -> int:
    if talk.verbose:
        import traceback

        traceback.print_exception(error)
    hint = "" if talk.verbose else "; run again with -v for the traceback"
    return _end(f"unexpected {type(error).__name__}: {error}; this is a fault of slopemap{hint}", UNEXPECTED)
