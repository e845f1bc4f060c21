"""Read correspondences from a CSV file with a header: columns x1, y1, x2, y2, optionally patch and sigma."""

from __future__ import annotations

import hashlib
import math
import sys
from collections.abc import Mapping
from os import PathLike

import numpy as np

from slopecli.errors import InputError
from slopecli.io.files import csv_rows, read_file, readable
from slopecli.patches.given import Given

MAX_BYTES = 500_000_000
COORDINATES = ("x1", "y1", "x2", "y2")
WANTED = "needed a header with the columns x1,y1,x2,y2, and if need be patch and sigma"
SHOWN = 40  # characters of a bad cell in a message
LARGEST = 1e9  # coordinate: wider than any image, px or mrad
SIGMAS = 1e-6, 1e6  # px or mrad


def read_correspondences(path: str | PathLike[str]) -> Given:
    """Read a CSV file with a header, or stdin for "-". Columns may be in any order; others are ignored.

    Cells are separated by commas, semicolons, tabs or spaces, whichever of them the header has first in this list.
    Without the column patch all rows belong to patch 1; an empty cell or -1 means no patch.

    Raises
    ------
    InputError : the file cannot be read, lacks a column, or has a row that is not numbers; the row is named.
    """
    data = _read(path)
    rows = csv_rows(path, data, WANTED, ",;\t ")
    columns = _columns(path, next(rows, (0, []))[1])
    values = [_values(path, f"row {n} (line {line})", cells, columns) for n, (line, cells) in enumerate(rows, 1)]
    if not values:
        raise InputError(f"{path}: has no rows under its header; needed at least five correspondences")
    table = np.array(values, float)
    sigma = table[:, 5] if "sigma" in columns else None
    digest = hashlib.sha256(data).hexdigest()
    return Given(table[:, :2], table[:, 2:4], table[:, 4].astype(np.int64), sigma, str(path), digest)


def _read(path: str | PathLike[str]) -> bytes:
    if str(path) == "-":
        if sys.stdin is None:
            raise InputError("-: stdin is closed; give a file, or pipe the correspondences in")
        with readable(path):
            data = sys.stdin.buffer.read(MAX_BYTES + 1)
    else:
        data = read_file(path, "CSV file", MAX_BYTES, pipe=True)
    if len(data) > MAX_BYTES:
        raise InputError(f"{path}: is larger than {MAX_BYTES / 1e6:.0f} MB; give fewer correspondences")
    return data


def _columns(path: str | PathLike[str], header: list[str]) -> Mapping[str, int]:
    """Index of each column."""
    names = [cell.lower() for cell in header]
    missing = [name for name in COORDINATES if name not in names]
    if missing:
        found = ", ".join(names)[:SHOWN] or "nothing"
        raise InputError(f"{path}: has no column {', '.join(missing)} (its first line is: {found}); {WANTED}")
    twice = [name for name in (*COORDINATES, "patch", "sigma") if names.count(name) > 1]
    if twice:
        raise InputError(f"{path}: has two columns {twice[0]}; leave one out")
    return {name: names.index(name) for name in (*COORDINATES, "patch", "sigma") if name in names}


def _values(path: str | PathLike[str], where: str, cells: list[str], columns: Mapping[str, int]) -> tuple[float, ...]:
    """x1, y1, x2, y2, patch, sigma of a row; sigma is 1 without such a column."""
    if len(cells) <= max(columns.values()):
        raise InputError(f"{path}: {where} has {len(cells)} cells, and the header names more; complete the row")
    texts = {name: cells[column] for name, column in columns.items()}
    try:
        point = [_coordinate(texts[name], name) for name in COORDINATES]
        return (*point, _patch(texts.get("patch", "1")), _sigma(texts.get("sigma", "1")))
    except ValueError as error:
        raise InputError(f"{path}: {where}: {error}") from None


def _number(text: str, name: str) -> float:
    try:
        number = math.nan if "_" in text else float(text)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise ValueError(f"{name} is {text[:SHOWN]!r}, needed a finite number; correct the row or leave it out")
    return number


def _coordinate(text: str, name: str) -> float:
    number = _number(text, name)
    if abs(number) > LARGEST:
        raise ValueError(f"{name} is {text[:SHOWN]!r}, needed one up to {LARGEST:g}; correct the row or leave it out")
    return number


def _patch(text: str) -> float:
    if not text:
        return -1
    number = _number(text, "patch")
    if number != int(number) or not -1 <= number < 2**31:
        raise ValueError(f"patch is {text[:SHOWN]!r}, needed the number of a plane, 0 or more, or -1 for none")
    return number


def _sigma(text: str) -> float:
    number = _number(text, "sigma")
    least, most = SIGMAS
    if not least <= number <= most:
        wanted = f"needed the 1-sigma of the match in image 2, {least:g} to {most:g}"
        raise ValueError(f"sigma is {text[:SHOWN]!r}, {wanted}")
    return number
