"""Blocks of cases: changed files by their number, or inputs that Hypothesis draws, whose failures it makes small."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from fuzzing.case import Case
from fuzzing.drawn import drawn_failures
from fuzzing.kinds import KINDS, make_case

DRAWN = "drawn"
ONE_IN = 5  # blocks are drawn by Hypothesis
Run = Callable[[Case], list[str]]


def block(seed: int, number: int, size: int, kinds: list[str] | None, run: Run) -> Iterator[tuple[Case, list[str]]]:
    """The failures among the `size` cases of a block."""
    changed = [kind for kind in kinds or KINDS if kind in KINDS]
    if DRAWN in (kinds or (DRAWN,)) and (number % ONE_IN == 0 or not changed):
        yield from drawn_failures(seed * 1_000_003 + number, size, run)
        return
    for k in range(number * size, (number + 1) * size):
        case = make_case(seed, k, changed)
        if found := run(case):
            yield case, found
