"""Size and orientation in the header of an image file, and whether the file is complete.

Decoders differ in how much damage they accept, so completeness is checked here: every critical chunk of a PNG must be
present with its checksum, and a JPEG must reach its end marker. Pillow reads the tags of TIFF files and EXIF blocks.
Sources: PNG (W3C, third edition), JPEG (ITU T.81 annex B), TIFF 6.0, EXIF 2.3.
"""

from __future__ import annotations

import struct
import warnings
import zlib
from dataclasses import dataclass
from io import BytesIO
from typing import Any

from slopecli.errors import InputError

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
JPEG_SIGNATURE = b"\xff\xd8\xff"
TIFF_SIGNATURES = (b"II*\x00", b"MM\x00*", b"II+\x00", b"MM\x00+")
CRITICAL_CHUNKS = (b"IHDR", b"PLTE", b"IDAT", b"IEND")


@dataclass(frozen=True)
class ImageHeader:
    """size: (width, height) px as stored, None for formats other than PNG, JPEG and TIFF.

    orientation: EXIF orientation, 1 when absent. is_raw: whether it is a raw camera file (DNG).
    """

    size: tuple[int, int] | None = None
    orientation: int = 1
    is_raw: bool = False


def read_header(data: bytes) -> ImageHeader:
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
            _check_png_chunk(data, body, length, kind)
        if kind == b"IHDR" and length == 13:
            size = struct.unpack_from(">II", data, body)
        elif kind == b"eXIf":
            orientation = _orientation(_tiff_tags(data[body : body + length]))
        elif kind == b"IEND":
            return ImageHeader(size, orientation)
    raise InputError(f"the PNG file is cut short after {len(data)} bytes; copy or download it again")


def _check_png_chunk(data: bytes, body: int, length: int, kind: bytes) -> None:
    stored = struct.unpack_from(">I", data, body + length)[0]
    if zlib.crc32(memoryview(data)[body - 4 : body + length]) != stored:
        raise InputError(f"the PNG file is damaged (checksum of {kind.decode()} is wrong); copy or download it again")


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


def without_orientation(data: bytes, orientation: int) -> bytes:
    """A TIFF file with orientation 1 in place of the given one, so that OpenCV leaves the pixels as stored."""
    from PIL.ExifTags import Base

    order, count = "<" if data.startswith(b"II") else ">", "Q" if _is_big_tiff(data) else "I"
    for kind, value in ((3, "H"), (4, "I")):  # the TIFF types SHORT and LONG
        entry = struct.Struct(f"{order}HH{count}{value}")
        data = data.replace(
            entry.pack(Base.Orientation, kind, 1, orientation), entry.pack(Base.Orientation, kind, 1, 1)
        )
    return data
