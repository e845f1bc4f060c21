"""Cameras of a COLMAP model: cameras.txt and cameras.bin; pixel centres at (0.5, 0.5).

Source: COLMAP's documentation, "Output Format" and "Camera Models". Its division models have the ray of a normalised
pixel (x, y) along (x, y, 1 + k r^2).
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from typing import Any

from slopecli.errors import InputError
from slopecli.io.cameras import values
from slopecli.io.cameras.content import Beside, CameraFileContent
from slopecli.types import Camera, CameraModel

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
    "SIMPLE_DIVISION": "f cx cy k",
    "DIVISION": "fx fy cx cy k",
    "SIMPLE_FISHEYE": "f cx cy",
    "FISHEYE": "fx fy cx cy",
}
# of COLMAP 4, with ids after those, which moved between its versions
NEWER = {16: "EUCM or EQUIRECTANGULAR", 17: "EQUIRECTANGULAR"}
MOST_PARAMETERS = 24
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
    values.refuse_twice(f"camera {w[0]}" for w in words)
    return {w[0]: (w[1], w[2], w[3], w[4:]) for w in words}


def _find_in_binary(data: bytes) -> dict[str, ColmapCamera]:
    """The cameras of cameras.bin. A model that is not known may have any number of parameters: the one that fits."""
    unknown = _first_unknown(data, {})
    if unknown is None:
        return _records(data, {}) or {}
    for count in range(MOST_PARAMETERS + 1):
        second = _first_unknown(data, {unknown: count})
        others = range(MOST_PARAMETERS + 1) if second is not None else (0,)
        for other in others:
            if cameras := _records(data, {second: other, unknown: count} if second is not None else {unknown: count}):
                return cameras
    return {}


def _first_unknown(data: bytes, counts: dict[int, int]) -> int | None:
    """The first model id that is neither known nor among the counts, None if the file ends before it."""
    for model_id, _ in _walk(data, counts):
        if model_id not in counts and not 0 <= model_id < len(MODELS):
            return model_id
    return None


def _records(data: bytes, counts: dict[int, int]) -> dict[str, ColmapCamera] | None:
    """The cameras if the records fill the file exactly, None otherwise.

    counts : numbers of parameters of models that are not in `MODELS`, by id.
    """
    cameras: list[tuple[str, ColmapCamera]] = []
    names = list(MODELS)
    (count,) = struct.unpack_from("<Q", data) if len(data) >= 8 else (0,)
    end = 8
    for model_id, position in _walk(data, counts):
        identity, _, width, height = struct.unpack_from("<IiQQ", data, position)
        n = _count_of(model_id, counts)
        end = position + 24 + 8 * n
        if n < 0 or end > len(data) or width * height == 0 or max(width, height) > 1_000_000:
            return None
        name = names[model_id] if 0 <= model_id < len(names) else NEWER.get(model_id, f"with the id {model_id}")
        parameters = struct.unpack_from(f"<{n}d", data, position + 24)
        cameras.append((str(identity), (name, width, height, list(parameters))))
    if end != len(data) or len(cameras) != count:
        return None
    values.refuse_twice(f"camera {name}" for name, _ in cameras)
    return dict(cameras)


def _walk(data: bytes, counts: dict[int, int]) -> Iterator[tuple[int, int]]:
    """Model id and position of every record, as far as the numbers of parameters are known."""
    if len(data) < 8:
        return
    (count,), position = struct.unpack_from("<Q", data), 8
    while count > 0 and position + 24 <= len(data):
        model_id = struct.unpack_from("<IiQQ", data, position)[1]
        yield model_id, position
        n = _count_of(model_id, counts)
        if n < 0:
            return
        position, count = position + 24 + 8 * n, count - 1


def _count_of(model_id: int, counts: dict[int, int]) -> int:
    """Number of parameters of a model, -1 where it is not known."""
    names = list(MODELS)
    return _parameter_count(names[model_id]) if 0 <= model_id < len(names) else counts.get(model_id, -1)


def labelled_images(_content: CameraFileContent, beside: Beside) -> dict[str, str]:
    """Camera of every image by its path, of images.txt or images.bin beside the file; {} without them."""
    if (data := beside("images.bin")) is not None:
        return _images_of_records(data)
    data = beside("images.txt")
    return {} if data is None else _images_of_lines(data.decode("utf-8", "replace"))


def _images_of_lines(text: str) -> dict[str, str]:
    """Each image has a line of id, rotation, position, camera id and name, and one of its points, maybe empty."""
    found: dict[str, str] = {}
    lines = (line for line in text.splitlines() if not line.lstrip().startswith("#"))
    for line in lines:
        words = line.split(maxsplit=9)
        if len(words) == 10:
            found[words[9].strip()] = words[8]
            next(lines, None)
    return found


def _images_of_records(data: bytes) -> dict[str, str]:
    """Each image is its id, rotation, position, camera id, name and points; {} where that does not fill the file."""
    found: dict[str, str] = {}
    (count,), position = struct.unpack_from("<Q", data) if len(data) >= 8 else (0,), 8
    for _ in range(count):
        end = data.find(b"\0", position + 64)
        if end < 0 or end + 9 > len(data):
            return {}
        (camera,), (points,) = struct.unpack_from("<I", data, position + 60), struct.unpack_from("<Q", data, end + 1)
        found[data[position + 64 : end].decode("utf-8", "replace")] = str(camera)
        position = end + 9 + 24 * points
    return found if position == len(data) else {}


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
    division = model.endswith("DIVISION")
    lens: CameraModel = "division" if division else values.lens_model(model)
    coefficients = [values.number(named["k"], f"{model} k")] if division else values.named_coefficients(named, lens)
    size = values.size_of(width, height)
    return values.make_camera("COLMAP", size, (fx, fy, cx - 0.5, cy - 0.5), lens, coefficients)


def _parameter_count(model: str) -> int:
    names = MODELS[model]
    return len(names.split()) if isinstance(names, str) else names
