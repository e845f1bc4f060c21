"""The direction of gravity that Apple's telephones and tablets write beside a photograph, in their maker's note.

Source: ExifTool, "Apple Tags", AccelerationVector, in units of g: at rest it is gravity along the right, the top and
the outside of the screen. The camera at the back looks into the screen; its sensor has the top of the device at its
left.
"""

from __future__ import annotations

import math
import struct
from dataclasses import replace
from typing import NamedTuple

from slopecli.io.metadata.attitudes import SIGMAS, shown_turn_deg, steep
from slopecli.io.metadata.image_metadata import Attitude
from slopecli.io.metadata.image_tags import ImageTags, Tag

SOURCE = "gravity by Apple"
HEADER = b"Apple iOS\0"


class _Down(NamedTuple):
    """Unit vector of gravity in the axes of an image: right, down, ahead."""

    x: float
    y: float
    z: float

    def turned(self, turn_deg: float) -> _Down:
        """In the axes of the image turned clockwise by quarters."""
        quarters = round(turn_deg / 90.0) % 4
        x, y = ((self.x, self.y), (-self.y, self.x), (-self.x, -self.y), (self.y, -self.x))[quarters]
        return _Down(x, y, self.z)


def gravity_attitude(tags: ImageTags, orientation: int, heading_deg: float | None) -> tuple[Attitude | None, str]:
    """The attitude of the pixels as stored, by gravity and the heading stated; a note where it cannot be used."""
    vector = acceleration_of(tags.exif.get(Tag.MAKER_NOTE))
    if vector is None:
        return None, ""
    length = math.hypot(*vector)
    if not 0.9 < length < 1.1:
        return None, f"its {SOURCE} is {length:.2f} g: it was moved as it was taken"
    if "back" not in str(tags.exif.get(Tag.LENS_MODEL) or ""):
        return None, f"its {SOURCE} is not used: it is not said to be taken with a camera at the back"
    right, top, outside = (value / length for value in vector)
    down = _as_stored(_Down(-top, -right, -outside), tags.size, orientation)
    if down is None:
        return None, f"its {SOURCE} does not fit its EXIF orientation {orientation}: it was turned after it was taken"
    attitude = Attitude(
        -math.degrees(math.asin(down.z)),
        math.degrees(math.atan2(down.x, down.y)),
        tilt_sigma_deg=SIGMAS.body,
        yaw_sigma_deg=SIGMAS.telephone,
        source=SOURCE,
    )
    return (attitude if steep(down.x, down.y) else replace(attitude, yaw_deg=heading_deg)), ""


def _as_stored(sensor: _Down, size: tuple[int, int], orientation: int) -> _Down | None:
    """Gravity in the axes of the pixels as stored, out of that in those of the sensor; None where they were turned.

    Pixels higher than wide were turned by a program: the way that has the top of the image up. The image as shown must
    have its top up, unless it looks too steeply down, or up, to tell.
    """
    shown = shown_turn_deg(orientation)
    if shown is None:
        return None
    width, height = size
    ways = [sensor] if width >= height else [sensor.turned(90.0), sensor.turned(270.0)]
    if steep(sensor.x, sensor.y):
        return ways[0] if len(ways) == 1 else None
    best = max(ways, key=lambda way: way.turned(shown).y)
    upright = best.turned(shown)
    return best if upright.y > abs(upright.x) else None


def acceleration_of(note: object) -> tuple[float, float, float] | None:
    """The three numbers of AccelerationVector out of a maker's note; None without it."""
    if not isinstance(note, bytes) or not note.startswith(HEADER):
        return None
    order = {b"MM": ">", b"II": "<"}.get(note[12:14])
    try:
        (count,) = struct.unpack_from(f"{order}H", note, 14) if order else (0,)
        for k in range(count):
            entry = 16 + 12 * k  # after header, version, order of bytes and the number of entries
            tag, kind, length, place = struct.unpack_from(f"{order}HHII", note, entry)
            if (tag, kind, length) == (8, 10, 3):  # AccelerationVector: three signed fractions
                parts = struct.unpack_from(f"{order}6i", note, place)
                x, y, z = (above / below for above, below in zip(parts[::2], parts[1::2], strict=True))
                return x, y, z
    except (struct.error, ZeroDivisionError):
        pass
    return None
