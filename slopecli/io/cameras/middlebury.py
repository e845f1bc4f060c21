"""calib.txt of the Middlebury stereo sets of 2014 and 2021: rectified images without distortion.

Source: Scharstein et al., "High-resolution stereo datasets with subpixel-accurate ground truth", 2014, and the page of
the data: doffs is the difference of the principal points in x.
"""

from __future__ import annotations

import re
from typing import Any

from slopecli.errors import InputError
from slopecli.io.cameras import values
from slopecli.io.cameras.content import CameraFileContent
from slopecli.types import Camera

MATRIX = re.compile(r"^(cam[01])[ \t]*=[ \t]*\[([^\]\r\n]*)\]", re.MULTILINE)
NUMBER = re.compile(r"^(width|height|doffs)[ \t]*=[ \t]*([^\s]+)", re.MULTILINE)


def images_called(camera: str) -> str:
    """What images of cam0 and cam1 are called."""
    return camera.replace("cam", "im")


def find(content: CameraFileContent) -> dict[str, dict[str, Any]]:
    """The matrices cam0 and cam1 of the files im0 and im1; {} for another format."""
    if content.is_binary or "cam0" not in content.text:
        return {}
    matrices = MATRIX.findall(content.text)
    pairs = NUMBER.findall(content.text)
    values.refuse_twice(name for name, _ in [*matrices, *pairs])
    named = {name: [row.split() for row in text.split(";")] for name, text in matrices}
    return {name: {**dict(pairs), **named, "matrix": matrix} for name, matrix in named.items()}


def read(tree: values.Tree, image: values.Size | None) -> Camera:
    """The difference of the principal points must be the one stated, else the matrices are of other images."""
    own = values.size_of(tree.get("width"), tree.get("height"))
    intrinsics = values.intrinsics_of_matrix(tree["matrix"], "cam0 or cam1")
    if "doffs" in tree and {"cam0", "cam1"} <= set(tree):
        left, right = (values.intrinsics_of_matrix(tree[name], name)[2] for name in ("cam0", "cam1"))
        doffs = values.number(tree["doffs"], "doffs")
        if abs(right - left - doffs) > 0.01:  # three decimals are written
            raise InputError(
                f"doffs = {doffs:g}, but the principal points of cam0 and cam1 differ by {right - left:g}; are the "
                "cameras exchanged, or of another size?"
            )
    return values.make_camera("Middlebury", own or image, intrinsics, size_given=own is not None)
