"""Correspondences from text: a table with a header, or the columns x1, y1, x2, y2 and patch without one."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from itertools import chain

import numpy as np

from slopecli.errors import InputError
from slopecli.io.correspondences.match_source import LIMITS, MatchSource
from slopecli.io.files import as_utf8, csv_rows
from slopecli.patches.given import Given

COORDINATES = ("x1", "y1", "x2", "y2")
WANTED = "needed a header with the columns x1,y1,x2,y2, and if need be patch and sigma; or just these four and patch"


def read(source: MatchSource) -> Given:
    """Read a table. Columns may be in any order under a header; others are ignored.

    Cells are separated by commas, semicolons, tabs or spaces, whichever of them the first line has first in this list.
    Lines that begin with # are comments, but the header may do so, as NumPy writes it. Without the column patch all
    rows belong to patch 1; an empty cell or -1 means no patch.

    Raises
    ------
    InputError : the file lacks a column, or has a row that is not numbers; the row is named.
    """
    rows = csv_rows(source.path, _without_comments(as_utf8(source.data or b"")), WANTED, ",;\t ")
    columns, rows = _layout(source.path, rows)
    values = [_values(source.path, f"row {n} (line {line})", cells, columns) for n, (line, cells) in enumerate(rows, 1)]
    if not values:
        raise InputError(f"{source.path}: has no rows under its header; needed at least five correspondences")
    table = np.array(values, float)
    sigma = table[:, 5] if "sigma" in columns else None
    return Given(
        table[:, :2],
        table[:, 2:4],
        table[:, 4].astype(np.int64),
        sigma,
        source.path,
        source.sha256,
        has_patch="patch" in columns,
    )


def _without_comments(data: bytes) -> bytes:
    """The text with its comments as empty lines, so that lines keep their numbers, and a header without its mark."""
    if b"#" not in data:
        return data
    header = re.compile(rb"^\s*#([^\r\n]*\bx1\b[^\r\n]*\by2\b)", re.IGNORECASE)
    lines = data.splitlines(keepends=True)
    first = next((k for k, line in enumerate(lines) if line.strip() and not line.lstrip().startswith(b"#")), len(lines))
    marked = [k for k in range(first) if header.match(lines[k])]
    for k, line in enumerate(lines):
        if line.lstrip().startswith(b"#"):
            lines[k] = header.sub(rb"\1", line) if marked and k == marked[-1] else b"\n"
    return b"".join(lines)


def _layout(
    path: str, rows: Iterator[tuple[int, list[str]]]
) -> tuple[Mapping[str, int], Iterator[tuple[int, list[str]]]]:
    """Index of each column, and the rows below the header; where the first row is numbers, it is no header."""
    first = next(rows, (0, []))
    cells = first[1]
    if not cells or not all(map(_is_number, cells)):
        return _columns(path, cells), rows
    names = (*COORDINATES, "patch")
    if len(cells) not in (4, 5):
        found = f"has {len(cells)} columns and no header (its first line is: {', '.join(cells)[: LIMITS.shown]})"
        raise InputError(f"{path}: {found}; {WANTED}")
    return {name: names.index(name) for name in names[: len(cells)]}, chain([first], rows)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _columns(path: str, header: list[str]) -> Mapping[str, int]:
    """Index of each column."""
    names = [cell.lower() for cell in header]
    missing = [name for name in COORDINATES if name not in names]
    if missing:
        found = ", ".join(names)[: LIMITS.shown] or "nothing"
        raise InputError(f"{path}: has no column {', '.join(missing)} (its first line is: {found}); {WANTED}")
    twice = [name for name in (*COORDINATES, "patch", "sigma") if names.count(name) > 1]
    if twice:
        raise InputError(f"{path}: has two columns {twice[0]}; leave one out")
    return {name: names.index(name) for name in (*COORDINATES, "patch", "sigma") if name in names}


def _values(path: str, where: str, cells: list[str], columns: Mapping[str, int]) -> tuple[float, ...]:
    """x1, y1, x2, y2, patch, sigma of a row; sigma is 1 without such a column."""
    if len(cells) <= max(columns.values()):
        raise InputError(f"{path}: {where} has {len(cells)} cells, and the first line has more; complete the row")
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
        raise ValueError(f"{name} is {text[: LIMITS.shown]!r}, needed a finite number; correct the row or leave it out")
    return number


def _coordinate(text: str, name: str) -> float:
    number = _number(text, name)
    if abs(number) > LIMITS.largest:
        raise ValueError(
            f"{name} is {text[: LIMITS.shown]!r}, needed one up to {LIMITS.largest:g}; correct the row or leave it out"
        )
    return number


def _patch(text: str) -> float:
    if not text:
        return -1
    number = _number(text, "patch")
    if number != int(number) or not -1 <= number < 2**31:
        raise ValueError(f"patch is {text[: LIMITS.shown]!r}, needed the number of a plane, 0 or more, or -1 for none")
    return number


def _sigma(text: str) -> float:
    number = _number(text, "sigma")
    least, most = LIMITS.sigmas
    if not least <= number <= most:
        wanted = f"needed the 1-sigma of the match in image 2, {least:g} to {most:g}"
        raise ValueError(f"sigma is {text[: LIMITS.shown]!r}, {wanted}")
    return number
