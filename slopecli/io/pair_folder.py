"""The folder of one pair of a batch: its files, and a record that they are complete.

The record is removed before the first file changes and written after the last. Where there is a record, its files are
complete and belong together, whenever the writer was killed. Two writers of the same files do no harm.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Mapping
from pathlib import Path

from slopecli.io.atomic import TEMPORARY, sync_folder, write_through
from slopecli.products import OUTPUT_NAMES

RECORD = "pair.json"


def store_pair(folder: Path, contents: Mapping[str, bytes], record: bytes) -> None:
    """Replace the output files of a pair by `contents`, then write its record.

    Raises
    ------
    OSError : a file could not be written. Until all are on the disk, the folder is unchanged.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=TEMPORARY, dir=folder) as temporary:
        beside = Path(temporary)
        for name, content in (*contents.items(), (RECORD, record)):
            write_through(beside / name, content)
        _remove_record(folder / RECORD)
        for name in OUTPUT_NAMES:
            if name in contents:
                os.replace(beside / name, folder / name)
            else:
                (folder / name).unlink(missing_ok=True)
        sync_folder(folder)
        os.replace(beside / RECORD, folder / RECORD)
    sync_folder(folder)


def _remove_record(path: Path) -> None:
    """Remove the record of an earlier answer, and wait until that is on the disk."""
    if os.path.lexists(path):
        path.unlink(missing_ok=True)  # another writer may have removed it
        sync_folder(path.parent)


def read_record(folder: Path) -> bytes | None:
    """The record of a pair, None if there is none or it cannot be read."""
    try:
        return (folder / RECORD).read_bytes()
    except OSError:
        return None


def has_files(folder: Path, sizes: Mapping[str, int]) -> bool:
    """Whether the output files of a pair are exactly these, by name and size in bytes."""
    try:
        there = {name: os.path.getsize(folder / name) for name in OUTPUT_NAMES if os.path.lexists(folder / name)}
    except OSError:
        return False
    return there == sizes
