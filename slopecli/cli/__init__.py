"""The command line: the only room that imports click and rich. `main` is the entry point of `slopemap`."""

from __future__ import annotations

from slopecli.face import lazy_names

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "app": "run slopemap",
        "batch": "batch_table maps_table",
        "opencv_wheels": "explain_opencv",
        "parameter_types": "PAIRINGS",
        "progress": "BatchProgress",
        "report_table": "classes_table result_table talk_lines",
        "shared_options": "talk_options",
        "table": "Table draw_table print_table",
        "talk": "Talk print_facts print_result",
    },
)


def main() -> None:
    """Run the `slopemap` command on sys.argv and end the process with its exit status."""
    import sys

    try:
        status = _main(sys.argv[1:])
    except KeyboardInterrupt:  # before or after the command itself
        if sys.stderr is not None:
            sys.stderr.write("slopemap: error: interrupted\n")
        status = 130
    sys.exit(status)


def _main(arguments: list[str]) -> int:
    from slopecli.cli.interruption import stop_watching, was_interrupted, watch_interrupts

    watch_interrupts()
    import gc

    _keep_memory()
    gc.set_threshold(500_000)  # few searches for garbage: together with the freeze below 5-10 % of an estimate
    try:
        from slopecli.cli.app import run, slopemap

        status = run(slopemap, arguments)
    except Exception:
        if was_interrupted():  # while a module was loaded, which made another error of it
            raise KeyboardInterrupt from None
        raise
    stop_watching()
    gc.freeze()  # none at exit
    return status


def _keep_memory() -> None:
    """Have the C library keep the memory of freed arrays for the next ones, which the system would clear anew.

    3-6 % of a run; where the library is not glibc, nothing happens.
    """
    import ctypes
    import sys

    if sys.platform == "linux" and (mallopt := getattr(ctypes.CDLL(None), "mallopt", None)) is not None:
        mallopt(-1, 2**30)  # bytes, beyond which the end of the heap is given back
        mallopt(-3, 2**25)  # bytes of a block, beyond which it is apart from the heap; the most that is allowed
