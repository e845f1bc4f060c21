"""What a reader of correspondences gets and gives: the file with the pair that is wanted of it, and checked rows."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TypeVar

import numpy as np

from slopecli.errors import InputError
from slopecli.io.files import readable
from slopecli.patches.given import Given
from slopecli.types import Camera, FloatArray, IntArray


@dataclass(frozen=True)
class MatchLimits:
    """Limits of files of correspondences."""

    shown: int = 40  # characters of a bad cell or name in a message
    largest: float = 1e9  # coordinate: wider than any image, px or mrad
    sigmas: tuple[float, float] = (1e-6, 1e6)  # px or mrad


LIMITS = MatchLimits()

Names = tuple[str, str]
Found = TypeVar("Found")


@dataclass(frozen=True, eq=False)
class MatchSource:
    """A file of correspondences.

    path : as the user gives it, "-" for stdin.  data : its bytes; None where the reader opens the file itself.
    names : of images 1 and 2 in it, None where the user names none.  keypoints : path of a second file with them.
    """

    path: str
    data: bytes | None = None
    names: Names | None = None
    keypoints: str | None = None

    def refused(self, why: str) -> InputError:
        """The error that says why this file is of no use."""
        return InputError(f"{self.path}: {why}")

    @cached_property
    def sha256(self) -> str:
        """Of the whole file, read in parts where it is large."""
        if self.data is not None:
            return hashlib.sha256(self.data).hexdigest()
        with readable(self.path), open(self.path, "rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()


def checked_rows(
    source: MatchSource,
    xy1: FloatArray,
    xy2: FloatArray,
    patch: IntArray | None = None,
    sigma: FloatArray | None = None,
    *,
    names: Names | None = None,
    cameras: tuple[Camera, Camera] | None = None,
    pixels: bool = False,
    note: str = "",
) -> Given:
    """The correspondences (n, 2) of a file that is no table; patch (n,) None: all on plane 1, and nothing said of it.

    names : of the two images.  cameras : those that the file has.  pixels : whether the format has no rays.

    Raises
    ------
    InputError : there is none, a number is not finite or beyond `LIMITS.largest`, or a sigma is not a sigma.
    """
    if not len(xy1):
        raise source.refused("has no correspondences in it; needed at least five")
    table = np.column_stack([xy1, xy2])
    bad = np.flatnonzero(~(np.abs(table) <= LIMITS.largest).all(axis=1))
    if len(bad):
        values = ", ".join(f"{value:g}" for value in table[bad[0]])
        raise source.refused(
            f"correspondence {bad[0] + 1} is ({values}), needed finite numbers up to {LIMITS.largest:g}; leave it out"
        )
    if sigma is not None and not ((sigma >= LIMITS.sigmas[0]) & (sigma <= LIMITS.sigmas[1])).all():
        raise source.refused(f"a sigma is not from {LIMITS.sigmas[0]:g} to {LIMITS.sigmas[1]:g}; correct it")
    return Given(
        np.ascontiguousarray(table[:, :2]),
        np.ascontiguousarray(table[:, 2:]),
        np.ones(len(table), np.int64) if patch is None else patch,
        sigma,
        source.path,
        source.sha256,
        has_patch=patch is not None,
        names=names,
        cameras=cameras,
        pixels=pixels,
        note=note,
    )


def chosen_pair(source: MatchSource, pairs: Mapping[Names, Found], count: Callable[[Found], int]) -> tuple[Names, bool]:
    """Names under which the wanted pair stands in a file, and whether image 1 stands second there.

    pairs : what the file has of a pair, by the names of two images.  count : the number of matches of that.

    Raises
    ------
    InputError : it is not among them, or there are several and none is named; the message lists them.
    """
    if source.names is None:
        if len(pairs) == 1:
            return next(iter(pairs)), False
        some = f"{len(pairs)} pairs" if pairs else "no pair"
        raise source.refused(
            f"holds {some} of images with matches{_listed(pairs, count)}; choose one with --pair NAME1 NAME2"
        )
    first, second = source.names
    for names, turned in (((first, second), False), ((second, first), True)):
        if names in pairs:
            return names, turned
    wanted = " and ".join(repr(name[: LIMITS.shown]) for name in source.names)
    raise source.refused(f"has no matches of {wanted}{_listed(pairs, count)}; --pair takes the names that it has")


def _listed(pairs: Mapping[Names, Found], count: Callable[[Found], int]) -> str:
    """The pairs with the most matches, for a message."""
    counts = {names: count(found) for names, found in pairs.items()}
    most = sorted(counts.items(), key=lambda row: (-row[1], row[0]))[:6]
    listed = ", ".join(f"{first} {second} ({number} matches)" for (first, second), number in most)
    more = f", and {len(pairs) - len(most)} more" if len(pairs) > len(most) else ""
    return f": {listed}{more}" if pairs else ""


def regular_file(path: str, what: str) -> None:
    """Raise InputError unless a path leads to a regular file, which other programs' libraries may then open."""
    with readable(path):
        if not Path(path).is_file():
            missing = "is a folder" if Path(path).is_dir() else "no such file"
            raise InputError(f"{path}: {missing}, needed {what}; check the path")


def taken(source: MatchSource, points: FloatArray, which: IntArray, whose: str) -> FloatArray:
    """(n, 2) the points of these indices. InputError where there are no such points: they belong to other matches."""
    if len(which) and not 0 <= which.min() <= which.max() < len(points):
        raise source.refused(
            f"a match names keypoint {which.max()} of {whose[: LIMITS.shown]}, which has {len(points)}; "
            "the keypoints are of another run than the matches"
        )
    return points[which]
