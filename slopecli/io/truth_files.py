"""Read known ground: depths and disparities as arrays or images, and point clouds."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from os import PathLike
from pathlib import Path
from typing import Any, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from slopecli.errors import InputError
from slopecli.io.decoding import decode_pixels
from slopecli.io.files import read_file
from slopecli.io.image_headers import read_header
from slopecli.io.images import read_image_file
from slopecli.io.numpy_files import array_of, member_of, members_of
from slopecli.types import FloatArray

Grid = NDArray[Any]
Reader = TypeVar("Reader")
GRID_NAMES = ("depth", "disparity", "disp", "z")  # of the array in an NPZ with several


def read_grid(path: str | PathLike[str], key: str | None = None) -> FloatArray:
    """Read one number a pixel: NPY, NPZ, PFM, EXR, PNG or TIFF; (h, w).

    key : name of the array in an NPZ, or of the channel of an EXR; None: the only one, or depth, disparity, disp or z.
    InputError : the file cannot be read, or is not one number a pixel.
    """
    kind, reader = _reader_for(path, GRID_READERS, "depth")
    try:
        values = np.asarray(reader(path, key))
    except InputError:
        raise
    except ImportError as error:
        raise InputError(f"{path}: needs {error.name}; install it with: pip install 'slopemap[exr]'") from error
    except (ValueError, OSError, KeyError, EOFError, RuntimeError, cv2.error) as error:
        raise InputError(f"{path}: cannot be read as {kind} ({error}); write the file again") from error
    if values.ndim == 3 and values.shape[2] in (3, 4) and (values == values[..., :1]).all():
        values = values[..., :1]  # a grey image stored as colours
    if values.dtype == np.uint8:
        raise InputError(f"{path}: has 8 bits, too few for a depth or a disparity; needed 16 bits or float")
    values = values[..., 0] if values.ndim == 3 and values.shape[2] == 1 else values
    if values.ndim != 2 or not np.issubdtype(values.dtype, np.number) or np.iscomplexobj(values):
        shape = "x".join(map(str, values.shape))
        raise InputError(
            f"{path}: has the shape {shape} of {values.dtype}; needed one number for every pixel of image 1"
        )
    with np.errstate(invalid="ignore"):  # NaN of any kind stays NaN
        return values.astype(np.float64)


def _reader_for(path: str | PathLike[str], readers: Mapping[str, Reader], what: str) -> tuple[str, Reader]:
    """The kind of a file, by its name, and its reader; InputError if there is none, or no such file."""
    kind = Path(path).suffix.lower()
    if kind not in readers:
        raise InputError(f"{path}: is no kind of {what} that is known; needed one of {', '.join(readers)}")
    if not Path(path).is_file():
        raise InputError(f"{path}: no such file; check the path")
    return kind[1:], readers[kind]


def _read_npy(path: str | PathLike[str], key: str | None) -> Grid:
    return array_of(read_file(path, "depth"))


def _read_npz(path: str | PathLike[str], key: str | None) -> Grid:
    data = read_file(path, "depth")
    members = members_of(data)
    if key is None:
        likely = [*members] if len(members) == 1 else [name for name in GRID_NAMES if name in members]
        key = likely[0] if likely else None
    if key not in members:
        raise InputError(f"{path}: holds {', '.join(members) or 'nothing'}; say which array by --key NAME")
    return member_of(data, members[key])


def _read_image(path: str | PathLike[str], key: str | None) -> Grid:
    data = read_image_file(path)
    try:
        return decode_pixels(data, read_header(data))
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _read_exr(path: str | PathLike[str], key: str | None) -> Grid:
    """The channel `key` of an OpenEXR file, or its only one, or Z, or its three if they are alike."""
    import OpenEXR

    channels = {name: channel.pixels for name, channel in OpenEXR.File(str(path)).channels().items()}
    if key is None:
        key = next((name for name in ("Z", "V", "Y", "R") if name in channels), next(iter(channels), None))
    if key not in channels:
        raise InputError(f"{path}: holds {', '.join(channels) or 'nothing'}; say which channel by --key NAME")
    values: Grid = channels[key]
    return values


def _read_pfm(path: str | PathLike[str], key: str | None) -> Grid:
    """A portable float map: text lines "Pf", "width height" and a scale, then rows from the bottom up.

    The scale is negative where the bytes are little-endian. Source: Debevec, "PFM portable float map format".
    """
    content = read_file(path, "depth")
    head = content.split(None, 4)
    if len(head) < 5 or head[0] != b"Pf":
        raise InputError(f"{path}: is no PFM of one channel (it begins with {content[:2]!r}); needed Pf")
    width, height, scale = int(head[1]), int(head[2]), float(head[3])
    start = content.index(head[3], content.index(head[2], len(head[0]) + len(head[1]))) + len(head[3]) + 1
    values = np.frombuffer(content[start : start + 4 * width * height], "<f4" if scale < 0 else ">f4")
    if width < 1 or height < 1 or values.size != width * height:
        raise InputError(f"{path}: has {values.size} numbers, and {width}x{height} px; write the file again")
    return values.reshape(height, width)[::-1]


def _read_tiff(path: str | PathLike[str], key: str | None) -> Grid:
    import tifffile

    values: Grid = tifffile.imread(path)
    return values


GRID_READERS: dict[str, Callable[[str | PathLike[str], str | None], Grid]] = {
    ".npy": _read_npy,
    ".npz": _read_npz,
    ".pfm": _read_pfm,
    ".exr": _read_exr,
    ".png": _read_image,
    ".tif": _read_tiff,
    ".tiff": _read_tiff,
}


def read_points(path: str | PathLike[str]) -> FloatArray:
    """Read the points (n, 3) of a PLY, LAS or LAZ cloud, or of an array (n, 3) in an NPY.

    InputError : the file cannot be read, or holds no points.
    """
    kind, reader = _reader_for(path, POINT_READERS, "point cloud")
    try:
        with np.errstate(invalid="ignore"):
            points = np.asarray(reader(path), float)
    except ImportError as error:
        raise InputError(f"{path}: needs {error.name}; install it with: pip install 'slopemap[las]'") from error
    except Exception as error:  # of readers of other projects, which raise what they like
        raise InputError(f"{path}: cannot be read as {kind} ({error}); write the file again") from error
    if points.ndim != 2 or points.shape[1] != 3 or not len(points):
        raise InputError(f"{path}: has no points of three coordinates; needed x, y and z of each")
    return points


def _read_ply(path: str | PathLike[str]) -> FloatArray:
    import trimesh

    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        cloud: Any = trimesh.load(str(path), file_type="ply", process=False)
    return np.asarray(cloud.vertices)


def _read_las(path: str | PathLike[str]) -> FloatArray:
    import laspy

    if str(path).lower().endswith(".laz") and not laspy.LazBackend.detect_available():
        raise ImportError("no reader of compressed points", name="lazrs")
    cloud = laspy.read(path)
    return np.column_stack([cloud.x, cloud.y, cloud.z])


POINT_READERS: dict[str, Callable[[str | PathLike[str]], FloatArray]] = {
    ".ply": _read_ply,
    ".las": _read_las,
    ".laz": _read_las,
    ".npy": lambda path: array_of(read_file(path, "point cloud")),
}
