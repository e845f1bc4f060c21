"""Camera files with several cameras, in a batch: every image has the camera of its name."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from contextlib import suppress
from itertools import islice

from slopecli.errors import InputError
from slopecli.io.cameras.picking import of_image
from slopecli.io.cameras.reading import camera_names, decode_camera, read_camera_file, split_name
from slopecli.io.images import load_image
from slopecli.options import CameraChoice


class NamedCameras:
    """Picks the cameras of images by their names; every camera file is read once."""

    def __init__(self) -> None:
        self._names: dict[str, tuple[str, ...]] = {}  # of the cameras of every file
        self._images: dict[str, list[str]] = {}  # whose camera was picked, by file

    def pick(self, choice: CameraChoice, image: str) -> CameraChoice:
        """The choice with #NAME, where the file holds several cameras and the path of the image fits one.

        Raises
        ------
        InputError : several fit equally well.
        """
        file = choice.file
        if file is None or split_name(file)[1] is not None:
            return choice
        if file not in self._names:
            self._names[file] = ()
            with suppress(InputError):  # said where the file is checked
                self._names[file] = camera_names(read_camera_file(file), file)
        names = self._names[file]
        try:
            name = of_image(names, os.path.abspath(image)) if len(names) > 1 else None
        except InputError as error:
            raise InputError(f"{file}: {error}") from None
        if name is None:
            return choice
        self._images.setdefault(file, []).append(image)
        return CameraChoice(file=f"{file}#{name}")

    def check(self, file: str, images: Iterable[str]) -> str:
        """Try a camera file that many pairs share, and return what the user should know of how it is read.

        A file without an image size may be valid for some sizes only, so it is tried with those of up to three images.

        Raises
        ------
        InputError : it cannot be read.
        """
        path, name = split_name(file)
        data = read_camera_file(path)
        if file in self._images:
            images = self._images[file]
            several = f"of its {len(self._names[file])} cameras, each image has that of its name"
        else:
            several = ""
        problem = None
        for image, size in [("", None), *islice(_sizes_of(images), 3)]:
            try:
                camera = decode_camera(data, path, name, size, image or None)
                return several or camera.note
            except InputError as error:
                problem = error
        raise problem or InputError(f"{file}: cannot be read")


def _sizes_of(images: Iterable[str]) -> Iterator[tuple[str, tuple[int, int]]]:
    """Paths and sizes of those images that can be read."""
    for path in images:
        with suppress(InputError):
            image = load_image(path)
            yield path, (image.width, image.height)
