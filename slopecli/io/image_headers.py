"""What the header of an image file says, and whether the file is complete: PNG, JPEG, TIFF, WebP, and sizes of others.

Decoders differ in how much damage they accept, so completeness is checked here: every critical chunk of a PNG must be
present with its checksum, a JPEG must reach its end marker, and a WebP must be as long as it says.
Sources: PNG (W3C, third edition), JPEG (ITU T.81 annex B), TIFF 6.0, EXIF 2.3, WebP (RFC 9649).
"""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from typing import NoReturn

from slopecli.errors import InputError
from slopecli.io import tiff_directories as tiff
from slopecli.io.tiff_directories import TiffTag

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
JPEG_SIGNATURE = b"\xff\xd8\xff"
CRITICAL_CHUNKS = (b"IHDR", b"PLTE", b"IDAT", b"IEND")
COMPRESSIONS = {
    **dict.fromkeys((*range(9), 32773, 32946), ""),  # those that are read
    **{34712: "JPEG 2000", 34887: "LERC", 34925: "LZMA", 50000: "Zstandard", 50001: "WebP", 50002: "JPEG XL"},
}
SAMPLE_KINDS = {4: "undefined", 5: "complex", 6: "complex"}  # of SampleFormat, that are not read; 3 is floating point
SEVERAL_PICTURES = "is animated; its first picture is used"


@dataclass(frozen=True)
class ImageHeader:
    """size : (width, height) px as stored, None if the format is not known here.

    orientation : EXIF orientation, 1 when absent. is_raw : whether it is a raw camera file. note : for the user, "" if
    there is nothing to say. nodata : value of pixels without a measurement. image : directory of a TIFF file to read.
    unusual : what decoders may not read of it, with the remedy; "" if nothing.
    """

    size: tuple[int, int] | None
    orientation: int
    is_raw: bool = False
    note: str = ""
    nodata: float | None = None
    image: tiff.Directory | None = None
    unusual: str = ""


def read_header(data: bytes) -> ImageHeader:
    """Read the header of an image file and check that a PNG, JPEG or WebP file is complete.

    Raises
    ------
    InputError : the file is cut short, a checksum is wrong, or the decoder would mix up the bands of a TIFF. The
        message does not name the file.
    """
    if data.startswith(PNG_SIGNATURE):
        return _png_header(data)
    if data.startswith(JPEG_SIGNATURE):
        return _jpeg_header(data)
    if data.startswith(tiff.TIFF_SIGNATURES):
        return _tiff_header(data)
    if data.startswith(b"RIFF") and data[8:12] == b"WEBP":
        return _webp_header(data)
    if data[4:12] in (b"ftypavif", b"ftypavis"):
        return _avif_header(data)
    return ImageHeader(_other_size(data), 1, note=SEVERAL_PICTURES if _is_animated_gif(data) else "")


def _cut_short(kind: str, data: bytes) -> NoReturn:
    raise InputError(f"the {kind} file is cut short after {len(data)} bytes; copy or download it again")


def _png_header(data: bytes) -> ImageHeader:
    size, orientation, note, position = None, 1, "", len(PNG_SIGNATURE)
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
            orientation = _orientation(data[body : body + length])
        elif kind == b"acTL":
            note = SEVERAL_PICTURES
        elif kind == b"IEND":
            return ImageHeader(size, orientation, note=note)
    _cut_short("PNG", data)


def _jpeg_header(data: bytes) -> ImageHeader:
    size, orientation = None, 1
    for marker, body, end in jpeg_segments(data):
        is_frame = 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC)
        if is_frame and size is None and body + 5 <= len(data):
            height, width = struct.unpack_from(">HH", data, body + 1)
            size = width, height
        elif marker == 0xE1 and data.startswith(b"Exif\0\0", body):
            orientation = _orientation(data[body + 6 : end])
        elif marker == 0xD9:
            return ImageHeader(size, orientation)
    _cut_short("JPEG", data)


