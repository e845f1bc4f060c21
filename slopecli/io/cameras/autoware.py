"""Autoware's camera calibration: `CameraMat`, `DistCoeff`, `ImageSize` and `DistModel`."""

from __future__ import annotations

from slopecli.errors import InputError
from slopecli.io.cameras import values
from slopecli.io.cameras.content import CameraFileContent
from slopecli.io.cameras.lens_marks import marked_model
from slopecli.io.cameras.sizes import image_size
from slopecli.types import Camera


def find(content: CameraFileContent) -> dict[str, values.Tree]:
    """The camera; {} for another format."""
    return {"": content.tree} if "CameraMat" in content.tree else {}


def read(tree: values.Tree, image: values.Size | None) -> Camera:
    """The size is width, height; `CameraExtrinsicMat` is of the lidar and not read."""
    values.refuse_unread_distortion(tree, ("DistCoeff", "DistModel"), "list the coefficients as DistCoeff")
    if "DistCoeff" not in tree:
        raise InputError("DistCoeff, the distortion that belongs to CameraMat, is missing")
    fx, fy, cx, cy = values.intrinsics_of_matrix(tree["CameraMat"], "CameraMat")
    coefficients = values.numbers(tree["DistCoeff"], "DistCoeff")
    model = marked_model(tree) or "brown"
    own, note = image_size(tree, (cx, cy), image)
    return values.make_camera(
        "Autoware", own or image, (fx, fy, cx, cy), model, coefficients, note=note, size_given=own is not None
    )
