"""ROS sensor_msgs/CameraInfo: the calibration file, and the output of `topic echo` (ROS 1 and 2)."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

from slopecli.errors import InputError
from slopecli.io.cameras import values
from slopecli.io.cameras.content import CameraFileContent
from slopecli.io.cameras.lens_marks import marked_model
from slopecli.io.cameras.sizes import image_size
from slopecli.types import Camera

LENS_KEYS = ("distortion_model", "distortion_coefficients")


def find(content: CameraFileContent) -> dict[str, Any]:
    """The camera under its `camera_name` ("" without one); {} for another format."""
    tree = content.tree
    own = "distortion_model" in tree and any(key in tree for key in ("camera_matrix", "K", "k"))
    return {str(tree.get("camera_name") or ""): tree} if own else {}


def read(tree: values.Tree, size: values.Size | None) -> Camera:
    """K is for the full sensor; the image is its region of interest, then binned (sensor_msgs/CameraInfo).

    Binning averages neighbouring pixels, so the principal point moves as in `scale_camera`.
    """
    values.refuse_unread_distortion(tree, LENS_KEYS, "list the coefficients as distortion_coefficients")
    matrix = next(key for key in ("camera_matrix", "K", "k") if key in tree)
    lens = next((tree[key] for key in ("distortion_coefficients", "D", "d") if key in tree), None)
    model = marked_model(tree) or "pinhole"
    if lens is None and model != "pinhole":
        raise InputError(f"distortion_model is {tree['distortion_model']}, but D (distortion_coefficients) is missing")
    coefficients = values.numbers(lens, "distortion coefficients")
    fx, fy, cx, cy = values.intrinsics_of_matrix(tree[matrix], matrix)
    own, note = image_size(tree, (cx, cy), size)
    full, make = own or size, partial(values.make_camera, "ROS camera_info", note=note, size_given=own is not None)
    camera = make(full, (fx, fy, cx, cy), model, coefficients)
    left, top, width, height = _region(tree, (camera.width, camera.height))
    across, down = (max(1, int(values.number(tree.get(f"binning_{axis}", 1) or 1, f"binning_{axis}"))) for axis in "xy")
    centre = (cx - left + 0.5) / across - 0.5, (cy - top + 0.5) / down - 0.5
    size = values.size_of(width // across, height // down)
    return make(size, (fx / across, fy / down, *centre), model, coefficients)


def _region(tree: values.Tree, full: values.Size) -> tuple[int, int, int, int]:
    """x, y, width, height of the region of interest; zero width or height means the whole sensor."""
    roi = tree.get("roi") or {}
    if not isinstance(roi, Mapping):
        raise InputError(f"roi is {roi!r}, needed x_offset, y_offset, width and height")
    x, y, width, height = (
        int(values.number(roi.get(key, 0), f"roi.{key}")) for key in ("x_offset", "y_offset", "width", "height")
    )
    return (x, y, width, height) if width and height else (0, 0, *full)
