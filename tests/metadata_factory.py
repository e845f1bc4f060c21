"""Image files with EXIF and XMP, as cameras write them, by a writer of our own beside Pillow."""

from __future__ import annotations

import io
import struct
from collections.abc import Mapping
from fractions import Fraction
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np
from PIL import Image as PilImage
from PIL.TiffImagePlugin import IFDRational

DJI = "http://www.dji.com/drone-dji/1.0/"
PLACE = (47.3769, 8.5417)  # latitude, longitude, deg
EXIF_IFD, GPS_IFD = 0x8769, 0x8825
MAKER_NOTE, LENS_MODEL = 37500, 42036
FOCAL_MM, FOCAL_35, WIDTH, HEIGHT, PLANE_X, PLANE_Y, PLANE_UNIT = 37386, 41989, 40962, 40963, 41486, 41487, 41488


def xmp_packet(values: Mapping[str, Any], namespace: str = DJI, prefix: str = "drone-dji") -> bytes:
    """An XMP packet with attributes of one namespace."""
    attributes = " ".join(f"{prefix}:{name}={quoteattr(str(value))}" for name, value in values.items())
    return (
        '<?xpacket begin="\ufeff" id="W5M0MpCehiHzreSzNTczkc9d"?>\n<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF '
        'xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#"><rdf:Description rdf:about="" '
        f'xmlns:{prefix}="{namespace}" {attributes}/></rdf:RDF></x:xmpmeta>\n<?xpacket end="w"?>'
    ).encode()


def gimbal(yaw: float, pitch: float, roll: float = 0.0, **more: Any) -> dict[str, Any]:
    """The angles of a gimbal as DJI writes them, and more."""
    angles = {"GimbalYawDegree": yaw, "GimbalPitchDegree": pitch, "GimbalRollDegree": roll}
    return {**{name: f"{angle:+.2f}" for name, angle in angles.items()}, **more}


def apple_note(*vector: float) -> bytes:
    """The maker's note of a telephone, with an acceleration, g, along the right, the top and the outside of it."""
    start = b"Apple iOS\0\0\1MM" + struct.pack(">H", 2)
    entries = struct.pack(">HHII", 1, 9, 1, 14) + struct.pack(">HHII", 8, 10, 3, len(start) + 28)
    fractions = (number for one in vector for number in (round(one * 10**6), 10**6))
    return start + entries + bytes(4) + struct.pack(">6i", *fractions)


def degrees(angle: float) -> tuple[IFDRational, ...]:
    """Degrees, minutes and seconds of an angle, to a millionth of a second."""
    seconds = Fraction(round(abs(angle) * 3600 * 10**6), 10**6)
    minutes, seconds = divmod(seconds, 60)
    whole, minutes = divmod(minutes, 60)
    return IFDRational(int(whole)), IFDRational(int(minutes)), IFDRational(seconds.numerator, seconds.denominator)


def gps_tags(latitude: float, longitude: float, altitude: float | None = None) -> dict[int, Any]:
    """The GPS directory of EXIF."""
    sides = "N" if latitude >= 0 else "S", "E" if longitude >= 0 else "W"
    tags: dict[int, Any] = {1: sides[0], 2: degrees(latitude), 3: sides[1], 4: degrees(longitude)}
    if altitude is not None:
        tags |= {5: b"\1" if altitude < 0 else b"\0", 6: IFDRational(round(abs(altitude) * 1000), 1000)}
    return tags


def exif_block(
    exif: Mapping[int, Any] | None = None, gps: Mapping[int, Any] | None = None, main: Mapping[int, Any] | None = None
) -> PilImage.Exif:
    """EXIF with tags in its three directories."""
    block = PilImage.Exif()
    for tag, value in (main or {}).items():
        block[tag] = value
    for number, tags in ((EXIF_IFD, exif), (GPS_IFD, gps)):
        if tags:
            block[number] = dict(tags)
    return block


def photograph(
    pixels: np.ndarray | tuple[int, int],
    exif: Mapping[int, Any] | None = None,
    gps: Mapping[int, Any] | None = None,
    main: Mapping[int, Any] | None = None,
    xmp: bytes = b"",
    quality: int = 98,
) -> bytes:
    """A JPEG file of grey pixels, or of bare ones of that (width, height), with EXIF tags and an XMP packet."""
    grey = np.full(pixels[::-1], 128, np.uint8) if isinstance(pixels, tuple) else pixels
    file = io.BytesIO()
    PilImage.fromarray(grey).save(file, "JPEG", exif=exif_block(exif, gps, main), quality=quality)
    return with_xmp(file.getvalue(), xmp) if xmp else file.getvalue()


def with_xmp(jpeg: bytes, packet: bytes) -> bytes:
    """The JPEG file with an XMP packet right after its start."""
    content = b"http://ns.adobe.com/xap/1.0/\0" + packet
    return jpeg[:2] + b"\xff\xe1" + struct.pack(">H", len(content) + 2) + content + jpeg[2:]
