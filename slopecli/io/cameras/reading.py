"""Read the camera of an image: from a file of any format, from four numbers, or from a field of view."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import cached_property
from numbers import Real
from os import PathLike
from pathlib import Path
from typing import Any, Literal

from slopecli.errors import InputError, WrongArgument
from slopecli.geometry.camera import scale_camera
from slopecli.io.cameras.content import Beside, CameraFileContent, UnknownContent
from slopecli.io.cameras.formats import CAMERA_FORMATS, CameraFormat
from slopecli.io.cameras.picking import listed, named, of_image, of_labelled_image, stem_of
from slopecli.io.cameras.unread import looks_like
from slopecli.io.cameras.values import Size, make_camera
from slopecli.io.files import MOST_BYTES, checked_path, read_file
from slopecli.options import CameraChoice
from slopecli.types import Camera, Image

NEEDED = f"needed a camera file of one of these formats: {', '.join(form.name for form in CAMERA_FORMATS)}"


def nothing_beside(_name: str) -> None:
    """Nothing is beside a camera file of which only the bytes are known."""


def load_camera(path: str | PathLike[str], name: str | None = None, size: Size | None = None) -> Camera:
    """Read a camera file into OpenCV's convention (pixel centres at integers); its `source` names the format.

    Parameters
    ----------
    path : the file; FILE#NAME picks one of several cameras.
    name : the camera to pick, in place of #NAME (`cam1` in Kalibr, the id in COLMAP, `1`/`2` or left/right in OpenCV,
        the path of a frame in nerfstudio, or its end).
    size : (width, height) px to use when the file gives none, usually the image's.

    Returns
    -------
    camera : its `note` is what a user should know of how it was read, "" for nothing.

    Raises
    ------
    InputError : the file cannot be read or is not understood, holds several cameras and none is picked, or has a lens
        that is not supported.
    """
    checked_path(path, "camera file")
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
    if os.path.isdir(Path(base, file)):
        raise InputError(
            f"{file}: is a folder, needed a camera file; slopemap does not calibrate from images of a chessboard: "
            "OpenCV (calibrateCamera, interactive-calibration) and Kalibr do, and what they write is read"
        )
    data = read_file(file, "camera file", 64_000_000, base)
    if not data.strip():
        raise InputError(f"{file}: is empty; {NEEDED}")
    return data


def decode_camera(
    data: bytes,
    file: str | PathLike[str],
    name: str | None = None,
    size: Size | None = None,
    image: str | None = None,
    others: Beside = nothing_beside,
) -> Camera:
    """As `load_camera`, from the bytes of the file; `file` is for messages and is not opened.

    image : path of the image that the camera is for: it picks one of several cameras where none is named.
    others : reads files beside it, which may list images.
    """
    held = CamerasHeld(data, file, others)
    with _one_line(file):
        count = len(held.cameras)
        key, picked = _pick(held.cameras, name), ""
        if key is None and image and (key := held.of_image(image)) is not None:
            picked = f"of its {count} cameras, {key} is that of {image}"
        if key is None:
            key, picked = _alike(held.form, held.cameras, Path(file).name, size), f"its {count} cameras are the same"
        camera: Camera = held.form.module.read(held.cameras[key], size)
        return replace(camera, note="; ".join(filter(None, (*held.content.notes, picked, camera.note))))


class CamerasHeld:
    """The cameras of a file by name, "" for one without a name, and which of them took an image.

    Raises InputError as `decode_camera`.
    """

    def __init__(self, data: bytes, file: str | PathLike[str], others: Beside) -> None:
        self._file, self._others = file, others
        with _one_line(file):
            self.content = CameraFileContent(data)
            self.form, self.cameras = _find_cameras(self.content)

    @cached_property
    def _by_stem(self) -> dict[str, dict[str, str]]:
        """Names of cameras by the labels of their images, these by the last part of the label without its suffix."""
        found: dict[str, dict[str, str]] = {}
        of_images = getattr(self.form.module, "labelled_images", None)
        for label, camera in (of_images(self.content, self._others) if of_images else {}).items():
            if camera in self.cameras:
                found.setdefault(stem_of(label), {})[label] = camera
        return found

    def of_image(self, image: str) -> str | None:
        """The camera of an image by what the file says of its images, else by the names of its cameras.

        None where none fits. Raises InputError where several fit equally well.
        """
        path = os.path.abspath(image)
        with _one_line(self._file):
            labelled = of_labelled_image(self._by_stem.get(stem_of(path), {}), path)
            if labelled is not None:
                return labelled
            return of_image(self.cameras, path, getattr(self.form.module, "images_called", None))


def camera_format(data: bytes, file: str | PathLike[str]) -> CameraFormat:
    """The format of a camera file. Raises InputError as `decode_camera`."""
    with _one_line(file):
        return _find_cameras(CameraFileContent(data))[0]


def camera_names(data: bytes, file: str | PathLike[str]) -> tuple[str, ...]:
    """The names of the cameras of a file, "" for one without a name. Raises InputError as `decode_camera`."""
    with _one_line(file):
        return tuple(_find_cameras(CameraFileContent(data))[1])


def beside(file: str | PathLike[str]) -> Beside:
    """Reads files beside a camera file; what is there but cannot be read is as if it were not there."""

    def read(name: str) -> bytes | None:
        path = Path(file).with_name(name)
        with suppress(InputError):
            return read_file(path, "list of images", MOST_BYTES) if path.is_file() else None
        return None

    return read


@contextmanager
def _one_line(file: str | PathLike[str]) -> Iterator[None]:
    """Name the file in every message, which may quote it, and a damaged file may hold text of any length."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{file}: {' '.join(str(error).split())[:400]}") from None
    except RecursionError:
        raise InputError(f"{file}: is nested too deeply for a camera file") from None


