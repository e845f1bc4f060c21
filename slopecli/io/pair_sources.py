"""The inputs of a batch: images, sub-folders and camera files of a folder, and lists of pairs."""

from __future__ import annotations

import fnmatch
import os
import re
from pathlib import Path
from typing import NamedTuple

from slopecli.errors import InputError
from slopecli.io.cameras.formats import CAMERA_FORMATS
from slopecli.io.files import csv_rows, read_file
from slopecli.io.images import RAW_SUFFIXES

IMAGE_SUFFIXES = frozenset(
    (".png", ".jpg", ".jpeg", ".jpe", ".jp2", ".tif", ".tiff", ".bmp", ".dib", ".webp", ".pbm", ".pgm", ".ppm", ".pnm")
)
UNREAD_SUFFIXES = RAW_SUFFIXES | {".heic", ".heif", ".avif", ".mp4", ".mov", ".avi", ".mkv"}
CAMERA_SUFFIXES = frozenset(
    (".json", ".yaml", ".yml", ".xml", ".txt", ".bin", ".npz", ".npy", ".cam", ".sfm", ".mat", ".m")
)
# Stems of camera files, lower case; the second is used if none matches the first.
CAMERA_STEMS = (
    re.compile("|".join("|".join(form.stems.split()) for form in CAMERA_FORMATS if form.stems)),
    re.compile(r".*(camera|calib|intrinsic|camchain).*"),
)
LIST_COLUMNS = ("image1", "image2", "camera1", "camera2")


class PairRow(NamedTuple):
    """A row of a list of pairs; a camera is "" if none is given. line : in the file, from 1."""

    line: int
    image1: str
    image2: str
    camera1: str = ""
    camera2: str = ""


def natural_key(name: str) -> tuple[list[str | int], str]:
    """Sort key of natural order, ignoring case: img2 before img10."""
    parts: list[str | int] = list(re.split(r"([0-9]+)", name.casefold()))
    parts[1::2] = map(int, parts[1::2])
    return parts, name


def images_in(folder: str, pattern: str = "") -> list[str]:
    """Names in a folder that have the suffix of an image, in natural order, without hidden ones.

    The content is not checked: a folder named view.jpg is listed, and reading it will fail with a message.

    Parameters
    ----------
    pattern : of the names wanted, as in a shell ("left_*.png"); "" for all.

    Raises
    ------
    InputError : the folder cannot be read, or no name of its images fits the pattern.
    """
    names = [name for name in _entries(folder) if Path(name).suffix.lower() in IMAGE_SUFFIXES]
    fitting = [name for name in names if not pattern or fnmatch.fnmatch(name, pattern)]
    if names and not fitting:
        raise InputError(f"{folder}: none of its {len(names)} images is called {pattern}; check --glob")
    return fitting


def folders_in(folder: str) -> list[str]:
    """Names of the sub-folders of a folder in natural order, without hidden ones; raises InputError as `images_in`."""
    return [name for name in _entries(folder) if os.path.isdir(os.path.join(folder, name))]


def cameras_in(folder: str) -> list[str]:
    """Names of the files of a folder that have the name of a camera file; none if it cannot be read."""
    files = _camera_like(folder)
    for stems in CAMERA_STEMS:
        found = [name for name in files if stems.fullmatch(Path(name).stem.lower())]
        if found:
            # COLMAP writes the same cameras to a .txt and a .bin
            return [name for name in found if not (name.endswith(".bin") and f"{name[:-4]}.txt" in found)]
    return []


def cameras_by_number(folder: str) -> tuple[str | None, str | None]:
    """Names of the files camera1.* and camera2.* of a folder; None for one that is missing or not unique."""
    files = _camera_like(folder)
    first, second = (
        [name for name in files if re.fullmatch(rf"camera[-_]?{number}", Path(name).stem.lower())] for number in "12"
    )
    return first[0] if len(first) == 1 else None, second[0] if len(second) == 1 else None


def _camera_like(folder: str) -> list[str]:
    try:
        names = [name for name in _entries(folder) if Path(name).suffix.lower() in CAMERA_SUFFIXES]
    except InputError:
        return []
    return [name for name in names if os.path.isfile(os.path.join(folder, name))]


def why_no_images(folder: str) -> str:
    """The end of a message about a folder without images: what it holds, and what to do."""
    names = _entries(folder)
    unread = [name for name in names if Path(name).suffix.lower() in UNREAD_SUFFIXES]
    if unread:
        return f"it holds {unread[0]} and the like, which is not read; convert it to PNG, JPEG or TIFF first"
    if any(os.path.isdir(os.path.join(folder, name)) for name in names):
        return "it holds folders; give one of them, or --pairing folders if each holds a pair"
    return "needed PNG, JPEG, TIFF, BMP, WebP or PNM files"


def read_pair_list(file: str) -> list[PairRow]:
    """Rows of a list of pairs: two images, and one or two cameras if need be.

    Columns are image1, image2, camera1, camera2, in this order or in that of a header; other columns of a header are
    ignored. They are separated by commas, or by semicolons or tabs if the first line has no comma.

    Raises
    ------
    InputError : the file cannot be read or is not such a table; the message names the line.
    """
    try:
        data = read_file(file, "list of pairs", 64_000_000, pipe=True)
    except InputError as error:
        raise InputError(f"{error}; its path is not taken to be below the folder of images") from None
    numbered = list(csv_rows(file, data, "needed two images a row", ",;\t"))
    columns = _header(numbered[0][1]) if numbered else None
    try:
        return [_row(line, cells, columns) for line, cells in numbered[columns is not None :]]
    except InputError as error:
        raise InputError(f"{file}: {error}") from None


def _header(cells: list[str]) -> dict[str, int] | None:
    """Indices of the columns, if these are the cells of a header."""
    titles = [cell.lower() for cell in cells]
    columns = {name: titles.index(name) for name in LIST_COLUMNS if name in titles}
    return columns if {"image1", "image2"} <= set(columns) else None


def _row(line: int, cells: list[str], columns: dict[str, int] | None) -> PairRow:
    if columns is None and len(cells) > len(LIST_COLUMNS):
        wanted = ", ".join(LIST_COLUMNS)
        raise InputError(f"line {line} has {len(cells)} cells, needed at most {wanted}, or a header that names these")
    places = columns or dict(zip(LIST_COLUMNS, range(len(cells)), strict=False))
    found = {name: cells[place] for name, place in places.items() if place < len(cells)}
    if not (found.get("image1") and found.get("image2")):
        raise InputError(f"line {line} names one image, needed two, for example: frame_1.png,frame_2.png")
    return PairRow(line, **found)


def _entries(folder: str) -> list[str]:
    try:
        names = os.listdir(folder)
    except NotADirectoryError:
        raise InputError(f"{folder}: is a file, needed a folder of images") from None
    except FileNotFoundError:
        raise InputError(f"{folder}: no such folder; check the path") from None
    except OSError as error:
        raise InputError(f"{folder}: cannot be read ({error.strerror}); check its permissions") from None
    shown = (name for name in names if not name.startswith(".") and name != "__pycache__")
    return sorted(shown, key=natural_key)
