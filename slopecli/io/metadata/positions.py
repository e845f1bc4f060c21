"""The place of a camera out of its metadata: satellite fixes in EXIF and in the XMP of drones, and their errors."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

from slopecli.io.metadata.attitudes import DJI
from slopecli.io.metadata.image_tags import GpsTag, ImageTags, number_of, numbers_of
from slopecli.options import Position


@dataclass(frozen=True)
class FixErrors:
    """1-sigma, m, of a satellite fix that states none, and of a length the relative one beyond which it gives no scale.

    place : against the map, and twice as much against the level of the sea: what receivers of drones and telephones
        reach in the open.
    apart : north and east each, of a fix against another of the same flight, whose errors are mostly the same.
    climb : of a difference of two heights above take-off, by air pressure.
    """

    place: float = 3.0
    apart: float = 1.0
    climb: float = 0.5
    most_share: float = 0.3  # as of --scale-sigma
    farthest: float = 1e5  # of a height, and of one image from the other: beyond, the number is none


FIX = FixErrors()


def position_of(tags: ImageTags) -> tuple[Position | None, str]:
    """The place that the metadata state, and a note where they state one that cannot be used."""
    latitude, longitude, altitude, note = _stated(tags)
    if latitude is None or longitude is None:
        return None, note
    if not (abs(latitude) <= 90.0 and abs(longitude) <= 180.0):
        return None, f"its GPS position {latitude:.6g}, {longitude:.6g} is on no globe"
    if latitude == longitude == 0.0:
        return None, "its GPS position is 0, 0, which is what is written without a fix"
    sigma, sigma_up, apart = _sigmas(tags)
    return Position(latitude, longitude, altitude, sigma, sigma_up, apart), note


def _stated(tags: ImageTags) -> tuple[float | None, float | None, float | None, str]:
    """Latitude, longitude, degrees, altitude, m, and a note. XMP has more digits, and is preferred to EXIF."""
    latitude = tags.xmp_number(DJI, "GpsLatitude", "GPSLatitude", "Latitude")
    longitude = tags.xmp_number(DJI, "GpsLongitude", "GpsLongtitude", "GPSLongitude", "GPSLongtitude", "Longitude")
    above = _altitude(tags)
    if latitude is not None and longitude is not None:
        return latitude, longitude, above, ""
    datum = re.sub("[^A-Z0-9]", "", str(tags.gps.get(GpsTag.DATUM) or "").upper())
    if datum and not datum.startswith(("WGS84", "UNKNOWN")):
        return None, None, None, f"its GPS position is of the datum {datum[:20]}, not of WGS 84"
    latitude = _angle(tags.gps.get(GpsTag.LATITUDE), tags.gps.get(GpsTag.LATITUDE_SIDE), "NS")
    longitude = _angle(tags.gps.get(GpsTag.LONGITUDE), tags.gps.get(GpsTag.LONGITUDE_SIDE), "EW")
    partly = any(tag in tags.gps for tag in (GpsTag.LATITUDE, GpsTag.LONGITUDE)) and (
        latitude is None or longitude is None
    )
    return latitude, longitude, above, "its GPS position is incomplete" if partly else ""


def _altitude(tags: ImageTags) -> float | None:
    """Metres up; None where it is not stated, or is no altitude."""
    altitude = tags.xmp_number(DJI, "AbsoluteAltitude")
    if altitude is None and (altitude := number_of(tags.gps.get(GpsTag.ALTITUDE))) is not None:
        below = tags.gps.get(GpsTag.ALTITUDE_SIDE) in (b"\x01", 1, "1")
        altitude = -altitude if below else altitude
    return altitude if altitude is not None and abs(altitude) < FIX.farthest else None


def _angle(value: Any, side: Any, sides: str) -> float | None:
    """Degrees out of degrees, minutes and seconds, and the letter of a side; None for anything else."""
    parts = numbers_of(value, 3)
    letter = (side.decode("latin-1") if isinstance(side, bytes) else str(side or "")).strip("\0 ").upper()
    if parts is None or letter not in sides or len(letter) != 1 or min(parts) < 0:
        return None
    degrees = parts[0] + parts[1] / 60.0 + parts[2] / 3600.0
    return degrees if letter == sides[0] else -degrees


def _sigmas(tags: ImageTags) -> tuple[float, float, float]:
    """1-sigmas, m, of the place, of the height, and of the place against another: as stated, or as usual."""
    north, east, up = (tags.xmp_number(DJI, name) for name in ("RtkStdLat", "RtkStdLon", "RtkStdHgt"))
    if north and east and min(north, east) > 0 and max(north, east) < FIX.farthest:
        place = max(north, east)
        return place, up if up and 0 < up < FIX.farthest else 2 * place, place
    stated = number_of(tags.gps.get(GpsTag.ERROR_M))
    place = stated if stated is not None and 0 < stated < FIX.farthest else FIX.place
    return place, max(2 * FIX.place, place), min(place, FIX.apart)


def relative_altitude_of(tags: ImageTags) -> float | None:
    """Height above the place of take-off, m; None where it is not stated, or is no height."""
    height = tags.xmp_number(DJI, "RelativeAltitude")
    return height if height is not None and abs(height) < FIX.farthest else None
