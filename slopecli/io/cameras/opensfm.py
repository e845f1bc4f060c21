"""OpenSfM's and OpenDroneMap's camera_models.json, cameras.json and reconstruction.json.

Lengths are in units of the longer side of the image, and the principal point is measured from its middle.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from slopecli.errors import InputError
from slopecli.io.cameras import values
from slopecli.io.cameras.content import CameraFileContent
from slopecli.io.cameras.lens_marks import marked_model
from slopecli.io.cameras.sizes import image_size
from slopecli.types import Camera


def find(content: CameraFileContent) -> dict[str, Any]:
    """Cameras by name, of several reconstructions as well; {} for another format."""
    found: dict[str, Any] = {}
    for number, tree in enumerate((content.tree, *content.rows)):
        cameras = tree.get("cameras") if isinstance(tree.get("cameras"), Mapping) else tree
        for name, camera in (cameras or {}).items():
            if isinstance(camera, Mapping) and "projection_type" in camera:
                # each reconstruction has adjusted its cameras for itself
                same = found.setdefault(str(name), camera) == camera
                found |= {} if same else {f"{number}/{name}": camera}
    return found


def read(tree: values.Tree, size: values.Size | None) -> Camera:
    """Converts normalised lengths to pixels; without a focal length per axis, `focal` is that of both."""
    values.refuse_unread_distortion(tree, (), "give the coefficients as k1, k2, p1, p2, ...")
    model = marked_model(tree) or "brown"
    own, note = image_size(tree, image=size)
    size = values.known_size(own or size)
    longer = max(size)
    focal = tree.get("focal", tree.get("focal_x"))
    fx = values.number(tree.get("focal_x", focal), "focal_x") * longer
    fy = values.number(tree.get("focal_y", focal), "focal_y") * longer
    if max(fx, fy) > 20 * longer:
        raise InputError(
            f"focal = {fx / longer:g}: OpenSfM's is in units of the longer side of the image, not px or mm"
        )
    off = [values.number(tree.get(key, 0), key) for key in ("c_x", "c_y")]
    if max(map(abs, off)) > 0.25:
        raise InputError(
            f"c_x = {off[0]:g}, c_y = {off[1]:g} put the principal point far off the middle; OpenSfM measures them "
            "from the middle of the image, in units of its longer side (0.5 is its edge): is it from a corner?"
        )
    cx, cy = (place * longer + (side - 1) / 2 for place, side in zip(off, size, strict=True))
    coefficients = values.named_coefficients(tree, model)
    return values.make_camera(
        "OpenSfM", size, (fx, fy, cx, cy), model, coefficients, note=note, size_given=own is not None
    )
