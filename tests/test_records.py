"""`slopecli.records` against the library's own dataclasses."""

from __future__ import annotations

import dataclasses
import inspect
import pickle
from typing import Any

import pytest

from slopecli import records
from slopecli.options import Options


def make(decorator: Any, **how: bool) -> Any:
    class Place:
        """A place."""

        u: float
        v: float = 2.0
        notes: list[str] = records.field(default_factory=list)
        hidden: int = records.field(default=0, compare=False, repr=False)

    return decorator(**how)(Place)


CASES = {"frozen": {"frozen": True}, "identity": {"frozen": True, "eq": False}, "open": {}}


@pytest.mark.parametrize("how", CASES.values(), ids=CASES)
def test_it_does_what_the_library_does(how: dict[str, bool]) -> None:
    said = []
    for decorator in (records.dataclass, dataclasses.dataclass):
        Place = make(decorator, **how)
        one, other = Place(1.0, notes=["x"]), Place(u=1.0, v=2.0, notes=["x"], hidden=3)
        said.append(
            [
                repr(one),
                one == other,
                one != Place(5.0),
                one == 1.0,
                Place.__hash__ is None,
                list(vars(other)),
                dataclasses.asdict(dataclasses.replace(one, v=7.0)),
                [field.name for field in dataclasses.fields(Place)],
                Place(1.0).notes is Place(1.0).notes,
                Place.v,
                Place.__doc__,
            ]
        )
    assert said[0] == said[1]


def test_hash_is_of_what_is_compared() -> None:
    Place = make(records.dataclass, frozen=True)
    assert hash(Place(1.0, 2.0, ())) == hash(Place(1.0, 2.0, (), 5))
    assert len({Place(1.0, 2.0, ()), Place(1.0, 2.0, ()), Place(1.0, 3.0, ())}) == 2
    Place = make(records.dataclass, frozen=True, eq=False)
    assert len({Place(1.0), Place(1.0)}) == 2


def test_frozen_refuses_changes() -> None:
    place = make(records.dataclass, frozen=True)(1.0)
    with pytest.raises(dataclasses.FrozenInstanceError, match="v"):
        place.v = 3.0
    with pytest.raises(dataclasses.FrozenInstanceError, match="v"):
        del place.v
    assert place.v == 2.0
    place = make(records.dataclass)(1.0)
    place.v = 3.0
    assert place.v == 3.0


@pytest.mark.parametrize(
    ("given", "named", "words"),
    [
        ((), {}, "u missing"),
        ((1.0,), {"w": 2.0}, "w unknown"),
        ((1.0,), {"u": 2.0}, "u given twice"),
        ((), {"w": 2.0}, "w unknown; u missing"),
        ((1, 2, [], 4, 5), {}, "takes 4 values, 5 were given"),
    ],
)
def test_wrong_values_are_named(given: tuple[Any, ...], named: dict[str, Any], words: str) -> None:
    with pytest.raises(TypeError, match=words):
        make(records.dataclass, frozen=True)(*given, **named)


def test_methods_of_the_class_itself_stay() -> None:
    checked = []

    @records.dataclass(frozen=True)
    class Named:
        name: str

        def __repr__(self) -> str:
            return self.name

        def __post_init__(self) -> None:
            checked.append(self.name)

    assert repr(Named("here")) == "here"
    assert checked == ["here"]


def test_it_survives_pickling() -> None:
    options = Options(grid=(2, 2), seed=4)
    assert pickle.loads(pickle.dumps(options)) == options


def test_help_and_notebooks_show_the_fields() -> None:
    parameters = inspect.signature(Options).parameters
    assert list(parameters) == [field.name for field in dataclasses.fields(Options)]
    assert parameters["seed"].default == 0
    listed = inspect.signature(make(records.dataclass)).parameters
    assert [p.default is p.empty for p in listed.values()] == [
        p.default is p.empty for p in inspect.signature(make(dataclasses.dataclass)).parameters.values()
    ]


def test_what_is_not_made_here_is_refused() -> None:
    with pytest.raises(TypeError, match="without a default follows"):

        @records.dataclass()
        class Disordered:
            first: int = 1
            second: int  # type: ignore[misc]

    with pytest.raises(TypeError, match="without init"):

        @records.dataclass()
        class Hidden:
            first: int = records.field(init=False, default=1)
