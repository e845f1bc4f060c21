"""Intrinsics of Intel RealSense cameras, `rs2_intrinsics` as JSON: ppx, ppy, fx, fy, model, coeffs.

Source: "Projection in RealSense SDK 2.0". Pixel centres are at integers.
"""

from __future__ import annotations

from slopecli.errors import InputError
from slopecli.io.cameras import values
from slopecli.io.cameras.content import CameraFileContent
from slopecli.io.cameras.sizes import image_size
from slopecli.types import Camera, CameraModel

# rs2_distortion in its order, by which some programs write it
MODELS = ("none", "modifiedbrownconrady", "inversebrownconrady", "ftheta", "brownconrady", "kannalabrandt4")
WHY_NOT = {
    "inversebrownconrady": "versions of librealsense apply them in opposite directions",
    "modifiedbrownconrady": "the model is not supported",
    "ftheta": "the model is not supported",
}


def find(content: CameraFileContent) -> dict[str, values.Tree]:
    """The camera; {} for another format."""
    tree = content.tree
    return {"": tree} if {"ppx", "ppy", "fx", "fy"} <= set(tree) else {}


def read(tree: values.Tree, image: values.Size | None) -> Camera:
    """Coefficients that are all 0 are none, whatever the model, as for most colour and all rectified streams."""
    values.refuse_unread_distortion(tree, ("coeffs", "distortion_model"), "list the coefficients as coeffs")
    fx, fy, cx, cy = (values.number(tree[key], key) for key in ("fx", "fy", "ppx", "ppy"))
    if "coeffs" not in tree:
        raise InputError("coeffs, the distortion, is missing; five zeros if there is none")
    coefficients = values.numbers(tree["coeffs"], "coeffs")
    model, coefficients = _lens(tree, coefficients)
    own, note = image_size(tree, (cx, cy), image)
    return values.make_camera(
        "RealSense", own or image, (fx, fy, cx, cy), model, coefficients, note=note, size_given=own is not None
    )


def _lens(tree: values.Tree, coefficients: list[float]) -> tuple[CameraModel, list[float]]:
    given = tree.get("model", tree.get("distortion_model"))
    plain = values.plain_key(given).removeprefix("distortion").removeprefix("rs2distortion")
    if plain.isdigit() and int(plain) < len(MODELS):
        plain = MODELS[int(plain)]
    if plain == "kannalabrandt4":
        if any(coefficients[4:]):
            raise InputError(f"coeffs has {len(coefficients)} numbers, a Kannala-Brandt lens takes four and zeros")
        return "fisheye", coefficients[:4]
    if plain not in MODELS:
        raise InputError(f"the RealSense model {str(given)[:40]!r} is not known; give its name as librealsense does")
    if not any(coefficients):
        return "pinhole", []
    if plain not in ("brownconrady", "none"):
        raise InputError(
            f"the RealSense model {str(given)[:40]!r} has coefficients that are not 0: {WHY_NOT[plain]}; calibrate "
            "the camera with OpenCV or Kalibr, or undistort the images first"
        )
    return ("brown" if plain == "brownconrady" else "pinhole"), coefficients
