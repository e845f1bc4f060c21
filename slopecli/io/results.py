"""Read a finished answer back: slopes.json, and beside it labels.png and slope_map.tif."""

from __future__ import annotations

import json
import math
from os import PathLike
from pathlib import Path
from typing import Any, get_args

import numpy as np

from slopecli.errors import InputError, visible
from slopecli.io.correspondences.label_image import read_label_image
from slopecli.io.files import read_file
from slopecli.patches import FINDERS
from slopecli.products import RESULT
from slopecli.products.map_tiff import BANDS, MAP_FILE, NODATA
from slopecli.types import Camera, CameraModel, FloatArray, IntArray
from slopecli.validate.finished_result import Result, ResultMap, ResultPlane

LABELS = "labels.png"
WANTED = "needed the folder of an answer of estimate, segment or map, or its slopes.json"


def read_result(path: str | PathLike[str]) -> Result:
    """Read an answer.

    path : a folder that holds slopes.json, or that file.
    InputError : it is no answer, or one without cameras, as of rays.
    """
    file = Path(path) / RESULT if Path(path).is_dir() else Path(path)
    if not file.exists():
        raise InputError(f"{path}: no such answer; {WANTED}")
    try:
        document = json.loads(read_file(file, "slopes.json"))
        return _result(document, file.parent)
    except InputError:
        raise
    except (ValueError, KeyError, TypeError, IndexError, AttributeError, RecursionError, OverflowError) as error:
        raise InputError(f"{file}: is no answer of slopemap ({visible(str(error)[:80])}); {WANTED}") from error


def _result(document: dict[str, Any], folder: Path) -> Result:
    cameras = tuple(_camera(one) for one in document["cameras"])
    if len(cameras) != 2 or not all(camera.width for camera in cameras):
        raise InputError(f"{folder}: the answer has no camera with an image size, as of rays; {WANTED}")
    options = document["options"]
    return Result(
        planes=tuple(_planes(document)),
        cameras=(cameras[0], cameras[1]),
        up=_vector(document["up"]["vector_cam1"], 3),
        unit=str(document["scale"]["unit"])[:20],
        baseline_cam1=_vector(document["motion"]["baseline_cam1"], 3),
        tolerance_deg=_number(options["tolerance_deg"]),
        confidence=_number(options["confidence"]),
        labels=_labels(folder, cameras[0]),
        cells=_cells(document["map"], folder) if "map" in document else None,
    )


def _camera(values: dict[str, Any]) -> Camera:
    width, height = (_number(values[name] or 0) for name in ("width", "height"))
    lens = tuple(map(_number, values["distortion"]))
    model = values["model"]
    known = width == height == 0 or 1 <= min(width, height) <= max(width, height) < 1 << 20
    if model not in get_args(CameraModel) or not known or width % 1 or height % 1:
        raise ValueError(f"a camera {width:g}x{height:g} px, {model!r}")
    fx, fy, cx, cy = (_number(values[name]) for name in ("fx", "fy", "cx", "cy"))
    if not min(fx, fy) > 0:
        raise ValueError(f"a camera of the focal length {fx:g}, {fy:g}")
    return Camera(int(width), int(height), fx, fy, cx, cy, model, lens)


def _number(value: Any) -> float:
    """A number whose square is finite, as lengths of vectors need it; ValueError for anything else."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(float(value) * value):
        raise ValueError(f"{str(value)[:20]!r} in place of a number")
    return float(value)


def _vector(values: Any, length: int) -> FloatArray:
    if not isinstance(values, list) or len(values) != length:
        raise ValueError(f"{str(values)[:20]!r} in place of {length} numbers")
    return np.array(list(map(_number, values)))


def _planes(document: dict[str, Any]) -> list[ResultPlane]:
    found = {finder.source for finder in FINDERS if finder.found}
    ambiguity = document["ambiguity"]
    other = ambiguity["alternative"] if ambiguity["status"] == "unresolved" else None
    others = {} if other is None else {one["id"]: one["normal_cam1"] for one in other["planes"]}
    return [
        ResultPlane(
            id=int(_number(one["id"])),
            normals=tuple(
                _vector(normal, 3) for normal in (one["normal_cam1"], others.get(one["id"])) if normal is not None
            ),
            distance=_number(one["distance"]),
            slope_deg=_number(one["slope_deg"]),
            sigma_deg=None if one["slope_sigma_deg"] is None else _number(one["slope_sigma_deg"]),
            verdict=None if one["verdict"] is None else str(one["verdict"])[:20],
            status=str(one["status"])[:20],
            polygon_px=np.stack([_vector(corner, 2) for corner in one["polygon_px"]]),
            found=one["source"] in found,
        )
        for one in document["planes"]
    ]


def _labels(folder: Path, camera: Camera) -> IntArray | None:
    """labels.png of image 1's size; None where there is none."""
    if not (folder / LABELS).exists():
        return None
    return read_label_image(folder / LABELS, (camera.width, camera.height))


def _cells(info: dict[str, Any], folder: Path) -> ResultMap | None:
    """The cells of slope_map.tif; None where there is no such file."""
    import tifffile

    if not (folder / MAP_FILE).exists():
        return None
    bands = tifffile.imread(folder / MAP_FILE).astype(float)
    layers = {name: np.where(bands[k] == NODATA, np.nan, bands[k]) for k, name in enumerate(BANDS)}
    slope, sigma, p_safe = (layers[name] for name in ("slope_deg", "slope_sigma_deg", "p_safe"))
    return ResultMap(slope, sigma, p_safe, int(_number(info["spacing_px"])), _number(info["footprint_px"]))
