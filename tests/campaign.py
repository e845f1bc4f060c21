"""How large a statistical test is: a few seeds in the ordinary run, all in `make test-all`; and when it may stop."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable

ALL = "SLOPEMAP_TEST_ALL"  # set by `make test-all`


def seeds(everything: int, ordinary: int) -> range:
    """Seeds of a statistical test: `everything` in `make test-all`, the first `ordinary` of them otherwise."""
    return range(everything if ALL in os.environ else ordinary)


def assert_rare(events: Iterable[bool], at_most: float, too_often: float, error: float = 1e-3) -> int:
    """Fail if events happen more often than `at_most`, by Wald's sequential probability ratio test.

    Parameters
    ----------
    events : outcomes of independent trials, drawn one by one; no more are drawn than the decision needs.
    at_most, too_often : rates that must pass and must fail; between them either may happen.
    error : probability of a wrong decision at each of the two rates.

    Returns
    -------
    n : trials drawn.
    """
    hit = math.log(too_often / at_most)
    miss = math.log((1 - too_often) / (1 - at_most))
    evidence, n, hits = 0.0, 0, 0
    for event in events:
        n, hits = n + 1, hits + bool(event)
        evidence += hit if event else miss
        assert evidence < math.log((1 - error) / error), f"{hits} of {n} trials, at most {at_most:g} of all may"
        if evidence <= -math.log((1 - error) / error):
            return n
    raise AssertionError(f"{hits} of {n} trials: too few to decide between {at_most:g} and {too_often:g}")
