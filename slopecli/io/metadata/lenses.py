"""Focal length and distortion out of the metadata of an image: one row a way in which they are stated.

Two conventions of the "35 mm equivalent" are in use: of equal field of view across the image (36 mm), and of equal
field of view across the diagonal (43.27 mm, CIPA DCG-001). They are the same for images of 3:2, and 4 % apart for 4:3.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from slopecli.errors import InputError
from slopecli.io.cameras.values import refuse_off_middle
from slopecli.io.metadata.attitudes import DJI
from slopecli.io.metadata.image_metadata import Lens
from slopecli.io.metadata.image_tags import ImageTags, Tag, number_of

Size = tuple[int, int]


@dataclass(frozen=True)
class LensErrors:
    """Relative 1-sigmas of a focal length.

    calibrated : of the camera itself, by its maker, which the temperature moves.  nominal : of a lens by its name, as
    data sheets round and focusing changes it; as large is that of the two equivalents, which are 4 % apart at most.
    contradiction : between two statements of one file, beyond which neither is believed.
    """

    calibrated: float = 0.005
    nominal: float = 0.02
    contradiction: float = 0.15


ERRORS = LensErrors()


def taken_size(tags: ImageTags) -> Size | None:
    """(width, height) px of the image as taken, None where EXIF does not state it."""
    sides = [number_of(tags.exif.get(tag)) for tag in (Tag.WIDTH, Tag.HEIGHT)]
    width, height = (int(side) if side is not None and 1 <= side < 1e6 else 0 for side in sides)
    return (width, height) if width and height else None


def _calibrated_size(tags: ImageTags, taken: Size) -> Size:
    """(width, height) px of the image that DJI's numbers are for: twice as wide as the centre that is stated.

    Programs that shrink an image write its new size into EXIF, and leave these numbers as they were. The height follows
    from the shape of the image, which may be that of the sensor cut in height.
    """
    centre = tags.xmp_number(DJI, "CalibratedOpticalCenterX")
    width, height = taken
    if centre is None or not 1 <= centre < 1e6 or width < height:
        return taken
    return round(2 * centre), max(round(2 * centre * height / width), 1)


# DJI's calibrations, the better first: tag, and what its numbers are, after a date
DEWARPS = {
    "DewarpDataK6": "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6",
    "DewarpData": "fx fy cx cy k1 k2 p1 p2 k3",
}


def _dewarp(tags: ImageTags, taken: Size) -> Lens | None:
    """DJI's calibration: lengths in px, the principal point from the middle of the image, OpenCV's distortion."""
    for tag, names in DEWARPS.items():
        parts = tags.xmp.get((DJI, tag), "").rpartition(";")[2].split(",")
        values = [value for part in parts if (value := number_of(part)) is not None]
        if not len(values) == len(parts) == len(names.split()):
            continue
        fx, fy, cx, cy, *distortion = values
        if fx > 0 and fy > 0:
            undistorted = tags.xmp.get((DJI, "DewarpFlag"), "0").strip() == "1"
            how = ", distortion already taken out (DewarpFlag)" if undistorted else ""
            lens = () if undistorted else tuple(distortion)
            return Lens(_calibrated_size(tags, taken), fx, fy, ERRORS.calibrated, f"DJI {tag}{how}", (cx, cy), lens)
    return None


def _calibrated(tags: ImageTags, taken: Size) -> Lens | None:
    """DJI's focal length of the model of camera, px."""
    focal = tags.xmp_number(DJI, "CalibratedFocalLength")
    if focal is None or focal <= 0:
        return None
    size = _calibrated_size(tags, taken)
    return Lens(size, focal, focal, ERRORS.nominal, f"DJI CalibratedFocalLength {focal:g} px")


def _focal_plane(tags: ImageTags, taken: Size) -> Lens | None:
    """FocalLength in mm times the pixels per mm of FocalPlaneResolution."""
    focal_mm = number_of(tags.exif.get(Tag.FOCAL_MM))
    across, down = (number_of(tags.exif.get(tag)) for tag in (Tag.PLANE_X, Tag.PLANE_Y))
    units_mm = {2: 25.4, 3: 10.0, 4: 1.0, 5: 0.001}
    unit = units_mm.get(int(number_of(tags.exif.get(Tag.PLANE_UNIT)) or 2))
    if not focal_mm or not across or unit is None or min(focal_mm, across, down or across) <= 0:
        return None
    zoom = max(number_of(tags.exif.get(Tag.ZOOM)) or 1.0, 1.0)
    fx, fy = (zoom * focal_mm * per / unit for per in (across, down or across))
    sensor = f"{taken[0] * unit / across:.3g} mm wide sensor"
    return Lens(taken, fx, fy, ERRORS.nominal, f"FocalLength {focal_mm:g} mm, {sensor}")


