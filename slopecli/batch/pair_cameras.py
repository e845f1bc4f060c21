"""Find the camera files of a batch beside its images, and check a camera file that many pairs share."""

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


class CameraSearch:
    """Search for the cameras of images for which the user gave none; every folder is listed once.

    Parameters
    ----------
    folder : of the batch, searched if the folder of an image has no camera file.
    """

    def __init__(self, folder: str) -> None:
        self.folder = folder
        self._names: dict[str, list[str]] = {}
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
        """Files that were found in the folder of the batch."""
        return [file for file in self._uses if os.path.dirname(file) == self.folder]

    def notes(self) -> list[str]:
        """Messages about the files found: a line for each, or one line for more than three."""
        files = list(self._uses)
        if len(files) > 3:
            return [f"camera: {len(files)} files found beside the images, {files[0]} to {files[-1]}"]
        return [f"camera: {file}, found beside the images" for file in files]


def check_camera_file(file: str, images: Iterable[str]) -> None:
    """Raise InputError if a camera file that many pairs share cannot be read.

    A file without an image size may be valid for some sizes only, so it is tried with those of up to three images.
    """
    from slopecli.io.cameras.reading import load_camera

    try:
        load_camera(file)
        return
    except InputError as error:
        problem = error
    for size in islice(_sizes_of(images), 3):
        try:
            load_camera(file, size=size)
            return
        except InputError as error:
            problem = error
    raise problem


def _sizes_of(images: Iterable[str]) -> Iterator[tuple[int, int]]:
    """Sizes of those images that can be read."""
    from slopecli.io.images import load_image

    for path in images:
        with suppress(InputError):
            image = load_image(path)
            yield image.width, image.height
