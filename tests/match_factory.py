"""Files of correspondences in the conventions of the tools that write them, made from points of our own."""

from __future__ import annotations

import io
import sqlite3
import struct
from collections.abc import Mapping
from contextlib import closing
from pathlib import Path

import numpy as np

# the tables of COLMAP 3 and of COLMAP 4, as far as matches go
TABLES = {
    3: (
        "CREATE TABLE cameras (camera_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, model INTEGER NOT NULL,"
        " width INTEGER NOT NULL, height INTEGER NOT NULL, params BLOB, prior_focal_length INTEGER NOT NULL)",
        "CREATE TABLE images (image_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, name TEXT NOT NULL UNIQUE,"
        " camera_id INTEGER NOT NULL, prior_qw REAL, prior_qx REAL, prior_qy REAL, prior_qz REAL, prior_tx REAL,"
        " prior_ty REAL, prior_tz REAL)",
        "CREATE TABLE keypoints (image_id INTEGER PRIMARY KEY NOT NULL, rows INTEGER NOT NULL, cols INTEGER NOT NULL,"
        " data BLOB)",
        "CREATE TABLE matches (pair_id INTEGER PRIMARY KEY NOT NULL, rows INTEGER NOT NULL, cols INTEGER NOT NULL,"
        " data BLOB)",
        "CREATE TABLE two_view_geometries (pair_id INTEGER PRIMARY KEY NOT NULL, rows INTEGER NOT NULL,"
        " cols INTEGER NOT NULL, data BLOB, config INTEGER NOT NULL, F BLOB, E BLOB, H BLOB, qvec BLOB, tvec BLOB)",
    ),
}
TABLES[4] = (
    TABLES[3][0],
    "CREATE TABLE images (image_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, name TEXT NOT NULL UNIQUE,"
    " camera_id INTEGER NOT NULL)",
    *TABLES[3][2:4],
    TABLES[3][4].replace("tvec BLOB)", "tvec BLOB, camera1 BLOB, camera2 BLOB)"),
    "CREATE TABLE rigs (rig_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, ref_sensor_id INTEGER NOT NULL,"
    " ref_sensor_type INTEGER NOT NULL)",
    "CREATE TABLE frames (frame_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, rig_id INTEGER NOT NULL)",
)
MAX_IDS = 2147483647


def pair_id(first: int, second: int) -> int:
    """COLMAP's number of a pair of images, whichever comes first."""
    return min(first, second) * MAX_IDS + max(first, second)


def colmap_database(
    path: Path,
    points: Mapping[str, np.ndarray],
    pairs: Mapping[tuple[str, str], np.ndarray],
    *,
    version: int = 3,
    columns: int = 6,
    camera: tuple[int, int, int, tuple[float, ...]] = (1, 1024, 1024, (800.0, 800.0, 512.0, 512.0)),
    known: bool = True,
    config: int = 2,
    verified: bool = True,
) -> Path:
    """A database.db of images 1, 2, ... with their points, px with centres at integers, and matches of pairs by name.

    pairs : (m, 2) indices of points, in the order of the names.  camera : COLMAP's model, width, height, parameters.
    """
    path.unlink(missing_ok=True)
    with closing(sqlite3.connect(path)) as database:
        for table in TABLES[version]:
            database.execute(table)
        if version == 4:
            database.execute("PRAGMA user_version = 4020100")
        model, width, height, parameters = camera
        blob = struct.pack(f"<{len(parameters)}d", *parameters)
        database.execute("INSERT INTO cameras VALUES (1, ?, ?, ?, ?, ?)", (model, width, height, blob, int(known)))
        ids = {name: number for number, name in enumerate(points, 1)}
        for name, xy in points.items():
            database.execute("INSERT INTO images (image_id, name, camera_id) VALUES (?, ?, 1)", (ids[name], name))
            table = np.zeros((len(xy), columns), "<f4")
            table[:, :2] = xy + 0.5  # the centre of the first pixel is at (0.5, 0.5)
            row = (ids[name], len(xy), columns, table.tobytes())
            database.execute("INSERT INTO keypoints VALUES (?, ?, ?, ?)", row)
        for (first, second), indices in pairs.items():
            number = pair_id(ids[first], ids[second])
            table = np.asarray(indices, "<u4")[:, :: 1 if ids[first] < ids[second] else -1]
            row = (number, len(table), 2, np.ascontiguousarray(table).tobytes())
            database.execute("INSERT INTO matches VALUES (?, ?, ?, ?)", row)
            if verified:
                database.execute(
                    "INSERT INTO two_view_geometries (pair_id, rows, cols, data, config) VALUES (?, ?, ?, ?, ?)",
                    (*row, config),
                )
        database.commit()
    return path


def hloc_files(
    folder: Path,
    points: Mapping[str, np.ndarray],
    pairs: Mapping[tuple[str, str], np.ndarray],
    *,
    dtype: str = "f4",
    old: bool = False,
) -> tuple[Path, Path]:
    """matches.h5 and features.h5 as hloc writes them; points px with centres at integers, as it has them."""
    import h5py

    paths = folder / "matches.h5", folder / "features.h5"
    with h5py.File(paths[1], "w") as features:
        for name, xy in points.items():
            group = features.create_group(name)
            group.create_dataset("keypoints", data=np.asarray(xy, dtype))
            group.create_dataset("image_size", data=np.array([1024, 1024]))
            group.create_dataset("descriptors", data=np.zeros((2, len(xy)), "f2"))
    with h5py.File(paths[0], "w") as matches:
        for (first, second), indices in pairs.items():
            group = matches.create_group(("_" if old else "/").join(name.replace("/", "-") for name in (first, second)))
            partner = np.full(len(points[first]), -1, np.int16)
            partner[indices[:, 0]] = indices[:, 1]
            group.create_dataset("matches0", data=partner)
            group.create_dataset("matching_scores0", data=np.ones(len(partner), "f2"))
    return paths


def two_column_files(
    folder: Path, points: Mapping[str, np.ndarray], pairs: Mapping[tuple[str, str], np.ndarray]
) -> tuple[Path, Path]:
    """matches.h5 and keypoints.h5 with an array an image, and one a pair under the name of its first image."""
    import h5py

    paths = folder / "matches.h5", folder / "keypoints.h5"
    with h5py.File(paths[1], "w") as features:
        for name, xy in points.items():
            features[name] = np.asarray(xy, "f4")
    with h5py.File(paths[0], "w") as matches:
        for (first, second), indices in pairs.items():
            matches.require_group(first).create_dataset(second, data=np.asarray(indices))
    return paths


def archive(**arrays: np.ndarray) -> bytes:
    """The bytes of a .npz file."""
    file = io.BytesIO()
    np.savez(file, **arrays)
    return file.getvalue()
