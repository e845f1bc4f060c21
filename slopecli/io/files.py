"""Read a file with a message of one line for every error; write one so that a reader never finds a part of it."""

from __future__ import annotations

import codecs
import csv
import errno
import os
import re
import select
import shutil
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from io import StringIO
from os import PathLike
from pathlib import Path
from typing import BinaryIO

from slopecli.errors import InputError, WrongArgument

TEMPORARY = ".slopemap-"  # prefix of the names of unfinished files and folders
NO_WAITING = getattr(os, "O_NONBLOCK", 0)
MOST_BYTES = 500_000_000  # of a file of numbers: correspondences, or a list of images
PIPE_WAIT_S = 5.0  # until the first byte of a pipe must come; more would look like a hang
UTF16_MARKS = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
DISK_FULL = (errno.ENOSPC, errno.EDQUOT)


def checked_path(path: object, kind: str) -> str | PathLike[str]:
    """The path of a file of this kind; raises WrongArgument for anything that is none."""
    if isinstance(path, str | PathLike):
        return path
    raise WrongArgument(f"the {kind} is given as {type(path).__name__}, needed its path: a text or a pathlib.Path")


def read_file(
    path: str | PathLike[str],
    kind: str,
    max_bytes: int = 2_000_000_000,
    base: str | PathLike[str] = "",
    *,
    pipe: bool = False,
) -> bytes:
    """The bytes of an input file.

    Parameters
    ----------
    kind : what it should be, for messages: "image file".  max_bytes : more are refused; by default what memory holds.
    base : folder that a relative path starts from.
    pipe : whether it may be a pipe; of a pipe at most max_bytes + 1 are read.

    Raises
    ------
    InputError : there is no such file, it is a folder or a device, too large, or cannot be read; or no path is given.
    """
    place = Path(base, checked_path(path, kind))
    with readable(path):
        if place.is_dir():
            raise InputError(f"{path}: is a folder, needed {'an' if kind[0] in 'aeiou' else 'a'} {kind}")
        if not place.exists():
            raise InputError(f"{path}: no such {kind}; check the path")
        if pipe and place.is_fifo():
            return _read_pipe(path, place, max_bytes)
        if not place.is_file():
            raise InputError(f"{path}: is not a regular file; save it to disk first")
        size = place.stat().st_size
        data = b"" if size > max_bytes else _read_regular(place, max_bytes + 1)
        size = max(size, len(data))
        if size > max_bytes:  # or a file of the system that has no end, and says that it has no bytes
            sizes = f"{size / 1e6:.0f} MB, at most {max_bytes / 1e6:.0f} MB are read"
            raise InputError(f"{path}: is too large for a {kind} ({sizes}); give a smaller one")
        return data


def _read_regular(place: Path, n: int) -> bytes:
    """At most n bytes of a file; does not wait if it has become a pipe meanwhile."""
    with open(place, "rb", opener=lambda name, flags: os.open(name, flags | NO_WAITING)) as file:
        return _at_most(file, n)


def _at_most(file: BinaryIO, n: int) -> bytes:
    """At most n bytes of a file, in parts: `file.read(n)` reserves n bytes however few there are."""
    content = bytearray()
    while len(content) < n and (part := file.read(min(n - len(content), 1 << 22))):
        content += part
    return bytes(content)


def _read_pipe(path: str | PathLike[str], place: Path, max_bytes: int) -> bytes:
    """All bytes of a pipe, at most max_bytes + 1. Raises InputError if nobody writes to one that has a name."""
    has_name = os.path.exists(os.path.realpath(place))  # those of the shell, /dev/fd/63, have none, and have a writer
    descriptor = os.open(place, os.O_RDONLY | NO_WAITING)  # opening it otherwise waits for a writer
    with open(descriptor, "rb") as file:
        if not select.select([descriptor], [], [], PIPE_WAIT_S if has_name else None)[0]:
            raise InputError(f"{path}: is a pipe to which nothing is written; write to it, or give a file")
        os.set_blocking(descriptor, True)
        return _at_most(file, max_bytes + 1)


