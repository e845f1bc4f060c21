"""Which cameras the images of a batch have: named on the command line, in the list of pairs, or found beside them."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from contextlib import suppress
from itertools import islice

from slopecli.batch.jobs import CameraChoice
from slopecli.errors import InputError

Cameras = tuple[CameraChoice, CameraChoice]

NO_CAMERA = (
    "no camera; give --camera FILE, --intrinsics FX,FY,CX,CY or --fov DEG, or put a camera.json beside the images"
)
SIZES_TRIED = 3  # images whose sizes a camera file that gives none is tried with


class CameraSearch:
    """Cameras of images that none was given for; keeps what it has seen, as folders hold many images.

    Parameters
    ----------
    folder : the batch's, looked into where an image's own folder holds no camera.
    """

    def __init__(self, folder: str) -> None:
        self.folder = folder
        self._names: dict[str, list[str]] = {}
        self._uses: dict[str, None] = {}

    def cameras_of(self, image1: str, image2: str) -> Cameras:
        """The camera file in each image's folder, else in the batch's.

        Raises
        ------
        InputError : there is none, or more than one and no telling which.
        """
        first, second = self._file_for(image1), self._file_for(image2)
        return self._used(first), self._used(second)

    def numbered_cameras(self, folder: str) -> Cameras | None:
        """Of a folder that is one pair: its camera1 and camera2, if it has both."""
        from slopecli.io.pair_sources import cameras_by_number

        first, second = cameras_by_number(folder)
        if not (first and second):
            return None
        return self._used(os.path.join(folder, first)), self._used(os.path.join(folder, second))

    def _file_for(self, image: str) -> str:
        for folder in (os.path.dirname(image), self.folder):
            names = self._names_in(folder)
            if len(names) > 1:
                several = " and ".join(names)
                raise InputError(f"{folder or os.curdir} holds {several}; say which is the camera with --camera FILE")
            if names:
                return os.path.join(folder, names[0])
        raise InputError(NO_CAMERA)

    def _names_in(self, folder: str) -> list[str]:
        from slopecli.io.pair_sources import cameras_in

        if folder not in self._names:
            self._names[folder] = cameras_in(folder or os.curdir)
        return self._names[folder]

    def _used(self, file: str) -> CameraChoice:
        self._uses[file] = None
        return CameraChoice(file=file)

    def shared_files(self) -> list[str]:
        """What was found in the batch's own folder."""
        return [file for file in self._uses if os.path.dirname(file) == self.folder]

    def notes(self) -> list[str]:
        """What was found, for the user: a line a file, or one for all where they are many."""
        files = list(self._uses)
        if len(files) > 3:
            return [f"camera: {len(files)} files found beside the images, {files[0]} to {files[-1]}"]
        return [f"camera: {file}, found beside the images" for file in files]


def check_camera_file(file: str, images: Iterable[str]) -> None:
    """Raise InputError if a camera file that many pairs share cannot be read, before the first of them is tried.

    A file that gives no image size may be right for one size only, so it is tried with those of a few images.
    """
    from slopecli.io.cameras.reading import load_camera

    try:
        load_camera(file)
        return
    except InputError as error:
        complaint = error
    for size in islice(_sizes_of(images), SIZES_TRIED):
        try:
            load_camera(file, size=size)
            return
        except InputError as error:
            complaint = error
    raise complaint


def _sizes_of(images: Iterable[str]) -> Iterator[tuple[int, int]]:
    """Sizes of the images that can be read."""
    from slopecli.io.images import load_image

    for path in images:
        with suppress(InputError):
            image = load_image(path)
            yield image.width, image.height
