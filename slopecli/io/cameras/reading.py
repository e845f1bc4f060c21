"""Read the camera of an image: from a file of any format, from four numbers, or from a field of view."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any, Literal

from slopecli.errors import InputError
from slopecli.geometry.camera import scale_camera
from slopecli.io.cameras.content import CameraFileContent, UnknownContent
from slopecli.io.cameras.formats import CAMERA_FORMATS, CameraFormat
from slopecli.io.cameras.values import Size, make_camera
from slopecli.io.files import read_file
from slopecli.options import CameraChoice
from slopecli.types import Camera, Image

MAX_NAMES = 8  # of cameras, listed in a message
NEEDED = f"needed a camera file of one of these formats: {', '.join(form.name for form in CAMERA_FORMATS)}"


def load_camera(path: str | PathLike[str], name: str | None = None, size: Size | None = None) -> Camera:
    """Read a camera file into OpenCV's convention (pixel centres at integers); its `source` names the format.

    Parameters
    ----------
    path : the file; FILE#NAME picks one of several cameras.
    name : the camera to pick, in place of #NAME (`cam1` in Kalibr, the id in COLMAP, `1`/`2` or left/right in OpenCV).
    size : (width, height) px to use when the file gives none, usually the image's.

    Raises
    ------
    InputError : the file cannot be read or is not understood, holds several cameras and none is picked, or has a lens
        that is not supported.
    """
    file, picked = split_name(path) if name is None else (str(path), name)
    return decode_camera(read_camera_file(file), file, picked, size)


def split_name(path: str | PathLike[str], base: str | PathLike[str] = "") -> tuple[str, str | None]:
    """FILE#NAME as FILE and NAME, unless a file of that whole name exists (below `base`, where it is relative)."""
    file, hash_sign, picked = str(path).rpartition("#")
    if hash_sign and not os.path.exists(Path(base, path)):
        return file, picked
    return str(path), None


def read_camera_file(file: str | PathLike[str], base: str | PathLike[str] = "") -> bytes:
    """The bytes of a camera file, whose path is relative to `base`; raises InputError if it cannot be read."""
    data = read_file(file, "camera file", 64_000_000, base)
    if not data.strip():
        raise InputError(f"{file}: is empty; {NEEDED}")
    return data


def decode_camera(data: bytes, file: str | PathLike[str], name: str | None = None, size: Size | None = None) -> Camera:
    """As `load_camera`, from the bytes of the file; `file` is for messages and is not opened."""
    try:
        form, cameras = _find_cameras(data)
        camera: Camera = form.module.read(_pick(cameras, name, Path(file).name), size)
        return camera
    except InputError as error:
        # messages quote the file, and a damaged file may hold text of any length
        raise InputError(f"{file}: {' '.join(str(error).split())[:400]}") from None


def camera_for(
    image: Image, choice: CameraChoice, files: Mapping[str, bytes] | None = None
) -> tuple[Camera, str | None]:
    """The camera of an image, scaled to its size if need be, and a message for the user about that, or None.

    Parameters
    ----------
    choice : a camera file, four numbers or a field of view.
    files : bytes of camera files by path, if they have been read already.

    Raises
    ------
    InputError : the file holds no camera, or not the camera of this image.
    """
    size = (image.width, image.height)
    if choice.file is not None:
        return _camera_from_file(image, choice.file, files)
    if choice.intrinsics is not None:
        return camera_from_intrinsics(choice.intrinsics, *size), None
    if choice.fov_deg is not None:
        return camera_from_fov(choice.fov_deg, *size), None
    raise InputError(f"{image.path}: no camera; give a camera file, intrinsics or a field of view")


def _camera_from_file(image: Image, path: str, files: Mapping[str, bytes] | None) -> tuple[Camera, str | None]:
    size = (image.width, image.height)
    file, name = (path, None) if files and path in files else split_name(path)
    camera = decode_camera(files[file] if files else read_camera_file(file), file, name, size)
    try:
        camera, message = fit_camera_to_image(camera, *size)
    except InputError as error:
        raise InputError(f"{image.path} with {path}: {error}") from None
    return camera, f"{image.path} with {path}: {message}" if message else None


def camera_from_intrinsics(intrinsics: tuple[float, float, float, float], width: int, height: int) -> Camera:
    """A pinhole camera from fx, fy, cx, cy, px."""
    return make_camera("given", (width, height), intrinsics)


def camera_from_fov(deg: float, width: int, height: int, which: Literal["h", "v", "d"] = "h") -> Camera:
    """A pinhole camera with square pixels and the principal point in the middle, from its field of view.

    Parameters
    ----------
    deg : full angle, degrees, between the outer edges of the image: horizontal "h", vertical "v" or diagonal "d".
    """
    if not 0 < deg < 180:
        raise InputError(f"the field of view is {deg:g} degrees, needed more than 0 and less than 180")
    extent = {"h": width, "v": height, "d": math.hypot(width, height)}[which]
    focal = extent / 2 / math.tan(math.radians(deg) / 2)
    return make_camera("field of view", (width, height), (focal, focal, (width - 1) / 2, (height - 1) / 2))


def fit_camera_to_image(camera: Camera, width: int, height: int) -> tuple[Camera, str | None]:
    """Scale a camera to an image of width x height pixels that shows the same view, resized or not.

    Returns
    -------
    camera : unchanged for the same size, scaled if both sides have the same scale (to within the rounding of a pixel).
    message : what was done, None if nothing.

    Raises
    ------
    InputError : another shape (a crop, a turned image, another camera).
    """
    if (width, height) == (camera.width, camera.height):
        return camera, None
    sizes = f"the camera is for {camera.width}x{camera.height} px, the image has {width}x{height} px"
    if _is_rescale(camera.width, camera.height, width, height):
        return scale_camera(camera, width, height), f"{sizes}: intrinsics scaled by {width / camera.width:.6g}"
    if _is_rescale(camera.height, camera.width, width, height):
        raise InputError(
            f"{sizes}: the image is turned; EXIF orientation is not applied here, so give the image as the sensor "
            "stored it, or calibrate on turned images"
        )
    raise InputError(f"{sizes}: not the same view resized; give the camera of this image, or an uncropped image")


def _is_rescale(width: int, height: int, new_width: int, new_height: int) -> bool:
    across, down = new_width / width, new_height / height
    return abs(new_height - height * across) < 1 or abs(new_width - width * down) < 1


def _find_cameras(data: bytes) -> tuple[CameraFormat, Mapping[str, Any]]:
    """The format of a file and its cameras by name."""
    content = CameraFileContent(data)
    try:
        for form in CAMERA_FORMATS:
            if cameras := form.module.find(content):
                return form, cameras
    except UnknownContent as error:
        raise InputError(f"{error}; {NEEDED}") from None
    text = "holds no" if content.xml is None else "is XML without a"
    kind = "is binary data without a" if content.is_binary else text
    raise InputError(f"{kind} camera that is understood; {NEEDED}")


def _pick(cameras: Mapping[str, Any], name: str | None, file: str) -> Any:
    names = ", ".join(list(cameras)[:MAX_NAMES]) + (", ..." if len(cameras) > MAX_NAMES else "")
    if name is None:
        if len(cameras) == 1:
            return next(iter(cameras.values()))
        raise InputError(f"holds {len(cameras)} cameras ({names}); pick one, for example {file}#{next(iter(cameras))}")
    if name not in cameras:
        held = f"holds {names}" if any(cameras) else "holds one camera without a name; leave the name out"
        raise InputError(f"has no camera {name!r}; it {held}")
    return cameras[name]