def _equivalent(tags: ImageTags, taken: Size) -> Lens | None:
    """FocalLengthIn35mmFilm, by the diagonal: that of the whole sensor, of 4:3 unless the image is of 3:2 or less wide.

    An image of 16:9 is a sensor of 4:3 cut at the top and at the bottom; one of 3:2 is a whole sensor.
    """
    film = number_of(tags.exif.get(Tag.FOCAL_35))
    if film is None or film <= 0:
        return None
    longer, shorter = max(taken), min(taken)
    ratio = longer / shorter
    sensor_height = shorter if ratio < 1.6 else 0.75 * longer  # 1.6: between 3:2 and 16:9
    per_mm = math.hypot(longer, sensor_height) / math.hypot(36.0, 24.0)  # mm, of film
    sigma = math.hypot(ERRORS.nominal, ERRORS.nominal, 0.5 / math.sqrt(3.0) / film)  # a whole number of mm
    return Lens(taken, film * per_mm, film * per_mm, sigma, f"35 mm equivalent {film:g} mm")


@dataclass(frozen=True)
class LensSource:
    """One way in which metadata state a focal length.

    name, needs : in docs/drone.md: what it is called, and the tags that it needs.
    lens : the lens of the image as taken out of its tags, None where they do not state it in this way.
    """

    name: str
    needs: str
    lens: Callable[[ImageTags, Size], Lens | None]


# the best first; the first that is stated is used
LENS_SOURCES = (
    LensSource("calibration by DJI", "`DewarpDataK6` or `DewarpData`, `DewarpFlag`", _dewarp),
    LensSource("focal length by DJI", "`CalibratedFocalLength`", _calibrated),
    LensSource("millimetres", "`FocalLength`, `FocalPlaneXResolution` with its unit", _focal_plane),
    LensSource("35 mm equivalent", "`FocalLengthIn35mmFilm`", _equivalent),
)


def lens_of(tags: ImageTags) -> tuple[Lens | None, str]:
    """The lens of an image as stored, and a note where one is stated that cannot be used."""
    taken = taken_size(tags) or tags.size
    found = [lens for row in LENS_SOURCES if (lens := row.lens(tags, taken)) is not None]
    if not found:
        focal_mm = number_of(tags.exif.get(Tag.FOCAL_MM))
        return None, f"it states a focal length of {focal_mm:g} mm, but no size of the sensor" if focal_mm else ""
    first, *others = found
    for other in others:
        if abs(math.log(other.fx / other.size[0] * first.size[0] / first.fx)) > ERRORS.contradiction:
            each = f"{first.source} is {first.fx:.4g} px, {other.source} is {other.fx:.4g} px"
            return None, f"its focal lengths contradict each other: {each}"
    try:
        refuse_off_middle(first.centre_px, first.size, "DJI measures it from there: is it from a corner?")
        lens = _as_stored(first, tags.size)
        lens.camera()
    except InputError as error:
        return None, f"its focal length cannot be used: {error}"
    return lens, ""


def _as_stored(lens: Lens, stored: Size) -> Lens:
    """The lens of an image as taken, for the image as stored: resized, or turned by a quarter.

    Raises
    ------
    InputError : the image is neither, or it is turned and the principal point is not in the middle.
    """
    (width, height), sides = lens.size, f"{lens.size[0]}x{lens.size[1]} px were taken, {stored[0]}x{stored[1]} are here"
    turned = not is_resized(lens.size, stored) and is_resized((height, width), stored)
    if not turned and not is_resized(lens.size, stored):
        raise InputError(f"the image was cut after it was taken ({sides})")
    if turned and (any(lens.centre_px) or any(lens.distortion)):
        raise InputError(f"the image was turned after it was taken ({sides})")
    scale = max(stored) / max(width, height)
    fx, fy = (lens.fy, lens.fx) if turned else (lens.fx, lens.fy)
    x, y = lens.centre_px
    source = lens.source if scale == 1.0 else f"{lens.source}, resized by {scale:.4g}"
    return Lens(stored, fx * scale, fy * scale, lens.sigma, source, (x * scale, y * scale), lens.distortion)


def is_resized(one: Size, other: Size) -> bool:
    """Whether both sizes have one shape, to within the rounding of a pixel."""
    return abs(other[1] - one[1] * other[0] / one[0]) < 1 or abs(other[0] - one[0] * other[1] / one[1]) < 1
