"""Medians and quantiles against those of NumPy and of the standard library."""

from __future__ import annotations

from statistics import NormalDist

import numpy as np
import pytest

from slopecli.geometry import median, normal_quantile, quantile, student_quantile


@pytest.mark.parametrize("n", [1, 2, 3, 10, 101])
def test_they_are_what_numpy_says(n: int) -> None:
    values = np.random.default_rng(n).normal(size=n)
    assert median(values) == np.median(values)
    for at in (0.0, 0.1, 0.5, 0.98, 1.0):
        assert quantile(values, at) == pytest.approx(np.quantile(values, at), rel=1e-12)


@pytest.mark.parametrize("values", [[], [1.0, np.nan, 2.0], [np.nan]])
def test_what_is_not_known_is_not_a_number(values: list[float]) -> None:
    assert np.isnan(median(values))
    assert np.isnan(quantile(values, 0.5))


@pytest.mark.parametrize("probability", [1e-9, 0.025, 0.5, 0.975, 0.999999])
def test_normal_quantiles_are_those_of_the_standard_library(probability: float) -> None:
    assert normal_quantile(probability) == pytest.approx(NormalDist().inv_cdf(probability), rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("probability", [0.0, 1.0, -0.1, np.nan])
def test_there_is_no_quantile_beyond_certainty(probability: float) -> None:
    with pytest.raises(ValueError, match="no quantile"):
        normal_quantile(probability)


def test_student_quantiles_are_those_of_the_tables() -> None:
    known = {1: 12.7062, 2: 4.3027, 3: 3.1824, 4: 2.7764, 5: 2.5706, 30: 2.0423, 100: 1.9840}
    assert {nu: round(student_quantile(0.975, nu), 4) for nu in known} == known
    with pytest.raises(ValueError, match="no quantile"):
        student_quantile(0.975, 0)
