"""The command line: the only room that imports click and rich. `main` is the entry point of `slopemap`."""

from __future__ import annotations

from slopecli.face import lazy_names

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "app": "run slopemap",
        "batch": "batch_table",
        "parameter_types": "PAIRINGS",
        "progress": "BatchProgress",
        "report_table": "result_table talk_lines",
        "shared_options": "talk_options",
        "table": "Table draw_table",
        "talk": "Talk",
    },
)


def main() -> None:
    """Run the `slopemap` command on sys.argv and end the process with its exit status."""
    import gc
    import sys

    gc.set_threshold(500_000)  # few searches for garbage: together with the freeze below 5-10 % of an estimate

    from slopecli.cli.app import run, slopemap

    status = run(slopemap, sys.argv[1:])
    gc.freeze()  # none at exit
    sys.exit(status)
