"""Types of option values; each refuses a bad value with what was found, what is needed and an example."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import Any, get_args, get_type_hints

import click

from slopecli.options import Options

Values = tuple[Any, ...]


class CommaSeparated(click.ParamType):
    """A fixed number of comma-separated finite numbers.

    Parameters
    ----------
    layout : what is expected, for example "X,Y,W,H"; it fixes how many.
    example : a good value, shown when a bad one is refused.
    number : int or float.
    accepts : the condition the numbers must meet, and `condition`, the same in words.
    """

    name = "numbers"

    def __init__(
        self,
        layout: str,
        example: str,
        number: Callable[[str], float],
        accepts: Callable[[Values], bool],
        condition: str,
    ) -> None:
        self.layout, self.example, self.number = layout, example, number
        self.accepts, self.condition = accepts, condition

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Values:
        """Return the numbers, or refuse the value."""
        if isinstance(value, tuple):
            return value
        numbers = self._numbers(value)
        if numbers is None:
            self.fail(f"{value!r} is not {self._wanted()}, for example {self.example}.", param, ctx)
        if not self.accepts(numbers):
            self.fail(f"{value!r}: {self.condition}, for example {self.example}.", param, ctx)
        return numbers

    def _numbers(self, value: str) -> Values | None:
        try:
            numbers = tuple(self.number(part) for part in value.split(","))
        except ValueError:
            return None
        complete = len(numbers) == len(self.layout.split(","))
        return numbers if complete and all(map(math.isfinite, numbers)) else None

    def _wanted(self) -> str:
        kind = "whole numbers" if self.number is int else "numbers"
        return f"{self.layout} ({len(self.layout.split(','))} {kind})"


class Grid(click.ParamType):
    """COLUMNSxROWS, for example 3x3."""

    name = "grid"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[int, int]:
        """Return columns and rows, or refuse the value."""
        if isinstance(value, tuple):
            return value
        match = re.fullmatch(r"([1-9]\d{0,3})x([1-9]\d{0,3})", value)
        if match is None:
            self.fail(f"{value!r} is not COLUMNSxROWS with both at least 1, for example 3x3.", param, ctx)
        return int(match[1]), int(match[2])


class Size(click.ParamType):
    """WIDTHxHEIGHT, px, each at least `least`."""

    name = "size"

    def __init__(self, least: int = 1) -> None:
        self.least = least

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[int, int]:
        """Return width and height, px, or refuse the value."""
        match = re.fullmatch(r"([1-9]\d{0,5})x([1-9]\d{0,5})", str(value))
        if match is None or min(int(match[1]), int(match[2])) < self.least:
            least = f" of at least {self.least} px each" if self.least > 1 else " in px"
            self.fail(f"{value!r} is not WIDTHxHEIGHT{least}, for example 1024x768.", param, ctx)
        return int(match[1]), int(match[2])


class NumberList(click.ParamType):
    """Comma-separated numbers within bounds, none twice, 100 at most."""

    name = "numbers"

    def __init__(self, low: float, high: float) -> None:
        self.low, self.high = low, high

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[float, ...]:
        """Return the numbers, or refuse the value."""
        try:
            numbers = tuple(float(part) for part in value.split(","))
        except ValueError:
            self.fail(f"{value!r} is not a list of numbers, for example 0,0.3,1.", param, ctx)
        wrong = [number for number in numbers if not self.low <= number <= self.high]
        if wrong:
            self.fail(f"{wrong[0]:g} is not between {self.low:g} and {self.high:g}.", param, ctx)
        if len(set(numbers)) < len(numbers) or len(numbers) > 100:
            self.fail(f"{value!r} has a number twice, or more than 100.", param, ctx)
        return numbers


class NameList(click.ParamType):
    """Some of the given names, comma-separated, none twice."""

    name = "names"

    def __init__(self, names: tuple[str, ...]) -> None:
        self.names = names

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[str, ...]:
        """Return the names, or refuse the value."""
        chosen = tuple(value.split(","))
        if not set(chosen) <= set(self.names) or len(set(chosen)) < len(chosen):
            self.fail(f"{value!r} is not a list of {', '.join(self.names)}.", param, ctx)
        return chosen


class Up(CommaSeparated):
    """`camera`, `dominant-plane` or a vector."""

    name = "up"
    words = ("camera", "dominant-plane")

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the word or the vector, or refuse the value."""
        return value if value in self.words else super().convert(value, param, ctx)

    def _wanted(self) -> str:
        return f"{', '.join(self.words)} or {super()._wanted()}"


