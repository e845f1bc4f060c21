"""Writing a report's files: all of them or none."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Collection, Sequence
from contextlib import suppress
from pathlib import Path

from slopecli.errors import DiskFull, InputError
from slopecli.io.atomic import DISK_FULL, TEMPORARY, write_through
from slopecli.products import BY_DEFAULT, OUTPUT_NAMES, encode_products
from slopecli.types import Image, Report


def write_outputs(
    report: Report, image: Image, directory: str | Path, keep: Collection[str] = BY_DEFAULT
) -> list[Path]:
    """Write the files of a report to a folder: what `encode_products` gives, stored by `store_outputs`.

    Parameters
    ----------
    report : the finished answer.
    image : image 1.
    directory : folder to write to; made if missing.
    keep : the user's choices among `slopecli.products.CHOICES`.

    Returns
    -------
    Paths of the files written, slopes.json first.

    Raises
    ------
    InputError : the folder cannot be made or written to.
    DiskFull : there is no space left.
    """
    return store_outputs(encode_products(report, image, keep), directory)


def store_outputs(contents: dict[str, bytes], directory: str | Path, names: Sequence[str] = OUTPUT_NAMES) -> list[Path]:
    """Write the files of an answer to a folder, made if missing: all of them or none.

    Everything is stored beside before the first file appears under its name. After a failure the folder is as it was.
    Files of an earlier run that are not among `contents` are removed, as they would not belong to this result.

    Parameters
    ----------
    names : all that files of such an answer may be called, the last one last to appear.

    Returns
    -------
    Their paths, in the order given.

    Raises
    ------
    InputError : the folder cannot be made or written to.
    DiskFull : there is no space left.
    """
    folder = Path(directory)
    check_directory(folder, names)
    try:
        _store(contents, folder, names)
    except OSError as error:
        kind = DiskFull if error.errno in DISK_FULL else InputError
        raise kind(_complaint(folder, error.strerror or str(error))) from error
    return [folder / name for name in contents]


def check_directory(directory: str | Path, names: Sequence[str] = OUTPUT_NAMES) -> None:
    """Raise InputError if files of these names could not be written to a folder. Makes and changes nothing.

    Worth calling before a long computation.
    """
    folder = Path(directory)
    blocked = [name for name in names if os.path.isdir(folder / name)]
    if blocked:
        raise InputError(
            _complaint(folder, f"{blocked[0]} in it is a folder, and a file of that name is to be written")
        )
    nearest = next(place for place in (folder, *folder.absolute().parents) if os.path.lexists(place))
    if not os.path.isdir(nearest):
        raise InputError(_complaint(folder, f"{nearest} is not a folder"))
    if not os.access(nearest, os.W_OK | os.X_OK):
        raise InputError(_complaint(folder, f"no permission to write in {nearest}"))


def _complaint(folder: Path, reason: str) -> str:
    return f"cannot write results to {folder}: {reason}; choose another folder with -o"


def _store(contents: dict[str, bytes], folder: Path, names: Sequence[str]) -> None:
    missing = [place for place in (folder, *folder.parents) if not place.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        # inside the folder, so that the files need not cross file systems to get their names
        with tempfile.TemporaryDirectory(prefix=TEMPORARY, dir=folder) as beside:
            for name, content in contents.items():
                write_through(Path(beside, name), content)
            _exchange(folder, Path(beside), [name for name in names if name in contents], names)
    except BaseException:
        for place in missing:
            with suppress(OSError):
                place.rmdir()
        raise


def _exchange(folder: Path, beside: Path, new: Sequence[str], names: Sequence[str]) -> None:
    """Move the old files of these names out and the new ones in; puts everything back if a move fails."""
    old = beside / "old"
    old.mkdir()
    moves = [(folder / name, old / name) for name in names if os.path.lexists(folder / name)]
    moves += [(beside / name, folder / name) for name in new]
    done: list[tuple[Path, Path]] = []
    try:
        for source, target in moves:
            os.rename(source, target)
            done.append((source, target))
    except BaseException:
        for source, target in reversed(done):
            os.replace(target, source)
        raise
