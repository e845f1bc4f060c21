"""OpenSfM's and OpenDroneMap's camera_models.json and cameras.json.

Lengths are in units of the longer side of the image, and the principal point is measured from its middle.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from slopecli.io.cameras.content import CameraFileContent
from slopecli.io.cameras.values import (
    Size,
    Tree,
    known_size,
    lens_model,
    make_camera,
    named_coefficients,
    number,
    refuse_unread_distortion,
    size_of,
)
from slopecli.types import Camera


def find_opensfm(content: CameraFileContent) -> dict[str, Any]:
    """Cameras by name; {} for another format."""
    tree = content.tree
    cameras = tree.get("cameras") if isinstance(tree.get("cameras"), Mapping) else tree
    return {str(k): v for k, v in (cameras or {}).items() if isinstance(v, Mapping) and "projection_type" in v}


def read_opensfm(tree: Tree, size: Size | None) -> Camera:
    """Converts normalised lengths to pixels; without a focal length per axis, `focal` is that of both."""
    refuse_unread_distortion(tree, (), "give the coefficients as k1, k2, p1, p2, ...")
    model = lens_model(tree["projection_type"], "projection_type")
    size = known_size(size_of(tree.get("width"), tree.get("height")) or size)
    longer = max(size)
    focal = tree.get("focal", tree.get("focal_x"))
    fx = number(tree.get("focal_x", focal), "focal_x") * longer
    fy = number(tree.get("focal_y", focal), "focal_y") * longer
    centre = zip(("c_x", "c_y"), size, strict=True)
    cx, cy = (number(tree.get(key, 0), key) * longer + (side - 1) / 2 for key, side in centre)
    return make_camera("OpenSfM", size, (fx, fy, cx, cy), model, named_coefficients(tree, model))
