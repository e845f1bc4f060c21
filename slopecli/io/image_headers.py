"""What an image file says of itself before it is decoded: size, orientation, and whether it is all there.

Decoders differ in how much of a damaged file they let pass, so completeness is settled here: every critical chunk of a
PNG must be present with its checksum, and a JPEG must reach its end marker. Sources: PNG (W3C, third edition), JPEG
(ITU T.81 annex B), TIFF 6.0, EXIF 2.3.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass

from slopecli.errors import InputError

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
JPEG_SIGNATURE = b"\xff\xd8\xff"
TIFF_SIGNATURES = (b"II*\x00", b"MM\x00*", b"II+\x00", b"MM\x00+")
CRITICAL_CHUNKS = (b"IHDR", b"PLTE", b"IDAT", b"IEND")

WIDTH_TAG, HEIGHT_TAG, ORIENTATION_TAG, DNG_VERSION_TAG = 256, 257, 274, 50706


@dataclass(frozen=True)
class ImageHeader:
    """size: (width, height) px as stored, None when the format is not looked into.

    orientation: EXIF orientation, 1 when absent. orientation_offset: where a decoder would read it from the file's
    own directory (TIFF only), with `orientation_upright` the two bytes that say 1 there.
    """

    size: tuple[int, int] | None = None
    orientation: int = 1
    orientation_offset: int | None = None
    orientation_upright: bytes = b""
    is_raw: bool = False


def read_header(data: bytes) -> ImageHeader:
    """Read the header of a PNG, JPEG or TIFF file and check that the file is whole.

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
        if _is_frame(marker) and body + 5 <= len(data):
            height, width = struct.unpack_from(">HH", data, body + 1)
            size = width, height
        elif marker == 0xE1 and data.startswith(b"Exif\0\0", body):
            orientation = _orientation(_tiff_tags(data[body + 6 : position]))
        elif marker == 0xDA:
            break
    # inside the scan 0xff is always escaped, so the first end marker from here on is the image's own
    if data.find(b"\xff\xd9", position) < 0:
        raise InputError(f"the JPEG file is cut short after {len(data)} bytes; copy or download it again")
    return ImageHeader(size, orientation)


def _is_frame(marker: int) -> bool:
    return 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC)


def _tiff_header(data: bytes) -> ImageHeader:
    tags = _tiff_tags(data)
    size = (tags[WIDTH_TAG][0], tags[HEIGHT_TAG][0]) if WIDTH_TAG in tags and HEIGHT_TAG in tags else None
    return ImageHeader(
        size,
        _orientation(tags),
        orientation_offset=tags[ORIENTATION_TAG][1] if ORIENTATION_TAG in tags else None,
        orientation_upright=struct.pack(_byte_order(data) + "H", 1),
        is_raw=DNG_VERSION_TAG in tags,
    )


def _orientation(tags: dict[int, tuple[int, int]]) -> int:
    value = tags.get(ORIENTATION_TAG, (1, 0))[0]
    return value if 1 <= value <= 8 else 1


def _byte_order(data: bytes) -> str:
    return "<" if data[:2] == b"II" else ">"


def _tiff_tags(data: bytes) -> dict[int, tuple[int, int]]:
    """Tag -> (first value, its offset) of the first directory of a TIFF or EXIF block; what is damaged is left out."""
    order = _byte_order(data)
    tags: dict[int, tuple[int, int]] = {}
    try:
        big = struct.unpack_from(order + "H", data, 2)[0] == 43
        count_format, entry_size, value_at = ("Q", 20, 12) if big else ("H", 12, 8)
        start = struct.unpack_from(order + ("Q" if big else "I"), data, 8 if big else 4)[0]
        count = struct.unpack_from(order + count_format, data, start)[0]
        first = start + struct.calcsize(count_format)
        for entry in range(first, min(first + count * entry_size, len(data)), entry_size):
            tag, kind = struct.unpack_from(order + "HH", data, entry)
            value_format = {1: "B", 3: "H", 4: "I"}.get(kind)
            if value_format:
                tags[tag] = (struct.unpack_from(order + value_format, data, entry + value_at)[0], entry + value_at)
    except struct.error:
        pass
    return tags
