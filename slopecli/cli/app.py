"""The `slopemap` command: one file per sub-command, gathered here."""

from __future__ import annotations

from collections import UserDict
from importlib import import_module
from typing import Any

import click

from slopecli import __version__

COMMANDS = ("estimate", "segment", "batch", "solve", "plan", "simulate")
EPILOG = """\b
Exit status:
  0    an answer was written
  1    an input was unusable
  2    the command line was wrong
  3    the inputs were read, but the scene gives no answer
  4    a batch finished, and some pairs have no answer
  130  interrupted"""


class _Commands(UserDict[str, Any]):
    """The commands by name, each in the module of its name, which is loaded when the command is looked up."""

    def __getitem__(self, name: str) -> click.Command:
        command: click.Command = self.data[name] or getattr(import_module(f"slopecli.cli.{name}"), name)
        return command


@click.group(
    commands=_Commands.fromkeys(COMMANDS), epilog=EPILOG, context_settings={"help_option_names": ["-h", "--help"]}
)
@click.version_option(__version__, prog_name="slopemap", message="%(prog)s %(version)s")
def slopemap() -> None:
    """How steep is the ground, and how sure are we?

    Finds one relative motion and one normal per window or plane from two overlapping images, all consistent with a
    single epipolar geometry, and reports each slope with its uncertainty.
    """
