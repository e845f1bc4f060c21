"""Matches of a pair of images in HDF5 files: those of hloc, and of two columns of indices a pair.

hloc writes keypoints to one file, a group an image, and matches to another, a group a pair, whose name has the names of
both images, with - for every /. Keypoints have pixel centres at integers. Others (deep-image-matching, notebooks around
LightGlue) have the keypoints of an image, and the indices of a pair, as one array each.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slopecli.errors import InputError
from slopecli.io.correspondences.match_arrays import indices_of
from slopecli.io.correspondences.match_source import (
    LIMITS,
    MatchSource,
    Names,
    checked_rows,
    chosen_pair,
    regular_file,
    taken,
)
from slopecli.io.files import MOST_BYTES
from slopecli.patches.given import Given

HALF = (
    "its keypoints have 16 bits each, which rounds them to half a pixel and more; write them with as_half=False for "
    "better slopes"
)
FEATURES = "give the file with the keypoints as --keypoints features.h5"


def read(source: MatchSource) -> Given:
    """The matches of the pair of images that is wanted, or of the only one, with the points of `source.keypoints`."""
    if source.keypoints is None:
        raise source.refused(f"has indices of keypoints and not the points; {FEATURES}")
    regular_file(source.keypoints, "the file with the keypoints")
    features = replace(source, path=source.keypoints)
    with _opened(features) as points, _opened(source) as matches:
        arrays = _keypoint_arrays(points)
        if not arrays:
            raise features.refused(f"has no keypoints of images; {FEATURES}")
        pairs = _pairs(source, matches, arrays)
        (first, second), turned = chosen_pair(source, pairs, lambda array: _count(source, array))
        all1, all2 = _loaded(features, arrays[first], first), _loaded(features, arrays[second], second)
        found = _loaded(source, pairs[first, second], f"the pair {first!r}")
    for name, array in ((first, all1), (second, all2)):
        if array.ndim != 2 or array.shape[1] < 2 or array.dtype.kind != "f":
            raise features.refused(
                f"the keypoints of {name[: LIMITS.shown]} have the shape {array.shape}, needed (n, 2) numbers"
            )
    index1, index2 = indices_of(source, found, "its matches", len(all1))
    xy1 = taken(source, all1[:, :2].astype(np.float64), index1, first)
    xy2 = taken(source, all2[:, :2].astype(np.float64), index2, second)
    names = (first, second)
    if turned:
        xy1, xy2, names = xy2, xy1, (second, first)
    note = HALF if all1.dtype.itemsize == 2 else ""
    return checked_rows(source, xy1, xy2, names=names, pixels=True, note=note)


@contextmanager
def _opened(source: MatchSource) -> Iterator[Any]:
    """The root of an HDF5 file. Raises InputError without h5py, or where the file is damaged."""
    try:
        import h5py
    except ImportError:
        raise source.refused("is an HDF5 file, which needs h5py; run pip install 'slopemap[h5]'") from None
    try:
        with h5py.File(source.path, "r", locking=False) as file:
            yield file
    except InputError:
        raise
    except Exception as error:  # h5py raises many kinds of exceptions on damaged files
        reason = " ".join(str(error).split())[:80]
        raise source.refused(f"is no HDF5 file, or a damaged one ({reason}); write it again") from None


def _members(group: Any) -> Iterator[tuple[str, Any]]:
    """Names and objects in a group; links to other places and files are not followed."""
    import h5py

    for name in group:
        if isinstance(group.get(name, getlink=True), h5py.HardLink):
            yield name, group[name]


def _is_array(member: Any) -> bool:
    return hasattr(member, "shape") and hasattr(member, "dtype")


def _keypoint_arrays(root: Any, before: str = "", depth: int = 0) -> dict[str, Any]:
    """The array with the keypoints of every image, by its name, in which every / is a group."""
    found: dict[str, Any] = {}
    for name, member in _members(root) if depth < 10 else ():
        path = f"{before}{name}"
        if _is_array(member):
            if name == "keypoints" and before:
                found[before.removesuffix("/")] = member
            elif len(member.shape) == 2 and not before:
                found[path] = member
        else:
            found |= _keypoint_arrays(member, f"{path}/", depth + 1)
    return found


def _pairs(source: MatchSource, root: Any, images: Mapping[str, Any]) -> dict[Names, Any]:
    """The array with the matches of every pair, by the names of its images."""
    by_key = {name.replace("/", "-"): name for name in images}
    pairs: dict[Names, Any] = {}
    for key, group in _members(root):
        for names, member in _of_group(key, group, by_key):
            array = dict(_members(member)).get("matches0") if not _is_array(member) else member
            if array is not None and _is_array(array) and array.shape:
                pairs[names] = array
    if not pairs:
        raise source.refused(
            f"has no matches of images whose keypoints are in {source.keypoints}; are both of one run?"
        )
    return pairs


def _count(source: MatchSource, array: Any) -> int:
    """Number of matches of a pair."""
    found = _loaded(source, array, "a pair")
    return len(found) if found.ndim == 2 else int((found >= 0).sum())


def _of_group(key: str, group: Any, by_key: Mapping[str, str]) -> Iterator[tuple[Names, Any]]:
    """Pairs of a group of the first image's name, or the one of a group of both names (hloc before 1.2)."""
    if key in by_key and not _is_array(group):
        yield from (((by_key[key], by_key[other]), member) for other, member in _members(group) if other in by_key)
        return
    for place in (place for place, letter in enumerate(key) if letter == "_"):
        if key[:place] in by_key and key[place + 1 :] in by_key:
            yield (by_key[key[:place]], by_key[key[place + 1 :]]), group


def _loaded(source: MatchSource, array: Any, whose: str) -> NDArray[Any]:
    """The numbers of an array that lie in the file itself."""
    if array.external or array.is_virtual or math.prod(array.shape) * array.dtype.itemsize > MOST_BYTES:
        raise source.refused(
            f"{whose[: LIMITS.shown]} lies in other files, or is larger than {MOST_BYTES / 1e6:.0f} MB"
        )
    return np.asarray(array[()])
