"""Limit a library to one thread while any caller works: threads cost more than they gain on small matrices."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from threading import Lock
from typing import Any


class SharedLimit:
    """One process-wide limit for callers that may come and go in any order: set by the first, lifted by the last.

    limit : sets the limit and returns the function that lifts it.
    """

    def __init__(self, limit: Callable[[], Callable[[], object]]) -> None:
        self._limit = limit
        self._lift: Callable[[], object] = lambda: None
        self._lock = Lock()
        self._callers = 0

    @contextmanager
    def __call__(self) -> Iterator[None]:
        with self._lock:
            if not self._callers:
                self._lift = self._limit()
            self._callers += 1
        try:
            yield
        finally:
            with self._lock:
                self._callers -= 1
                if not self._callers:
                    self._lift()


@cache
def _blas() -> Any:
    """Controller of the BLAS libraries loaded; finding them takes milliseconds."""
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController().select(user_api="blas")


one_blas_thread = SharedLimit(lambda: _blas().limit(limits=1).restore_original_limits)
