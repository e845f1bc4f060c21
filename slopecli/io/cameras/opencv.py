"""Cameras saved by OpenCV: FileStorage YAML, XML and JSON, plain JSON and YAML, and NumPy archives.

The intrinsic matrix and the distortion coefficients are found under the many names that people give them.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from slopecli.errors import InputError
from slopecli.io.cameras import values
from slopecli.io.cameras.content import CameraFileContent
from slopecli.types import Camera

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

MATRICES = "cameramatrix|intrinsicmatrix|cameraintrinsics|cameraintrinsicmatrix|intrinsics|intrinsic|cammatrix|mtx|k|m"
LENSES = (
    "distortioncoefficients|distortioncoeffs|distortioncoefs|distcoefficients|distcoeffs|distcoefs|distcoeff|"
    "distortion|dist|d"
)
KEY = re.compile(rf"(?P<before>left|right)?(?:(?P<matrix>{MATRICES})|(?P<lens>{LENSES}))(?P<after>\d+|left|right|l|r)?")
WIDTH_KEYS = ("image_width", "imageWidth", "width", "img_width", "w")
HEIGHT_KEYS = ("image_height", "imageHeight", "height", "img_height", "h")
SIZE_KEYS = ("image_size", "imageSize", "img_size", "imgSize", "ImageSize", "resolution")
MODEL_KEYS = ("model", "camera_model", "distortion_model", "lens_model", "model_type")


def find(content: CameraFileContent) -> dict[str, Any]:
    """Matrix and coefficients of each camera by the suffix of their names ("" without one); {} for another format."""
    tree = _arrays(content)
    cameras: dict[str, dict[str, Any]] = {}
    for key, value in tree.items():
        match = KEY.fullmatch(values.plain_key(key))
        if match is None or (match["matrix"] and not isinstance(value, list | tuple | Mapping)):
            continue
        part = "matrix" if match["matrix"] else "lens"
        camera = cameras.setdefault(match["before"] or match["after"] or "", {"tree": tree})
        if part in camera:
            raise InputError(f"both {camera[part][0]!r} and {key!r} are given; keep one of them")
        camera[part] = key, value
    found = {name: camera for name, camera in cameras.items() if "matrix" in camera}
    for name, camera in cameras.items() if found else ():
        if name not in found:
            raise InputError(f"{camera['lens'][0]!r} belongs to no matrix; give both the same suffix, or none")
    return found


def read(camera: Mapping[str, Any], size: values.Size | None) -> Camera:
    """Without coefficients it is a pinhole, and `Camera.source` says so."""
    tree = camera["tree"]
    _refuse_unread_names(tree)
    fisheye = bool(values.number(tree.get("fisheye_model", 0), "fisheye_model"))
    named = next((tree[key] for key in MODEL_KEYS if key in tree), None)
    model = values.lens_model(named) if named is not None else "fisheye" if fisheye else "brown"
    key, value = camera["matrix"]
    lens_key, lens = camera.get("lens", ("", None))
    source = "OpenCV" if lens_key else "OpenCV, no distortion given"
    # many files call OpenCV's usual lens model a pinhole
    model = "brown" if model == "pinhole" else model
    intrinsics = values.intrinsics_of_matrix(value, key)
    return values.make_camera(source, _size(tree) or size, intrinsics, model, values.numbers(lens, lens_key))


def _refuse_unread_names(tree: values.Tree) -> None:
    for key, value in tree.items():
        plain = values.plain_key(key)
        if plain == "xi":
            raise InputError("an omnidirectional camera (xi) is not supported; undistort the images first")
        if re.fullmatch("[kp][1-6]", plain) and not isinstance(value, list | tuple | Mapping):
            raise InputError(f"{key!r} stands alone; list the coefficients as distortion_coefficients")
    known = [*MODEL_KEYS, *(key for key in tree if KEY.fullmatch(values.plain_key(key)))]
    values.refuse_unread_distortion(tree, known, "list the coefficients as distortion_coefficients")


def _size(tree: values.Tree) -> values.Size | None:
    pair = next((tree[key] for key in SIZE_KEYS if key in tree), None)
    if pair is not None:
        return values.size_of_list(pair, "image size")
    width, height = (next((tree[key] for key in keys if key in tree), None) for keys in (WIDTH_KEYS, HEIGHT_KEYS))
    return values.size_of(width, height)


def _arrays(content: CameraFileContent) -> values.Tree:
    """Names and values of a NumPy archive, an OpenCV XML or a tree."""
    if content.is_binary:
        return _numpy_arrays(content.data) if content.data.startswith(b"PK") else {}
    if content.xml is not None:
        return {child.tag: _xml_value(child) for child in content.xml} if content.xml.tag == "opencv_storage" else {}
    return content.tree


def _numpy_arrays(data: bytes) -> dict[str, Any]:
    """The arrays of a .npz. Pickled objects are not loaded; reading one as coefficients is an error."""
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
    except Exception:  # zipfile and NumPy raise many kinds of exceptions on damaged bytes
        raise InputError("is a damaged zip or NumPy archive") from None
    return arrays


def _xml_value(element: Element) -> Any:
    if len(element) and all(child.tag == "_" for child in element):
        return [_xml_value(child) for child in element]
    if len(element) or element.get("type_id"):
        return {child.tag: _xml_value(child) for child in element}
    words = (element.text or "").split()
    return words[0] if len(words) == 1 and element.tag != "data" else words
