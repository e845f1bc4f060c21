"""Files that grow by whole lines while others read them: one write a line, an unfinished last one is ignored."""

from __future__ import annotations

import json
import os
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from slopecli.errors import DiskFull, InputError
from slopecli.io.files import DISK_FULL, read_file


class LineFile:
    """A new file of lines. Every line is one write, so that a reader finds it whole or not at all, but the last."""

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_APPEND
            self._descriptor = os.open(self.path, flags, 0o666)
        except OSError as error:
            raise self._problem(error) from error

    def write(self, line: bytes) -> None:
        """Add one line, given without its end. Raises DiskFull or InputError, and leaves the lines before it whole."""
        data = line + b"\n"
        before = os.lseek(self._descriptor, 0, os.SEEK_END)
        try:
            written = os.write(self._descriptor, data)
            while written < len(data):
                written += os.write(self._descriptor, data[written:])
        except OSError as error:
            os.ftruncate(self._descriptor, before)
            raise self._problem(error) from error

    def _problem(self, error: OSError) -> InputError | DiskFull:
        kind = DiskFull if error.errno in DISK_FULL else InputError
        return kind(f"cannot write {self.path}: {error.strerror}; choose another folder with -o")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        os.close(self._descriptor)


def read_lines(path: str | Path) -> list[dict[str, Any]]:
    """The objects of a file such as sequence.jsonl, one a line; a last line without its end is left out.

    Raises
    ------
    InputError : the file cannot be read, or one of its other lines is no JSON object.
    """
    data = read_file(path, "file of JSON lines", 10_000_000_000)
    objects = []
    for number, line in enumerate(data.split(b"\n")[:-1], 1):
        try:
            value = json.loads(line)
        except ValueError:
            raise InputError(f"{path}: line {number} is no JSON; write the file again") from None
        if not isinstance(value, dict):
            raise InputError(f"{path}: line {number} is no JSON object; write the file again")
        objects.append(value)
    return objects
