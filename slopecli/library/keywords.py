"""Keyword arguments as fields of options: unknown names refused with the nearest one, values checked by their type."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields, replace
from difflib import get_close_matches
from functools import cache
from numbers import Integral, Real
from types import NoneType, UnionType
from typing import Any, Literal, NamedTuple, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from slopecli.errors import WrongArgument

AnyOptions = TypeVar("AnyOptions")


class _Refused(NamedTuple):
    """What is no value of a type; told from every value that is."""


REFUSED = _Refused()


def divide_keywords(keywords: Mapping[str, Any], *kinds: type) -> list[dict[str, Any]]:
    """The keywords of each kind of options, their values converted to the type of the field.

    Raises
    ------
    WrongArgument : none of the kinds has such a field, or the value is of another type.
    """
    named: list[dict[str, Any]] = [{} for _ in kinds]
    for name, value in keywords.items():
        place = next((k for k, kind in enumerate(kinds) if name in _hints(kind)), None)
        if place is None:
            raise WrongArgument(_unknown(name, kinds))
        named[place][name] = _checked(name, value, kinds[place])
    return named


def with_keywords(given: object, kind: type[AnyOptions], name: str, keywords: Mapping[str, Any]) -> AnyOptions:
    """Options as given, the defaults where they are None, with keywords in place of their fields.

    name : of the argument, for messages.
    """
    options = kind() if given is None else given
    if not isinstance(options, kind):
        raise WrongArgument(
            f"{name}: is of type {type(options).__name__}, needed {kind.__name__}, or its fields by name"
        )
    return replace(options, **keywords)  # type: ignore[type-var]


@cache
def _hints(kind: type) -> dict[str, Any]:
    """The types of the fields of a dataclass by name."""
    hints = get_type_hints(kind)
    return {field.name: hints[field.name] for field in fields(kind)}  # type: ignore[arg-type]


def _unknown(name: str, kinds: tuple[type, ...]) -> str:
    names = [field for kind in kinds for field in _hints(kind)]
    near = get_close_matches(name, names, n=1)
    hint = f"did you mean {near[0]}?" if near else f"there are camera, camera1, camera2, {', '.join(sorted(names))}"
    return f"there is no argument {name!r}; {hint}"


def _checked(name: str, value: Any, kind: type) -> Any:
    hint = _hints(kind)[name]
    converted = _converted(value, hint)
    if converted is REFUSED:
        raise WrongArgument(f"{name}: is {value!r}, needed {_wanted(hint)}")
    return converted


def _converted(value: Any, hint: Any) -> Any:
    """The value with NumPy's numbers as Python's, lists and arrays as tuples; `REFUSED` if it is not of the type."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    origin, parts = get_origin(hint), get_args(hint)
    if origin in (Union, UnionType):
        tried = (_converted(value, part) for part in parts)
        return next((one for one in tried if one is not REFUSED), REFUSED)
    if origin is Literal:
        return value if isinstance(value, str) and value in parts else REFUSED
    if origin is tuple:
        return _tuple(value, parts)
    if hint is float or hint is int:
        return _number(value, hint)
    return value if isinstance(value, hint) else REFUSED


def _number(value: Any, kind: type) -> Any:
    """The value as float or int, `REFUSED` if it is no finite number of that kind."""
    fits = isinstance(value, Real if kind is float else Integral) and not isinstance(value, bool)
    return kind(value) if fits and math.isfinite(value) else REFUSED


def _tuple(value: Any, parts: tuple[Any, ...]) -> Any:
    """The value as a tuple of items of these types, `REFUSED` if it is none."""
    if not isinstance(value, list | tuple):
        return REFUSED
    kinds = parts[:1] * len(value) if parts[1:] == (...,) else parts
    if len(kinds) != len(value):
        return REFUSED
    items = tuple(_converted(item, kind) for item, kind in zip(value, kinds, strict=True))
    return REFUSED if any(item is REFUSED for item in items) else items


def _wanted(hint: Any) -> str:
    """A type in words."""
    origin, parts = get_origin(hint), get_args(hint)
    if origin in (Union, UnionType):
        return " or ".join(map(_wanted, parts))
    if origin is Literal:
        return " or ".join(map(repr, parts))
    if origin is tuple:
        inner = ", ".join("..." if part is ... else _wanted(part) for part in parts)
        return f"({inner})"
    words = {float: "a number", int: "a whole number", str: "a string", bool: "True or False", NoneType: "None"}
    return words.get(hint, getattr(hint, "__name__", str(hint)))