def jpeg_segments(data: bytes) -> Iterator[tuple[int, int, int]]:
    """Marker, start and end of the content of every segment up to the end marker; the scans between are skipped."""
    # within a scan, 0xff is followed by 0 or by a restart marker, and before any marker there may be more of 0xff
    mark = re.compile(rb"\xff([^\x00\x01\xd0-\xd7\xff])", re.DOTALL)
    position = 2
    while found := mark.search(data, position):
        marker, body = found[1][0], found.end() + 2
        if marker == 0xD9:
            yield marker, found.end(), found.end()
            return
        if body > len(data):
            return
        position = max(body, found.end() + struct.unpack_from(">H", data, found.end())[0])
        yield marker, body, position


def _tiff_header(data: bytes) -> ImageHeader:
    directories = tiff.read_directories(data)
    image = tiff.full_image(directories)
    if image is None:
        return ImageHeader(None, 1)
    bands, bits = image.number(TiffTag.SAMPLES, 1), image.number(TiffTag.BITS, 1)
    if bands > 1 and bits != 8 and image.number(TiffTag.PLANAR, 1) == 2:  # OpenCV mixes them up
        what = f"keeps its {bands} bands of {bits} bits one after the other (planar)"
        raise InputError(f"{what}, which is not read; save it with interleaved bands, or one band of it")
    sizes = [one.size for one in directories if min(one.size) > 0 and not one.is_reduced]
    note = ""
    if len(sizes) > 1:
        which = "the first" if len(set(sizes)) == 1 else f"the largest ({image.size[0]}x{image.size[1]} px)"
        note = f"holds {len(sizes)} images; {which} is used"
    orientation = image.number(TiffTag.ORIENTATION, 1)
    return ImageHeader(
        image.size,
        orientation if 1 <= orientation <= 8 else 1,
        image.number(TiffTag.PHOTOMETRIC) == TiffTag.COLOUR_FILTERS
        or any(TiffTag.DNG_VERSION in one.tags for one in directories),
        note,
        _nodata(image.text(TiffTag.NODATA)),
        image,
        _unusual_tiff(image),
    )


def _unusual_tiff(image: tiff.Directory) -> str:
    """What decoders may not read of an image, "" if it is of the usual kind."""
    bands, bits = image.number(TiffTag.SAMPLES, 1), image.number(TiffTag.BITS, 1)
    kind, compression = image.number(TiffTag.SAMPLE_FORMAT, 1), image.number(TiffTag.COMPRESSION, 1)
    if bands > 4:
        return f"has {bands} bands, needed 1 (grey), 3 (colour) or 4; export one band, or three of them"
    if kind in SAMPLE_KINDS or (kind == 3 and bits not in (32, 64)):
        what = SAMPLE_KINDS.get(kind, "floating-point")
        return f"holds {what} values of {bits} bits, needed 8 or 16-bit integers or 32-bit floats; convert it"
    if name := COMPRESSIONS.get(compression, f"number {compression}"):
        return f"is compressed by a method that is not read ({name}); save it with LZW, deflate or none"
    return ""


def _nodata(text: str) -> float | None:
    """The value of GDAL's tag; NaN and what is no number stand for none."""
    try:
        value = float(text)
    except ValueError:
        return None
    return value if value == value else None


def _webp_header(data: bytes) -> ImageHeader:
    (length,) = struct.unpack_from("<I", data.ljust(12, b"\0"), 4)
    size, orientation, note, position = None, 1, "", 12
    while position + 8 <= min(len(data), length + 8):
        kind, n = struct.unpack_from("<4sI", data, position)
        body, position = position + 8, position + 8 + n + n % 2
        if body + n > len(data):
            _cut_short("WebP", data)
        content = data[body : body + min(n, 65536)]
        if kind in (b"VP8 ", b"VP8L") and n > 1024 and not any(data[body + n - 256 : body + n]):
            raise InputError("the WebP file is damaged (it ends in zeros); copy or download it again")
        size = size or _webp_size(kind, content)
        if kind == b"ANIM":
            note = SEVERAL_PICTURES
        elif kind == b"EXIF":
            orientation = _orientation(content.removeprefix(b"Exif\0\0"))
    if length + 8 > len(data):
        _cut_short("WebP", data)
    return ImageHeader(size, orientation, note=note)