def csv_rows(
    path: str | PathLike[str], data: bytes, wanted: str, delimiters: str = ","
) -> Iterator[tuple[int, list[str]]]:
    """Line number and stripped cells of every row of a CSV file that is not empty.

    The delimiter is the first of `delimiters` that is in the first line. Raises InputError, which ends with what is
    `wanted`, if the file is no CSV text.
    """
    line, text = 0, _text(path, data, wanted)
    try:
        first = re.search(r"\S.*", text)
        delimiter = next((mark for mark in delimiters if first and mark in first[0]), delimiters[0])
        # spaces, and tabs beside spaces or other tabs: as many as there are, they are one delimiter
        aligned = delimiter == "\t" and " " in delimiters and first and re.search(r"\S(?: |\t\s+)\S", first[0].rstrip())
        spaced = delimiter == " " or bool(aligned)
        lines = (" ".join(row.split()) for row in text.splitlines()) if spaced else StringIO(text, newline="")
        reader = csv.reader(lines, delimiter=" " if spaced else delimiter, skipinitialspace=spaced, strict=True)
        for cells in reader:
            line, cells = reader.line_num, [cell.strip() for cell in cells]
            if any(cells):
                yield line, cells
    except csv.Error as error:
        raise InputError(f"{path}: is not CSV text ({error} after line {line}); {wanted}") from None


def as_utf8(data: bytes) -> bytes:
    """UTF-16 with its mark, as spreadsheets write it, as UTF-8; all else, and damaged UTF-16, as it is."""
    if not data.startswith(UTF16_MARKS):
        return data
    with suppress(UnicodeDecodeError):
        return data.decode("utf-16").encode()
    return data


def mostly_ascii(text: str) -> bool:
    """Whether it is text of numbers and English: most characters are printable ASCII, the rest names and comments."""
    plain = sum(character.isascii() and (character.isprintable() or character in "\t\r\n\f") for character in text)
    return plain >= 0.7 * len(text)


def _text(path: str | PathLike[str], data: bytes, wanted: str) -> str:
    """Text of bytes: UTF-8, UTF-16 with its mark, or Latin-1, which is believed only of what is mostly ASCII."""
    data = as_utf8(data)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")
        if not mostly_ascii(text):
            raise InputError(f"{path}: is not CSV text (neither UTF-8 nor UTF-16); {wanted}") from None
    if "\0" in text:
        raise InputError(f"{path}: is not CSV text (it has a zero byte, or is UTF-16 without its mark); {wanted}")
    return text


@contextmanager
def readable(path: str | PathLike[str]) -> Iterator[None]:
    """Turn errors of the system while a file is read into InputError."""
    try:
        yield
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); check the path and its permissions") from None


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


def unfinished(folder: Path) -> list[os.DirEntry[str]]:
    """The unfinished files and folders in a folder, of processes that run or were killed; [] if it cannot be read."""
    try:
        return [entry for entry in os.scandir(folder) if entry.name.startswith(TEMPORARY)]
    except OSError:  # no such folder, or not readable: writing to it will report that
        return []


def remove_temporary(folder: Path) -> None:
    """Remove the unfinished files of killed processes from a folder; errors are ignored, as such files do no harm."""
    for entry in unfinished(folder):
        with suppress(OSError):
            if entry.is_dir(follow_symlinks=False):
                shutil.rmtree(entry.path)
            else:
                os.unlink(entry.path)


@contextmanager
def signals_held_back() -> Iterator[None]:
    """Let SIGINT, SIGTERM and SIGHUP wait until the end of the body, so that it is done whole or not begun.

    Python handles signals in its main thread only; in others this does nothing.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    waiting: list[int] = []
    numbers = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
    before = {number: signal.signal(number, lambda number, _: waiting.append(number)) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, signal.SIG_DFL if handler is None else handler)
        for number in waiting:
            signal.raise_signal(number)
