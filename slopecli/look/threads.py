"""How many threads OpenCV works on."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from threading import Lock

import cv2


class _Threads:
    """What OpenCV's number of threads was before the first who wanted one, for the last of them to give back."""

    def __init__(self) -> None:
        self._lock, self._wanted, self._before = Lock(), 0, 1

    def decline(self) -> None:
        with self._lock:
            if not self._wanted:
                self._before = cv2.getNumThreads()
                cv2.setNumThreads(1)
            self._wanted += 1

    def give_back(self) -> None:
        with self._lock:
            self._wanted -= 1
            if not self._wanted:
                cv2.setNumThreads(self._before)


_threads = _Threads()


@contextmanager
def single_threaded() -> Iterator[None]:
    """OpenCV on one thread: much that is small costs more to hand to threads, and to wait for them, than it takes.

    The number is one for the whole process; threads of a caller's own may come in and go out in any order.
    """
    _threads.decline()
    try:
        yield
    finally:
        _threads.give_back()
