"""Find the pairs of images in a folder or a list, with their folder names and the camera files beside them."""

from __future__ import annotations

import hashlib
import os
import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path, PurePath
from typing import NamedTuple

from slopecli.batch.jobs import Pair
from slopecli.batch.named_cameras import NamedCameras
from slopecli.batch.summary import FILES
from slopecli.errors import InputError
from slopecli.io.pair_sources import cameras_by_number, cameras_in, folders_in, images_in, read_pair_list, why_no_images
from slopecli.options import CameraChoice

Cameras = tuple[CameraChoice, CameraChoice]

MAX_NAME_BYTES = 120  # half the limit of file systems
UNSAFE = re.compile(r'[\x00-\x1f\x7f\ud800-\udfff/\\:*?"<>|]+')
TAKEN_NAMES = (*FILES, "con", "prn", "aux", "nul")  # files beside the folders of the pairs, names reserved by Windows
NO_CAMERA = (
    "no camera; give --camera FILE, --intrinsics FX,FY,CX,CY or --fov DEG, or put a camera.json beside the images"
)


class FoundPairs(NamedTuple):
    """pairs: in the order of the report. notes: lines for the user, such as which cameras were found."""

    pairs: list[Pair]
    notes: list[str]


@dataclass(frozen=True)
class Candidate:
    """Two images that may become a pair: `wanted` camera files of a list of pairs, "" for none; `own_folder` if any.

    frames : all images of a folder that is a sequence.
    """

    name: str
    image1: str
    image2: str
    wanted: tuple[str, str] = ("", "")
    own_folder: str | None = None
    problem: str | None = None
    frames: tuple[str, ...] = ()


def find_pairs(
    folder: str,
    pairing: str = "consecutive",
    *,
    stride: int = 1,
    pattern: str = "",
    cameras: Cameras | None = None,
    output: str | None = None,
) -> FoundPairs:
    """Find the pairs of images in a folder, and the cameras of each.

    Parameters
    ----------
    pairing : "consecutive": each image with the next, in natural order; "stride": each with the `stride`-th after it;
        "folders": every sub-folder is a pair, of its two images or of those named image1 and image2; "sequences":
        every sub-folder is a sequence of all its images in natural order; else the path of
        a CSV file with two images a row, relative to `folder`, and one or two cameras if need be.
    pattern : of the names of images that are taken, as in a shell; "" for all. A list of pairs is taken as it is.
    cameras : of all pairs except those that have their own in a CSV file. None: a camera file is searched beside the
        images, then in `folder`.
    output : folder of the results, excluded from the input.

    Returns
    -------
    FoundPairs; the `problem` of a pair says why it cannot be estimated.

    Raises
    ------
    InputError : no pair can be estimated, the list of pairs or a shared camera file cannot be read, or `output` is
        `folder` itself.
    """
    folder = folder.rstrip(os.sep) or folder
    if output is not None and _is_same_place(folder, output):
        raise InputError(f"{folder}: is the folder of the images, and cannot take the results too; give another -o")
    candidates, notes = _candidates(folder, pairing, stride, pattern, output)
    search, picked = CameraSearch(folder), NamedCameras()
    pairs = [_pair(*named, cameras, search, picked) for named in zip(_names(candidates), candidates, strict=True)]
    problems = list(dict.fromkeys(pair.problem for pair in pairs))
    if None not in problems:
        others = f" (and {len(problems) - 1} other reasons)" if len(problems) > 1 else ""
        raise InputError(f"{folder}: no pair can be tried: {problems[0]}{others}")
    files = {choice.file: None for choice in cameras or () if choice.file} or search.shared_files()
    read = {file: picked.check(file, (pair.image1 for pair in pairs)) for file in files}
    notes = [*notes, *search.notes(), *(f"camera: {file}: {note}" for file, note in read.items() if note)]
    return FoundPairs(pairs, notes)


# ---- which images belong together ----


def _candidates(
    folder: str, pairing: str, stride: int, pattern: str, output: str | None
) -> tuple[list[Candidate], list[str]]:
    if pairing in ("folders", "sequences"):
        return _one_per_folder(folder, pattern, output, sequences=pairing == "sequences"), []
    if pairing in ("consecutive", "stride"):
        return _along_the_folder(folder, stride, pattern, output), []
    return _listed(folder, pairing)


