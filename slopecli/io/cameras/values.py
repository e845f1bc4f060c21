"""Shared by the camera formats: parse numbers and lens names, check the values, build the Camera."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Collection, Hashable, Iterable, Mapping, Sequence
from dataclasses import replace
from difflib import get_close_matches
from typing import Any, NamedTuple, TypeVar

from slopecli.errors import InputError
from slopecli.geometry.camera import OFF_MIDDLE, share_with_rays
from slopecli.types import Camera, CameraModel

Name = TypeVar("Name", bound=Hashable)
Size = tuple[int, int]  # width, height, px
Tree = Mapping[str, Any]  # names and values of a JSON or YAML file
Intrinsics = tuple[float, float, float, float]  # fx, fy, cx, cy, px

# The names under which the lens models go, lower case without separators. What is not here is refused by its name.
LENS_NAMES: dict[CameraModel, str] = {
    "pinhole": "none pinhole simplepinhole pinholecamera ideal undistorted rectified nodistortion",
    "brown": "brown brownconrady opencv opencv5 opencv8 opencvpinhole fullopencv perspective rectilinear plumbbob "
    "radtan radialtangential radialtangentialdistortion rationalpolynomial rational simpleradial radial standard "
    "normal pinholeradtan pinholeradialtangential",
    "fisheye": "fisheye equidistant equi opencvfisheye fisheyeopencv simplefisheye simpleradialfisheye radialfisheye "
    "cv2fisheye equidistantfisheye fisheyeequidistant kannalabrandt kannalabrandt4 kannalabrandt8 kb4 kb8 pinholeequi "
    "pinholeequidistant",
}
LENSES_KNOWN = "pinhole, radial-tangential, rational and equidistant fisheye"
BROWN_ORDER = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
FISHEYE_ORDER = ("k1", "k2", "k3", "k4")
LOOKS_LIKE_DISTORTION = "coef|distor|^r?dist(?!ance)|radial|tangential|lensparam"


class Bounds(NamedTuple):
    """Limits beyond which a value is of no camera; `findings.camera_checks` warns of what is unusual within them."""

    focal: tuple[float, float] = (0.15, 1000.0)  # over the longer side of the image; millimetres, shares fall below
    least_wide_focal: float = 0.06  # the same of fisheye lenses
    largest_coefficient: float = 1e6  # rational models have a few hundred
    least_seen: float = 0.1  # of the pixels of an image must have a ray


BOUNDS = Bounds()
WIDE: tuple[CameraModel, ...] = ("fisheye", "cahvor")


def lens_model(name: Any, what: str = "lens model") -> CameraModel:
    """Our name of a lens model, or InputError naming the one that is not understood."""
    plain = re.sub("^distortion(?=.)", "", plain_key(name)) or "none"
    for model, names in LENS_NAMES.items():
        if plain in names.split():
            return model
    shown, meant = repr(name)[:60], _mistyped(plain)
    advice = f"did you mean {meant!r}?" if meant else "undistort the images first"
    raise InputError(f"{what} {shown} is not supported, only {LENSES_KNOWN} lenses are; {advice}")


def _mistyped(plain: str) -> str:
    """The known lens model that a name is most likely a misspelling of, "" where there is none."""
    known = [name for names in LENS_NAMES.values() for name in names.split() if len(name) > 4]
    near = [] if re.search(r"\d", plain) else get_close_matches(plain, known, n=1, cutoff=0.9)
    spelled = {"plumbbob": "plumb_bob", "rationalpolynomial": "rational_polynomial"}  # as ROS does
    return spelled.get(near[0], near[0]) if near else ""


def number(value: Any, name: str) -> float:
    """A finite float; YAML readers leave 1e-05 as text, so text that is a number counts."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise InputError(f"{name} is {repr(value)[:60]}, needed a number")
    try:
        found = float(value)
    except ValueError:
        raise InputError(f"{name} is {str(value)[:60]!r}, needed a number") from None
    except OverflowError:  # an integer of more than 308 digits
        found = math.inf
    if not math.isfinite(found):
        raise InputError(f"{name} is {found!r}, needed a finite number; calibrate again")
    return found


