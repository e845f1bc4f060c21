"""An image as a Python user has it: path, array or `Image`."""

from __future__ import annotations

from os import PathLike
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from slopecli.errors import WrongArgument
from slopecli.io.images import image_from_pixels, load_image
from slopecli.types import Image

ImageLike: TypeAlias = str | PathLike[str] | NDArray[Any] | Image
WANTED = "needed a path, a NumPy array (grey, or BGR as OpenCV reads images) or an Image"


def image_from(value: ImageLike, name: str) -> Image:
    """The image that an argument gives.  name : of the argument, for messages.

    Raises
    ------
    WrongArgument : it is of another type.  InputError : the file or the array is no usable image.
    """
    if isinstance(value, Image):
        if value.grey.ndim != 2 or value.grey.dtype != np.uint8:
            found = f"{value.grey.dtype} of shape {value.grey.shape}"
            raise WrongArgument(
                f"{name}: the grey of this Image is {found}, needed (h, w) uint8; give its pixels alone"
            )
        return value
    if isinstance(value, str | PathLike):
        return load_image(value)
    if isinstance(value, np.ndarray):
        return image_from_pixels(value, name)
    raise WrongArgument(f"{name}: is of type {type(value).__name__}, {WANTED}")
