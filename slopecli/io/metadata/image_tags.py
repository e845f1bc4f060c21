"""The tags of an image file, EXIF by their number and XMP by namespace and name, as numbers and text.

Sources: EXIF 2.3 (CIPA DC-008), XMP (ISO 16684-1). Pillow finds the blocks and reads EXIF; it decodes no pixels.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from io import BytesIO
from typing import Any

from slopecli.io.image_headers import JPEG_SIGNATURE, jpeg_segments
from slopecli.io.metadata.xmp_packet import Name, xmp_values

XMP_HEADER = b"http://ns.adobe.com/xap/1.0/\0"  # of a segment of JPEG files
FORMATS = ("JPEG", "PNG", "WEBP", "TIFF")  # that have EXIF or XMP


class Tag(IntEnum):
    """Numbers of tags: those of the picture and the two directories below it (TIFF 6.0), then those of EXIF."""

    MAKER = 0x010F
    MODEL = 0x0110
    ORIENTATION = 0x0112
    XMP = 0x02BC  # of TIFF files
    EXIF = 0x8769
    GPS = 0x8825
    FOCAL_MM = 0x920A
    MAKER_NOTE = 0x927C
    WIDTH = 0xA002  # of the image as taken
    HEIGHT = 0xA003
    PLANE_X = 0xA20E  # FocalPlaneXResolution, pixels per unit
    PLANE_Y = 0xA20F
    PLANE_UNIT = 0xA210
    ZOOM = 0xA404
    FOCAL_35 = 0xA405
    LENS_MODEL = 0xA434


class GpsTag(IntEnum):
    """Numbers of tags in the GPS directory of EXIF."""

    LATITUDE_SIDE = 1
    LATITUDE = 2
    LONGITUDE_SIDE = 3
    LONGITUDE = 4
    ALTITUDE_SIDE = 5
    ALTITUDE = 6
    DIRECTION_OF = 0x10  # GPSImgDirectionRef: T or M
    DIRECTION = 0x11
    DATUM = 0x12
    ERROR_M = 0x1F  # GPSHPositioningError


@dataclass(frozen=True)
class ImageTags:
    """Tags of the picture (`main`), of how it was taken (`exif`) and of the place (`gps`), by number; XMP by name.

    size : (width, height) px as stored.  notes : what could not be read.
    """

    size: tuple[int, int]
    main: Mapping[int, Any] = field(default_factory=dict)
    exif: Mapping[int, Any] = field(default_factory=dict)
    gps: Mapping[int, Any] = field(default_factory=dict)
    xmp: Mapping[Name, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def text(self, tag: int) -> str:
        """The text of a tag of the picture, printable and short; "" without one."""
        value = self.main.get(tag)
        plain = value.decode("latin-1") if isinstance(value, bytes) else str(value or "")
        return "".join(c for c in plain if c.isprintable()).strip()[:200]

    def xmp_number(self, namespace: str, *names: str) -> float | None:
        """The number under the first of the names of a namespace that has one."""
        found = (number_of(self.xmp.get((namespace, name))) for name in names)
        return next((value for value in found if value is not None), None)


def read_tags(data: bytes) -> ImageTags:
    """The tags of the bytes of an image file; none of a file that Pillow does not know or of damaged blocks."""
    from PIL import Image

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Pillow warns of corrupt blocks, and of large images, which are not decoded
        try:
            with Image.open(BytesIO(data), formats=FORMATS) as picture:
                main, exif, gps, damage = _exif_of(picture)
                packet = _xmp_of(data, picture, main)
                size = picture.size
        except Exception:  # Pillow raises many kinds of exceptions on damaged bytes
            return ImageTags((0, 0), notes=("its EXIF and XMP cannot be read: the file is of no kind that has them",))
    xmp, wrong = xmp_values(packet) if packet else ({}, "")
    notes = [damage] if damage else []
    return ImageTags(size, main, exif, gps, xmp, (*notes, *([f"its XMP {wrong}"] if wrong else [])))


def _xmp_of(data: bytes, picture: Any, main: Mapping[int, Any]) -> bytes:
    """The XMP packet of a picture, b"" without one; of a JPEG file the first, which old Pillow leaves out."""
    start_of_scan, application = 0xDA, 0xE1
    if data.startswith(JPEG_SIGNATURE):
        for marker, body, end in jpeg_segments(data):
            if marker == start_of_scan:
                break
            if marker == application and data.startswith(XMP_HEADER, body):
                return data[body + len(XMP_HEADER) : end]
    found = picture.info.get("xmp") or picture.info.get("XML:com.adobe.xmp") or main.get(Tag.XMP)
    found = found.encode() if isinstance(found, str) else found
    return found if isinstance(found, bytes) else b""


def _exif_of(picture: Any) -> tuple[dict[int, Any], dict[int, Any], dict[int, Any], str]:
    """The tags of a picture, and of the two directories below, and what is wrong with them."""
    found: list[dict[int, Any]] = [{}, {}, {}]
    try:
        exif = picture.getexif()
        found[0] = dict(exif)
        for place, number in ((1, Tag.EXIF), (2, Tag.GPS)):
            found[place] = dict(exif.get_ifd(number))
    except Exception:  # as above
        return found[0], found[1], found[2], "its EXIF is damaged"
    return found[0], found[1], found[2], ""


def number_of(value: Any) -> float | None:
    """A finite number of a tag or of a text such as "+12.5" or "25/2"; None for anything else."""
    if isinstance(value, tuple | list):
        value = value[0] if len(value) == 1 else None
    try:
        if isinstance(value, str):
            above, slash, below = value.partition("/")
            number = float(above) / float(below) if slash else float(value)
        elif isinstance(value, bytes) or value is None:
            return None
        else:
            number = float(value)
    except (TypeError, ValueError, ZeroDivisionError, OverflowError):
        return None
    return number if math.isfinite(number) else None


def numbers_of(value: Any, count: int) -> tuple[float, ...] | None:
    """That many finite numbers of a tag; None for anything else."""
    if not isinstance(value, tuple | list) or len(value) != count:
        return None
    found = [number_of(one) for one in value]
    return None if None in found else tuple(one for one in found if one is not None)