class RotationPrior(CommaSeparated):
    """A rotation as a quaternion or as a rotation vector, and its sigma; converted to quaternion and sigma, deg."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Values:
        """Return a quaternion and its sigma, deg, or refuse the value."""
        if isinstance(value, tuple) or value.count(",") != 3:
            return super().convert(value, param, ctx)
        numbers = ROTATION_VECTOR.convert(value, param, ctx)
        angle = math.radians(math.hypot(*numbers[:3]))
        scale = math.sin(angle / 2) / angle if angle else 0.5
        return (math.cos(angle / 2), *(scale * math.radians(part) for part in numbers[:3]), numbers[3])


class PathText(click.ParamType):
    """A path that is not empty, as an unset shell variable gives. `io` checks what is there."""

    name = "path"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return the path, or refuse an empty one."""
        if not value:
            self.fail("it is empty, needed a path; is a shell variable unset?", param, ctx)
        return str(value)


class Pairing(PathText):
    """`consecutive`, `stride`, `folders`, or the path of a list of pairs, which ends in .csv."""

    name = "pairing"
    words = ("consecutive", "stride", "folders")

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return the word or the path, or refuse the value."""
        if value not in self.words and not str(value).lower().endswith(".csv"):
            self.fail(f"{value!r} is not {', '.join(self.words)} or a file that ends in .csv.", param, ctx)
        return str(value)


class Between(click.FloatRange):
    """A finite number within bounds (click's own FloatRange lets nan through)."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Return the number, or refuse the value."""
        number = float(super().convert(value, param, ctx))
        if not math.isfinite(number):
            self.fail(f"{value!r} is not a finite number.", param, ctx)
        return number


def _is_direction(vector: Values) -> bool:
    return 0 < math.hypot(*vector) < math.inf


def _is_sigma(sigma_deg: float) -> bool:
    return 0 < sigma_deg < 90


SIGMA_IS = "SIGMA must be > 0 and < 90 deg"

WINDOW = CommaSeparated(
    "X,Y,W,H", "100,100,200,150", int, lambda w: min(w[:2]) >= 0 < min(w[2:]), "X, Y must be 0 or more, W, H 1 or more"
)
INTRINSICS = CommaSeparated("FX,FY,CX,CY", "800,800,511.5,383.5", float, lambda k: min(k[:2]) > 0, "FX, FY must be > 0")
VECTOR = CommaSeparated("X,Y,Z", "0,0,-1", float, _is_direction, "the vector must not be zero")
UP = Up("X,Y,Z", "0,0,-1", float, _is_direction, "the vector must not be zero")
ROTATION_VECTOR = CommaSeparated(
    "RX,RY,RZ,SIGMA",
    "0,0,1.5,0.1",
    float,
    lambda r: math.hypot(*r[:3]) <= 360 and _is_sigma(r[3]),
    f"the angle must be at most 360 deg and {SIGMA_IS}",
)
ROTATION_PRIOR = RotationPrior(
    "QW,QX,QY,QZ,SIGMA",
    "1,0,0,0.01,0.1",
    float,
    lambda q: _is_direction(q[:4]) and _is_sigma(q[4]),
    f"the quaternion must not be zero and {SIGMA_IS}",
)
DIRECTION_PRIOR = CommaSeparated(
    "X,Y,Z,SIGMA",
    "0,0,1,0.5",
    float,
    lambda d: _is_direction(d[:3]) and _is_sigma(d[3]),
    f"the direction must not be zero and {SIGMA_IS}",
)
GRID = Grid()
SIZE = Size()
PATH = PathText()
POSITIVE = Between(min=0, min_open=True)
SEED = click.IntRange(0, 2**31 - 1)


def choices_of(option: str) -> click.Choice:
    """The choices the library itself declares for one of its options."""
    return click.Choice(get_args(get_type_hints(Options)[option]))
