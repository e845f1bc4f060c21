"""AliceVision's and Meshroom's .sfm and cameras.sfm; what the numbers mean depends on the version of the file.

Source: AliceVision's sfmDataIO. Until 1.2 one focal length in pixels, until 1.2.2 two; then millimetres, with the
sensor's width. Until 1.2.1 the principal point is measured from the first pixel, then from the middle (w/2, h/2). Pixel
centres are at integers.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from slopecli.errors import InputError
from slopecli.io.cameras import values
from slopecli.io.cameras.content import CameraFileContent
from slopecli.types import Camera, CameraModel

# kinds of lenses, and the coefficients they come with
LENSES: dict[str, tuple[CameraModel, str]] = {
    **dict.fromkeys(("pinhole", "none"), ("pinhole", "")),
    **dict.fromkeys(("radial1", "radialk1"), ("brown", "k1")),
    **dict.fromkeys(("radial3", "radialk3"), ("brown", "k1 k2 k3")),
    "brown": ("brown", "k1 k2 k3 p1 p2"),
    **dict.fromkeys(("fisheye4", "fisheye"), ("fisheye", "k1 k2 k3 k4")),
}
Version = tuple[int, ...]


def find(content: CameraFileContent) -> dict[str, tuple[Version, values.Tree]]:
    """Cameras by their intrinsicId, with the version of the file; {} for another format."""
    listed = content.tree.get("intrinsics")
    rows = [row for row in listed if isinstance(row, Mapping)] if isinstance(listed, list) else []
    rows = [row for row in rows if "intrinsicId" in row]
    if not rows:
        return {}
    values.refuse_twice(f"camera {row['intrinsicId']}" for row in rows)
    version = tuple(int(part) for part in values.numbers(content.tree.get("version"), "version"))
    if len(rows) == 1:
        return {"": (version, rows[0])}
    return {str(row["intrinsicId"]): (version, row) for row in rows}


def read(camera: tuple[Version, values.Tree], image: values.Size | None) -> Camera:
    """Lenses of 3DEqualizer, equidistant cameras and those with an undistortion of their own are refused by name."""
    version, tree = camera
    if len(version) != 3:
        raise InputError("its version is missing, without which focal length and principal point have no meaning")
    model, names = _lens_kind(tree)
    own = values.size_of(tree.get("width"), tree.get("height"))
    size = values.known_size(own or image)
    fx, fy = _focal(tree, version, size)
    x, y = _two(tree.get("principalPoint"), "principalPoint")
    middle = size[0] / 2, size[1] / 2
    if version < (1, 2, 1):
        x, y = x - middle[0], y - middle[1]
    origin = "a corner" if version < (1, 2, 1) else "there"
    values.refuse_off_middle((x, y), size, f"files of version {'.'.join(map(str, version))} measure it from {origin}")
    given = values.numbers(tree.get("distortionParams") or [], "distortionParams")
    if not names and any(given):
        raise InputError(f"distortionParams are given, but the camera is a {tree.get('type')} without distortion")
    if names and len(given) not in (0, len(names)):
        raise InputError(f"distortionParams has {len(given)} numbers, this camera has {' '.join(names)}")
    named = dict(zip(names, given, strict=False))
    coefficients = values.named_coefficients(named, model) if named else []
    intrinsics = fx, fy, middle[0] + x, middle[1] + y
    return values.make_camera("AliceVision", size, intrinsics, model, coefficients, size_given=own is not None)


def _lens_kind(tree: values.Tree) -> tuple[CameraModel, list[str]]:
    kind = str(tree.get("type", "")).lower()
    lens = str(tree.get("distortionType", kind)).lower() if kind == "pinhole" else kind
    for name in (kind, lens):
        if name not in LENSES:
            raise InputError(f"the AliceVision camera {name[:40]!r} is not supported; export undistorted images")
    undistortion = values.numbers(tree.get("undistortionParams") or [], "undistortionParams")
    if any(undistortion):
        raise InputError("undistortionParams of 3DEqualizer are not supported; export undistorted images")
    model, names = LENSES[lens]
    return model, names.split()


def _focal(tree: values.Tree, version: Version, size: values.Size) -> tuple[float, float]:
    if version < (1, 2, 0):
        focal = values.number(tree.get("pxFocalLength"), "pxFocalLength")
        return focal, focal
    if version < (1, 2, 2):
        return _two(tree.get("pxFocalLength"), "pxFocalLength")
    focal, sensor = (values.number(tree.get(key), key) for key in ("focalLength", "sensorWidth"))
    ratio = values.number(tree.get("pixelRatio", 1), "pixelRatio")
    if sensor <= 0 or ratio <= 0:
        raise InputError(f"sensorWidth = {sensor:g}, pixelRatio = {ratio:g}, needed more than 0")
    fx = focal / sensor * size[0]
    # before 1.2.5 the ratio was that of the focal lengths
    return fx, fx / ratio if version < (1, 2, 5) else fx * ratio


def _two(value: Any, name: str) -> tuple[float, float]:
    """Two numbers in a list, or x and y."""
    if isinstance(value, Mapping):
        value = [value.get("x"), value.get("y")]
    found = values.numbers(value, name)
    if len(found) != 2:
        raise InputError(f"{name} has {len(found)} numbers, needed two")
    return found[0], found[1]
