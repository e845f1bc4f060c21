"""Types of option values; each refuses a bad value with what was found, what is needed and an example."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from typing import Any, get_args, get_type_hints

import click

from slopecli.options import Lander, Options

Values = tuple[Any, ...]


class Parsed(click.ParamType):
    """A value that `parse` makes of a text; the message of its ValueError is what the user reads."""

    name = "value"

    def __init__(self, parse: Callable[[str], Any]) -> None:
        self.parse = parse

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return what the text says, or refuse it; what is not a text is a value already."""
        try:
            return self.parse(value) if isinstance(value, str) else value
        except ValueError as error:
            self.fail(str(error), param, ctx)


class OrWord(click.ParamType):
    """A value of a type, or one word."""

    name = "value"

    def __init__(self, kind: click.ParamType, word: str) -> None:
        self.kind, self.word = kind, word

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the word, or what the type makes of the value."""
        return value if value == self.word else self.kind.convert(value, param, ctx)


def is_usual(number: float) -> bool:
    """Whether a number is 0 or of a size with which one can calculate, 1e-12 to 1e12; False for nan."""
    return number == 0 or 1e-12 <= abs(number) <= 1e12


def comma_separated(
    layout: str,
    example: str,
    accepts: Callable[[Values], bool],
    condition: str,
    *,
    number: Callable[[str], float] = float,
    words: tuple[str, ...] = (),
) -> Parsed:
    """The type of a fixed number of comma-separated finite numbers.

    Parameters
    ----------
    layout : what is expected, for example "X,Y,W,H"; it fixes how many.
    example : a good value, shown when a bad one is refused.
    accepts : the condition the numbers must meet, and `condition`, the same in words.
    number : int or float.
    words : what may stand there instead.
    """
    count = len(layout.split(","))
    wanted = f"{layout} ({count} {'whole numbers' if number is int else 'numbers'})"
    wanted = f"{', '.join(words)} or {wanted}" if words else wanted

    def parse(text: str) -> str | Values:
        """Return the text if it is one of the words, else its numbers."""
        if text in words:
            return text
        try:
            numbers = tuple(map(number, text.split(",")))
        except ValueError:
            numbers = ()
        finite = all(abs(one) < 1e18 for one in numbers) if number is int else all(map(math.isfinite, numbers))
        if len(numbers) != count or not finite:
            raise ValueError(f"{text!r} is not {wanted}, for example {example}.")
        if not accepts(numbers):
            raise ValueError(f"{text!r}: {condition}, for example {example}.")
        return numbers

    return Parsed(parse)


def two_sides(wanted: str, example: str, least: int = 1, most: int = 999_999) -> Parsed:
    """Two whole numbers with an x between them, each from `least` to `most`, for example 1024x768."""

    def parse(text: str) -> tuple[int, int]:
        match = re.fullmatch(r"([1-9]\d{0,5})x([1-9]\d{0,5})", text)
        if match is None or not all(least <= int(side) <= most for side in match.groups()):
            raise ValueError(f"{text!r} is not {wanted}, for example {example}.")
        return int(match[1]), int(match[2])

    return Parsed(parse)


def number_list(low: float, high: float) -> Parsed:
    """Comma-separated numbers within bounds, none twice, 100 at most."""

    def parse(text: str) -> tuple[float, ...]:
        """Return the numbers of the list."""
        try:
            numbers = tuple(map(float, text.split(",")))
        except ValueError:
            raise ValueError(f"{text!r} is not a list of numbers, for example 0,0.3,1.") from None
        wrong = [number for number in numbers if not low <= number <= high]
        if wrong:
            raise ValueError(f"{wrong[0]:g} is not between {low:g} and {high:g}.")
        if len(set(numbers)) < len(numbers) or len(numbers) > 100:
            raise ValueError(f"{text!r} has a number twice, or more than 100.")
        return numbers

    return Parsed(parse)


def name_list(names: tuple[str, ...]) -> Parsed:
    """Some of the given names, comma-separated, none twice."""

    def parse(text: str) -> tuple[str, ...]:
        chosen = tuple(text.split(","))
        if not set(chosen) <= set(names) or len(set(chosen)) < len(chosen):
            raise ValueError(f"{text!r} is not a list of {', '.join(names)}.")
        return chosen

    return Parsed(parse)


def _path(text: str) -> str:
    if not text:  # as an unset shell variable gives; `io` checks what is there
        raise ValueError("it is empty, needed a path; is a shell variable unset?")
    return text


def _pairing(text: str) -> str:
    if text not in PAIRINGS and not text.lower().endswith(".csv"):
        raise ValueError(f"{text!r} is not {', '.join(PAIRINGS)} or a file that ends in .csv.")
    return text


def _rotation_prior(text: str) -> Values:
    """A quaternion and its sigma, deg, of a quaternion or a rotation vector, deg, and its sigma."""
    if text.count(",") != 3:
        quaternion: Values = QUATERNION.parse(text)
        return quaternion
    *vector, sigma_deg = ROTATION_VECTOR.parse(text)
    angle = math.radians(math.hypot(*vector))
    scale = math.sin(angle / 2) / angle if angle else 0.5
    return (math.cos(angle / 2), *(scale * math.radians(part) for part in vector), sigma_deg)


def _lander(text: str) -> Lander:
    parts = text.split(",")
    try:
        pads, diameter, pad = int(parts[0]), float(parts[1]), float(parts[2]) if len(parts) == 3 else 0.0
    except (ValueError, IndexError):
        pads, diameter, pad = 0, 0.0, 0.0
    usual = diameter > 0 and pad >= 0 and is_usual(diameter) and is_usual(pad)
    if not 3 <= pads <= 12 or not usual or pad > diameter or len(parts) > 3:
        raise ValueError(
            f"{text!r} is not PADS,DIAMETER or PADS,DIAMETER,PAD: 3 to 12 pads, the diameter of the circle they stand "
            "on, and of a pad, for example 4,3.5,0.3."
        )
    return Lander(pads, diameter, pad)


def _position(text: str) -> tuple[float, float, float | None]:
    """Latitude and longitude, degrees, and altitude, metres, where it is given."""
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    usual = len(numbers) in (2, 3) and all(map(math.isfinite, numbers)) and abs(numbers[-1]) < 1e5
    if not usual or abs(numbers[0]) > 90 or abs(numbers[1]) > 180:
        raise ValueError(
            f"{text!r} is not LAT,LON or LAT,LON,ALT: degrees north (-90 to 90) and east (-180 to 180) of WGS 84, and "
            "metres, for example 46.5763,8.0158,1600."
        )
    return numbers[0], numbers[1], numbers[2] if len(numbers) == 3 else None


def _classes(text: str) -> tuple[float, ...]:
    edges: tuple[float, ...] = number_list(0.1, 90).parse(text)
    if list(edges) != sorted(edges) or len(edges) > 8:
        raise ValueError(f"{text!r} is not a rising list of at most 8 slopes, for example 5,10,15,20,30.")
    return edges


class Between(click.FloatRange):
    """A number of usual size within bounds (click's own FloatRange lets nan through)."""

    name = "number"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Return the number, or refuse the value."""
        number = float(super().convert(value, param, ctx))
        if not math.isfinite(number):
            self.fail(f"{value!r} is not a finite number.", param, ctx)
        if not is_usual(number):
            self.fail(f"{value!r} is too small or too large, needed 1e-12 to 1e12.", param, ctx)
        return number


class Whole(click.IntRange):
    """A whole number within bounds."""

    name = "whole number"


def inside(low: float, high: float) -> Between:
    """A number between bounds that are refused themselves."""
    return Between(low, high, min_open=True, max_open=True)


def _is_direction(vector: Sequence[float]) -> bool:
    return 0 < math.hypot(*vector) < math.inf


def _is_sigma(sigma_deg: float) -> bool:
    return 0 < sigma_deg < 90


def _is_window(window: Values) -> bool:
    return min(window[:2]) >= 0 < min(window[2:])


def _has_focal_lengths(intrinsics: Values) -> bool:
    low, high = sorted(intrinsics[:2])
    return low >= 1e-3 and high <= min(10 * low, 1e6)


def _is_rotation_prior(prior: Values) -> bool:
    *vector, sigma_deg = prior
    return math.hypot(*vector) <= 360 and _is_sigma(sigma_deg)


def _is_direction_prior(prior: Values) -> bool:
    *vector, sigma_deg = prior
    return _is_direction(vector) and _is_sigma(sigma_deg)


SIGMA_IS = "SIGMA must be > 0 and < 90 deg"
VECTOR_IS = ("X,Y,Z", "0,0,-1", _is_direction, "the vector must not be zero")
PAIRINGS = ("consecutive", "stride", "folders")  # or the path of a list of pairs, which ends in .csv

WINDOW = comma_separated(
    "X,Y,W,H",
    "100,100,200,150",
    _is_window,
    "X, Y must be 0 or more, W, H 1 or more",
    number=int,
)
INTRINSICS = comma_separated(
    "FX,FY,CX,CY",
    "800,800,511.5,383.5",
    _has_focal_lengths,
    "FX, FY must be > 0, of 0.001 to 1e6 px and within a factor of 10 of each other",
)
VECTOR = comma_separated(*VECTOR_IS)
UP = comma_separated(*VECTOR_IS, words=("camera", "dominant-plane"))
ROTATION_VECTOR = comma_separated(
    "RX,RY,RZ,SIGMA",
    "0,0,1.5,0.1",
    _is_rotation_prior,
    f"the angle must be at most 360 deg and {SIGMA_IS}",
)
QUATERNION = comma_separated(
    "QW,QX,QY,QZ,SIGMA",
    "1,0,0,0.01,0.1",
    _is_direction_prior,
    f"the quaternion must not be zero and {SIGMA_IS}",
)
DIRECTION_PRIOR = comma_separated(
    "X,Y,Z,SIGMA",
    "0,0,1,0.5",
    _is_direction_prior,
    f"the direction must not be zero and {SIGMA_IS}",
)
ROTATION_PRIOR = Parsed(_rotation_prior)
GRID = two_sides("COLUMNSxROWS with both from 1 to 9999", "3x3", most=9999)
SIZE = two_sides("WIDTHxHEIGHT in px", "1024x768")
PATH, PAIRING = Parsed(_path), Parsed(_pairing)
LANDER, CLASSES, POSITION = Parsed(_lander), Parsed(_classes), Parsed(_position)
POSITIVE = Between(min=0, min_open=True)
SEED = Whole(0, 2**31 - 1)


def choices_of(option: str) -> click.Choice:
    """The choices the library itself declares for one of its options."""
    return click.Choice(get_args(get_type_hints(Options)[option]))