def numbers(value: Any, name: str) -> list[float]:
    """All numbers of a list, of nested lists, or of a matrix stored as {rows, cols, data}; none for null."""
    if value is None:
        return []
    if isinstance(value, Mapping):
        return _matrix_data(value, name)
    if isinstance(value, str) or not isinstance(value, Sequence):
        return [number(value, name)]
    return [x for element in value for x in numbers(element, name)]


def _matrix_data(matrix: Mapping[str, Any], name: str) -> list[float]:
    if "data" not in matrix:
        raise InputError(f"{name} holds {', '.join(map(str, matrix))}, needed a list or rows, cols and data")
    data = numbers(matrix["data"], name)
    for keys in (("rows", "cols"), ("sizes",)):
        sides = [side for key in keys for side in numbers(matrix.get(key), f"{key} of {name}")]
        if len(sides) >= len(keys) and math.prod(sides) != len(data):
            shape = f"{' x '.join(keys)} = {' x '.join(f'{side:g}' for side in sides)}"
            raise InputError(f"{name} has {len(data)} numbers, needed {shape}")
    return data


def intrinsics_of_matrix(value: Any, name: str) -> Intrinsics:
    """fx, fy, cx, cy of a 3x3 intrinsic matrix without skew."""
    fx, fy, cx, cy, skew = skewed_intrinsics(value, name)
    if skew != 0:
        raise InputError(f"{name} has skew {skew:g}, which is not supported; calibrate with square axes (skew 0)")
    return fx, fy, cx, cy


def skewed_intrinsics(value: Any, name: str) -> tuple[float, float, float, float, float]:
    """fx, fy, cx, cy and the skew, px, of a 3x3 intrinsic matrix, or of its four numbers by their names."""
    if isinstance(value, Mapping) and {"fx", "fy", "cx", "cy"} <= set(value):
        refuse_others(value, "fx fy cx cy skew width height", name)
        fx, fy, cx, cy = (number(value[key], key) for key in ("fx", "fy", "cx", "cy"))
        return fx, fy, cx, cy, number(value.get("skew") or 0, "skew")
    k = numbers(value, name)
    if len(k) != 9:
        raise InputError(f"{name} has {len(k)} numbers, needed a 3x3 matrix")
    if not any(k) or k == [1, 0, 0, 0, 1, 0, 0, 0, 1]:
        what = "all zero" if not any(k) else "the identity matrix"
        raise InputError(f"{name} is {what}: the camera is not calibrated; calibrate it first")
    if k[3] != 0 or k[6:] != [0, 0, 1]:
        raise InputError(f"{name} is not an intrinsic matrix [fx 0 cx; 0 fy cy; 0 0 1]; is it transposed, or scaled?")
    return k[0], k[4], k[2], k[5], k[1]


def size_of(width: Any, height: Any) -> Size | None:
    """Image size, or None when neither is given."""
    if width is None and height is None:
        return None
    return _side(width, "width"), _side(height, "height")


def known_size(size: Size | None) -> Size:
    """The size, or InputError when neither the file nor the caller knows it."""
    if size is None:
        raise InputError(
            "gives no image size; add width and height, or convert it: slopemap camera show FILE --size WxH -o DIR"
        )
    return size


def _side(value: Any, name: str) -> int:
    side = number(value, name)
    if side < 1 or side != int(side):
        raise InputError(f"{name} is {value!r}, needed a whole number of pixels")
    return int(side)


def named_coefficients(values: Mapping[str, Any], model: CameraModel) -> list[float]:
    """Coefficients in OpenCV's order from their names; a missing one is 0."""
    order = FISHEYE_ORDER if model == "fisheye" else BROWN_ORDER
    return [number(values.get(name) or 0, name) for name in order]


def coefficients_by_name(lens: Any, model: CameraModel, name: str) -> list[float]:
    """Coefficients in OpenCV's order, of a list or a matrix, or each by its name: k1, k2, p1, ...; InputError for names
    of which programs differ in what they mean."""
    if not isinstance(lens, Mapping) or not set(BROWN_ORDER) & set(lens):
        return numbers(lens, name)
    first = next(key for key in BROWN_ORDER if key in lens)
    if model == "fisheye":
        refuse_nonzero(lens, ("p1", "p2", "k5", "k6"), "beyond k1 to k4 of a fisheye lens")
    elif model not in ("pinhole", "brown"):
        raise InputError(f"{first} of a {model} lens: list its coefficients as {name}")
    elif not {"k5", "k6"} <= set(lens) and number(lens.get("k4") or 0, "k4") != 0:
        raise InputError(
            f'k4 = {lens["k4"]} without k5 and k6 is none of OpenCV\'s lenses; of a fisheye lens add "model": "fisheye"'
        )
    return named_coefficients(lens, model)


