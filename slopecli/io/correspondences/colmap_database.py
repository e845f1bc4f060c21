"""Verified matches of a pair of images in COLMAP's database.db, with the cameras where these were given to COLMAP.

Source: COLMAP's documentation, "Database Format". Keypoints have pixel centres at (0.5, 0.5). The number of a pair is
first image_id x (2^31 - 1) + second, the smaller image_id first. Tables and columns that only COLMAP 4 has are not
read.
"""

from __future__ import annotations

import sqlite3
import struct
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from slopecli.errors import InputError
from slopecli.io.cameras import colmap
from slopecli.io.cameras.content import CameraFileContent
from slopecli.io.correspondences.match_source import MatchSource, Names, checked_rows, chosen_pair, taken
from slopecli.io.files import MOST_BYTES
from slopecli.patches.given import Given
from slopecli.types import Camera, FloatArray, IntArray

# columns that are read, by table
TABLES = {
    "images": {"image_id", "name", "camera_id"},
    "cameras": {"camera_id", "model", "width", "height", "params", "prior_focal_length"},
    "keypoints": {"image_id", "rows", "cols", "data"},
    "two_view_geometries": {"pair_id", "rows", "cols", "data", "config"},
}
GUESSED = "the focal length of its cameras is COLMAP's guess and was not used"


@dataclass(frozen=True)
class _Conventions:
    """What COLMAP's files rely on."""

    ids: int  # pair_id = first image_id x this + second
    centre_px: float  # of the first pixel
    unusable: tuple[int, ...]  # config of a pair: degenerate; a watermark that all images have


COLMAP = _Conventions(2**31 - 1, 0.5, (1, 7))


def read(source: MatchSource) -> Given:
    """The verified matches of the pair of images that is wanted, or of the only one."""
    with _opened(source) as database:
        _check_tables(source, database)
        images = {identity: (name, camera) for identity, name, camera in _images(source, database)}
        pairs = _pairs(source, database, images)
        (first, second), turned = chosen_pair(source, pairs, lambda pair: pair[1])
        pair_id, _, config = pairs[first, second]
        if config in COLMAP.unusable:
            kind = "degenerate" if config == COLMAP.unusable[0] else "of a watermark"
            raise source.refused(f"COLMAP calls the pair {first!r}, {second!r} {kind}; choose another with --pair")
        matches = _indices(source, database, pair_id)
        ids = divmod(pair_id, COLMAP.ids)
        xy1, xy2 = (
            taken(source, _keypoints(source, database, identity), index, images[identity][0])
            for identity, index in zip(ids, matches.T, strict=True)
        )
        cameras = [_camera(source, database, images[identity][1]) for identity in ids]
    names, (camera1, camera2) = (first, second), cameras
    if turned:
        xy1, xy2, camera1, camera2, names = xy2, xy1, camera2, camera1, (second, first)
    known = (camera1, camera2) if camera1 and camera2 else None
    note = "" if known else GUESSED
    return checked_rows(source, xy1, xy2, names=names, cameras=known, pixels=True, note=note)


@contextmanager
def _opened(source: MatchSource) -> Iterator[sqlite3.Connection]:
    """The database, only to be read. Raises InputError where it is damaged, or in use by another program."""
    place = Path(source.path)
    log = place.with_name(f"{place.name}-wal")
    if log.exists() and log.stat().st_size:
        raise source.refused(f"is open in another program, or was not closed ({log.name} beside it); close it there")
    try:
        with closing(sqlite3.connect(f"{place.absolute().as_uri()}?mode=ro&immutable=1", uri=True)) as database:
            database.execute("PRAGMA trusted_schema = OFF")
            database.text_factory = lambda text: text.decode("utf-8", "replace")
            database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MOST_BYTES)
            yield database
    except (sqlite3.Error, UnicodeError, OverflowError) as error:
        raise source.refused(f"is a damaged SQLite database ({str(error)[:80]}); copy it again") from None


def _check_tables(source: MatchSource, database: sqlite3.Connection) -> None:
    """Raise InputError unless every table that is read is there, is a table and has its columns."""
    kinds = dict(database.execute("SELECT name, type FROM sqlite_master WHERE type IN ('table', 'view')"))
    if kinds.get("inlier_matches") == "table" and "two_view_geometries" not in kinds:
        raise source.refused("is of a COLMAP before 3.5; open it once in a newer COLMAP, which converts it")
    for table, columns in TABLES.items():
        there = (
            {row[1] for row in database.execute(f"PRAGMA table_info({table})")}
            if kinds.get(table) == "table"
            else set()
        )
        if missing := sorted(columns - there):
            what = f"no column {missing[0]} in its table {table}" if there else f"no table {table}"
            raise source.refused(f"has {what}; needed a database.db of COLMAP")


