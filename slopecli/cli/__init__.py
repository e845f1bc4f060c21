"""The command line: the only room that imports click and rich. `main` is the entry point of `slopemap`."""

from __future__ import annotations


def main() -> None:
    """Run the `slopemap` command on sys.argv and end the process with its exit status."""
    import gc
    import sys

    gc.set_threshold(500_000)  # few searches for garbage: together with the freeze below 5-10 % of an estimate

    from slopecli.cli.app import slopemap
    from slopecli.cli.boundary import run

    status = run(slopemap, sys.argv[1:])
    gc.freeze()  # none at exit
    sys.exit(status)