def _webp_size(kind: bytes, content: bytes) -> tuple[int, int] | None:
    """Width and height from the first chunk of a WebP file; None from another one."""
    if len(content) < 10:
        return None
    if kind == b"VP8X":
        width, height = (int.from_bytes(content[at : at + 3], "little") for at in (4, 7))
        return width + 1, height + 1
    if kind == b"VP8L":
        bits = int.from_bytes(content[1:5], "little")
        return (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1
    if kind == b"VP8 ":
        width, height = struct.unpack_from("<HH", content, 6)
        return width & 0x3FFF, height & 0x3FFF
    return None


def _avif_header(data: bytes) -> ImageHeader:
    """Size and orientation from the properties `ispe`, `irot` and `imir` (ISO/IEC 23008-12)."""
    head, size = data[:8192], None
    if found := re.search(rb"ispe\0{4}(.{8})", head, re.DOTALL):
        width, height = struct.unpack(">II", found[1])
        size = width, height
    turns = re.search(rb"irot(.)", head, re.DOTALL)
    mirrors = re.search(rb"imir(.)", head, re.DOTALL)
    quarters = turns[1][0] & 3 if turns else 0  # anticlockwise
    plain, mirrored = (1, 8, 3, 6), ((4, 5, 2, 7), (2, 7, 4, 5))  # turned first, then mirrored
    return ImageHeader(size, mirrored[mirrors[1][0] & 1][quarters] if mirrors else plain[quarters])


def _is_animated_gif(data: bytes) -> bool:
    from PIL import Image

    if not data.startswith(b"GIF8"):
        return False
    try:
        with Image.open(BytesIO(data), formats=["GIF"]) as picture:
            return bool(getattr(picture, "is_animated", False))
    except Exception:  # Pillow raises many kinds of exceptions on damaged bytes
        return False


def _other_size(data: bytes) -> tuple[int, int] | None:
    """Width and height from the header of a BMP, GIF, JPEG 2000 or PNM file and their like."""
    start, place = data[:512], data.find(b"ihdr", 0, 512)
    if start.startswith(b"BM") and len(start) >= 26:
        width, height = struct.unpack_from("<ii", start, 18)
        return abs(width), abs(height)
    if start.startswith(b"GIF8") and len(start) >= 10:
        width, height = struct.unpack_from("<HH", start, 6)
        return width, height
    if start.startswith(b"\x59\xa6\x6a\x95") and len(start) >= 12:  # Sun raster
        width, height = struct.unpack_from(">II", start, 4)
        return width, height
    if start.startswith(b"\xff\x4f\xff\x51") and len(start) >= 24:  # a JPEG 2000 codestream
        right, bottom, left, top = struct.unpack_from(">IIII", start, 8)
        return right - left, bottom - top
    if b"jP  " in start[:8] and 0 <= place <= len(start) - 12:
        height, width = struct.unpack_from(">II", start, place + 4)
        return width, height
    found = re.match(rb"P[1-6Ff](?:\s|#[^\n]*\n)+(\d{1,9})(?:\s|#[^\n]*\n)+(\d{1,9})", start)
    found = found or re.match(rb"P7\n(?:.*\n)*?WIDTH (\d{1,9})\nHEIGHT (\d{1,9})\n", start)
    return (int(found[1]), int(found[2])) if found else None


def _orientation(exif: bytes) -> int:
    """Orientation in an EXIF block, 1 if there is none."""
    directories = tiff.read_directories(exif)
    value = directories[0].number(TiffTag.ORIENTATION, 1) if directories else 1
    return value if 1 <= value <= 8 else 1
