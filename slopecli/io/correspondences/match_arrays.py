"""Correspondences from NumPy: an array of a row each, or an archive with the points of both images by name.

Names are those in use: of SuperGlue's demo, of kornia and LoFTR, of OpenCV's and scikit-image's examples. Points have
pixel centres at integers, as all of these have.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slopecli.io.correspondences.match_source import MatchSource, Names, checked_rows, taken
from slopecli.io.files import MOST_BYTES
from slopecli.io.numpy_files import array_of, member_of, members_of
from slopecli.patches.given import Given
from slopecli.types import FloatArray, IntArray

# points of images 1 and 2, row k matched with row k; the first pair of names that is there is read
MATCHED = (
    ("mkpts0", "mkpts1"),
    ("mkpts1", "mkpts2"),
    ("xy1", "xy2"),
    ("uv1", "uv2"),
    ("pts1", "pts2"),
    ("pts0", "pts1"),
    ("points1", "points2"),
    ("points0", "points1"),
    ("src_pts", "dst_pts"),
    ("src", "dst"),
    ("x1", "x2"),
)
# all points that were found, which a third array matches
FOUND = (("keypoints0", "keypoints1"), ("kpts0", "kpts1"), ("keypoints1", "keypoints2"), ("kpts1", "kpts2"))
INDICES = ("matches", "matches0", "match_indices")
COLUMNS = ("x1", "y1", "x2", "y2")
WANTED = (
    "needed mkpts0 and mkpts1 (or pts1 and pts2, x1 and x2) of shape (n, 2), or keypoints0, keypoints1 and matches, "
    "or x1, y1, x2, y2"
)

Arrays = Mapping[str, NDArray[Any]]


def read_array(source: MatchSource) -> Given:
    """A .npy file: a table of the columns x1 y1 x2 y2, and patch if there is a fifth."""
    try:
        return _table(source, array_of(source.data or b""))
    except ValueError as error:
        raise source.refused(f"is {error}; save it again") from None


def read_archive(source: MatchSource) -> Given:
    """A .npz file, see `MATCHED`, `FOUND` and `COLUMNS`; patch and sigma may be there too."""
    arrays = _arrays(source)
    if all(name in arrays and arrays[name].ndim == 1 for name in COLUMNS):
        return _of_columns(source, arrays)
    if pair := _first_pair(arrays, MATCHED):
        return _of_points(source, arrays, *pair)
    if pair := _first_pair(arrays, FOUND):
        return _of_indices(source, arrays, *pair)
    if len(arrays) == 1:
        (array,) = arrays.values()
        return _table(source, array)
    found = ", ".join(repr(name[:20]) for name in list(arrays)[:6]) or "nothing"
    raise source.refused(f"has no points under a known name (found {found}); {WANTED}")


def _first_pair(arrays: Arrays, names: tuple[Names, ...]) -> Names | None:
    return next((pair for pair in names if pair[0] in arrays and pair[1] in arrays), None)


def _of_columns(source: MatchSource, arrays: Arrays) -> Given:
    columns = [_numbers(source, arrays[name], name) for name in COLUMNS]
    if len({len(column) for column in columns}) > 1:
        raise source.refused(f"its x1, y1, x2, y2 have {', '.join(str(len(column)) for column in columns)} numbers")
    table = np.column_stack(columns)
    return _with_columns(source, arrays, table[:, :2], table[:, 2:])


def _of_points(source: MatchSource, arrays: Arrays, first: str, second: str) -> Given:
    """Points of both images, row k matched with row k."""
    xy1, xy2 = (_points(source, arrays[name], name) for name in (first, second))
    if len(xy1) != len(xy2):
        counts = f"has {len(xy1)} points in {first} and {len(xy2)} in {second}"
        raise source.refused(f"{counts}; needed a row a match")
    return _with_columns(source, arrays, xy1, xy2)


def _of_indices(source: MatchSource, arrays: Arrays, first: str, second: str) -> Given:
    """All points of both images and which match which: a partner for each in image 1 (-1: none), or rows of two."""
    name = next((name for name in INDICES if name in arrays), None)
    if name is None:
        raise source.refused(f"{first} and {second} are all points found, and nothing says which match; {WANTED}")
    all1, all2 = (_points(source, arrays[points], points) for points in (first, second))
    index1, index2 = indices_of(source, arrays[name], name, len(all1))
    return checked_rows(source, taken(source, all1, index1, first), taken(source, all2, index2, second), pixels=True)


def indices_of(source: MatchSource, array: NDArray[Any], name: str, count: int) -> tuple[IntArray, IntArray]:
    """Indices of the points of image 1 and of image 2, (m,) each, out of either way to write matches.

    count : points of image 1, each of which has its partner, or -1, where the array has one dimension.
    """
    partner = array[0] if array.ndim == 2 and array.shape[0] == 1 and array.shape[1] == count else array
    if partner.dtype.kind not in "iu":
        raise source.refused(f"{name[:20]} has no whole numbers ({partner.dtype}), needed indices of keypoints")
    partner = partner.astype(np.int64)
    if partner.ndim == 2 and partner.shape[1] == 2:
        return partner[:, 0], partner[:, 1]
    if partner.ndim != 1:
        raise source.refused(f"{name[:20]} has the shape {array.shape}, needed (n,) or (m, 2) indices")
    if len(partner) != count:
        raise source.refused(f"{name[:20]} has {len(partner)} entries for {count} keypoints; they are of two runs")
    matched = np.flatnonzero(partner >= 0)
    return matched, partner[matched]


def _with_columns(source: MatchSource, arrays: Arrays, xy1: FloatArray, xy2: FloatArray) -> Given:
    """The points with patch and sigma, where the archive has these."""
    columns: dict[str, FloatArray] = {}
    for name in ("patch", "sigma"):
        if name in arrays:
            columns[name] = _numbers(source, arrays[name], name)
            if columns[name].shape != (len(xy1),):
                raise source.refused(f"{name} has the shape {arrays[name].shape}, needed ({len(xy1)},): one a match")
    patch = _patches(source, columns["patch"]) if "patch" in columns else None
    return checked_rows(source, xy1, xy2, patch, columns.get("sigma"))


def _table(source: MatchSource, array: NDArray[Any]) -> Given:
    if array.ndim != 2 or array.shape[1] not in (4, 5):
        raise source.refused(f"its array has the shape {array.shape}, needed (n, 4): x1 y1 x2 y2, or (n, 5) with patch")
    values = _numbers(source, array, "its array")
    patch = _patches(source, values[:, 4]) if values.shape[1] == 5 else None
    return checked_rows(source, values[:, :2], values[:, 2:4], patch)


def _patches(source: MatchSource, values: FloatArray) -> IntArray:
    good = (values == np.floor(values)) & (values >= -1) & (values < 2**31)
    if not good.all():
        found = f"{values[~good][0]:g}"
        raise source.refused(f"patch is {found}, needed the number of a plane, 0 or more, or -1 for none")
    return values.astype(np.int64)


def _points(source: MatchSource, array: NDArray[Any], name: str) -> FloatArray:
    """(n, 2) points, also out of OpenCV's (n, 1, 2) and the (1, n, 2) of a batch of one."""
    values = _numbers(source, array, name)
    if values.ndim == 3 and 1 in values.shape[:2]:
        values = values.reshape(-1, values.shape[2])
    if values.ndim != 2 or values.shape[1] != 2:
        raise source.refused(f"{name} has the shape {array.shape}, needed (n, 2): a point in a row")
    return values


def _numbers(source: MatchSource, array: NDArray[Any], name: str) -> FloatArray:
    if array.dtype.kind not in "iuf":
        raise source.refused(f"{name} has no numbers ({str(array.dtype)[:20]}), needed real ones")
    return np.asarray(array, np.float64)


def _arrays(source: MatchSource) -> dict[str, NDArray[Any]]:
    """The arrays of an archive whose names are known, and of others the first."""
    known = {*COLUMNS, *INDICES, "patch", "sigma", *(name for pair in (*MATCHED, *FOUND) for name in pair)}
    arrays: dict[str, NDArray[Any]] = {}
    data = source.data or b""
    try:
        parts = members_of(data)
    except ValueError as error:
        raise source.refused(f"is {error}; save it again") from None
    for name, part in parts.items():
        if name in known or len(parts) == 1:
            try:
                arrays[name] = member_of(data, part, MOST_BYTES)
            except ValueError as error:
                raise source.refused(f"its {name[:20]!r} is {error}; save it again") from None
        else:
            arrays.setdefault(name, np.empty(0))
    return arrays
