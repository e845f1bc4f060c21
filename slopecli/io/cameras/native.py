"""The native camera file: JSON or YAML with width, height, fx, fy, cx, cy (or K), distortion and model."""

from __future__ import annotations

from typing import Any

from slopecli.errors import InputError
from slopecli.geometry.camera import MAX_COEFFICIENTS
from slopecli.io.cameras import values
from slopecli.io.cameras.content import CameraFileContent
from slopecli.io.cameras.lens_marks import is_mark_key, marked_model
from slopecli.io.cameras.sizes import image_size, is_size_key
from slopecli.types import Camera, CameraModel

NUMBERS = ("fx", "fy", "cx", "cy")
KEYS = {"width", "height", *NUMBERS, "K", "distortion", "model"}
NOTES = {"name", "source", "comment", "description"}


def find(content: CameraFileContent) -> dict[str, Any]:
    """The camera under its `name` ("" without one); {} for another format."""
    tree = content.tree
    own = "fx" in tree or ("K" in tree and set(tree) <= KEYS | NOTES)
    return {str(tree.get("name") or ""): tree} if own else {}


def read(tree: values.Tree, size: values.Size | None) -> Camera:
    """Missing coefficients count as 0; an unknown key is an error, as it may be a misspelt coefficient."""
    others = [str(key) for key in tree if not (is_size_key(key) or is_mark_key(key))]
    unknown = sorted(set(others) - KEYS - NOTES - set(values.BROWN_ORDER))
    if unknown:
        raise InputError(f"unknown key {unknown[0]!r}; a native camera file has {', '.join(sorted(KEYS))}")
    # names that other programs give to other lenses
    own_names = tree.get("model") in ("polynomial", "cahvor", "division")
    model: CameraModel = tree["model"] if own_names else marked_model(tree) or "brown"
    named = [key for key in values.BROWN_ORDER if key in tree]
    if named and "distortion" in tree:
        raise InputError(f"both distortion and {named[0]} are given; keep one of them")
    given = values.coefficients_by_name(tree if named else tree.get("distortion"), model, "distortion")
    counts = (0, MAX_COEFFICIENTS[model]) if own_names else (0, 4) if model == "fisheye" else (0, 4, 5, 8)
    coefficients = given + [0.0] * (next((c for c in counts if c >= len(given)), 0) - len(given))
    fx, fy, cx, cy = _intrinsics(tree)
    own, note = image_size(tree, (cx, cy), size)
    return values.make_camera(
        "native", own or size, (fx, fy, cx, cy), model, coefficients, note=note, size_given=own is not None
    )


def _intrinsics(tree: values.Tree) -> values.Intrinsics:
    if "K" in tree:
        if any(name in tree for name in NUMBERS):
            raise InputError("both K and fx, fy, cx, cy are given; keep one of them")
        return values.intrinsics_of_matrix(tree["K"], "K")
    missing = [name for name in NUMBERS if name not in tree]
    if missing:
        raise InputError(f"{missing[0]} is missing; a camera needs fx, fy, cx and cy, or K")
    fx, fy, cx, cy = (values.number(tree[name], name) for name in NUMBERS)
    return fx, fy, cx, cy
