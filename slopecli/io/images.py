"""Read image files of any depth as 8-bit grey and colour, with the pixels as the sensor stored them.

Decoders differ in how much damage they accept, so completeness is checked here: every critical chunk of a PNG must be
present with its checksum, and a JPEG must reach its end marker. Pillow reads the tags of TIFF files and EXIF blocks.
Sources: PNG (W3C, third edition), JPEG (ITU T.81 annex B), TIFF 6.0, EXIF 2.3.
"""

from __future__ import annotations

import hashlib
import struct
import warnings
import zlib
from dataclasses import dataclass
from io import BytesIO
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slopecli.errors import InputError
from slopecli.io.files import read_file
from slopecli.types import Image
from slopecli.windows import MIN_SIDE_PX

MAX_PIXELS = 300_000_000  # twice the largest single-shot sensor
TAIL_PERCENT = 0.1  # share of the pixels that saturates at either end when values are mapped to 8 bits
SAMPLE_SIDE = 1024  # about the rows and columns from which percentiles are estimated
RAW_SUFFIXES = {".dng", ".nef", ".cr2", ".cr3", ".arw", ".raf", ".rw2", ".orf", ".pef", ".srw"}
READABLE = "PNG, JPEG, TIFF, BMP, WebP or PNM"
ORIENTATIONS = {
    2: "mirrored",
    3: "turned by 180 degrees",
    4: "flipped",
    5: "transposed",
    6: "turned by 90 degrees clockwise",
    7: "transverse",
    8: "turned by 90 degrees anticlockwise",
}
PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
JPEG_SIGNATURE = b"\xff\xd8\xff"
TIFF_SIGNATURES = (b"II*\x00", b"MM\x00*", b"II+\x00", b"MM\x00+")
CRITICAL_CHUNKS = (b"IHDR", b"PLTE", b"IDAT", b"IEND")


def load_image(path: str | PathLike[str]) -> Image:
    """Read an image file as the sensor stored it.

    8-bit pixels stay untouched. 16-bit, float and other pixels are mapped to 0..255 by one straight line for all
    channels, from the 0.1 and 99.9 percentiles of the grey values (clipped outside, also infinities; NaN becomes 0),
    so that a few hot or dead pixels have no influence. An alpha channel is dropped. EXIF orientation is never applied,
    since intrinsics belong to the pixels as stored; `note` says when there is one. Formats: PNG, JPEG, TIFF, BMP, WebP,
    PNM and what else the installed OpenCV decodes.

    Returns
    -------
    image : grey (h, w) uint8, colour (h, w, 3) uint8 BGR or None for a one-channel file, and the file's SHA-256.

    Raises
    ------
    InputError : missing, a directory, empty, cut short, damaged, not an image, or of an absurd size.
    """
    return decode_image(read_image_file(path), path)


def read_image_file(path: str | PathLike[str], base: str | PathLike[str] = "") -> bytes:
    """The bytes of an image file, whose path is relative to `base`; raises InputError if it cannot be read."""
    data = read_file(path, "image file", 2_000_000_000, base)
    if not data:
        raise InputError(f"{path}: is empty (0 bytes); copy or download it again")
    return data


def decode_image(data: bytes, path: str | PathLike[str]) -> Image:
    """As `load_image`, from the bytes of the file; `path` is for messages and is not opened."""
    try:
        header = _read_header(data)
        _refuse_raw(Path(path), header)
        if header.size is not None:
            _check_size(*header.size)
        pixels = _decode(data, header)
        _check_size(pixels.shape[1], pixels.shape[0])
        grey, colour, mapped = _to_8_bit(pixels)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    notes = [_orientation_note(header.orientation), mapped]
    return Image(grey, colour, str(path), hashlib.sha256(data).hexdigest(), note="; ".join(filter(None, notes)))


def _refuse_raw(path: Path, header: ImageHeader) -> None:
    if header.is_raw or path.suffix.lower() in RAW_SUFFIXES:
        raise InputError("is a raw camera file, of which only a preview would be read; develop it to PNG or TIFF first")


def _check_size(width: int, height: int) -> None:
    if width * height > MAX_PIXELS:
        limit = MAX_PIXELS // 1_000_000
        raise InputError(f"claims {width}x{height} px, more than {limit} megapixels; cut or shrink it")
    if min(width, height) < MIN_SIDE_PX:
        raise InputError(f"is {width}x{height} px, needed at least {MIN_SIDE_PX}x{MIN_SIDE_PX}; use a larger image")


