"""Image sizes under the names that people give them: any case, one number a key, pairs, text, or nested."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from slopecli.errors import InputError
from slopecli.io.cameras.values import Size, Tree, number, numbers, plain_key, size_of

OWNER = "(?:image|img|im|frame|picture|photo|video|stream|camera|cam|calib|calibration|capture|pixel|full)"
WHOLE = "(?:sensorresolution|size|resolution|res|dims?|dimensions?|shape)"
SIDE_KEYS = (
    re.compile(rf"{OWNER}{{0,2}}(?:{WHOLE}?(?:width|w)(?:in)?(?:px|pixels?)?|cols?|columns|{WHOLE}x|xres\w*|nx)"),
    re.compile(rf"{OWNER}{{0,2}}(?:{WHOLE}?(?:height|h)(?:in)?(?:px|pixels?)?|rows?|{WHOLE}y|yres\w*|ny)"),
)
PAIR_KEY = re.compile(rf"{OWNER}{{0,2}}(?:{WHOLE}(?:of)?{OWNER}?|wh|hw|widthheight)(?:wh|hw|px|pixels?)?")
# sizes of something else: a part of the image, a calibration target, a sensor in mm
NOT_THE_IMAGE = re.compile(
    "roi|crop|region|board|chess|checker|pattern|target|grid|tag|sensor|header|thumbnail|preview"
)


class Stated(NamedTuple):
    """A size as a file states it: two numbers in their order, whether rows come first, and its key."""

    first: int
    second: int
    rows_first: bool
    key: str


def is_size_key(key: Any) -> bool:
    """Whether a key is one of those under which image sizes are read."""
    plain = plain_key(key)
    return bool(PAIR_KEY.fullmatch(plain) or any(side.fullmatch(plain) for side in SIDE_KEYS))


def image_size(
    tree: Tree, centre: tuple[float, float] | None = None, image: Size | None = None
) -> tuple[Size | None, str]:
    """The image size that a tree of names and values states, and a note for the user, or "".

    Parameters
    ----------
    centre : principal point, px, which tells width, height from rows, columns.
    image : size of the image in hand, which does so where the principal point cannot.

    Raises
    ------
    InputError : a size is no size, or two sizes contradict each other.
    """
    stated = _statements(tree)
    if not stated:
        return None, ""
    found = {one.key: _in_order(one, centre, image) for one in stated}
    key, (size, note) = next(iter(found.items()))
    for other, (another, _) in found.items():
        if another != size:
            raise InputError(f"{key} says {size[0]}x{size[1]} px, {other} {another[0]}x{another[1]}; keep one of them")
    return size, note


def _in_order(stated: Stated, centre: tuple[float, float] | None, image: Size | None) -> tuple[Size, str]:
    """Width and height of two numbers, whichever comes first."""
    straight = (stated.first, stated.second)
    turned = (stated.second, stated.first)
    usual, other = (turned, straight) if stated.rows_first else (straight, turned)
    swap = image == other != usual
    if centre is not None:
        off, swapped_off = _off_centre(centre, usual), _off_centre(centre, other)
        if abs(off - swapped_off) > 0.08:  # the centre of a calibrated camera is within a few percent of the middle
            swap = swapped_off < min(off, 0.15)
    size = other if swap else usual
    if size == straight or stated.first == stated.second:
        return size, ""
    return size, f"{stated.key} [{stated.first}, {stated.second}] is read as rows x columns, {size[0]}x{size[1]} px"


def _off_centre(centre: tuple[float, float], size: Size) -> float:
    """How far the principal point is off the middle, as a share of the side where it is more."""
    return max(abs(c - (side - 1) / 2) / side for c, side in zip(centre, size, strict=True))


def _statements(tree: Tree, level: int = 0) -> list[Stated]:
    """All sizes of the shallowest level that has any."""
    here = [*_sides(tree), *_pairs(tree)]
    if here or level == 3:
        return here
    below = (value for key, value in tree.items() if not NOT_THE_IMAGE.search(plain_key(key)))
    return [
        one for value in below if isinstance(value, Mapping) and "data" not in value for one in _nested(value, level)
    ]


def _nested(tree: Tree, level: int) -> list[Stated]:
    """The same below the root, where a matrix {rows, cols} states no size, and one side alone is something else."""
    if {"rows", "cols"} <= set(tree):
        return []
    sides = [next((key for key in tree if side.fullmatch(plain_key(key))), None) for side in SIDE_KEYS]
    alone = [key for key in sides if key is not None] if None in sides else []
    return _statements({key: value for key, value in tree.items() if key not in alone}, level + 1)


def _sides(tree: Tree) -> Iterator[Stated]:
    """Width and height under two keys."""
    plain = {key: plain_key(key) for key, value in tree.items() if not isinstance(value, list | tuple | Mapping)}
    widths, heights = ([key for key in plain if side.fullmatch(plain[key])] for side in SIDE_KEYS)
    for keys in (widths, heights):
        if len({number(_without_unit(tree[key]), str(key)) for key in keys if tree[key] is not None}) > 1:
            raise InputError(f"{keys[0]!r} and {keys[1]!r} are both given, and differ; keep one of them")
    if not widths and not heights:
        return
    width, height = (_without_unit(tree[keys[0]]) if keys else None for keys in (widths, heights))
    size = size_of(width, height)
    if size is not None:
        yield Stated(*size, False, " and ".join(str(keys[0]) for keys in (widths, heights) if keys))


def _without_unit(side: Any) -> Any:
    return re.sub(r"\s*(px|pixels?)\s*$", "", side) if isinstance(side, str) else side


def _pairs(tree: Tree) -> Iterator[Stated]:
    """Both sides under one key: a list, a text such as 800x600, or names with values."""
    for key, value in tree.items():
        plain = plain_key(key)
        if value is None or not PAIR_KEY.fullmatch(plain):
            continue
        if isinstance(value, Mapping) and "data" not in value:
            inner = {"width": value["x"], "height": value["y"]} if {"x", "y"} <= set(value) else value
            yield from (one._replace(key=str(key)) for one in _sides(inner))
            continue
        size = _pair(str(key), plain, value)
        if size is not None:
            yield Stated(*size, "shape" in plain or "hw" in plain, str(key))


def _pair(key: str, plain: str, value: Any) -> tuple[int, int] | None:
    """The two sides in a value, a list or a text; None if it is something else. InputError if they are not two."""
    if isinstance(value, str):
        value = re.findall(r"\d+", value) if re.fullmatch(r"\D*\d+\D+\d+\D*", value) else value
    vague = plain in ("size", "res", "resolution", "dim", "dims", "shape")  # also bytes, dots per inch, "1080p"
    if vague and not isinstance(value, list | tuple | Mapping):
        return None
    sides = numbers(value, key)
    if len(sides) == 3 and sides[2] in (1, 3, 4):  # channels
        sides = sides[:2]
    if len(sides) != 2:
        raise InputError(f"{key} has {len(sides)} numbers, needed width and height")
    return size_of(*sides)
