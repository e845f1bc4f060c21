"""A writer that dies at any of its calls that change the disk, as by SIGKILL."""

from __future__ import annotations

import os
from typing import Any

import pytest


class Killed(BaseException):
    """Stands for SIGKILL: nothing is done any more."""


def kill_at(monkeypatch: pytest.MonkeyPatch, step: int) -> None:
    """Let the writer die in the `step`th call that changes something on the disk, which then does not happen."""
    count = 0
    for name in ("rename", "replace", "unlink", "fsync", "mkdir", "rmdir"):

        def dying(*args: Any, _real: Any = getattr(os, name), **kwargs: Any) -> Any:
            nonlocal count
            count += 1
            if count >= step:
                raise Killed
            return _real(*args, **kwargs)

        monkeypatch.setattr(os, name, dying)
