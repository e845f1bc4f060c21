"""Cameras from files of many formats (told apart by content), from four numbers, or from a field of view."""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Callable, Mapping
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from slopecli.errors import InputError
from slopecli.geometry.camera import scale_camera
from slopecli.io.cameras.colmap import find_in_binary, find_in_text, read_colmap
from slopecli.io.cameras.metashape import find_metashape, read_metashape
from slopecli.io.cameras.trees import FORMATS, find_opencv, read_opencv
from slopecli.io.cameras.values import Size, make_camera
from slopecli.orders import CameraChoice
from slopecli.types import Camera, Image

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

MAX_BYTES = 64_000_000
MAX_YAML_CHARACTERS = 4_000_000  # YAML is read at about 1 MB a second
MAX_MESSAGE = 400  # characters
MAX_NAMES = 8  # listed in a message
UNDERSTOOD = "the native JSON, OpenCV, ROS camera_info, Kalibr, COLMAP, OpenSfM, nerfstudio or Metashape"

Reader = Callable[[Any, Size | None], Camera]


def load_camera(path: str | PathLike[str], name: str | None = None, size: Size | None = None) -> Camera:
    """Read a camera file, whatever its format, into OpenCV's convention (pixel centres at integers).

    Parameters
    ----------
    path : the file; FILE#NAME picks one of several cameras.
    name : the camera to pick, in place of #NAME (`cam1` in Kalibr, the id in COLMAP, `1`/`2` or left/right in OpenCV).
    size : (width, height) px to use when the file gives none, usually the image's.

    Returns
    -------
    camera : `source` names the format.

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
    """The bytes of a camera file, whose path is relative to `base`; InputError where there are none to read."""
    try:
        _refuse_non_files(Path(file), place := Path(base, file))
        data = place.read_bytes()
    except OSError as error:
        raise InputError(f"{file}: cannot be read ({error.strerror}); check the path and its permissions") from None
    if not data.strip():
        raise InputError(f"{file}: is empty; needed {UNDERSTOOD} camera file")
    return data


def decode_camera(data: bytes, file: str | PathLike[str], name: str | None = None, size: Size | None = None) -> Camera:
    """What `load_camera` makes of the bytes of a file; `file` says where they are from and is not opened."""
    try:
        read, cameras = _cameras_in(data)
        return read(_pick(cameras, name, Path(file).name), size)
    except InputError as error:
        # what a damaged file holds is quoted in messages, and may be of any length
        raise InputError(f"{file}: {' '.join(str(error).split())[:MAX_MESSAGE]}") from None


def camera_for(
    image: Image, choice: CameraChoice, files: Mapping[str, bytes] | None = None
) -> tuple[Camera, str | None]:
    """The camera of an image, made to fit its size, and what a user should know about that (None: nothing).

    Parameters
    ----------
    choice : a camera file, four numbers or a field of view.
    files : bytes of camera files by path, where they are at hand; otherwise the file is read.

    Raises
    ------
    InputError : the file is not a camera, or not the camera of this image.
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
    """Make a camera fit an image of width x height pixels, if the image is the same view, at most resized.

    Returns
    -------
    camera : unchanged for the same size, scaled when both sides shrank or grew alike (to within a pixel's rounding).
    message : what was done, None when nothing was.

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


# ---- from bytes to cameras by name ----


def _refuse_non_files(file: Path, place: Path) -> None:
    if place.is_dir():
        raise InputError(f"{file}: is a folder, needed a camera file")
    if not place.exists():
        raise InputError(f"{file}: no such camera file; check the path")
    if not place.is_file():
        raise InputError(f"{file}: is not a regular file; save the camera to disk first")
    if place.stat().st_size > MAX_BYTES:
        raise InputError(f"{file}: is {place.stat().st_size / 1e6:.0f} MB, too large for a camera file")


def _pick(cameras: Mapping[str, Any], name: str | None, file: str) -> Any:
    names = ", ".join(list(cameras)[:MAX_NAMES]) + (", ..." if len(cameras) > MAX_NAMES else "")
    if name is None:
        if len(cameras) == 1:
            return next(iter(cameras.values()))
        example = next(iter(cameras))
        raise InputError(f"holds {len(cameras)} cameras ({names}); pick one, for example {file}#{example}")
    if name not in cameras:
        held = f"holds {names}" if any(cameras) else "holds one camera without a name; leave the name out"
        raise InputError(f"has no camera {name!r}; it {held}")
    return cameras[name]


def _cameras_in(data: bytes) -> tuple[Reader, Mapping[str, Any]]:
    """The cameras of a file by name, and what reads one of them."""
    if b"\0" in data[:64]:
        return _cameras_in_binary(data)
    text = _text(data)
    if text.lstrip().startswith("<"):
        return _cameras_in_xml(text)
    if colmap := find_in_text(text):
        return read_colmap, colmap
    tree = _tree(text)
    if isinstance(tree, Mapping):
        for form in FORMATS:
            if cameras := form.find(tree):
                return form.read, cameras
    raise InputError(f"holds no camera that is understood; needed {UNDERSTOOD} camera file")


def _cameras_in_binary(data: bytes) -> tuple[Reader, Mapping[str, Any]]:
    if data.startswith(b"PK"):
        if cameras := find_opencv(_numpy_arrays(data)):
            return read_opencv, cameras
    elif colmap := find_in_binary(data):
        return read_colmap, colmap
    raise InputError(f"is binary and neither a COLMAP cameras.bin nor a NumPy .npz with a camera; needed {UNDERSTOOD}")


def _numpy_arrays(data: bytes) -> dict[str, Any]:
    """The arrays of a .npz; a pickled object stays unread, which only matters where coefficients are needed."""
    from io import BytesIO

    import numpy as np

    arrays: dict[str, Any] = {}
    try:
        with np.load(BytesIO(data), allow_pickle=False) as archive:
            for key in archive.files:
                try:
                    arrays[key] = archive[key].tolist()
                except ValueError:
                    arrays[key] = "a pickled object"
    except Exception:  # zipfile and NumPy raise a dozen kinds on damaged bytes
        raise InputError("is a damaged zip or NumPy archive") from None
    return arrays


def _text(data: bytes) -> str:
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(f"is neither text nor a COLMAP cameras.bin; needed {UNDERSTOOD} camera file") from None


def _cameras_in_xml(text: str) -> tuple[Reader, Mapping[str, Any]]:
    from xml.etree import ElementTree

    try:
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError) as error:
        raise InputError(f"is damaged XML ({error})") from None
    if root.tag == "opencv_storage":
        if cameras := find_opencv({child.tag: _opencv_xml_value(child) for child in root}):
            return read_opencv, cameras
    elif calibrations := find_metashape(root):
        return read_metashape, calibrations
    raise InputError("is XML without a camera; needed an OpenCV or a calibrated Metashape file")


def _opencv_xml_value(element: Element) -> Any:
    if len(element) and all(child.tag == "_" for child in element):
        return [_opencv_xml_value(child) for child in element]
    if len(element) or element.get("type_id"):
        return {child.tag: _opencv_xml_value(child) for child in element}
    words = (element.text or "").split()
    return words[0] if len(words) == 1 and element.tag != "data" else words


def _tree(text: str) -> Any:
    if text.lstrip()[0] not in "{[":
        return _yaml_tree(text)
    try:
        return json.loads(text)
    except RecursionError:
        raise InputError("is JSON nested too deeply for a camera file") from None
    except json.JSONDecodeError as error:
        try:
            return _yaml_tree(text)  # OpenCV's JSON has numbers like "1.", which only YAML reads
        except InputError:
            raise InputError(f"is damaged JSON ({error})") from None


def _yaml_tree(text: str) -> Any:
    import yaml

    if len(text) > MAX_YAML_CHARACTERS:
        raise InputError(f"is {len(text) / 1e6:.0f} MB of text that is not JSON, too large for a camera file")
    # OpenCV writes a version directive no YAML reader accepts
    text = re.sub(r"\A%YAML[^\n]*\n", "", text)
    try:
        documents = yaml.load_all(text, Loader=_yaml_loader())
        return next((tree for tree in documents if tree is not None), None)
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        problem = getattr(error, "problem", None) or type(error).__name__
        mark = getattr(error, "problem_mark", None)
        where = f" at line {mark.line + 1}" if mark is not None else ""
        raise InputError(f"is neither JSON nor YAML ({problem}{where}); needed {UNDERSTOOD} camera file") from None


def _yaml_loader() -> Any:
    """A safe loader that also knows OpenCV's matrices and Python's tuples."""
    import yaml

    base = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    loader: Any = type("CameraLoader", (base,), {})
    loader.add_multi_constructor(
        "tag:yaml.org,2002:opencv-", lambda loader, _, node: loader.construct_mapping(node, deep=True)
    )
    loader.add_constructor(
        "tag:yaml.org,2002:python/tuple", lambda loader, node: loader.construct_sequence(node, deep=True)
    )
    return loader
