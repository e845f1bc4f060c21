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
from slopecli.io.cameras.lens_marks import is_mark_key, marked_model
from slopecli.io.cameras.sizes import image_size
from slopecli.types import Camera

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

MATRICES = "cameramatrix|intrinsicmatrix|cameraintrinsics|cameraintrinsicmatrix|intrinsics|intrinsic|cammatrix|mtx|k|m"
LENSES = (
    "distortioncoefficients|distortioncoeffs|distortioncoefs|distcoefficients|distcoeffs|distcoefs|distcoeff|"
    "distortion|dist|d"
)
KEY = re.compile(rf"(?P<before>left|right)?(?:(?P<matrix>{MATRICES})|(?P<lens>{LENSES}))(?P<after>\d+|left|right|l|r)?")
FOUR = (
    "four coefficients and no lens model are read as k1 k2 p1 p2 of a radial-tangential lens (of a fisheye lens, add "
    '"model": "fisheye")'
)


def find(content: CameraFileContent) -> dict[str, Any]:
    """Matrix and coefficients of each camera by the suffix of their names ("" without one); {} for another format."""
    tree = _arrays(content)
    cameras: dict[str, dict[str, Any]] = {}
    for key, value in tree.items():
        match = KEY.fullmatch(values.plain_key(key))
        if match is None or (match["matrix"] and not _may_be_matrix(value)):
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


def _may_be_matrix(value: Any) -> bool:
    """Whether it is numbers in a list, or names with values; a list of cameras of another program is not."""
    return isinstance(value, Mapping) or (
        isinstance(value, list | tuple) and not any(isinstance(part, Mapping) for part in value)
    )


def read(camera: Mapping[str, Any], size: values.Size | None) -> Camera:
    """Without coefficients it is a pinhole, and `Camera.source` says so."""
    tree = camera["tree"]
    _refuse_unread_names(tree)
    marked = marked_model(tree)
    key, value = camera["matrix"]
    lens_key, lens = camera.get("lens", ("", None))
    source = "OpenCV" if lens_key else "OpenCV, no distortion given"
    # many files call OpenCV's usual lens model a pinhole
    model = marked if marked == "fisheye" else "brown"
    fx, fy, cx, cy = values.intrinsics_of_matrix(value, key)
    if isinstance(lens, Mapping) and set(values.BROWN_ORDER) & set(lens):
        values.refuse_others(lens, "k1 k2 p1 p2 k3 k4 k5 k6 model type", lens_key)
    coefficients = values.coefficients_by_name(lens, model, lens_key)
    own, turned = image_size(tree, (cx, cy), size)
    unmarked = marked is None and len(coefficients) == 4 and any(coefficients)
    note = "; ".join(filter(None, (FOUR if unmarked else "", turned)))
    return values.make_camera(
        source, own or size, (fx, fy, cx, cy), model, coefficients, note=note, size_given=own is not None
    )


def _refuse_unread_names(tree: values.Tree) -> None:
    for key, value in tree.items():
        plain = values.plain_key(key)
        if plain == "xi":
            raise InputError("an omnidirectional camera (xi) is not supported; undistort the images first")
        if re.fullmatch("[kp][1-6]", plain) and not isinstance(value, list | tuple | Mapping):
            raise InputError(f"{key!r} stands alone; list the coefficients as distortion_coefficients")
    known = [key for key in tree if KEY.fullmatch(values.plain_key(key)) or is_mark_key(key)]
    values.refuse_unread_distortion(tree, known, "list the coefficients as distortion_coefficients")


def _arrays(content: CameraFileContent) -> values.Tree:
    """Names and values of a NumPy archive, an OpenCV XML or a tree."""
    if content.is_binary:
        return _numpy_arrays(content.data) if content.data.startswith(b"PK") else {}
    if content.xml is not None:
        if content.xml.tag != "opencv_storage":
            return {}
        values.refuse_twice(child.tag for child in content.xml)
        return {child.tag: _xml_value(child) for child in content.xml}
    return content.tree


def _numpy_arrays(data: bytes) -> dict[str, Any]:
    """The small arrays of a .npz. Pickled objects are not loaded; reading one as coefficients is an error."""
    from io import BytesIO
    from zipfile import ZipFile

    import numpy as np

    arrays: dict[str, Any] = {}
    try:
        with ZipFile(BytesIO(data)) as archive:
            parts = archive.infolist()
            names = [part.filename.removesuffix(".npy") for part in parts]
            for name, part in zip(names, parts, strict=True):
                if part.file_size > 8 * 1000 + 4096:  # of numbers and a header: it is an image, or a list of points
                    arrays[name] = "a large array"
                    continue
                try:
                    arrays[name] = np.load(BytesIO(archive.read(part)), allow_pickle=False).tolist()
                except ValueError:
                    arrays[name] = "a pickled object"
    except Exception:  # zipfile and NumPy raise many kinds of exceptions on damaged bytes
        raise InputError("is a damaged zip or NumPy archive") from None
    values.refuse_twice(names)
    return arrays


def _xml_value(element: Element) -> Any:
    if len(element) and all(child.tag == "_" for child in element):
        return [_xml_value(child) for child in element]
    if len(element) or element.get("type_id"):
        return {child.tag: _xml_value(child) for child in element}
    words = (element.text or "").split()
    return words[0] if len(words) == 1 and element.tag != "data" else words
