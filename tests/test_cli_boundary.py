"""Every exception ends in one line on stderr and the exit status that was promised for it."""

from __future__ import annotations

import errno
import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import click
import pytest
from command import slopemap

from slopecli.cli import run, talk_options
from slopecli.errors import DegenerateConfiguration, InputError, NoAnswer


def command_that(body: Callable[[], object]) -> click.Command:
    return click.command(params=[*talk_options()])(lambda: body())


def raises(error: BaseException) -> click.Command:
    def body() -> None:
        raise error

    return command_that(body)


@pytest.mark.parametrize(
    ("error", "exit_code", "line"),
    [
        (InputError("a.png: empty file; an image is needed"), 1, "a.png: empty file; an image is needed"),
        (NoAnswer("pure-rotation", "parallax 0.1 px", "move"), 3, "pure-rotation: parallax 0.1 px; move"),
        (DegenerateConfiguration("3 points on one line"), 3, "3 points on one line"),
        (KeyboardInterrupt(), 130, "interrupted"),
        (MemoryError(), 1, "not enough memory"),
        (RuntimeError("can't start new thread"), 1, "not enough memory"),
        (ImportError("libx.so: failed to map segment from shared object"), 1, "not enough memory"),
        (OSError(errno.EBADF, "it is closed"), 1, "cannot write to stdout: it is closed"),
        (ZeroDivisionError("by zero"), 1, "unexpected ZeroDivisionError: by zero"),
        (InputError("two\nlines"), 1, "two lines"),
    ],
    ids=lambda value: type(value).__name__ if isinstance(value, BaseException) else "",
)
def test_one_line_and_the_promised_status(
    error: BaseException, exit_code: int, line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(raises(error), []) == exit_code
    stdout, stderr = capsys.readouterr()
    assert stdout == ""
    (said,) = stderr.strip().splitlines()
    assert said.startswith(f"slopemap: error: {line}")


def test_an_answer_is_status_0() -> None:
    assert run(command_that(lambda: None), []) == 0


def test_the_traceback_of_a_fault_comes_with_verbose_only(capsys: pytest.CaptureFixture[str]) -> None:
    run(raises(ZeroDivisionError("by zero")), [])
    assert "run again with -v" in capsys.readouterr().err
    run(raises(ZeroDivisionError("by zero")), ["-v"])
    stderr = capsys.readouterr().err
    assert "Traceback" in stderr
    assert "run again" not in stderr


def test_quiet_still_says_errors(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(raises(InputError("a.png: missing")), ["-q"]) == 1
    assert capsys.readouterr().err == "slopemap: error: a.png: missing\n"


def test_usage_is_status_2(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(command_that(lambda: None), ["--unknown"]) == 2
    assert "--unknown" in capsys.readouterr().err


@pytest.mark.parametrize(
    "arguments",
    [
        ("estimate", "a\x1b[31mred\x07\r.png", "b.png", "--fov", "60", "--json"),
        ("solve", "\x1b]0;title\x07\u202egnp"),
        ("solve", "a.csv", "--\x1b[31m"),
        ("segment", "a.png", "b.png", "--up", "\x1b[31m", "--json"),
    ],
)
def test_names_on_the_command_line_come_back_as_text(arguments: tuple[str, ...]) -> None:
    done = slopemap(*arguments)
    assert done.returncode in (1, 2)
    assert not re.search(r"[\x00-\x09\x0b-\x1f\x7f-\x9f\u202e]", done.stderr)
    assert r"\x1b" in done.stderr


def in_a_shell(command: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    text = command.replace("slopemap", f"'{sys.executable}' -m slopecli")
    return subprocess.run(["bash", "-c", text], cwd=cwd, capture_output=True, text=True, check=False)


@pytest.mark.skipif(os.name != "posix", reason="POSIX only")
@pytest.mark.parametrize(
    ("command", "line"),
    [
        ("slopemap solve - <&-", "-: stdin is closed"),
        ("mkdir gone; cd gone; rmdir ../gone; slopemap solve a.csv -o .", "the working folder no longer exists"),
        ("echo x > m.csv; slopemap solve m.csv >&- <&-", "m.csv: has no column"),
        ("slopemap plan --fov 60 --size 800x800 --trajectory 45 --height 9 --baseline 2 >&-", "cannot write to stdout"),
    ],
)
def test_streams_and_folders_that_are_gone(command: str, line: str, tmp_path: Path) -> None:
    done = in_a_shell(command, tmp_path)
    assert done.returncode == 1
    (said,) = done.stderr.splitlines()
    assert said.startswith(f"slopemap: error: {line}")


INTERRUPTED_WHILE_LOADING = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored where the tests themselves run in the background
class Loader:
    def find_spec(self, name, *_):
        if name == "slopecli.cli.app":
            try:
                signal.raise_signal(signal.SIGINT)
            except KeyboardInterrupt:
                raise ImportError("multiarray failed to import") from None
sys.meta_path.insert(0, Loader())
sys.argv = ["slopemap", "--help"]
from slopecli.cli import main
main()
"""


def test_ctrl_c_while_libraries_are_loaded(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", INTERRUPTED_WHILE_LOADING], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "slopemap: error: interrupted\n")
