"""Camera formats that are a tree of names and values (JSON, YAML): which one a tree is, and what it says.

Each `find_*` returns the cameras of a tree by name, or {} when the tree is of another format; each `read_*` turns one
of them into a Camera. FORMATS lists them in the order they are tried. Formats whose pixel centres lie at (0.5, 0.5)
are shifted by half a pixel into ours.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import PurePosixPath
from typing import Any, NamedTuple

from slopecli.errors import InputError
from slopecli.io.cameras.values import (
    Intrinsics,
    Size,
    intrinsics_of_matrix,
    known_size,
    lens_model,
    make_camera,
    named_coefficients,
    number,
    numbers,
    plain_key,
    refuse_nonzero,
    refuse_unread_distortion,
    size_of,
)
from slopecli.types import Camera

Tree = Mapping[str, Any]


class CameraFormat(NamedTuple):
    """find: cameras of a tree by name ("" when nameless). read: one of them, with the size to use if it gives none."""

    find: Callable[[Tree], dict[str, Any]]
    read: Callable[[Any, Size | None], Camera]


# ---- native: width, height, fx, fy, cx, cy or K, distortion, model ----

NATIVE_NUMBERS = ("fx", "fy", "cx", "cy")
NATIVE_KEYS = {"width", "height", *NATIVE_NUMBERS, "K", "distortion", "model"}
NATIVE_NOTES = {"name", "source", "comment", "description"}


def find_native(tree: Tree) -> dict[str, Any]:
    own = "fx" in tree or ("K" in tree and set(tree) <= NATIVE_KEYS | NATIVE_NOTES)
    return {str(tree.get("name", "")): tree} if own else {}


def read_native(tree: Tree, size: Size | None) -> Camera:
    unknown = sorted(set(map(str, tree)) - NATIVE_KEYS - NATIVE_NOTES)
    if unknown:
        raise InputError(f"unknown key {unknown[0]!r}; a native camera file has {', '.join(sorted(NATIVE_KEYS))}")
    model = lens_model(tree.get("model", "brown"), "model")
    given = numbers(tree.get("distortion"), "distortion")
    coefficients = given + [0.0] * (_padded_count(len(given), model) - len(given))
    size = size_of(tree.get("width"), tree.get("height")) or size
    return make_camera("native", size, _native_intrinsics(tree), model, coefficients)


def _native_intrinsics(tree: Tree) -> Intrinsics:
    if "K" in tree:
        if any(name in tree for name in NATIVE_NUMBERS):
            raise InputError("both K and fx, fy, cx, cy are given; keep one of them")
        return intrinsics_of_matrix(tree["K"], "K")
    missing = [name for name in NATIVE_NUMBERS if name not in tree]
    if missing:
        raise InputError(f"{missing[0]} is missing; a camera needs fx, fy, cx and cy, or K")
    fx, fy, cx, cy = (number(tree[name], name) for name in NATIVE_NUMBERS)
    return fx, fy, cx, cy


def _padded_count(count: int, model: str) -> int:
    """Missing coefficients are 0, so the next count a lens comes with."""
    counts = (0, 4) if model == "fisheye" else (0, 4, 5, 8)
    return next((c for c in counts if c >= count), count)


# ---- OpenCV: camera_matrix and distortion_coefficients under the many names people give them ----

OPENCV_MATRICES = (
    "cameramatrix|intrinsicmatrix|cameraintrinsics|cameraintrinsicmatrix|intrinsics|intrinsic|cammatrix|mtx|k|m"
)
OPENCV_LENSES = (
    "distortioncoefficients|distortioncoeffs|distortioncoefs|distcoefficients|distcoeffs|distcoefs|distcoeff|"
    "distortion|dist|d"
)
OPENCV_KEY = re.compile(
    rf"(?P<before>left|right)?(?:(?P<matrix>{OPENCV_MATRICES})|(?P<lens>{OPENCV_LENSES}))(?P<after>\d+|left|right|l|r)?"
)
OPENCV_WIDTHS = ("image_width", "imageWidth", "width", "img_width", "w")
OPENCV_HEIGHTS = ("image_height", "imageHeight", "height", "img_height", "h")
OPENCV_SIZES = ("image_size", "imageSize", "img_size", "imgSize", "ImageSize", "resolution")
OPENCV_MODELS = ("model", "camera_model", "distortion_model", "lens_model", "model_type")


def find_opencv(tree: Tree) -> dict[str, Any]:
    cameras: dict[str, dict[str, Any]] = {}
    for key, value in tree.items():
        match = OPENCV_KEY.fullmatch(plain_key(key))
        if match is None or (match["matrix"] and not isinstance(value, list | tuple | Mapping)):
            continue
        part = "matrix" if match["matrix"] else "lens"
        camera = cameras.setdefault(match["before"] or match["after"] or "", {"tree": tree})
        if part in camera:
            raise InputError(f"both {camera[part][0]!r} and {key!r} are given; keep one of them")
        camera[part] = key, value
    found = {name: camera for name, camera in cameras.items() if "matrix" in camera}
    for name, camera in cameras.items() if found else ():
        if name not in found:
            raise InputError(f"{camera['lens'][0]!r} belongs to no matrix; give both the same suffix, or none")
    return found


def read_opencv(camera: Mapping[str, Any], size: Size | None) -> Camera:
    tree = camera["tree"]
    _refuse_unread_opencv(tree)
    fisheye = bool(number(tree.get("fisheye_model", 0), "fisheye_model"))
    named = next((tree[key] for key in OPENCV_MODELS if key in tree), None)
    model = lens_model(named) if named is not None else "fisheye" if fisheye else "brown"
    key, value = camera["matrix"]
    lens_key, lens = camera.get("lens", ("", None))
    source = "OpenCV" if lens_key else "OpenCV, no distortion given"
    # a pinhole with coefficients is how many files name OpenCV's usual model
    model = "brown" if model == "pinhole" else model
    intrinsics = intrinsics_of_matrix(value, key)
    return make_camera(source, _opencv_size(tree) or size, intrinsics, model, numbers(lens, lens_key))


def _refuse_unread_opencv(tree: Tree) -> None:
    for key, value in tree.items():
        plain = plain_key(key)
        if plain == "xi":
            raise InputError("an omnidirectional camera (xi) is not supported; undistort the images first")
        if re.fullmatch("[kp][1-6]", plain) and not isinstance(value, list | tuple | Mapping):
            raise InputError(f"{key!r} stands alone; list the coefficients as distortion_coefficients")
    read = [*OPENCV_MODELS, *(key for key in tree if OPENCV_KEY.fullmatch(plain_key(key)))]
    refuse_unread_distortion(tree, read, "list the coefficients as distortion_coefficients")


def _opencv_size(tree: Tree) -> Size | None:
    pair = next((tree[key] for key in OPENCV_SIZES if key in tree), None)
    if pair is not None:
        sides = numbers(pair, "image size")
        if len(sides) != 2:
            raise InputError(f"image size has {len(sides)} numbers, needed width and height")
        return size_of(*sides)
    width, height = (next((tree[key] for key in keys if key in tree), None) for keys in (OPENCV_WIDTHS, OPENCV_HEIGHTS))
    return size_of(width, height)


# ---- ROS camera_info: the calibration file, and what `topic echo` prints ----


ROS_LENSES = ("distortion_model", "distortion_coefficients")


def find_ros(tree: Tree) -> dict[str, Any]:
    own = "distortion_model" in tree and any(key in tree for key in ("camera_matrix", "K", "k"))
    return {str(tree.get("camera_name") or ""): tree} if own else {}


def read_ros(tree: Tree, size: Size | None) -> Camera:
    """Source: sensor_msgs/CameraInfo. K is for the full sensor; the image is its region of interest, then binned.

    Binning averages neighbouring pixels, so centres move as in `scale_camera`.
    """
    refuse_unread_distortion(tree, ROS_LENSES, "list the coefficients as distortion_coefficients")
    matrix = next(key for key in ("camera_matrix", "K", "k") if key in tree)
    lens = next((tree[key] for key in ("distortion_coefficients", "D", "d") if key in tree), None)
    full = size_of(tree.get("width", tree.get("image_width")), tree.get("height", tree.get("image_height"))) or size
    model = lens_model(tree["distortion_model"], "distortion_model")
    if lens is None and model != "pinhole":
        raise InputError(f"distortion_model is {tree['distortion_model']}, but D (distortion_coefficients) is missing")
    coefficients = numbers(lens, "distortion coefficients")
    fx, fy, cx, cy = intrinsics_of_matrix(tree[matrix], matrix)
    camera = make_camera("ROS camera_info", full, (fx, fy, cx, cy), model, coefficients)
    left, top, width, height = _ros_region(tree, (camera.width, camera.height))
    across, down = (max(1, int(number(tree.get(f"binning_{axis}", 1) or 1, f"binning_{axis}"))) for axis in "xy")
    centre = (cx - left + 0.5) / across - 0.5, (cy - top + 0.5) / down - 0.5
    size = size_of(width // across, height // down)
    return make_camera("ROS camera_info", size, (fx / across, fy / down, *centre), model, coefficients)


def _ros_region(tree: Tree, full: Size) -> tuple[int, int, int, int]:
    """x, y, width, height of the region of interest; zero width or height means the whole sensor."""
    roi = tree.get("roi") or {}
    if not isinstance(roi, Mapping):
        raise InputError(f"roi is {roi!r}, needed x_offset, y_offset, width and height")
    x, y, width, height = (
        int(number(roi.get(key, 0), f"roi.{key}")) for key in ("x_offset", "y_offset", "width", "height")
    )
    return (x, y, width, height) if width and height else (0, 0, *full)


# ---- Kalibr camchain, and the sensor.yaml of EuRoC ----


KALIBR_LENSES = ("distortion_model", "distortion_coeffs", "distortion_coefficients")


def find_kalibr(tree: Tree) -> dict[str, Any]:
    if "camera_model" in tree and "intrinsics" in tree:
        return {"": tree}
    cameras = {str(key): value for key, value in tree.items() if re.fullmatch(r"cam\d+", str(key))}
    return {key: value for key, value in cameras.items() if isinstance(value, Mapping) and "camera_model" in value}


def read_kalibr(tree: Tree, size: Size | None) -> Camera:
    if tree["camera_model"] != "pinhole":
        raise InputError(f"camera_model {tree['camera_model']!r} is not supported, only 'pinhole' is")
    refuse_unread_distortion(tree, KALIBR_LENSES, "list the coefficients as distortion_coeffs")
    model = lens_model(tree.get("distortion_model"), "distortion_model")
    lens = tree.get("distortion_coeffs", tree.get("distortion_coefficients"))
    if lens is None and model != "pinhole":
        raise InputError(f"distortion_model is {tree['distortion_model']}, but distortion_coeffs are missing")
    intrinsics = numbers(tree.get("intrinsics"), "intrinsics")
    if len(intrinsics) != 4:
        raise InputError(f"intrinsics has {len(intrinsics)} numbers, needed fx, fy, cx, cy")
    sides = numbers(tree.get("resolution"), "resolution")
    if sides and len(sides) != 2:
        raise InputError(f"resolution has {len(sides)} numbers, needed width and height")
    return make_camera(
        "Kalibr", size_of(*sides) if sides else size, intrinsics, model, numbers(lens, "distortion_coeffs")
    )


# ---- nerfstudio transforms.json ----


def find_nerfstudio(tree: Tree) -> dict[str, Any]:
    if "fl_x" in tree:
        return {"": tree}
    frames = tree.get("frames")
    if not isinstance(frames, list):
        return {}
    frames = [f for f in frames if isinstance(f, Mapping) and "fl_x" in f and "file_path" in f]
    return {PurePosixPath(str(frame["file_path"])).name: {**tree, **frame} for frame in frames}


def read_nerfstudio(tree: Tree, size: Size | None) -> Camera:
    """Pixel centres at (0.5, 0.5), as in COLMAP."""
    refuse_unread_distortion(tree, (), "give the coefficients as k1, k2, p1, p2, ...")
    model = lens_model(tree.get("camera_model", "OPENCV"), "camera_model")
    model = "fisheye" if tree.get("is_fisheye") else "brown" if model == "pinhole" else model
    if model == "brown":
        refuse_nonzero(tree, ("k4",), "radial distortion of order 8")
    else:
        refuse_nonzero(tree, ("p1", "p2"), "tangential distortion of a fisheye lens")
    size = known_size(size_of(tree.get("w"), tree.get("h")) or size)
    fx = number(tree["fl_x"], "fl_x")
    fy = number(tree.get("fl_y", fx), "fl_y")
    cx, cy = (number(tree.get(key, side / 2), key) - 0.5 for key, side in zip(("cx", "cy"), size, strict=True))
    return make_camera("nerfstudio", size, (fx, fy, cx, cy), model, named_coefficients(tree, model))


# ---- OpenSfM and OpenDroneMap camera_models.json, cameras.json ----


def find_opensfm(tree: Tree) -> dict[str, Any]:
    cameras = tree.get("cameras") if isinstance(tree.get("cameras"), Mapping) else tree
    return {str(k): v for k, v in (cameras or {}).items() if isinstance(v, Mapping) and "projection_type" in v}


def read_opensfm(tree: Tree, size: Size | None) -> Camera:
    """Lengths are in units of the longer side, centres measured from the middle of the image."""
    refuse_unread_distortion(tree, (), "give the coefficients as k1, k2, p1, p2, ...")
    model = lens_model(tree["projection_type"], "projection_type")
    size = known_size(size_of(tree.get("width"), tree.get("height")) or size)
    longer = max(size)
    focal = tree.get("focal", tree.get("focal_x"))
    fx = number(tree.get("focal_x", focal), "focal_x") * longer
    fy = number(tree.get("focal_y", focal), "focal_y") * longer
    centre = zip(("c_x", "c_y"), size, strict=True)
    cx, cy = (number(tree.get(key, 0), key) * longer + (side - 1) / 2 for key, side in centre)
    return make_camera("OpenSfM", size, (fx, fy, cx, cy), model, named_coefficients(tree, model))


FORMATS = (
    CameraFormat(find_kalibr, read_kalibr),
    CameraFormat(find_ros, read_ros),
    CameraFormat(find_nerfstudio, read_nerfstudio),
    CameraFormat(find_opensfm, read_opensfm),
    CameraFormat(find_native, read_native),
    CameraFormat(find_opencv, read_opencv),
)
