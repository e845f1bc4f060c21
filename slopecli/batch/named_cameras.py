"""Camera files with several cameras, in a batch: every image has the camera of its name."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import suppress
from itertools import islice

from slopecli.errors import InputError
from slopecli.io.cameras.reading import CamerasHeld, beside, decode_camera, read_camera_file, split_name
from slopecli.io.images import load_image
from slopecli.options import CameraChoice


class NamedCameras:
    """Picks the cameras of images by their names; every camera file is read once."""

    def __init__(self) -> None:
        self._files: dict[str, CamerasHeld | None] = {}  # None for one that cannot be read
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
        if file not in self._files:
            self._files[file] = None
            with suppress(InputError):  # said where the file is checked
                self._files[file] = CamerasHeld(read_camera_file(file), file, beside(file))
        held = self._files[file]
        name = held.of_image(image) if held and len(held.cameras) > 1 else None
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
        if file in self._images and (held := self._files[file]):
            images = self._images[file]
            several = f"of its {len(held.cameras)} cameras, each image has that of its name"
        else:
            several = ""
        problem = None
        for image, size in [("", None), *islice(_sizes_of(images), 3)]:
            try:
                camera = decode_camera(data, path, name, size, image or None, beside(path))
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
