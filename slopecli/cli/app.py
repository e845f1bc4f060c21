"""The `slopemap` command: one file per sub-command, gathered here."""

from __future__ import annotations

import click

from slopecli import __version__
from slopecli.cli.batch import batch
from slopecli.cli.estimate import estimate
from slopecli.cli.plan import plan
from slopecli.cli.segment import segment
from slopecli.cli.simulate import simulate
from slopecli.cli.solve import solve

EPILOG = """\b
Exit status:
  0    an answer was written
  1    an input was unusable
  2    the command line was wrong
  3    the inputs were read, but the scene gives no answer
  4    a batch finished, and some pairs have no answer
  130  interrupted"""


@click.group(epilog=EPILOG, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="slopemap", message="%(prog)s %(version)s")
def slopemap() -> None:
    """How steep is the ground, and how sure are we?

    Finds one relative motion and one normal per window or plane from two overlapping images, all consistent with a
    single epipolar geometry, and reports each slope with its uncertainty.
    """


slopemap.add_command(estimate)
slopemap.add_command(segment)
slopemap.add_command(batch)
slopemap.add_command(solve)
slopemap.add_command(plan)
slopemap.add_command(simulate)
