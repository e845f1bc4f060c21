"""OpenSfM's and OpenDroneMap's camera_models.json and cameras.json.

Lengths are in units of the longer side of the image, and the principal point is measured from its middle.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from slopecli.io.cameras import values
from slopecli.io.cameras.content import CameraFileContent
from slopecli.types import Camera


def find(content: CameraFileContent) -> dict[str, Any]:
    """Cameras by name; {} for another format."""
    tree = content.tree
    cameras = tree.get("cameras") if isinstance(tree.get("cameras"), Mapping) else tree
    return {str(k): v for k, v in (cameras or {}).items() if isinstance(v, Mapping) and "projection_type" in v}


def read(tree: values.Tree, size: values.Size | None) -> Camera:
    """Converts normalised lengths to pixels; without a focal length per axis, `focal` is that of both."""
    values.refuse_unread_distortion(tree, (), "give the coefficients as k1, k2, p1, p2, ...")
    model = values.lens_model(tree["projection_type"], "projection_type")
    size = values.known_size(values.size_of(tree.get("width"), tree.get("height")) or size)
    longer = max(size)
    focal = tree.get("focal", tree.get("focal_x"))
    fx = values.number(tree.get("focal_x", focal), "focal_x") * longer
    fy = values.number(tree.get("focal_y", focal), "focal_y") * longer
    centre = zip(("c_x", "c_y"), size, strict=True)
    cx, cy = (values.number(tree.get(key, 0), key) * longer + (side - 1) / 2 for key, side in centre)
    return values.make_camera("OpenSfM", size, (fx, fy, cx, cy), model, values.named_coefficients(tree, model))
