"""The formats of correspondences that are read, one row each. A new one is one module beside this and one row here."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from os import PathLike
from pathlib import Path

from slopecli.errors import InputError
from slopecli.io.correspondences.match_source import MatchSource, Names
from slopecli.io.files import MOST_BYTES, checked_path, read_file, readable
from slopecli.patches.given import Given


@dataclass(frozen=True)
class MatchFormat:
    """One format of files with correspondences.

    Attributes
    ----------
    name : in messages and in docs/solve.md.
    starts : the first bytes of such a file; b"" for what no other row recognises.
    reader : "module:function" of this package, `MatchSource` -> `Given` in px with centres at integers, or in rays.
    opens : whether the reader opens the file itself, which may be larger than what is read of it, and not stdin.
    files, holds, converted : the columns of the table in docs/solve.md, Markdown.
    """

    name: str
    starts: bytes
    reader: str
    opens: bool
    files: str
    holds: str
    converted: str = ""

    def read(self, source: MatchSource) -> Given:
        """The correspondences of a file of this format."""
        module, function = self.reader.split(":")
        read: Callable[[MatchSource], Given] = getattr(import_module(f"slopecli.io.correspondences.{module}"), function)
        return read(source)


MATCH_FORMATS = (
    MatchFormat(
        "COLMAP database",
        b"SQLite format 3\0",
        "colmap_database:read",
        opens=True,
        files="`database.db` of COLMAP 3 and 4",
        holds="the verified matches (`two_view_geometries`) of every pair; the cameras, where they were given",
        converted="half a pixel: COLMAP's pixel centres are at (0.5, 0.5)",
    ),
    MatchFormat(
        "HDF5",
        b"\x89HDF\r\n\x1a\n",
        "hdf5_matches:read",
        opens=True,
        files="`matches.h5` of hloc (LightGlue, ...), or of two columns a pair; with `--keypoints features.h5`",
        holds="indices of matched keypoints of every pair; needs `pip install 'slopemap[h5]'`",
        converted="nothing: pixel centres are at integers in hloc",
    ),
    MatchFormat(
        "NumPy archive",
        b"PK\x03\x04",
        "match_arrays:read_archive",
        opens=False,
        files="`.npz` by `numpy.savez`, also that of SuperGlue",
        holds="matched points `mkpts0` `mkpts1`, `pts1` `pts2`, `x1` `x2`, ...; `keypoints0` `keypoints1` with "
        "`matches`; columns `x1` `y1` `x2` `y2`; and if need be `patch` and `sigma`",
    ),
    MatchFormat(
        "NumPy array",
        b"\x93NUMPY",
        "match_arrays:read_array",
        opens=False,
        files="`.npy`",
        holds="a table of four columns x1 y1 x2 y2, or five with patch",
    ),
    MatchFormat(
        "table",
        b"",
        "match_tables:read",
        opens=False,
        files="text, for example `.csv`, `.txt`",
        holds="the columns below under a header, or x1 y1 x2 y2 and patch in this order without one",
    ),
)


def read_correspondences(
    path: str | PathLike[str], pair: Names | None = None, keypoints: str | PathLike[str] | None = None
) -> Given:
    """Read correspondences of any of `MATCH_FORMATS`, or a table or NumPy file from stdin for "-".

    Parameters
    ----------
    pair : names of images 1 and 2, where a file holds several pairs.
    keypoints : a second file with the keypoints, where the matches are indices.

    Raises
    ------
    InputError : the file cannot be read, or has no such pair or no correspondences; the place is named.
    """
    checked_path(path, "file of correspondences")
    start = b"" if str(path) == "-" else _start(path)
    form = next((row for row in MATCH_FORMATS if row.opens and start.startswith(row.starts)), None)
    data = None if form else _read(path)
    form = form or next(row for row in MATCH_FORMATS if (data or b"").startswith(row.starts))
    source = MatchSource(str(path), data, pair, None if keypoints is None else str(keypoints))
    _check(form, source)
    return form.read(source)


def _check(form: MatchFormat, source: MatchSource) -> None:
    """Raise InputError where a file on disk is needed and is not there, or where what is asked for says nothing."""
    if form.opens and source.data is not None:
        raise source.refused(f"is a {form.name} file, which must be a file on disk; give its path")
    if not form.opens and (source.names or source.keypoints):
        flag = "--pair" if source.names else "--keypoints"
        raise source.refused(f"is a {form.name}, which holds one pair with its points; leave {flag} out")


def _start(path: str | PathLike[str]) -> bytes:
    """The first bytes of a regular file; b"" of anything else, of which reading says what is wrong."""
    try:
        if not Path(path).is_file():
            return b""
        with open(path, "rb") as file:
            return file.read(16)
    except (OSError, ValueError):
        return b""


def _read(path: str | PathLike[str]) -> bytes:
    if str(path) == "-":
        if sys.stdin is None:
            raise InputError("-: stdin is closed; give a file, or pipe the correspondences in")
        with readable(path):
            data = sys.stdin.buffer.read(MOST_BYTES + 1)
    else:
        data = read_file(path, "file of correspondences", MOST_BYTES, pipe=True)
    if len(data) > MOST_BYTES:
        raise InputError(f"{path}: is larger than {MOST_BYTES / 1e6:.0f} MB; give fewer correspondences")
    return data
