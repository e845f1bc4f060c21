"""transforms.json of nerfstudio, instant-ngp and NeRF's synthetic scenes, with shared or per-frame intrinsics.

Pixel centres are at (0.5, 0.5), as in COLMAP. `camera_angle_x` is the horizontal field of view in radians.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

from slopecli.errors import InputError
from slopecli.io.cameras import values
from slopecli.io.cameras.content import CameraFileContent
from slopecli.io.cameras.lens_marks import is_mark_key, marked_model
from slopecli.io.cameras.sizes import image_size, is_size_key
from slopecli.types import Camera

TERMS = re.compile("fl_[xy]|camera_angle_[xy]|c[xy]|k[1-6]|p[1-4]")
Described = tuple[values.Tree, str]  # a camera's names and values, and a note where file and frame share them


def find(content: CameraFileContent) -> dict[str, Described]:
    """One nameless camera, or the cameras of the frames by their paths; {} for another format.

    What a frame does not say is that of the file; where both speak, the frame does.
    """
    tree = content.tree
    listed = tree.get("frames")
    frames = [frame for frame in listed if isinstance(frame, Mapping)] if isinstance(listed, list) else []
    shared = {key: value for key, value in tree.items() if key != "frames"}
    if not any("fl_x" in one or "camera_angle_x" in one for one in (tree, *frames)):
        return {}
    own = [frame for frame in frames if any(map(_is_of_camera, frame))]
    if not own:
        return {"": (shared, "")}
    cameras: dict[str, Described] = {}
    for frame in frames:
        name = re.sub(r"^(\./)+", "", str(frame.get("file_path", "")).replace("\\", "/"))
        if name in cameras:
            raise InputError(f"has the frame {name!r} twice; keep one of them")
        cameras[name] = ({**shared, **frame}, _merged(shared, frame))
    return cameras


def _is_of_camera(key: Any) -> bool:
    return bool(TERMS.fullmatch(str(key))) or is_size_key(key) or is_mark_key(key)


def _merged(shared: values.Tree, frame: values.Tree) -> str:
    """What is said of a camera that the file and its frame describe together, "" for one that either does alone."""
    of_file, of_frame = ([key for key in tree if _is_of_camera(key)] for tree in (shared, frame))
    taken = [key for key in of_file if key not in of_frame and key != "camera_model"]
    if not of_frame or not taken:
        return ""
    both = [key for key in of_file if key in of_frame and shared[key] != frame[key]]
    instead = f" ({', '.join(both)} instead of the file's)" if both else ""
    return f"{', '.join(taken)} of the whole file and {', '.join(of_frame)} of the frame{instead} are read together"


def read(camera: Described, size: values.Size | None) -> Camera:
    """The principal point is shifted by half a pixel; without one it is in the middle of the image."""
    tree, merged = camera
    values.refuse_unread_distortion(tree, (), "give the coefficients as k1, k2, p1, p2, ...")
    if "fl_x" not in tree and "camera_angle_x" not in tree:
        raise InputError("fl_x is missing in this frame and in the file")
    model = marked_model(tree) or "brown"
    model = "brown" if model == "pinhole" else model
    if model == "brown":
        values.refuse_nonzero(tree, ("k4",), "radial distortion of order 8")
    else:
        values.refuse_nonzero(tree, ("p1", "p2"), "tangential distortion of a fisheye lens")
    centre = [values.number(tree[key], key) - 0.5 if key in tree else None for key in ("cx", "cy")]
    both = None if centre[0] is None or centre[1] is None else (centre[0], centre[1])
    own, turned = image_size(tree, both, size)
    size = values.known_size(own or size)
    fx, fy = _focal(tree, size)
    cx, cy = (side / 2 - 0.5 if c is None else c for c, side in zip(centre, size, strict=True))
    coefficients = values.named_coefficients(tree, model)
    note = "; ".join(filter(None, (merged, turned)))
    return values.make_camera(
        "nerfstudio", size, (fx, fy, cx, cy), model, coefficients, note=note, size_given=own is not None
    )


def _focal(tree: values.Tree, size: values.Size) -> tuple[float, float]:
    """Focal lengths, px, which two ways to say them must agree on."""
    angles = [_focal_of_angle(tree, f"camera_angle_{axis}", side) for axis, side in zip("xy", size, strict=True)]
    if "fl_x" not in tree:
        fx = angles[0] or 0.0
        return fx, angles[1] or fx
    fx = values.number(tree["fl_x"], "fl_x")
    fy = values.number(tree.get("fl_y", fx), "fl_y")
    for name, focal, told in (("x", fx, angles[0]), ("y", fy, angles[1])):
        if told and abs(focal - told) > 0.05 * told:  # rounding and changed sizes are less
            raise InputError(
                f"fl_{name} = {focal:g} and camera_angle_{name}, which makes it {told:.6g} for this size, contradict "
                "each other; keep one of them"
            )
    return fx, fy


def _focal_of_angle(tree: values.Tree, key: str, side: int) -> float | None:
    if key not in tree:
        return None
    angle = values.number(tree[key], key)
    if not 0 < angle < math.pi:
        raise InputError(f"{key} = {angle:g} must be a field of view in radians, more than 0 and less than pi")
    return side / 2 / math.tan(angle / 2)
