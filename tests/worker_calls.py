"""Functions that the tests of a worker let it call; it imports this module, which therefore loads little."""

from __future__ import annotations

import os
import signal
import sys
import time

from slopecli.errors import DiskFull, NoAnswer

PATIENCE_S = 60.0


def add(a: int, b: int = 1) -> int:
    return a + b


def end_like(sent: signal.Signals) -> None:
    os.kill(os.getpid(), sent)
    time.sleep(PATIENCE_S)


def sleep_holding_on(seconds: float) -> None:
    time.sleep(seconds)


def fill_memory(n_bytes: int) -> int:
    import numpy as np

    return int(np.ones(n_bytes, np.uint8).sum())


def raise_disk_full() -> None:
    raise DiskFull("disk full while writing")


def raise_what_cannot_be_pickled() -> None:
    raise NoAnswer("pure-rotation", "no parallax", "move")


def print_much() -> str:
    os.write(1, b"noise among the replies\n" * 100)
    print("more noise")
    return "said"


def own_facts() -> dict[str, object]:
    import cv2

    return {
        "pid": os.getpid(),
        "threads": (os.environ["OPENBLAS_NUM_THREADS"], cv2.getNumThreads()),
        "interrupt": signal.getsignal(signal.SIGINT) == signal.SIG_IGN,
        "main": sys.modules["__main__"].__dict__.get("__file__"),
    }
