"""Write files so that a reader, or a run after a crash, finds the old or the new content, never a part."""

from __future__ import annotations

import errno
import os
import shutil
from contextlib import suppress
from pathlib import Path

TEMPORARY = ".slopemap-"  # prefix of the names of unfinished files and folders
DISK_FULL = (errno.ENOSPC, errno.EDQUOT)


def write_through(path: Path, content: bytes) -> None:
    """Write a new file and wait until it is on the disk."""
    with open(path, "xb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())


def sync_folder(folder: Path) -> None:
    """Wait until the entries of a folder are on the disk (POSIX only)."""
    if os.name != "posix":
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def write_atomically(path: Path, content: bytes) -> None:
    """Replace a file in one step: readers find the old or the new content, also after a power cut.

    Raises
    ------
    OSError : it could not be written; the old file is unchanged.
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
    """Remove the unfinished files of killed processes from a folder; errors are ignored, as such files do no harm."""
    try:
        left = [entry for entry in os.scandir(folder) if entry.name.startswith(TEMPORARY)]
    except OSError:  # no such folder, or not readable: writing to it will report that
        return
    for entry in left:
        with suppress(OSError):
            if entry.is_dir(follow_symlinks=False):
                shutil.rmtree(entry.path)
            else:
                os.unlink(entry.path)
