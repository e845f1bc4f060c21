"""nerfstudio's transforms.json, with shared or per-frame intrinsics; pixel centres at (0.5, 0.5), as in COLMAP."""

from __future__ import annotations

import re
from collections.abc import Mapping

from slopecli.errors import InputError
from slopecli.io.cameras import values
from slopecli.io.cameras.content import CameraFileContent
from slopecli.io.cameras.lens_marks import is_mark_key, marked_model
from slopecli.io.cameras.sizes import image_size, is_size_key
from slopecli.types import Camera

TERMS = re.compile("fl_[xy]|c[xy]|k[1-6]|p[1-4]")
Described = tuple[values.Tree, str]  # a camera's names and values, and a note where file and frame share them


def find(content: CameraFileContent) -> dict[str, Described]:
    """One nameless camera, or the cameras of the frames by their paths; {} for another format.

    What a frame does not say is that of the file; where both speak, the frame does.
    """
    tree = content.tree
    listed = tree.get("frames")
    frames = [frame for frame in listed if isinstance(frame, Mapping)] if isinstance(listed, list) else []
    shared = {key: value for key, value in tree.items() if key != "frames"}
    if not any("fl_x" in one for one in (tree, *frames)):
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


def _is_of_camera(key: str) -> bool:
    return bool(TERMS.fullmatch(key)) or is_size_key(key) or is_mark_key(key)


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
    if "fl_x" not in tree:
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
    fx = values.number(tree["fl_x"], "fl_x")
    fy = values.number(tree.get("fl_y", fx), "fl_y")
    cx, cy = (side / 2 - 0.5 if c is None else c for c, side in zip(centre, size, strict=True))
    coefficients = values.named_coefficients(tree, model)
    note = "; ".join(filter(None, (merged, turned)))
    return values.make_camera(
        "nerfstudio", size, (fx, fy, cx, cy), model, coefficients, note=note, size_given=own is not None
    )
