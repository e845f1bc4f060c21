"""Remember that Ctrl-C was pressed, so that it ends in one line and the status 130 at any moment.

Extension modules turn its exception into errors of their own while they are loaded; `cli/app.py` asks here what it was.
"""

from __future__ import annotations

import signal
from types import FrameType

_pressed: list[int] = []  # numbers of the signals that came


def watch_interrupts() -> None:
    """Remember Ctrl-C from now on."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # not where the caller ignores it
        signal.signal(signal.SIGINT, _remember)


def was_interrupted() -> bool:
    """Whether Ctrl-C was pressed since `watch_interrupts`."""
    return bool(_pressed)


def stop_watching() -> None:
    """Let Ctrl-C end the process at once and without a word, as nothing is left to be done."""
    if signal.getsignal(signal.SIGINT) is _remember:
        signal.signal(signal.SIGINT, signal.SIG_DFL)


def _remember(number: int, _: FrameType | None) -> None:
    _pressed.append(number)
    raise KeyboardInterrupt
