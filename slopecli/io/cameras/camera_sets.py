"""Cameras under names of their own: {"cam0": {"K": ..., "D": ...}}, camera_info messages by topic, and the like."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import ModuleType
from typing import Any

from slopecli.errors import InputError
from slopecli.io.cameras import native, opencv, realsense, ros, values
from slopecli.io.cameras.content import CameraFileContent
from slopecli.io.cameras.lens_marks import is_mark_key
from slopecli.io.cameras.sizes import is_size_key
from slopecli.types import Camera

PARTS = (ros, realsense, native, opencv)  # the formats that one camera may be written in
FOLDERS = ("cameras", "intrinsics", "sensors")
NAMES = ("name", "camera_name", "camera", "id")
Found = tuple[ModuleType, Any]


def find(content: CameraFileContent) -> dict[str, Found]:
    """Cameras by their names, each with its format; {} for another format."""
    tree = content.tree
    listed = next((tree[key] for key in FOLDERS if isinstance(tree.get(key), Mapping | list)), content.rows or tree)
    folder = _by_name(listed) if isinstance(listed, list) else listed
    shared = _shared(tree)
    found: dict[str, Found] = {}
    for name, value in folder.items():
        if isinstance(value, Mapping) and not {"rows", "data"} & set(value):
            found |= {str(name): part for part in _in_part({**shared, **value})}
    if found:
        _refuse_beside(key for key in tree if key not in shared and tree[key] is not listed and str(key) not in found)
    return {"": next(iter(found.values()))} if len(found) == 1 and folder is tree else found


def _shared(tree: values.Tree) -> dict[str, Any]:
    """Image size and lens model that stand beside the cameras and are those of all."""
    plain = {key: value for key, value in tree.items() if not isinstance(value, Mapping | list)}
    return {key: value for key, value in plain.items() if is_size_key(key) or is_mark_key(key)}


def _by_name(listed: list[Any]) -> dict[str, Any]:
    """Cameras of a list by what they are called there, or by their numbers."""
    rows = [row for row in listed if isinstance(row, Mapping)]
    names = [str(next((row[key] for key in NAMES if key in row), number)) for number, row in enumerate(rows)]
    values.refuse_twice(names)
    return dict(zip(names, rows, strict=True))


def _refuse_beside(keys: Iterable[Any]) -> None:
    """Refuse a matrix or a distortion that stands beside the named cameras: of which of them would it be?"""
    remedy = "give each camera its own coefficients"
    for key in keys:
        values.refuse_unread_distortion([key], (), remedy)
        if opencv.KEY.fullmatch(values.plain_key(key)):
            raise InputError(f"{key!r} stands beside the named cameras; {remedy}")


def _in_part(tree: values.Tree) -> list[Found]:
    """The one camera of a part, or none."""
    content = CameraFileContent.of_tree(tree)
    for module in PARTS:
        cameras = module.find(content)
        if len(cameras) == 1:
            return [(module, next(iter(cameras.values())))]
    return []


def read(camera: Found, image: values.Size | None) -> Camera:
    """As the format of the camera does, but for coefficients, which must stand beside a matrix."""
    module, part = camera
    if module is opencv and "lens" not in part:
        raise InputError(f"{part['matrix'][0]} comes without coefficients; add D, zeros if there is no distortion")
    found: Camera = module.read(part, image)
    return found
