"""The command line: the only room that knows click. `main` is the entry point of the `slopemap` command."""

from __future__ import annotations


def main() -> None:
    """Run the `slopemap` command on sys.argv and end the process with its exit status."""
    import sys

    from slopecli.cli.app import slopemap
    from slopecli.cli.boundary import run

    sys.exit(run(slopemap, sys.argv[1:]))
