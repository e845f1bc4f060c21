"""Settings files of ORB-SLAM2, ORB-SLAM3 and stella_vslam: `Camera.fx`, `Camera1.fx`, or the same below `Camera`."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from slopecli.errors import InputError
from slopecli.io.cameras import values
from slopecli.io.cameras.content import CameraFileContent
from slopecli.io.cameras.sizes import image_size
from slopecli.types import Camera, CameraModel

PREFIX = re.compile(r"(Camera\d?|LEFT|RIGHT|StereoRectifier)\.(.+)")
FISHEYE = {"kannalabrandt8", "fisheye"}
LENSES = {
    **dict.fromkeys(FISHEYE, "k1 k2 k3 k4"),
    **dict.fromkeys(("pinhole", "perspective"), "k1 k2 p1 p2 k3 k4 k5 k6"),
}
LENSES["rectified"] = ""


def find(content: CameraFileContent) -> dict[str, dict[str, Any]]:
    """Cameras by the first part of their keys, Camera alone without a name; {} for another format."""
    cameras: dict[str, dict[str, Any]] = {}
    for key, value in content.tree.items():
        match = PREFIX.fullmatch(str(key))
        if match:
            cameras.setdefault(match[1], {})[match[2]] = value
        elif key in ("Camera", "StereoRectifier") and isinstance(value, Mapping):
            cameras.setdefault(key, {}).update({str(name): part for name, part in value.items()})
    own = {name for name, tree in cameras.items() if "fx" in tree}
    if not own:
        return {}
    cameras |= _before_rectification(cameras.pop("StereoRectifier", {}))
    own |= {name for name, tree in cameras.items() if "K" in tree}
    if own == {"Camera"}:
        return {"": cameras["Camera"]}
    # ORB-SLAM3 keeps type and size, which are those of both cameras, under Camera
    shared = {
        key: value for key, value in cameras.get("Camera", {}).items() if not re.fullmatch("[fc][xy]|[kp][1-6]", key)
    }
    return {name: {**shared, **cameras[name]} for name in cameras if name in own}


def _before_rectification(rectifier: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """The cameras of the images as recorded, which stella_vslam has beside that of the rectified ones."""
    kind = str(rectifier.get("model", "perspective"))
    return {
        name: {"K": rectifier[name], "type": kind, **({"D": rectifier[lens]} if lens in rectifier else {})}
        for name, lens in (("K_left", "D_left"), ("K_right", "D_right"))
        if name in rectifier
    }


def read(tree: values.Tree, image: values.Size | None) -> Camera:
    """LEFT.K and RIGHT.K are of the images as recorded, and Camera.fx beside them of the rectified ones."""
    kind = str(tree.get("type", tree.get("model", "pinhole")))
    if kind.lower() not in LENSES:
        raise InputError(
            f"the ORB-SLAM camera type {kind[:40]!r} is not supported, only PinHole, KannalaBrandt8 and Rectified"
        )
    model: CameraModel = "fisheye" if kind.lower() in FISHEYE else "brown"
    if "K" in tree:
        return _recorded(tree, model, image)
    missing = [key for key in ("fx", "fy", "cx", "cy") if key not in tree]
    if missing:
        raise InputError(f"Camera.{missing[0]} is missing; a camera needs fx, fy, cx and cy")
    fx, fy, cx, cy = (values.number(tree[key], key) for key in ("fx", "fy", "cx", "cy"))
    own, note = image_size(tree, (cx, cy), image)
    coefficients = _coefficients(tree, kind)
    return values.make_camera(
        "ORB-SLAM", own or image, (fx, fy, cx, cy), model, coefficients, note=note, size_given=own is not None
    )


def _coefficients(tree: values.Tree, kind: str) -> list[float]:
    """In the order of the lens; those of another lens are refused."""
    names = LENSES[kind.lower()].split()
    given = [key for key in tree if re.fullmatch(r"[kp]\d", key)]
    for key in given:
        if key not in names and values.number(tree[key] or 0, key) != 0:
            raise InputError(f"{key} is not a coefficient of a {kind} camera, which has {' '.join(names) or 'none'}")
    if not {"type", "model", "p1", "p2"} & set(tree) and {"k3", "k4"} <= set(given):
        raise InputError("k1 to k4 without p1 and p2, and no Camera.type: say whether it is PinHole or KannalaBrandt8")
    return [values.number(tree.get(name) or 0, name) for name in names]


def _recorded(tree: values.Tree, model: CameraModel, image: values.Size | None) -> Camera:
    if "D" not in tree:
        raise InputError("D, the distortion that belongs to K, is missing")
    fx, fy, cx, cy = values.intrinsics_of_matrix(tree["K"], "K")
    own, note = image_size(tree, (cx, cy), image)
    lens = values.numbers(tree["D"], "D")
    return values.make_camera(
        "ORB-SLAM", own or image, (fx, fy, cx, cy), model, lens, note=note, size_given=own is not None
    )