def _decode(data: bytes, header: ImageHeader) -> NDArray[Any]:
    """Pixels as stored, with their own depth and channels."""
    import cv2

    if header.orientation != 1 and data.startswith(TIFF_SIGNATURES):
        data = _without_orientation(data, header.orientation)  # OpenCV turns TIFF pixels whatever the flags
    level = cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        pixels = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        pixels = None
    finally:
        cv2.utils.logging.setLogLevel(level)
    if pixels is None:
        raise InputError(_why_not_decoded(data))
    return pixels


def _why_not_decoded(data: bytes) -> str:
    if data.startswith(b"version https://git-lfs"):
        return "is a Git LFS pointer, not the image itself; run `git lfs pull`"
    if data[4:12] in (b"ftypheic", b"ftypheix", b"ftypmif1"):
        return f"is a HEIC file, needed {READABLE}; convert it first"
    if not any(byte < 9 for byte in data[:512]):
        return f"is text, not an image; needed {READABLE}"
    return f"is damaged or of a kind that cannot be read; needed {READABLE}, try to open and save it again"


def _orientation_note(orientation: int) -> str:
    if orientation == 1:
        return ""
    return f"EXIF says the image is to be shown {ORIENTATIONS[orientation]}; not applied, pixels are used as stored"


def _to_8_bit(pixels: NDArray[Any]) -> tuple[NDArray[np.uint8], NDArray[np.uint8] | None, str]:
    """Grey, colour (None for one channel) and a note on the mapping of the values ("" for 8-bit pixels)."""
    import cv2

    if pixels.ndim == 3 and pixels.shape[2] not in (3, 4):
        raise InputError(f"has {pixels.shape[2]} channels, needed 1 (grey), 3 (colour) or 4 (with alpha)")
    if pixels.dtype not in (np.uint8, np.uint16, np.float32):  # the types that OpenCV converts to grey
        pixels = pixels.astype(np.float32)
    grey: NDArray[Any] = pixels
    colour: NDArray[Any] | None = None
    if pixels.ndim == 3:
        alpha = pixels.shape[2] == 4
        grey = cv2.cvtColor(pixels, cv2.COLOR_BGRA2GRAY if alpha else cv2.COLOR_BGR2GRAY)
        colour = cv2.cvtColor(pixels, cv2.COLOR_BGRA2BGR) if alpha else pixels
    if pixels.dtype == np.uint8:
        return grey, colour, ""
    low, high = _range(grey)
    note = f"{pixels.dtype} values {low:.6g} to {high:.6g} mapped to 0..255"
    return _map(grey, low, high), None if colour is None else _map(colour, low, high), note


