"""Temporary folders within output folders, told apart by locks: those in use, and those that killed processes left."""

from __future__ import annotations

import os
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from slopecli.io.files import TEMPORARY, unfinished


@contextmanager
def temporary_folder(folder: Path) -> Iterator[Path]:
    """A new folder within a folder, so that files need not cross file systems to get there; removed at the end.

    What killed processes have left in the folder is removed first.
    """
    _remove_abandoned(folder)
    with ExitStack() as kept:
        with _locked(folder, shared=True):  # between being made and being locked, a folder looks abandoned
            made = tempfile.TemporaryDirectory(prefix=TEMPORARY, dir=folder, ignore_cleanup_errors=True)
            beside = Path(kept.enter_context(made))
            kept.enter_context(_locked(beside))
        yield beside


def _remove_abandoned(folder: Path) -> None:
    with _locked(folder) as alone:
        if alone is False:
            return
        for entry in unfinished(folder):
            if entry.is_dir(follow_symlinks=False) and _is_abandoned(entry, alone is True):
                shutil.rmtree(entry.path, ignore_errors=True)


def _is_abandoned(entry: os.DirEntry[str], lockable: bool) -> bool:
    """Whether the process that made a temporary folder has ended; where that cannot be told, whether it is old."""
    if lockable:
        with _locked(Path(entry.path)) as free:
            if free is not None:
                return free
    return time.time() - entry.stat(follow_symlinks=False).st_mtime > 24 * 3600


@contextmanager
def _locked(folder: Path, *, shared: bool = False) -> Iterator[bool | None]:
    """Lock a folder until the end or until the process ends. Only for a shared lock, other holders are waited for.

    Gives True; False if another process holds a lock; None where folders cannot be locked.
    """
    descriptor = _open_folder(folder)
    try:
        yield None if descriptor is None else _lock(descriptor, shared)
    finally:
        if descriptor is not None:
            os.close(descriptor)


def _open_folder(folder: Path) -> int | None:
    try:
        return os.open(folder, os.O_RDONLY)
    except OSError:  # not readable, or on Windows
        return None


def _lock(descriptor: int, shared: bool) -> bool | None:
    try:
        import fcntl

        fcntl.flock(descriptor, fcntl.LOCK_SH if shared else fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except (ImportError, OSError):
        return None
    return True
