"""The rows of FINDERS: what they name is there, and what is written elsewhere of finders agrees with them."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import fields
from pathlib import Path

import click
import pytest

from slopecli.cli import slopemap
from slopecli.options import Options
from slopecli.patches import FINDERS, PLANE_FINDERS, Finder

CHOSEN = [finder for finder in FINDERS if finder.choice]
PARAMETERS = {str(parameter.name): parameter for parameter in slopemap.commands["estimate"].params}


def test_what_the_rows_say_is_said_once() -> None:
    assert len({finder.source for finder in FINDERS}) == len(FINDERS)
    assert list(PLANE_FINDERS) == [finder.choice for finder in CHOSEN]


@pytest.mark.parametrize("finder", CHOSEN, ids=lambda finder: finder.choice)
def test_a_finder_has_a_function_and_options_that_there_are(finder: Finder) -> None:
    module, function = finder.function.split(":")
    assert (Path(__file__).resolve().parent.parent / "slopecli" / "patches" / f"{module.replace('.', '/')}.py").exists()
    assert callable(PLANE_FINDERS[finder.choice])
    assert function
    assert set(finder.options) <= {field.name for field in fields(Options)} | set(PARAMETERS)


def test_the_command_line_offers_the_finders() -> None:
    offered = PARAMETERS["planes"].type
    assert isinstance(offered, click.Choice)
    assert list(offered.choices) == list(PLANE_FINDERS)
    assert Options().planes in PLANE_FINDERS


def test_the_rows_are_light_to_import() -> None:
    script = "import sys, slopecli.patches; sys.exit('numpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", script], check=False).returncode == 0