def plain_key(key: Any) -> str:
    """A key without the separators and capitals in which files differ."""
    return re.sub(r"[_\-. ]", "", str(key)).lower()


def refuse_unread_distortion(keys: Collection[Any], read: Collection[str], remedy: str) -> None:
    """Refuse a distortion under one of the `keys` of a camera that its format does not `read`:
    the lens would count as one without distortion."""
    for key in keys:
        if key not in read and re.search(LOOKS_LIKE_DISTORTION, plain_key(key)):
            raise InputError(f"{key!r} is not understood; {remedy}")


def first_twice(names: Iterable[Name]) -> Name | None:
    """The first of the names that stands more than once, None if none does."""
    return next((name for name, count in Counter(names).items() if count > 1), None)


def refuse_twice(names: Iterable[str]) -> None:
    """Refuse names of which one stands twice."""
    if (twice := first_twice(names)) is not None:
        raise InputError(f"has {twice!r} twice; keep one of them")


def refuse_others(values: Tree, names: str, what: str) -> None:
    """Refuse names beside those that are read: they may be coefficients, which would count as 0."""
    if others := [key for key in values if str(key) not in names.split()]:
        raise InputError(f"{what} holds {str(others[0])[:40]!r}, which is not understood; it may have {names}")


def refuse_nonzero(values: Mapping[str, Any], names: Sequence[str], what: str) -> None:
    """Refuse a model that needs terms we do not have."""
    for name in names:
        if number(values.get(name) or 0, name) != 0:
            raise InputError(f"{name} = {values[name]} ({what}) is not supported; undistort the images first")


def refuse_off_middle(offset: Sequence[float], size: Size, why: str) -> None:
    """Refuse a principal point, px, that is not measured from the middle of the image; `why` says from where."""
    if any(abs(off) > OFF_MIDDLE * side for off, side in zip(offset, size, strict=True)):
        raise InputError(
            f"the principal point is {offset[0]:.6g}, {offset[1]:.6g} px off the middle of the image; {why}"
        )


def with_skew(coefficients: Sequence[float], skew: float) -> tuple[CameraModel, Sequence[float]]:
    """Model and coefficients of a Brown lens in OpenCV's order with a skew, the share of y_d that is added to x_d.

    Raises
    ------
    InputError : there is skew, and more than five coefficients, for which no model has both.
    """
    if skew == 0:
        return "brown", coefficients
    if len(coefficients) not in (0, 4, 5):
        raise InputError(f"skew {skew:g} with {len(coefficients)} coefficients is not supported; undistort first")
    return "polynomial", (*coefficients, *(0.0,) * (6 - len(coefficients)), skew)


def noted(camera: Camera, note: str) -> Camera:
    """The camera with one more note for the user, if it is not empty."""
    return replace(camera, note="; ".join(filter(None, (camera.note, note))))


def make_camera(
    source: str,
    size: Size | None,
    intrinsics: Sequence[float],
    model: CameraModel = "pinhole",
    coefficients: Sequence[float] = (),
    *,
    note: str = "",
    size_given: bool = True,
) -> Camera:
    """Build a camera from what a file says, in OpenCV's pixel convention, or refuse it by name.

    Parameters
    ----------
    source : name of the format, kept in the camera.
    size : (width, height) px; None when neither the file nor the caller knows it.
    intrinsics : fx, fy, cx, cy, px.
    model, coefficients : lens; a "brown" lens whose coefficients are all 0 becomes a "pinhole" one.
    note : what the user should know of how it was read.  size_given : False where the size is that of the image.

    Raises
    ------
    InputError : unknown size, values no camera has, or a number of coefficients the model does not come with.
    """
    size = known_size(size)
    fx, fy, cx, cy = (number(value, name) for name, value in zip(("fx", "fy", "cx", "cy"), intrinsics, strict=True))
    _check_focal(fx, "fx", size, model)
    _check_focal(fy, "fy", size, model)
    _check_centre((cx, cy), size, size_given)
    model, coefficients = _lens(model, [number(k, "a distortion coefficient") for k in coefficients])
    if not size_given:
        note = "; ".join([*filter(None, [note]), f"it gives no image size: taken to be for {size[0]}x{size[1]} px"])
    camera = Camera(*size, fx, fy, cx, cy, model, tuple(coefficients), source, size_given, note)
    _check_lens(camera)
    return camera


