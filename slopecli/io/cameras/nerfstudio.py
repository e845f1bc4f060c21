"""nerfstudio's transforms.json, with shared or per-frame intrinsics; pixel centres at (0.5, 0.5), as in COLMAP."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import PurePosixPath
from typing import Any

from slopecli.io.cameras import values
from slopecli.io.cameras.content import CameraFileContent
from slopecli.types import Camera


def find(content: CameraFileContent) -> dict[str, Any]:
    """One nameless camera, or the cameras of the frames by their file names; {} for another format."""
    tree = content.tree
    if "fl_x" in tree:
        return {"": tree}
    frames = tree.get("frames")
    if not isinstance(frames, list):
        return {}
    frames = [f for f in frames if isinstance(f, Mapping) and "fl_x" in f and "file_path" in f]
    return {PurePosixPath(str(frame["file_path"])).name: {**tree, **frame} for frame in frames}


def read(tree: values.Tree, size: values.Size | None) -> Camera:
    """The principal point is shifted by half a pixel; without one it is in the middle of the image."""
    values.refuse_unread_distortion(tree, (), "give the coefficients as k1, k2, p1, p2, ...")
    model = values.lens_model(tree.get("camera_model", "OPENCV"), "camera_model")
    model = "fisheye" if tree.get("is_fisheye") else "brown" if model == "pinhole" else model
    if model == "brown":
        values.refuse_nonzero(tree, ("k4",), "radial distortion of order 8")
    else:
        values.refuse_nonzero(tree, ("p1", "p2"), "tangential distortion of a fisheye lens")
    size = values.known_size(values.size_of(tree.get("w"), tree.get("h")) or size)
    fx = values.number(tree["fl_x"], "fl_x")
    fy = values.number(tree.get("fl_y", fx), "fl_y")
    cx, cy = (values.number(tree.get(key, side / 2), key) - 0.5 for key, side in zip(("cx", "cy"), size, strict=True))
    return values.make_camera("nerfstudio", size, (fx, fy, cx, cy), model, values.named_coefficients(tree, model))
