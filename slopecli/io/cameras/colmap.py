"""Cameras of a COLMAP model: cameras.txt and cameras.bin; pixel centres at (0.5, 0.5).

Source: COLMAP's documentation, "Output Format" and "Camera Models".
"""

from __future__ import annotations

import re
import struct
from typing import Any

from slopecli.errors import InputError
from slopecli.io.cameras import values
from slopecli.io.cameras.content import CameraFileContent
from slopecli.types import Camera

# Names of the parameters, in the order of the model ids of cameras.bin; only their number for models not supported.
MODELS: dict[str, str | int] = {
    "SIMPLE_PINHOLE": "f cx cy",
    "PINHOLE": "fx fy cx cy",
    "SIMPLE_RADIAL": "f cx cy k1",
    "RADIAL": "f cx cy k1 k2",
    "OPENCV": "fx fy cx cy k1 k2 p1 p2",
    "OPENCV_FISHEYE": "fx fy cx cy k1 k2 k3 k4",
    "FULL_OPENCV": "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6",
    "FOV": 5,
    "SIMPLE_RADIAL_FISHEYE": "f cx cy k1",
    "RADIAL_FISHEYE": "f cx cy k1 k2",
    "THIN_PRISM_FISHEYE": 12,
    "RAD_TAN_THIN_PRISM_FISHEYE": 16,
}
LINE = re.compile(r"\s*\d+\s+[A-Z][A-Z0-9_]+\s+\d+\s+\d+(\s+\S+)+\s*")


# Model, width, height and parameters of a camera as the file has them, its numbers not yet checked.
ColmapCamera = tuple[str, Any, Any, list[Any]]


def find(content: CameraFileContent) -> dict[str, ColmapCamera]:
    """Cameras by their id; {} for another format."""
    return _find_in_binary(content.data) if content.is_binary else _find_in_text(content.text)


def _find_in_text(text: str) -> dict[str, ColmapCamera]:
    lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    if not lines or not all(LINE.fullmatch(line) for line in lines):
        return {}
    words = [line.split() for line in lines]
    return {w[0]: (w[1], w[2], w[3], w[4:]) for w in words}


def _find_in_binary(data: bytes) -> dict[str, ColmapCamera]:
    cameras: dict[str, ColmapCamera] = {}
    names = list(MODELS)
    try:
        (count,), position = struct.unpack_from("<Q", data), 8
        for _ in range(count):
            identity, model_id, width, height = struct.unpack_from("<IiQQ", data, position)
            if not 0 <= model_id < len(names):
                return {}
            parameters = struct.unpack_from(f"<{_parameter_count(names[model_id])}d", data, position + 24)
            cameras[str(identity)] = (names[model_id], width, height, list(parameters))
            position += 24 + 8 * len(parameters)
    except struct.error:
        return {}
    return cameras if position == len(data) else {}


def read(camera: ColmapCamera, _size: values.Size | None) -> Camera:
    """The principal point is shifted by half a pixel."""
    model, width, height, parameters = camera
    names = MODELS.get(model)
    if not isinstance(names, str):
        raise InputError(f"COLMAP model {model} is not supported; undistort the images with COLMAP first")
    if len(parameters) != _parameter_count(model):
        wanted = _parameter_count(model)
        raise InputError(f"COLMAP model {model} has {len(parameters)} parameters, needed {wanted}: {names}")
    named = dict(zip(names.split(), parameters, strict=True))
    fx, fy, cx, cy = (
        values.number(named.get(key, named.get("f")), f"{model} {key}") for key in ("fx", "fy", "cx", "cy")
    )
    lens = values.lens_model(model)
    size = values.size_of(width, height)
    return values.make_camera(
        "COLMAP", size, (fx, fy, cx - 0.5, cy - 0.5), lens, values.named_coefficients(named, lens)
    )


def _parameter_count(model: str) -> int:
    names = MODELS[model]
    return len(names.split()) if isinstance(names, str) else names