def _check_focal(value: float, name: str, size: Size, model: CameraModel) -> None:
    if value == 0:
        raise InputError(f"{name} is 0: the camera is not calibrated; needed a focal length in pixels")
    if value < 0:
        raise InputError(f"{name} = {value:g} is negative, needed a focal length in pixels")
    longer = max(size)
    wide = model in WIDE
    if (BOUNDS.least_wide_focal if wide else BOUNDS.focal[0]) * longer <= value <= BOUNDS.focal[1] * longer:
        return
    lens = "no fisheye lens" if wide else "no lens but a fisheye"
    sees = f"a field of view of {2 * math.degrees(math.atan(longer / 2 / value)):.3g} deg"
    if wide:
        sees = f"180 deg in {value * math.pi:.3g} px"
    unit = "units of the image width" if value < 5 else "millimetres" if value < longer else "micrometres"
    raise InputError(
        f"{name} = {value:g} px for {size[0]}x{size[1]} px is {sees}, which {lens} has; it must be in pixels, "
        f"not in millimetres or normalised (is it in {unit}?): px = mm x image width in px / sensor width in mm"
    )


def _check_centre(centre: tuple[float, float], size: Size, size_given: bool) -> None:
    """Refuse a principal point that is in no image of this size, nor in the image that this one was cropped from."""
    for name, place, side in zip(("cx", "cy"), centre, size, strict=True):
        if not size_given and not 0 <= place <= side - 1:
            raise InputError(
                f"{name} = {place:g} is outside the image of {size[0]}x{size[1]} px, and the camera has no image size "
                "of its own; add the width and height in pixels that it is for"
            )
        if not -side <= place <= 2 * side:
            raise InputError(f"{name} = {place:g} is far outside an image of {size[0]}x{size[1]} px; is it in pixels?")


def _check_lens(camera: Camera) -> None:
    """Refuse distortion that leaves hardly a pixel with a ray."""
    if camera.model != "pinhole" and (seen := share_with_rays(camera)) < BOUNDS.least_seen:
        raise InputError(
            f"its distortion leaves only {100 * seen:.0f} % of the image with rays; coefficients must be in OpenCV's "
            "order and units (of normalised coordinates)"
        )


def _lens(model: CameraModel, coefficients: list[float]) -> tuple[CameraModel, list[float]]:
    if too_large := next((k for k in coefficients if abs(k) > BOUNDS.largest_coefficient), None):
        raise InputError(f"a distortion coefficient is {too_large:g}, which no lens has; calibrate again")
    if model == "pinhole" and any(coefficients):
        raise InputError("the lens is a pinhole without distortion, but coefficients are given; name the lens model")
    if model == "fisheye":
        return model, _counted(coefficients, (0, 4), "fisheye")
    if model == "cahvor":
        return model, _counted(coefficients, (0, 7), "CAHVOR")
    if model == "division":
        return (model, _counted(coefficients, (1,), "division")) if any(coefficients) else ("pinhole", [])
    if model == "polynomial":
        k4, skew = _counted(coefficients, (0, 7), "polynomial")[5:]
        if k4 or skew:
            return model, coefficients
        coefficients = coefficients[:5]
    coefficients = _counted(coefficients, (0, 4, 5, 8, 12, 14), "radial-tangential")
    if any(coefficients[8:]):
        raise InputError(
            f"{len(coefficients)} distortion coefficients with thin prism or tilt terms are not supported; "
            "calibrate with at most 8 (k1 k2 p1 p2 k3 k4 k5 k6)"
        )
    return ("brown", coefficients[:8]) if any(coefficients) else ("pinhole", [])


def _counted(coefficients: list[float], counts: tuple[int, ...], lens: str) -> list[float]:
    if len(coefficients) not in counts:
        wanted = ", ".join(map(str, counts[1:-1])) + " or " * (len(counts) > 2) + str(counts[-1])
        raise InputError(f"found {len(coefficients)} distortion coefficients, a {lens} lens takes {wanted}")
    return coefficients