def _range(grey: NDArray[Any]) -> tuple[float, float]:
    """The values mapped to 0 and 255: percentiles, or the extremes if the percentiles are equal."""
    step = [max(1, side // SAMPLE_SIDE) for side in grey.shape]
    values = grey[:: step[0], :: step[1]].astype(np.float64)
    values = values[np.isfinite(values)]
    if not len(values):
        raise InputError("has no finite pixel value; export it again")
    low, high = np.percentile(values, [TAIL_PERCENT, 100 - TAIL_PERCENT])
    if low == high:
        low, high = values.min(), values.max()
    if grey.dtype == np.uint16:  # bounds of the same type as the pixels
        low, high = np.floor(low), np.ceil(high)
    return float(low), float(high)


def _map(values: NDArray[Any], low: float, high: float) -> NDArray[np.uint8]:
    import cv2

    scale = 255.0 / (high - low) if high > low else 0.0
    if values.dtype == np.float32:
        values = np.nan_to_num(values, nan=low, posinf=high, neginf=low)
    clipped = np.clip(values, values.dtype.type(low), values.dtype.type(high))
    return np.asarray(cv2.convertScaleAbs(clipped, alpha=scale, beta=-low * scale), dtype=np.uint8)


# ---- headers ----


@dataclass(frozen=True)
class ImageHeader:
    """size: (width, height) px as stored, None for formats other than PNG, JPEG and TIFF.

    orientation: EXIF orientation, 1 when absent. is_raw: whether it is a raw camera file (DNG).
    """

    size: tuple[int, int] | None = None
    orientation: int = 1
    is_raw: bool = False


def _read_header(data: bytes) -> ImageHeader:
    """Read the header of a PNG, JPEG or TIFF file and check that a PNG or JPEG is complete.

    Raises
    ------
    InputError : the file is cut short or a checksum is wrong. The message does not name the file.
    """
    if data.startswith(PNG_SIGNATURE):
        return _png_header(data)
    if data.startswith(JPEG_SIGNATURE):
        return _jpeg_header(data)
    if data.startswith(TIFF_SIGNATURES):
        return _tiff_header(data)
    return ImageHeader()


def _png_header(data: bytes) -> ImageHeader:
    size, orientation, position = None, 1, len(PNG_SIGNATURE)
    while position + 12 <= len(data):
        length, kind = struct.unpack_from(">I4s", data, position)
        body, position = position + 8, position + 12 + length
        if position > len(data):
            break
        if kind in CRITICAL_CHUNKS:
            (checksum,) = struct.unpack_from(">I", data, body + length)
            if zlib.crc32(memoryview(data)[body - 4 : body + length]) != checksum:
                damage = f"checksum of {kind.decode()} is wrong"
                raise InputError(f"the PNG file is damaged ({damage}); copy or download it again")
        if kind == b"IHDR" and length == 13:
            size = struct.unpack_from(">II", data, body)
        elif kind == b"eXIf":
            orientation = _orientation(_tiff_tags(data[body : body + length]))
        elif kind == b"IEND":
            return ImageHeader(size, orientation)
    raise InputError(f"the PNG file is cut short after {len(data)} bytes; copy or download it again")


def _jpeg_header(data: bytes) -> ImageHeader:
    size, orientation, position = None, 1, 2
    while position + 4 <= len(data) and data[position] == 0xFF:
        marker = data[position + 1]
        if marker == 0xFF:  # fill byte
            position += 1
            continue
        length = struct.unpack_from(">H", data, position + 2)[0]
        body, position = position + 4, position + 2 + length
        is_frame = 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC)
        if is_frame and body + 5 <= len(data):
            height, width = struct.unpack_from(">HH", data, body + 1)
            size = width, height
        elif marker == 0xE1 and data.startswith(b"Exif\0\0", body):
            orientation = _orientation(_tiff_tags(data[body + 6 : position]))
        elif marker == 0xDA:
            break
    # 0xff is always escaped within the scan, so the first end marker from here on is that of the image
    if data.find(b"\xff\xd9", position) < 0:
        raise InputError(f"the JPEG file is cut short after {len(data)} bytes; copy or download it again")
    return ImageHeader(size, orientation)


def _tiff_header(data: bytes) -> ImageHeader:
    from PIL.ExifTags import Base

    tags = _tiff_tags(data)
    width, height = tags.get(Base.ImageWidth), tags.get(Base.ImageLength)
    size = (width, height) if isinstance(width, int) and isinstance(height, int) else None
    return ImageHeader(size, _orientation(tags), is_raw=Base.DNGVersion in tags)


def _tiff_tags(data: bytes) -> dict[int, Any]:
    """Values of the first directory of a TIFF file or EXIF block by tag; those that are damaged are left out."""
    from PIL.TiffImagePlugin import ImageFileDirectory_v2

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Pillow's, about damage
        try:
            directory = ImageFileDirectory_v2(data[: 16 if _is_big_tiff(data) else 8])
            file = BytesIO(data)
            file.seek(directory.next)
            directory.load(file)
            return dict(directory)
        except Exception:  # Pillow raises many kinds of exceptions on damaged bytes
            return {}


def _orientation(tags: dict[int, Any]) -> int:
    from PIL.ExifTags import Base

    value = tags.get(Base.Orientation)
    return value if isinstance(value, int) and 1 <= value <= 8 else 1


def _is_big_tiff(data: bytes) -> bool:
    return data[2:4] in (b"+\x00", b"\x00+")


def _without_orientation(data: bytes, orientation: int) -> bytes:
    """A TIFF file with orientation 1 in place of the given one, so that OpenCV leaves the pixels as stored."""
    from PIL.ExifTags import Base

    order, count = "<" if data.startswith(b"II") else ">", "Q" if _is_big_tiff(data) else "I"
    for kind, value in ((3, "H"), (4, "I")):  # the TIFF types SHORT and LONG
        entry = struct.Struct(f"{order}HH{count}{value}")
        data = data.replace(
            entry.pack(Base.Orientation, kind, 1, orientation), entry.pack(Base.Orientation, kind, 1, 1)
        )
    return data
