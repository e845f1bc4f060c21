"""cameras.json of 3D Gaussian splatting: a list of images, each with the focal lengths of its undistorted camera."""

from __future__ import annotations

from slopecli.errors import InputError
from slopecli.io.cameras import values
from slopecli.io.cameras.content import CameraFileContent
from slopecli.types import Camera

KEYS = {"img_name", "width", "height", "fx", "fy"}
CENTRED = "it has no principal point: the middle of the image is taken, as 3D Gaussian splatting does"


def find(content: CameraFileContent) -> dict[str, values.Tree]:
    """Cameras by the names of their images; {} for another format."""
    if content.is_binary or '"img_name"' not in content.text:
        return {}
    rows = [row for row in content.rows if set(row) >= KEYS]
    values.refuse_twice(str(row["img_name"]) for row in rows)
    return {str(row["img_name"]): row for row in rows}


def read(row: values.Tree, image: values.Size | None) -> Camera:
    """The principal point is in the middle of the image."""
    values.refuse_unread_distortion(row, (), "3D Gaussian splatting takes undistorted images")
    if {"cx", "cy"} & set(row):
        raise InputError("cx or cy is given, which 3D Gaussian splatting does not write; which program did?")
    size = values.known_size(values.size_of(row["width"], row["height"]) or image)
    fx, fy = (values.number(row[key], key) for key in ("fx", "fy"))
    return values.make_camera(
        "3D Gaussian splatting", size, (fx, fy, (size[0] - 1) / 2, (size[1] - 1) / 2), note=CENTRED
    )
