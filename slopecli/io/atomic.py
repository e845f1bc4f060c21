"""Files that are whole or not there."""

from __future__ import annotations

import errno
import os
import shutil
from contextlib import suppress
from pathlib import Path

TEMPORARY = ".slopemap-"  # what the names of unfinished files and folders begin with
DISK_FULL = (errno.ENOSPC, errno.EDQUOT)


def write_through(path: Path, content: bytes) -> None:
    """Write a new file and wait until the disk has it."""
    with open(path, "xb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())


def sync_folder(folder: Path) -> None:
    """Wait until the disk has the names in a folder; only POSIX systems can."""
    if os.name != "posix":
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def write_atomically(path: Path, content: bytes) -> None:
    """Replace a file at once: whoever looks, even after a power cut, finds the old one or the new one.

    Raises
    ------
    OSError : it could not be written; the old file is as it was.
    """
    beside = path.with_name(f"{TEMPORARY}{os.getpid()}-{path.name}")
    try:
        beside.unlink(missing_ok=True)
        write_through(beside, content)
        os.replace(beside, path)
    except BaseException:
        with suppress(OSError):
            beside.unlink(missing_ok=True)
        raise
    sync_folder(path.parent)


def remove_temporary(folder: Path) -> None:
    """Remove what a killed process left unfinished in a folder; what cannot be removed stays and does no harm."""
    try:
        left = [entry for entry in os.scandir(folder) if entry.name.startswith(TEMPORARY)]
    except OSError:  # none there, or none that can be read: whoever writes to it will say so
        return
    for entry in left:
        with suppress(OSError):
            if entry.is_dir(follow_symlinks=False):
                shutil.rmtree(entry.path)
            else:
                os.unlink(entry.path)