def _along_the_folder(folder: str, stride: int, pattern: str, output: str | None) -> list[Candidate]:
    found = images_in(folder, pattern)
    names = [name for name in found if not (output and _is_same_place(os.path.join(folder, name), output))]
    if not names:
        raise InputError(f"{folder}: holds no images; {why_no_images(folder)}")
    if len(names) <= stride:
        images = "1 image" if len(names) == 1 else f"{len(names)} images"
        called = f" called {pattern}" if pattern else ""
        raise InputError(f"{folder}: holds {images}{called}, needed at least {stride + 1}")
    return [
        Candidate(f"{PurePath(one).stem}-{PurePath(two).stem}", os.path.join(folder, one), os.path.join(folder, two))
        for one, two in zip(names, names[stride:], strict=False)
    ]


def _one_per_folder(folder: str, pattern: str, output: str | None, *, sequences: bool) -> list[Candidate]:
    each = _sequence_of_folder if sequences else _from_folder
    found = [each(name, os.path.join(folder, name), pattern) for name in folders_in(folder)]
    candidates = [one for one in found if not _holds_results(one, os.path.join(folder, one.name), output)]
    if not candidates:
        raise InputError(f"{folder}: holds no folders; needed one for each pair, or another --pairing")
    return candidates


def _holds_results(candidate: Candidate, place: str, output: str | None) -> bool:
    """Whether the output is this folder or below it. Raises InputError if it is the folder of a pair."""
    if output is None or not Path(os.path.realpath(output)).is_relative_to(os.path.realpath(place)):
        return False
    if candidate.problem is None and _is_same_place(output, place):
        raise InputError(f"{place}: holds images of a pair, and cannot take the results of all; give another -o")
    return candidate.problem is not None


def _sequence_of_folder(name: str, place: str, pattern: str) -> Candidate:
    try:
        frames = tuple(os.path.join(place, image) for image in images_in(place, pattern))
    except InputError as error:
        return Candidate(name, "", "", problem=str(error))
    if len(frames) < 2:
        return Candidate(name, "", "", problem=f"{place}: holds {len(frames)} images, a sequence needs at least two")
    return Candidate(name, frames[0], frames[-1], own_folder=place, frames=frames)


def _from_folder(name: str, place: str, pattern: str) -> Candidate:
    try:
        images = images_in(place, pattern)
    except InputError as error:
        return Candidate(name, "", "", problem=str(error))
    numbered = [image for image in images if PurePath(image).stem.lower() in ("image1", "image2")]
    chosen = images if len(images) == 2 else numbered
    if len(chosen) != 2:
        problem = f"{place}: holds {len(images)} images, needed two, or two of them named image1 and image2"
        return Candidate(name, "", "", problem=problem)
    one, two = (os.path.join(place, image) for image in chosen)
    return Candidate(name, one, two, own_folder=place)


def _listed(folder: str, file: str) -> tuple[list[Candidate], list[str]]:
    images_in(folder)  # it must be a folder
    rows = read_pair_list(file)
    if not rows:
        raise InputError(f"{file}: holds no pairs; needed two images a row, for example: frame_1.png,frame_2.png")
    first_lines: dict[tuple[str, ...], int] = {}
    candidates, notes = [], []
    for line, *cells in rows:
        first = first_lines.setdefault(tuple(cells), line)
        if first != line:
            notes.append(f"{file}: line {line} is the pair of line {first} again, and is left out")
            continue
        one, two, camera1, camera2 = (cell and os.path.join(folder, cell) for cell in cells)
        candidates.append(Candidate(f"{_short(cells[0])}-{_short(cells[1])}", one, two, (camera1, camera2)))
    return candidates, notes


def _is_same_place(one: str, other: str) -> bool:
    """Whether two paths, which need not exist, lead to the same place."""
    return os.path.realpath(one) == os.path.realpath(other)


# ---- names ----


def _short(path: str) -> str:
    """The last folder and the stem of a path: images in several folders may have the same name."""
    place = PurePath(path)
    parts = [part for part in (*place.parts[:-1], place.stem) if part not in ("..", place.anchor)]
    return "_".join(parts[-2:])


