"""Correspondences of other tools, changed: databases, archives, HDF5 files, tables without a header, label images."""

from __future__ import annotations

import io
import sqlite3
from contextlib import closing, suppress
from functools import cache
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory

import match_factory
import numpy as np

from fuzzing import samples
from fuzzing.case import Case, Content
from fuzzing.mutations import HOSTILE, ODD_TEXTS, change_bytes, change_encoding, change_text, changed

NAMES = "first.png", "second.png"
WHOLE = 0.1  # of files hold all correspondences


def _points(few: bool) -> tuple[np.ndarray, np.ndarray]:
    """(n, 2) px of the sample correspondences, all or a few, in both images."""
    table = np.genfromtxt(io.BytesIO(samples.pair(few=few)["matches.csv"]), delimiter=",", names=True)
    x1, y1, x2, y2 = (table[name] for name in ("x1", "y1", "x2", "y2"))
    return np.column_stack([x1, y1]), np.column_stack([x2, y2])


@cache
def _good(few: bool) -> dict[str, bytes]:
    """A file of every format but tables of text with a header."""
    xy1, xy2 = _points(few)
    rows = np.column_stack([np.arange(len(xy1))] * 2)
    points, pairs = dict(zip(NAMES, (xy1, xy2), strict=True)), {NAMES: rows}
    array = io.BytesIO()
    np.save(array, np.hstack([xy1, xy2]))
    text = io.BytesIO()
    np.savetxt(text, np.hstack([xy1, xy2]), fmt="%.6g", header="x1 y1 x2 y2")
    with TemporaryDirectory() as folder:
        files = {
            "old.db": match_factory.colmap_database(Path(folder, "old.db"), points, pairs).read_bytes(),
            "new.db": match_factory.colmap_database(Path(folder, "new.db"), points, pairs, version=4).read_bytes(),
        }
        with suppress(ImportError):
            matches, features = match_factory.hloc_files(Path(folder), points, pairs)
            files |= {"matches.h5": matches.read_bytes(), "features.h5": features.read_bytes()}
    return {
        **files,
        "matched.npz": match_factory.archive(mkpts0=xy1, mkpts1=xy2, patch=np.zeros(len(xy1), int)),
        "found.npz": match_factory.archive(keypoints0=xy1, keypoints1=xy2, matches=rows[:, 0]),
        "m.npy": array.getvalue(),
        "m.txt": text.getvalue(),
    }


def match_file(rng: Random) -> Case:
    """A changed file of correspondences of another tool, or a changed image of labels beside a good one."""
    good = _good(few=rng.random() > WHOLE)
    name = rng.choice([name for name in good if name != "features.h5"])
    files: dict[str, Content] = {name: good[name], "camera.json": samples.pair()["camera.json"]}
    several = name.endswith((".db", ".h5"))
    pair = [*rng.choice((NAMES, NAMES[::-1], (NAMES[0], rng.choice(HOSTILE[:5]) or "x")))]
    arguments = ["--pair", *pair] if several and rng.random() < 0.5 else []
    if name == "matches.h5":
        files["features.h5"] = good["features.h5"]
        arguments += ["--keypoints", "features.h5"]
    arguments += rng.choice(([], ["--camera", "camera.json"], ["--camera", "camera.json"]))
    arguments += rng.choice(([], [], ["--planes", "found"], ["--grid", "2x2"], ["--window", "0,0,400,400"]))
    if rng.random() < 0.1:
        labels = samples.encoded(".png", np.full((768, 1024), 1, np.uint16))
        files["labels.png"] = changed(rng, labels, change_bytes)
        arguments += ["--labels", "labels.png"]
    else:
        broken = rng.choice([one for one in files if one != "camera.json"])
        files[broken] = _changed(rng, broken, good[broken])
    return Case("match_file", ["solve", name, *arguments, "--json"], files)


def _changed(rng: Random, name: str, data: bytes) -> bytes:
    if name.endswith(".txt"):
        return changed(rng, data, change_text, change_text, change_encoding, change_bytes)
    if name.endswith(".db") and rng.random() < 0.6:
        return _changed_tables(rng, data)
    return changed(rng, data, change_bytes)


def _changed_tables(rng: Random, data: bytes) -> bytes:
    """A database with other values in a table, which SQLite allows of any type."""
    table, column = rng.choice(
        (
            ("images", "name"),
            ("images", "camera_id"),
            ("keypoints", "rows"),
            ("keypoints", "cols"),
            ("keypoints", "data"),
            ("two_view_geometries", "pair_id"),
            ("two_view_geometries", "rows"),
            ("two_view_geometries", "data"),
            ("two_view_geometries", "config"),
            ("cameras", "model"),
            ("cameras", "width"),
            ("cameras", "params"),
        )
    )
    value = rng.choice((None, 0, -1, 2**62, 1e300, "", rng.choice(ODD_TEXTS), b"", b"\xff" * 16, b"\0" * 64))
    with TemporaryDirectory() as folder:
        path = Path(folder, "d.db")
        path.write_bytes(data)
        with closing(sqlite3.connect(path)) as database, suppress(sqlite3.Error, UnicodeError, OverflowError):
            way = rng.randrange(4)
            if way == 0:
                database.execute(f"ALTER TABLE {table} RENAME COLUMN {column} TO other")
            elif way == 1:
                database.execute(f"DELETE FROM {table}")
            else:
                database.execute(f"UPDATE {table} SET {column} = ?", (value,))
            database.commit()
        return path.read_bytes()
