"""Kalibr's camchain.yaml, and the sensor.yaml of the EuRoC data set."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from slopecli.errors import InputError
from slopecli.io.cameras import values
from slopecli.io.cameras.content import CameraFileContent
from slopecli.io.cameras.lens_marks import marked_model
from slopecli.io.cameras.sizes import image_size
from slopecli.types import Camera

LENS_KEYS = ("distortion_model", "distortion_coeffs", "distortion_coefficients")


def find(content: CameraFileContent) -> dict[str, Any]:
    """Cameras by their key (cam0, cam1, ...), "" for a sensor.yaml; {} for another format."""
    tree = content.tree
    if "camera_model" in tree and "intrinsics" in tree:
        return {"": tree}
    cameras = {str(key): value for key, value in tree.items() if re.fullmatch(r"cam\d+", str(key))}
    return {key: value for key, value in cameras.items() if isinstance(value, Mapping) and "camera_model" in value}


def read(tree: values.Tree, size: values.Size | None) -> Camera:
    """Only pinhole projection, with radial-tangential, equidistant or no distortion."""
    if tree["camera_model"] != "pinhole":
        raise InputError(f"camera_model {tree['camera_model']!r} is not supported, only 'pinhole' is")
    values.refuse_unread_distortion(tree, LENS_KEYS, "list the coefficients as distortion_coeffs")
    model = marked_model(tree) or "pinhole"
    lens = tree.get("distortion_coeffs", tree.get("distortion_coefficients"))
    if lens is None and model != "pinhole":
        raise InputError(f"distortion_model is {tree['distortion_model']}, but distortion_coeffs are missing")
    intrinsics = values.numbers(tree.get("intrinsics"), "intrinsics")
    if len(intrinsics) != 4:
        raise InputError(f"intrinsics has {len(intrinsics)} numbers, needed fx, fy, cx, cy")
    own, note = image_size(tree, (intrinsics[2], intrinsics[3]), size)
    coefficients = values.numbers(lens, "distortion_coeffs")
    return values.make_camera(
        "Kalibr", own or size, intrinsics, model, coefficients, note=note, size_given=own is not None
    )