def _images(source: MatchSource, database: sqlite3.Connection) -> list[tuple[int, str, int]]:
    rows = database.execute("SELECT image_id, name, camera_id FROM images").fetchall()
    if not all(_are_integers(identity, camera) and isinstance(name, str) for identity, name, camera in rows):
        raise source.refused("its table images has a row that is no image; copy it again")
    return rows


def _pairs(
    source: MatchSource, database: sqlite3.Connection, images: dict[int, tuple[str, int]]
) -> dict[Names, tuple[int, int, int]]:
    """pair_id, number of matches and config of every pair with matches, by the names of its images."""
    pairs: dict[Names, tuple[int, int, int]] = {}
    for pair_id, rows, config in database.execute(
        "SELECT pair_id, rows, config FROM two_view_geometries WHERE rows > 0"
    ):
        first, second = divmod(pair_id, COLMAP.ids) if _are_integers(pair_id, rows, config) else (-1, -1)
        if first not in images or second not in images or first >= second:
            raise source.refused(
                f"its pair {str(pair_id)[:20]} does not name two of its images; needed COLMAP's pair_id"
            )
        pairs[images[first][0], images[second][0]] = pair_id, rows, config
    if not pairs:
        matched = database.execute("SELECT count(*) FROM sqlite_master WHERE type = 'table' AND name = 'matches'")
        some = matched.fetchone()[0] and database.execute("SELECT count(*) FROM matches WHERE rows > 0").fetchone()[0]
        if some:
            raise source.refused(f"of its {some} matched pairs none is verified; run COLMAP's geometric verification")
        raise source.refused("has no matches; run one of COLMAP's matchers")
    return pairs


def _indices(source: MatchSource, database: sqlite3.Connection, pair_id: int) -> IntArray:
    """(m, 2) indices of keypoints, that of the image with the smaller number first."""
    query = "SELECT rows, cols, data FROM two_view_geometries WHERE pair_id = ?"
    return _array(source, database.execute(query, (pair_id,)).fetchone(), np.dtype("<u4"), (2,)).astype(np.int64)


def _keypoints(source: MatchSource, database: sqlite3.Connection, image_id: int) -> FloatArray:
    """(n, 2) px with centres at integers. Four more columns, or two, are scale and shape."""
    row = database.execute("SELECT rows, cols, data FROM keypoints WHERE image_id = ?", (image_id,)).fetchone()
    points = _array(source, row, np.dtype("<f4"), (2, 4, 6))
    with np.errstate(invalid="ignore"):  # NaN of a damaged file is refused where correspondences are checked
        return points[:, :2].astype(np.float64) - COLMAP.centre_px


def _array(source: MatchSource, row: Any, dtype: np.dtype[Any], widths: tuple[int, ...]) -> np.ndarray[Any, Any]:
    """The array of a row (rows, cols, data) of a table, of one of these widths."""
    rows, cols, data = row or (0, widths[0], b"")
    if not _are_integers(rows, cols) or not isinstance(data, bytes):
        raise source.refused("has a damaged array of numbers; copy it again")
    if cols not in widths:
        raise source.refused(f"an array in it has {str(cols)[:20]} columns, needed {' or '.join(map(str, widths))}")
    if rows < 0 or len(data) != rows * cols * dtype.itemsize:
        raise source.refused(f"an array in it is {len(data)} bytes long and should be {rows} x {cols}; copy it again")
    return np.frombuffer(data, dtype).reshape(rows, cols)


def _camera(source: MatchSource, database: sqlite3.Connection, camera_id: int) -> Camera | None:
    """The camera if it was given to COLMAP; None where COLMAP guessed its focal length."""
    query = "SELECT model, width, height, params, prior_focal_length FROM cameras WHERE camera_id = ?"
    model, width, height, params, is_known = database.execute(query, (camera_id,)).fetchone() or (0, 0, 0, b"", 0)
    if not is_known:
        return None
    try:
        record = struct.pack("<QIiQQ", 1, 1, model, width, height) + params
        (camera,) = colmap.find(CameraFileContent(record)).values()
        return colmap.read(camera, None)
    except InputError as error:
        raise source.refused(f"its camera {camera_id}: {error}") from None
    except (struct.error, TypeError, ValueError):
        raise source.refused(f"its camera {camera_id} is damaged; copy it again") from None


def _are_integers(*values: Any) -> bool:
    return all(type(value) is int for value in values)
