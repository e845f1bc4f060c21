"""The command line: the only room that knows click. `main` is the entry point of the `slopemap` command."""

from __future__ import annotations


def main() -> None:
    """Run the `slopemap` command on sys.argv and end the process with its exit status."""
    import gc
    import sys

    # loading modules makes tens of thousands of objects that stay: to look through them for garbage again and again,
    # and at the end, takes longer than to load them
    gc.set_threshold(500_000, 20, 20)

    from slopecli.cli.app import slopemap
    from slopecli.cli.boundary import run

    status = run(slopemap, sys.argv[1:])
    gc.freeze()
    sys.exit(status)
