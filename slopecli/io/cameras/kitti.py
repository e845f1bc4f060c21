"""KITTI's calibration: calib.txt of the odometry and object sets, calib_cam_to_cam.txt of the raw recordings.

Source: Geiger et al., "Vision meets robotics: the KITTI dataset", 2013. P are 3x4 matrices of rectified images; K, D
and S (the size) are of the images as recorded. Pixel centres are at integers.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

from slopecli.errors import InputError
from slopecli.io.cameras import values
from slopecli.io.cameras.content import CameraFileContent
from slopecli.types import Camera

LINE = re.compile(r"^((?:P|K|D|S|S_rect|P_rect)_?\d{1,2}):[ \t]+([^\r\n]*)", re.MULTILINE)
Lines = Mapping[str, list[str]]


def images_called(camera: str) -> str:
    """The folder that the images of P0 to P3 are in; images of K_00 and P_rect_00 are in folders of the same name."""
    return camera.replace("P", "image_") if len(camera) == 2 else ""


def find(content: CameraFileContent) -> dict[str, tuple[str, Lines]]:
    """The matrices P and K by their names, each with all lines; {} for another format."""
    if content.is_binary or content.text.lstrip().startswith(("{", "[", "<", "%")):
        return {}
    lines = [(match[1], match[2].split()) for match in LINE.finditer(content.text)]
    if not any(len(numbers) == 12 for name, numbers in lines if name.startswith("P")):
        return {}
    values.refuse_twice(name for name, _ in lines)
    named = dict(lines)
    return {name: (name, named) for name in named if name.startswith(("P", "K"))}


def read(camera: tuple[str, Lines], image: values.Size | None) -> Camera:
    """Of P the first three columns: the fourth is the place of the camera beside camera 0."""
    name, lines = camera
    numbers = values.numbers(lines[name], name)
    number = name[-2:].lstrip("_")
    own = _size(lines.get(("S_rect_" if name.startswith("P_rect") else "S_") + number)) if "_" in name else None
    if name.startswith("P"):
        if len(numbers) != 12:
            raise InputError(f"{name} has {len(numbers)} numbers, needed a 3x4 matrix")
        rows = [numbers[k : k + 3] for k in (0, 4, 8)]
        lens: list[float] = []
    else:
        rows = [numbers]
        if f"D_{number}" not in lines:
            raise InputError(f"D_{number}, the distortion that belongs to {name}, is missing")
        lens = values.numbers(lines[f"D_{number}"], f"D_{number}")
    return values.make_camera(
        "KITTI", own or image, values.intrinsics_of_matrix(rows, name), "brown", lens, size_given=own is not None
    )


def _size(numbers: list[str] | None) -> values.Size | None:
    if numbers is None:
        return None
    if len(numbers) != 2:
        raise InputError(f"a size has {len(numbers)} numbers, needed width and height")
    return values.size_of(*numbers)
