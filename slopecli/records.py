"""Dataclasses whose methods need not be compiled: the library's `dataclass` writes and compiles their text at every
start, five methods a class, which for those of one command takes as long as a tenth of its answer.

To a type checker, and to `dataclasses.replace`, `fields` and `asdict`, they are dataclasses as any other.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import TYPE_CHECKING, Any


def _dataclass(*, frozen: bool = False, eq: bool = True) -> Callable[[type], type]:
    """Make a class a dataclass; `frozen` and `eq` mean what they do in `dataclasses.dataclass`."""

    def process(cls: type) -> type:
        cls.__doc__ = cls.__doc__ or cls.__name__  # else the library makes one, from a signature
        cls = dataclasses.dataclass(init=False, repr=False, eq=False)(cls)  # the fields alone
        fields = dataclasses.fields(cls)
        _check(cls, fields)
        cls.__signature__ = _Signature()  # type: ignore[attr-defined]
        methods: dict[str, Any] = {"__init__": _init(fields, hasattr(cls, "__post_init__")), "__repr__": _repr}
        if eq:
            methods |= {"__eq__": _eq, "__hash__": _hash if frozen else None}
        if frozen:
            methods |= {"__setattr__": _refuse, "__delattr__": _refuse}
        for name, method in methods.items():
            if name not in vars(cls) or vars(cls)[name] is None:
                setattr(cls, name, method)
        return cls

    return process


class _Signature:
    """Parameters of a record, made when they are asked for: `help` and notebooks show them."""

    def __get__(self, record: Any, cls: type) -> inspect.Signature:
        import inspect

        kind = inspect.Parameter.POSITIONAL_OR_KEYWORD
        empty = inspect.Parameter.empty
        return inspect.Signature(
            [
                inspect.Parameter(f.name, kind, default=_shown_default(f, empty), annotation=f.type)
                for f in dataclasses.fields(cls)
            ]
        )


def _shown_default(field: dataclasses.Field[Any], empty: Any) -> Any:
    if field.default_factory is not dataclasses.MISSING:
        return field.default_factory()
    return empty if field.default is dataclasses.MISSING else field.default


def _check(cls: type, fields: tuple[dataclasses.Field[Any], ...]) -> None:
    """Refuse what is not made here, and what the library refuses."""
    defaulted = [f.default is not dataclasses.MISSING or f.default_factory is not dataclasses.MISSING for f in fields]
    if sorted(defaulted) != defaulted:
        raise TypeError(f"{cls.__name__}: a field without a default follows one with a default")
    if any(not f.init or f.kw_only for f in fields):
        raise TypeError(f"{cls.__name__}: fields without init, or for keywords only, are for the library's dataclass")


def _init(fields: tuple[dataclasses.Field[Any], ...], more: bool) -> Callable[..., None]:
    names = tuple(field.name for field in fields)
    every = frozenset(names)
    defaults = {field.name: field.default for field in fields if field.default is not dataclasses.MISSING}
    factories = {f.name: f.default_factory for f in fields if f.default_factory is not dataclasses.MISSING}

    def __init__(self: Any, *given: Any, **named: Any) -> None:
        values = dict(zip(names, given, strict=False))
        if named or len(given) != len(names):
            absent = {name: make() for name, make in factories.items() if name not in values and name not in named}
            filled = {**defaults, **absent, **values, **named}
            if len(given) > len(names) or not values.keys().isdisjoint(named) or filled.keys() != every:
                raise TypeError(_complaint(type(self).__name__, names, given, named, filled))
            values = {name: filled[name] for name in names}
        vars(self).update(values)  # past what refuses changes
        if more:
            self.__post_init__()

    return __init__


def _complaint(
    title: str, names: tuple[str, ...], given: tuple[Any, ...], named: dict[str, Any], filled: dict[str, Any]
) -> str:
    if len(given) > len(names):
        return f"{title} takes {len(names)} values, {len(given)} were given"
    twice = [name for name in names[: len(given)] if name in named]
    unknown = [name for name in named if name not in names]
    missing = [name for name in names if name not in filled]
    found = (("given twice", twice), ("unknown", unknown), ("missing", missing))
    return f"{title}: " + "; ".join(f"{' '.join(which)} {what}" for what, which in found if which)


def _values(record: Any) -> tuple[Any, ...]:
    return tuple(getattr(record, field.name) for field in dataclasses.fields(record) if field.compare)


def _repr(self: Any) -> str:
    shown = (f"{field.name}={getattr(self, field.name)!r}" for field in dataclasses.fields(self) if field.repr)
    return f"{type(self).__qualname__}({', '.join(shown)})"


def _eq(self: Any, other: Any) -> Any:
    return _values(self) == _values(other) if other.__class__ is self.__class__ else NotImplemented


def _hash(self: Any) -> int:
    return hash(_values(self))


def _refuse(self: Any, name: str, *value: Any) -> None:
    raise dataclasses.FrozenInstanceError(f"{type(self).__name__} cannot be changed: {name}")


if TYPE_CHECKING:
    import inspect
    from dataclasses import dataclass, field
else:
    dataclass, field = _dataclass, dataclasses.field

__all__ = ["dataclass", "field"]