def camera_for(
    image: Image, choice: CameraChoice, files: Mapping[str, bytes] | None = None
) -> tuple[Camera, tuple[str, ...]]:
    """The camera of an image, scaled to its size if need be, and messages for the user about that.

    Parameters
    ----------
    choice : a camera file, four numbers, a field of view or the image's own metadata.
    files : bytes of camera files and images by path, if they have been read already.

    Raises
    ------
    InputError : the file holds no camera, or not the camera of this image.
    """
    size = (image.width, image.height)
    if choice.file is not None:
        return _camera_from_file(image, choice.file, files)
    if choice.exif:
        return _camera_of_metadata(image, files), ()
    if choice.intrinsics is not None:
        return camera_from_intrinsics(choice.intrinsics, *size), ()
    if choice.fov_deg is not None:
        return camera_from_fov(choice.fov_deg, *size), ()
    raise InputError(f"{image.path}: no camera; give a camera file, intrinsics or a field of view")


def _camera_of_metadata(image: Image, files: Mapping[str, bytes] | None) -> Camera:
    """The camera that the metadata of an image state."""
    from slopecli.io.metadata.metadata_reading import decode_metadata, read_metadata

    metadata = decode_metadata(files[image.path], image.path) if files else read_metadata(image.path)
    if metadata.lens is not None:
        return metadata.lens.camera()
    why = next(
        (note for note in metadata.notes if "focal length" in note or "EXIF" in note), "it states no focal length"
    )
    raise InputError(f"{image.path}: {why}; give --camera FILE, --intrinsics FX,FY,CX,CY or --fov DEG")


def _camera_from_file(image: Image, path: str, files: Mapping[str, bytes] | None) -> tuple[Camera, tuple[str, ...]]:
    size = (image.width, image.height)
    file, name = (path, None) if files and path in files else split_name(path)
    data, others = (files[file], nothing_beside) if files else (read_camera_file(file), beside(file))
    camera = decode_camera(data, file, name, size, image.path, others)
    notes = [f"{path}: {camera.note}"] if camera.note else []
    try:
        camera, message = fit_camera_to_image(camera, *size)
    except InputError as error:
        raise InputError(f"{image.path} with {path}: {error}") from None
    return camera, (*notes, *([f"{image.path} with {path}: {message}"] if message else []))


def camera_from_intrinsics(intrinsics: tuple[float, float, float, float], width: int, height: int) -> Camera:
    """A pinhole camera from fx, fy, cx, cy, px."""
    if not isinstance(intrinsics, Iterable):
        raise WrongArgument(f"intrinsics is of type {type(intrinsics).__name__}, needed fx, fy, cx and cy in px")
    camera = make_camera("given", (width, height), intrinsics)
    return replace(camera, size_given=False)


def camera_from_fov(deg: float, width: int, height: int, which: Literal["h", "v", "d"] = "h") -> Camera:
    """A pinhole camera with square pixels and the principal point in the middle, from its field of view.

    Parameters
    ----------
    deg : full angle, degrees, between the outer edges of the image: horizontal "h", vertical "v" or diagonal "d".
    """
    if not isinstance(deg, Real):
        raise WrongArgument(f"the field of view is of type {type(deg).__name__}, needed a number of degrees")
    if not 0 < deg < 180:
        raise InputError(f"the field of view is {deg:g} degrees, needed more than 0 and less than 180")
    if deg <= math.pi:
        raise InputError(
            f"a field of view of {deg:g} degrees: it must be in degrees, and {deg:g} radians are "
            f"{math.degrees(deg):.4g} degrees; for a lens as long as that give --intrinsics"
        )
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


def _find_cameras(content: CameraFileContent) -> tuple[CameraFormat, Mapping[str, Any]]:
    """The format of a file and its cameras by name."""
    try:
        if not content.is_binary and not content.text.strip():
            raise InputError(f"is empty; {NEEDED}")
        for form in CAMERA_FORMATS:
            if cameras := form.module.find(content):
                return form, cameras
    except UnknownContent as error:
        raise InputError(f"{error}{looks_like(content)}; {NEEDED}") from None
    text = "holds no" if content.xml is None else "is XML without a"
    kind = "is binary data without a" if content.is_binary else text
    raise InputError(f"{kind} camera that is understood{looks_like(content)}; {NEEDED}")


def _pick(cameras: Mapping[str, Any], name: str | None) -> str | None:
    """The camera of a name, or the only one; None where there are several and none is named."""
    if name is not None:
        return named(cameras, name)
    return next(iter(cameras)) if len(cameras) == 1 else None


def _alike(form: CameraFormat, cameras: Mapping[str, Any], file: str, size: Size | None) -> str:
    """The first of several cameras if they are the same."""
    first = next(iter(cameras))
    with suppress(InputError):
        if len({form.module.read(camera, size) for camera in cameras.values()}) == 1:
            return first
    raise InputError(
        f"holds {len(cameras)} cameras ({listed(cameras)}); pick one: add its name to that of the file, for example "
        f"{file}#{first}"
    )
