"""Where OpenCV cannot be used, one line says why and what to do; a long run shows on a terminal how far it is."""

from __future__ import annotations

import io
import sys

import click
import pytest

from slopecli import cli
from slopecli.cli import Table, print_result, print_table


@pytest.mark.parametrize(
    ("installed", "said"),
    [
        ((), "not installed"),
        (("opencv-python",), "of opencv-python; install it anew"),
        (("opencv-python", "opencv-contrib-python-headless"), "opencv-python and opencv-contrib-python-headless share"),
    ],
)
def test_wheels_that_are_missing_or_overwrote_each_other(
    monkeypatch: pytest.MonkeyPatch, installed: tuple[str, ...], said: str
) -> None:
    monkeypatch.setattr("slopecli.cli.opencv_wheels._is_installed", lambda name: name in installed)
    for error in (
        ModuleNotFoundError("No module named 'cv2'", name="cv2"),
        ImportError("libGL.so.1: cannot open shared object file"),
        AttributeError("module 'cv2' has no attribute 'DISOpticalFlow_create'"),
    ):
        line = cli.explain_opencv(error)
        assert line is not None
        assert said in line
        assert "pip install opencv-contrib-python-headless" in line


@pytest.mark.parametrize("error", [ImportError("No module named 'foo'", name="foo"), AttributeError("no such thing")])
def test_other_errors_are_not_explained_away(error: Exception) -> None:
    assert cli.explain_opencv(error) is None


class Terminal(io.StringIO):
    """A stderr that a person reads."""

    def isatty(self) -> bool:
        return True


def test_a_long_run_shows_its_stage_on_a_terminal_and_leaves_no_trace(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    talk = cli.Talk()
    talk.stage("features", 0.1)
    assert terminal.getvalue() == ""  # within the first two seconds
    talk._start -= 3.0
    talk.stage("overview", 0.1)
    assert "done: overview" in terminal.getvalue()
    talk.clear()
    assert terminal.getvalue().endswith("\r\033[K")


@pytest.mark.parametrize("as_table", [True, False], ids=["table", "JSON"])
def test_what_is_printed_begins_on_a_line_of_its_own(monkeypatch: pytest.MonkeyPatch, as_table: bool) -> None:
    screen = Terminal()  # where both streams go
    for name in ("stdout", "stderr"):
        monkeypatch.setattr(sys, name, screen)
    talk = cli.Talk()
    talk._start -= 3.0
    with click.Context(click.Command("any"), obj=talk):
        talk.stage("write", 0.1)
        print_table(Table(("id",), [("1",)]), talk) if as_table else print_result("{}")
    shown = click.unstyle(screen.getvalue().split("done: write")[1])
    assert screen.getvalue().split("done: write")[1].startswith("\r\033[K")
    assert ("id" if as_table else "{}") in shown


@pytest.mark.parametrize("quiet", [True, False])
def test_a_log_has_no_such_line(monkeypatch: pytest.MonkeyPatch, quiet: bool) -> None:
    log = Terminal() if quiet else io.StringIO()
    monkeypatch.setattr(sys, "stderr", log)
    talk = cli.Talk(quiet=quiet)
    talk._start -= 3.0
    talk.stage("overview", 0.1)
    assert log.getvalue() == ""