def _names(candidates: list[Candidate]) -> list[str]:
    """Folder names in the order of the candidates, unique also where case is ignored."""
    taken, names = set(TAKEN_NAMES), []
    counts: dict[str, int] = {}
    for candidate in candidates:
        plain = name = safe_name(candidate.name)
        while name.casefold() in taken:
            counts[plain] = counts.get(plain, 1) + 1
            name = f"{plain}_{counts[plain]}"
        taken.add(name.casefold())
        names.append(name)
    return names


def safe_name(text: str) -> str:
    """A valid folder name on every file system, not hidden and without separators."""
    name = UNSAFE.sub("_", text).rstrip(" .")
    name = "_" + name[1:] if name.startswith(".") else name or "pair"
    if len(name.encode()) <= MAX_NAME_BYTES:
        return name
    digest = hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()[:8]
    return f"{name.encode()[: MAX_NAME_BYTES - 9].decode(errors='ignore')}-{digest}"


# ---- cameras ----


class CameraSearch:
    """Search for the cameras of images for which the user gave none; every folder is listed once.

    The folder of the batch is searched if the folder of an image has no camera file.
    """

    def __init__(self, folder: str) -> None:
        self.folder = folder
        self._names_in = cache(cameras_in)
        self._uses: dict[str, None] = {}

    def cameras_of(self, image1: str, image2: str) -> Cameras:
        """The camera file in each image's folder, else in the batch's.

        Raises
        ------
        InputError : there is none, or more than one.
        """
        first, second = self._file_for(image1), self._file_for(image2)
        return self._used(first), self._used(second)

    def numbered_cameras(self, folder: str) -> Cameras | None:
        """The files camera1 and camera2 of a folder that holds one pair, None if it does not have both."""
        first, second = cameras_by_number(folder)
        if not (first and second):
            return None
        return self._used(os.path.join(folder, first)), self._used(os.path.join(folder, second))

    def _file_for(self, image: str) -> str:
        for folder in (os.path.dirname(image), self.folder):
            names = self._names_in(folder or os.curdir)
            if len(names) > 1:
                several = " and ".join(names)
                raise InputError(f"{folder or os.curdir} holds {several}; say which is the camera with --camera FILE")
            if names:
                return os.path.join(folder, names[0])
        raise InputError(NO_CAMERA)

    def _used(self, file: str) -> CameraChoice:
        self._uses[file] = None
        return CameraChoice(file=file)

    def shared_files(self) -> list[str]:
        """Files that were found in the folder of the batch."""
        return [file for file in self._uses if os.path.dirname(file) == self.folder]

    def notes(self) -> list[str]:
        """Messages about the files found: a line for each, or one line for more than three."""
        files = list(self._uses)
        if len(files) > 3:
            return [f"camera: {len(files)} files found beside the images, {files[0]} to {files[-1]}"]
        return [f"camera: {file}, found beside the images" for file in files]


def _pair(name: str, candidate: Candidate, given: Cameras | None, search: CameraSearch, picked: NamedCameras) -> Pair:
    images = (candidate.image1, candidate.image2)
    if candidate.problem is not None:
        return Pair(name, *images, None, None, candidate.problem)
    try:
        both = zip(_cameras(candidate, given, search), images, strict=True)
        camera1, camera2 = (picked.pick(choice, image) for choice, image in both)
        return Pair(name, *images, camera1, camera2, frames=candidate.frames)
    except InputError as error:
        return Pair(name, *images, None, None, str(error))


def _cameras(candidate: Candidate, given: Cameras | None, search: CameraSearch) -> Cameras:
    """Cameras from the list of pairs, else those given for all pairs, else those found beside the images."""
    first, second = candidate.wanted[0], candidate.wanted[1] or candidate.wanted[0]
    if first and second:
        return CameraChoice(file=first), CameraChoice(file=second)
    common = given
    if common is None and candidate.own_folder is not None:
        common = search.numbered_cameras(candidate.own_folder)
    common = common or search.cameras_of(candidate.image1, candidate.image2)
    return common[0], CameraChoice(file=second) if second else common[1]
