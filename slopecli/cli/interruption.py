"""Ctrl-C at any moment ends in one line and the status 130, also while libraries are loaded."""

from __future__ import annotations

import signal
from types import FrameType

_numbers: list[int] = []


def watch_interrupts() -> None:
    """Remember that Ctrl-C was pressed: extension modules turn its exception into others while they are loaded."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # not where the caller ignores it
        signal.signal(signal.SIGINT, _remember)


def was_interrupted() -> bool:
    """Whether Ctrl-C was pressed since `watch_interrupts`."""
    return bool(_numbers)


def stop_watching() -> None:
    """Let Ctrl-C end the process at once and without a word, as nothing is left to be done."""
    if signal.getsignal(signal.SIGINT) is _remember:
        signal.signal(signal.SIGINT, signal.SIG_DFL)


def _remember(number: int, _: FrameType | None) -> None:
    _numbers.append(number)
    raise KeyboardInterrupt
