"""nerfstudio's transforms.json, with shared or per-frame intrinsics; pixel centres at (0.5, 0.5), as in COLMAP."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import PurePosixPath
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
    refuse_nonzero,
    refuse_unread_distortion,
    size_of,
)
from slopecli.types import Camera


def find_nerfstudio(content: CameraFileContent) -> dict[str, Any]:
    """One nameless camera, or the cameras of the frames by their file names; {} for another format."""
    tree = content.tree
    if "fl_x" in tree:
        return {"": tree}
    frames = tree.get("frames")
    if not isinstance(frames, list):
        return {}
    frames = [f for f in frames if isinstance(f, Mapping) and "fl_x" in f and "file_path" in f]
    return {PurePosixPath(str(frame["file_path"])).name: {**tree, **frame} for frame in frames}


def read_nerfstudio(tree: Tree, size: Size | None) -> Camera:
    """The principal point is shifted by half a pixel; without one it is in the middle of the image."""
    refuse_unread_distortion(tree, (), "give the coefficients as k1, k2, p1, p2, ...")
    model = lens_model(tree.get("camera_model", "OPENCV"), "camera_model")
    model = "fisheye" if tree.get("is_fisheye") else "brown" if model == "pinhole" else model
    if model == "brown":
        refuse_nonzero(tree, ("k4",), "radial distortion of order 8")
    else:
        refuse_nonzero(tree, ("p1", "p2"), "tangential distortion of a fisheye lens")
    size = known_size(size_of(tree.get("w"), tree.get("h")) or size)
    fx = number(tree["fl_x"], "fl_x")
    fy = number(tree.get("fl_y", fx), "fl_y")
    cx, cy = (number(tree.get(key, side / 2), key) - 0.5 for key, side in zip(("cx", "cy"), size, strict=True))
    return make_camera("nerfstudio", size, (fx, fy, cx, cy), model, named_coefficients(tree, model))
