"""Read image files of any depth as 8-bit grey and colour, with the pixels as the sensor stored them."""

from __future__ import annotations

import hashlib
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slopecli.errors import InputError
from slopecli.io.decoding import decode_pixels
from slopecli.io.files import read_file
from slopecli.io.image_headers import ImageHeader, read_header
from slopecli.io.pixel_values import to_8_bit
from slopecli.options import MIN_SIDE_PX
from slopecli.types import Image

MAX_PIXELS = 300_000_000  # twice the largest single-shot sensor
RAW_SUFFIXES = {".dng", ".nef", ".cr2", ".cr3", ".arw", ".raf", ".rw2", ".orf", ".pef", ".srw"}
ORIENTATIONS = {
    2: "mirrored",
    3: "turned by 180 degrees",
    4: "flipped",
    5: "transposed",
    6: "turned by 90 degrees clockwise",
    7: "transverse",
    8: "turned by 90 degrees anticlockwise",
}


def load_image(path: str | PathLike[str]) -> Image:
    """Read an image file as the sensor stored it.

    8-bit pixels stay untouched. 16-bit, float and other pixels are mapped to 0..255 by one straight line for all
    channels, from the 0.1 to the 99.9 percentile of the grey values or, where these are far from the bulk of the
    pixels, from less (clipped outside, also infinities; NaN and GDAL's nodata value become 0), so that glints, hot
    pixels and missing ones have no influence. An alpha channel is dropped. EXIF orientation is never applied, since
    intrinsics belong to the pixels as stored; `note` says when there is one. Of a TIFF with several images the largest
    is read, of an animation the first picture. Formats: PNG, JPEG, TIFF, BMP, WebP, PNM and what else the installed
    OpenCV decodes.

    Returns
    -------
    image : grey (h, w) uint8, colour (h, w, 3) uint8 BGR or None for a one-channel file, and the file's SHA-256.

    Raises
    ------
    InputError : missing, a directory, empty, cut short, damaged by the decoder's own report, not an image, or of an
        absurd size.
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
        header = read_header(data)
        _refuse_raw(Path(path), header)
        if header.size is not None:
            _check_size(*header.size)
        pixels = decode_pixels(data, header)
        _check_size(pixels.shape[1], pixels.shape[0])
        grey, colour, mapped = to_8_bit(pixels, header.nodata)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    notes = [header.note, _orientation_note(header.orientation), mapped]
    return Image(grey, colour, str(path), hashlib.sha256(data).hexdigest(), note="; ".join(filter(None, notes)))


def image_from_pixels(pixels: NDArray[Any], name: str) -> Image:
    """An image from an array as OpenCV has it, mapped to 8 bits as `load_image` maps the pixels of a file.

    Parameters
    ----------
    pixels : (h, w) or (h, w, 1) grey, (h, w, 3) BGR or (h, w, 4) BGR and alpha.  name : for messages.

    Raises
    ------
    InputError : another shape, values that are no numbers, an absurd size, or no finite value.
    """
    if pixels.ndim == 3 and pixels.shape[2] == 1:
        pixels = pixels[:, :, 0]
    shape, values = "x".join(map(str, pixels.shape)), pixels.dtype
    if pixels.ndim not in (2, 3) or values.kind not in "uif":
        wanted = "rows x columns of numbers (grey) or rows x columns x 3 (BGR, as OpenCV reads images)"
        raise InputError(f"{name}: is an array of shape {shape or 'none'} and type {values}, needed {wanted}")
    try:
        _check_size(pixels.shape[1], pixels.shape[0])
        own = np.array(
            pixels, dtype=values.newbyteorder("="), order="C"
        )  # later changes of the caller's have no effect
        grey, colour, mapped = to_8_bit(own)
    except InputError as error:
        raise InputError(f"{name}: {error}") from None
    return Image(grey, colour, note=mapped)


def _refuse_raw(path: Path, header: ImageHeader) -> None:
    if header.is_raw or path.suffix.lower() in RAW_SUFFIXES:
        raise InputError("is a raw camera file, of which only a preview would be read; develop it to PNG or TIFF first")


def _check_size(width: int, height: int) -> None:
    if width * height > MAX_PIXELS:
        limit = MAX_PIXELS // 1_000_000
        raise InputError(f"claims {width}x{height} px, more than {limit} megapixels; cut or shrink it")
    if min(width, height) < MIN_SIDE_PX:
        raise InputError(f"is {width}x{height} px, needed at least {MIN_SIDE_PX}x{MIN_SIDE_PX}; use a larger image")


def _orientation_note(orientation: int) -> str:
    if orientation == 1:
        return ""
    return f"EXIF says the image is to be shown {ORIENTATIONS[orientation]}; not applied, pixels are used as stored"
