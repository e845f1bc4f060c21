"""OpenMVG's sfm_data.json: intrinsics as cereal writes them; pixel centres at integers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from slopecli.errors import InputError
from slopecli.io.cameras import values
from slopecli.io.cameras.content import CameraFileContent
from slopecli.types import Camera, CameraModel

# where the coefficients are, and their places in OpenCV's order k1 k2 p1 p2 k3
LENSES: dict[str, tuple[CameraModel, str, str]] = {
    "pinhole": ("pinhole", "", ""),
    "pinhole_radial_k1": ("brown", "disto_k1", "k1"),
    "pinhole_radial_k3": ("brown", "disto_k3", "k1 k2 k3"),
    "pinhole_brown_t2": ("brown", "disto_t2", "k1 k2 k3 p1 p2"),
    "fisheye": ("fisheye", "fisheye", "k1 k2 k3 k4"),
}


def find(content: CameraFileContent) -> dict[str, tuple[str, values.Tree]]:
    """The kind and the data of each camera by its key; {} for another format."""
    listed = content.tree.get("intrinsics")
    if not isinstance(listed, list):
        return {}
    found: dict[str, tuple[str, values.Tree]] = {}
    kinds: dict[Any, str] = {}
    for row in listed:
        value = row.get("value") if isinstance(row, Mapping) else None
        wrapper = value.get("ptr_wrapper") if isinstance(value, Mapping) else None
        if not isinstance(value, Mapping) or not isinstance(wrapper, Mapping):
            continue
        identity, kind = value.get("polymorphic_id"), value.get("polymorphic_name")
        if isinstance(identity, int):  # its highest bit is set where the name comes with it, for the first time
            kind = kinds.setdefault(identity & 0x7FFFFFFF, str(kind))
        data = wrapper.get("data")
        name = str(row.get("key", len(found)))
        if name in found:
            raise InputError(f"has the camera {name!r} twice; keep one of them")
        found[name] = str(kind), data if isinstance(data, Mapping) else {}
    return {"": next(iter(found.values()))} if len(found) == 1 else found


def read(camera: tuple[str, values.Tree], image: values.Size | None) -> Camera:
    """The parameters of newer files are below `value0`."""
    kind, tree = camera
    if kind not in LENSES:
        raise InputError(f"the OpenMVG camera {kind[:40]!r} is not supported, only {', '.join(LENSES)} are")
    model, place, order = LENSES[kind]
    inner = tree.get("value0")
    tree = {**inner, **tree} if isinstance(inner, Mapping) else tree
    values.refuse_unread_distortion(tree, (place,), f"a {kind} camera has its coefficients under {place or 'no name'}")
    names = order.split()
    given = values.numbers(tree.get(place), place) if place else []
    if len(given) != len(names):
        raise InputError(f"{place} has {len(given)} coefficients, a {kind} camera has {order}")
    named = dict(zip(names, given, strict=True))
    centre = values.numbers(tree.get("principal_point"), "principal_point")
    if len(centre) != 2:
        raise InputError(f"principal_point has {len(centre)} numbers, needed x and y")
    focal = values.number(tree.get("focal_length"), "focal_length")
    own = values.size_of(tree.get("width"), tree.get("height"))
    lens = values.named_coefficients(named, model) if names else []
    return values.make_camera("OpenMVG", own or image, (focal, focal, *centre), model, lens, size_given=own is not None)
