"""A camera as a Python user has it: path, `Camera`, dict, four numbers, matrix or `CameraChoice`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from os import PathLike, fspath
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from slopecli.errors import InputError, WrongArgument
from slopecli.io.cameras.native import read
from slopecli.io.cameras.reading import camera_for, camera_from_intrinsics, fit_camera_to_image
from slopecli.options import CameraChoice
from slopecli.types import Camera, Image

CameraLike: TypeAlias = str | PathLike[str] | Camera | Mapping[str, Any] | Sequence[float] | NDArray[Any] | CameraChoice
WANTED = (
    "needed a path, a Camera, a dict such as {'fx': .., 'fy': .., 'cx': .., 'cy': ..}, four numbers (fx, fy, cx, cy) "
    "or a 3x3 matrix"
)


def camera_from(value: CameraLike, image: Image, name: str) -> tuple[Camera, tuple[str, ...]]:
    """The camera that an argument gives, for the size of an image, and notes on how it was read.

    Parameters
    ----------
    image : that the camera took; a camera of the same view resized is scaled to it.  name : of the argument.

    Raises
    ------
    WrongArgument : it is of another type.  InputError : it is no camera, or not that of this image.
    """
    if isinstance(value, str | PathLike):
        return camera_for(image, CameraChoice(file=fspath(value)))
    if isinstance(value, CameraChoice):
        return camera_for(image, value)
    size = image.width, image.height
    try:
        camera = value if isinstance(value, Camera) else _camera_of_values(value, size)
        camera, message = fit_camera_to_image(camera, *size)
    except InputError as error:
        raise type(error)(f"{name}: {error}") from None
    return camera, tuple(f"{name}: {note}" for note in (message,) if note)


def _camera_of_values(value: Any, size: tuple[int, int]) -> Camera:
    """The camera of a dict in the form of a native file, of four numbers, or of a matrix."""
    if isinstance(value, Mapping):
        return read({str(key): _plain(item) for key, item in value.items()}, size)
    numbers = _plain(value)
    if not isinstance(numbers, list):
        raise WrongArgument(f"is of type {type(value).__name__}, {WANTED}")
    if len(numbers) == 3:
        return read({"K": numbers}, size)
    if len(numbers) != 4:
        raise WrongArgument(f"has {len(numbers)} values, {WANTED}")
    return camera_from_intrinsics((numbers[0], numbers[1], numbers[2], numbers[3]), *size)


def _plain(value: Any) -> Any:
    """Arrays and tuples as lists, and NumPy's numbers as Python's, as the reader of files has them."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    return [_plain(item) for item in value] if isinstance(value, list | tuple) else value
