"""The second root in the report: the sensor that is said to decide does decide, and need not be better than said."""

from __future__ import annotations

import re

import numpy as np
import pytest
from solution_factory import make_report_of, make_solution, with_second_root
from test_priors import DEG, flat_descent, measured, solved

from slopecli.geometry.solver import MotionPrior
from slopecli.report import deciding_sigma, margin, what_decides
from slopecli.types import AmbiguityReport


def advice(seed: int) -> str:
    found = solved(flat_descent(seed, 45.0))
    assert found.ambiguity.status == "unresolved"
    return what_decides(found, np.zeros(9), np.full(9, 20.4))


@pytest.mark.parametrize("known", ["rotation", "direction"])
def test_a_sensor_as_good_as_is_asked_for_decides(known: str) -> None:
    """Readings drawn with the sigma named: it allows for two of its own, so about 98 of 100 decide."""
    decided = []
    for seed in range(4):
        (named,) = re.findall(rf"--{known}-prior with a sigma below ([\d.]+) deg decides", advice(seed))
        for draw in range(5):
            scene = flat_descent(seed, 45.0)
            prior = measured(scene, seed + 100 * draw, **{f"{known}_sigma": float(named) * DEG})
            decided.append(solved(scene, prior).ambiguity.status != "unresolved")
    assert np.mean(decided) >= 0.9


def test_a_sensor_much_worse_does_not_decide() -> None:
    scene = flat_descent(0, 45.0)
    (named,) = re.findall(r"--rotation-prior with a sigma below ([\d.]+) deg", advice(0))
    vague = MotionPrior.checked(scene.R, 4 * float(named) * DEG)
    assert solved(scene, vague).ambiguity.status == "unresolved"


def test_differences_are_named_with_their_angles() -> None:
    text = advice(0)
    assert text.startswith("a third image, a wider baseline, the direction of motion (the two differ by 40.7 deg: ")
    assert "the rotation (the two differ by 8.71 deg: " in text
    assert text.endswith("or gravity (slopes differ by up to 20 deg: how steep is one of them, roughly?)")


def test_what_is_alike_in_both_answers_is_not_named() -> None:
    """The factory's roots have one rotation, and here slopes that hardly differ."""
    found = make_report_of(with_second_root(make_solution([5, 10]), [5.2, 10.1])).ambiguity
    assert found.resolve_with is not None
    assert "rotation" not in found.resolve_with
    assert "gravity" not in found.resolve_with
    assert "--direction-prior" in found.resolve_with


@pytest.mark.parametrize(("own_sigma", "decides"), [(0.0, True), (0.1, True), (0.26, False)])
def test_no_sensor_helps_where_an_answer_itself_reaches_as_far_as_the_other(own_sigma: float, decides: bool) -> None:
    sigma = deciding_sigma(1.0, own_sigma, 15.0)
    assert (sigma > 0) == decides
    if decides:
        assert (1.0 - 4.0 * sigma) / (sigma**2 + own_sigma**2) == pytest.approx(15.0)


@pytest.mark.parametrize(
    ("value", "said"), [(4.383e-26, "0"), (-1e-9, "0"), (0.126, "0.13"), (1.3, "1.3"), (412.04, "412")]
)
def test_a_difference_that_does_not_show_is_none(value: float, said: str) -> None:
    assert margin(AmbiguityReport("unresolved", value), 10) == f" (chi-square larger by {said}, of 10 matches)"
