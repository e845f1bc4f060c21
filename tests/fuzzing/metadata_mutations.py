"""Photographs with odd EXIF and XMP: changed values, names and blocks, and packets that cost much if believed."""

from __future__ import annotations

import warnings
from random import Random
from typing import Any

import metadata_factory as factory
from PIL.TiffImagePlugin import IFDRational

from fuzzing import samples
from fuzzing.image_mutations import change_structure
from fuzzing.mutations import HOSTILE, ODD_TEXTS, change_bytes, change_encoding, change_text, changed

LONGEST = 60_000  # bytes of a packet in one segment of a JPEG file
SPACES = (
    *(
        factory.DJI,
        "http://pix4d.com/camera/1.0",
        "http://ns.sensefly.com/sensefly/1.0/",
        "http://www.parrot.com/drone-parrot/1.0/",
        "http://ns.adobe.com/exif/1.0/",
    ),
    "",
)
ANGLES = ("0", "+0.00", "-90", "-89.9", "90", "180", "361", "1e9")
EXIF_TAGS = (
    *(factory.FOCAL_MM, factory.FOCAL_35, factory.WIDTH, factory.HEIGHT),
    *(factory.PLANE_X, factory.PLANE_Y, factory.PLANE_UNIT, 41988),
)
BOMBS = (
    b'<!DOCTYPE x [<!ENTITY a "ha">'
    + b"".join(b'<!ENTITY a%d "%s">' % (k, b"&a%d;" % (k - 1) * 10) for k in range(1, 9))
    + b"]><x>&a8;</x>",
    b'<!DOCTYPE x [<!ENTITY a SYSTEM "file:///dev/zero">]><x>&a;</x>',
    b"<x>" * 20_000,
    b"<x " + b" ".join(b'a%d="1"' % k for k in range(4000)) + b"/>",
    b'<x a="1" a="2"/>',
    b"\0" * LONGEST,
    b"<?xpacket?>" * 5000,
)


def good_values(number: int) -> dict[str, Any]:
    """What DJI writes of image 1 or 2 of the sample pair."""
    return factory.gimbal(
        30.0,
        -85.0,
        GpsLatitude=f"+{47.3769 + 1e-4 * number:.6f}",
        GpsLongitude="+8.541700",
        AbsoluteAltitude="+412.30",
        RelativeAltitude=f"+{40.0 - number:.1f}",
        DewarpData="2021-05-11;90.5,90.5,0.2,-0.1,-0.01,0.01,0,0,0",
        DewarpFlag="0",
        RtkStdLat="0.01",
        RtkStdLon="0.02",
        RtkStdHgt="0.03",
    )


def odd_photograph(rng: Random, number: int) -> bytes:
    """Image 1 or 2 of the sample pair with odd metadata."""
    values = good_values(number)
    for _ in range(rng.choice((0, 1, 1, 2, 4))):
        name = rng.choice([*values, "GpsLongtitude", "CalibratedFocalLength", "Yaw", "a b", "é"])
        values[name] = rng.choice(
            (*ODD_TEXTS, *HOSTILE[:8], *ANGLES, "1/0", "50/3", "2021;1,2", ",,,,,,,,", "1" * 5000)
        )
        if rng.random() < 0.2:
            del values[name]
    values = {name: value for name, value in values.items() if " " not in name}
    packet = factory.xmp_packet({name: _plain(value) for name, value in values.items()}, _space(rng))
    packet = _odd_packet(rng, packet)[:LONGEST]
    exif = {tag: _odd_number(rng) for tag in rng.sample(EXIF_TAGS, rng.choice((0, 0, 0, 1, 2, 5)))}
    if rng.random() < 0.2:
        exif |= _telephone(rng)
    gps = factory.gps_tags(rng.choice((47.3769, -90.0, 91.0)), 8.5417 + 1e-4 * number, rng.choice((412.0, -3.0, None)))
    if rng.random() < 0.3:
        gps[rng.choice(list(gps))] = rng.choice(("X", b"\xff", (IFDRational(1, 0),) * 3, (IFDRational(1, 2),), 1, ""))
    main = {274: rng.choice((1, 1, 1, 2, 3, 6, 8, 9, 65535))}
    grey = samples.view(number)[..., 0]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Pillow warns of odd values, and does not write every one
        try:
            file = factory.photograph(grey, exif, gps, main, packet)
        except Exception:
            file = factory.photograph(grey, xmp=packet)
    return changed(rng, file, change_structure, change_bytes) if rng.random() < 0.2 else file


def _telephone(rng: Random) -> dict[int, Any]:
    """What Apple writes of gravity, mostly changed."""
    note = factory.apple_note(*(rng.choice((0.0, -1.0, 0.7, 2.0, 2000.0)) for _ in range(3)))
    lens = rng.choice(("iPhone 7 back camera 3.99mm f/1.8", "front", "", "\x1bback", "é" * 3000))
    return {
        factory.MAKER_NOTE: changed(rng, note, change_bytes) if rng.random() < 0.8 else note,
        factory.LENS_MODEL: lens,
    }


def _space(rng: Random) -> str:
    return factory.DJI if rng.random() < 0.9 else rng.choice(SPACES)


def _plain(value: Any) -> str:
    return str(value).encode("utf-8", "replace").decode()


def _odd_number(rng: Random) -> Any:
    numerator, denominator = (rng.choice((0, 1, 3, 35, 400, 10**6, 2**32 - 1)) for _ in range(2))
    return rng.choice((numerator % 65536, IFDRational(numerator, denominator), IFDRational(88, 10), "x"))


def _odd_packet(rng: Random, packet: bytes) -> bytes:
    way = rng.random()
    if way < 0.15:
        return rng.choice(BOMBS)
    if way < 0.25:
        return rng.choice(BOMBS) + packet
    return changed(rng, packet, change_text, change_encoding, change_bytes) if way < 0.5 else packet
