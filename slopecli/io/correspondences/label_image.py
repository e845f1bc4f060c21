"""Read an image of labels: the number of the plane of every pixel of image 1, as labels.png has it."""

from __future__ import annotations

from os import PathLike

import numpy as np

from slopecli.errors import InputError
from slopecli.io.decoding import decode_pixels
from slopecli.io.image_headers import read_header
from slopecli.io.images import read_image_file
from slopecli.types import IntArray


def read_label_image(path: str | PathLike[str], size: tuple[int, int] | None = None) -> IntArray:
    """(h, w) whole numbers of one channel as stored, 0 for no plane.

    size : width and height of image 1, which it must have; None where that is not known.

    Raises
    ------
    InputError : it is no image, not of one channel of whole numbers, or of another size.
    """
    data = read_image_file(path)
    try:
        pixels = decode_pixels(data, read_header(data))
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    if pixels.ndim != 2 or pixels.dtype.kind not in "iu":
        channels = pixels.shape[2] if pixels.ndim == 3 else 1
        found = f"has {channels} channel{'s' if channels > 1 else ''} of {pixels.dtype}"
        raise InputError(f"{path}: {found}, needed one of whole numbers: the plane of every pixel, as labels.png")
    if size is not None and pixels.shape[::-1] != size:
        found = "x".join(map(str, pixels.shape[::-1]))
        raise InputError(
            f"{path}: is {found} px, and image 1 of the camera is {size[0]}x{size[1]}; give labels of image 1"
        )
    return pixels.astype(np.int64)
