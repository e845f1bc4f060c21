"""The native camera file: JSON or YAML with width, height, fx, fy, cx, cy (or K), distortion and model."""

from __future__ import annotations

from typing import Any

from slopecli.errors import InputError
from slopecli.io.cameras import values
from slopecli.io.cameras.content import CameraFileContent
from slopecli.types import Camera

NUMBERS = ("fx", "fy", "cx", "cy")
KEYS = {"width", "height", *NUMBERS, "K", "distortion", "model"}
NOTES = {"name", "source", "comment", "description"}


def find(content: CameraFileContent) -> dict[str, Any]:
    """The camera under its `name` ("" without one); {} for another format."""
    tree = content.tree
    own = "fx" in tree or ("K" in tree and set(tree) <= KEYS | NOTES)
    return {str(tree.get("name", "")): tree} if own else {}


def read(tree: values.Tree, size: values.Size | None) -> Camera:
    """Missing coefficients count as 0; an unknown key is an error, as it may be a misspelt coefficient."""
    unknown = sorted(set(map(str, tree)) - KEYS - NOTES)
    if unknown:
        raise InputError(f"unknown key {unknown[0]!r}; a native camera file has {', '.join(sorted(KEYS))}")
    model = values.lens_model(tree.get("model", "brown"), "model")
    given = values.numbers(tree.get("distortion"), "distortion")
    counts = (0, 4) if model == "fisheye" else (0, 4, 5, 8)
    coefficients = given + [0.0] * (next((c for c in counts if c >= len(given)), 0) - len(given))
    size = values.size_of(tree.get("width"), tree.get("height")) or size
    return values.make_camera("native", size, _intrinsics(tree), model, coefficients)


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
