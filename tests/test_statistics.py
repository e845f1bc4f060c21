"""Medians, robust weights and reweighted least squares."""

from __future__ import annotations

from statistics import NormalDist

import numpy as np
import pytest
from scipy.special import chdtri

from slopecli.geometry import (
    CHI2,
    MAD_FACTOR,
    geman_mcclure,
    median,
    robust_least_squares,
    robust_sigma,
)


@pytest.mark.parametrize("n", [1, 2, 3, 10, 101])
def test_the_median_is_that_of_numpy(n: int) -> None:
    values = np.random.default_rng(n).normal(size=n)
    assert median(values) == np.median(values)


@pytest.mark.parametrize("values", [[], [1.0, np.nan, 2.0], [np.nan]])
def test_the_median_of_what_is_not_known_is_not_a_number(values: list[float]) -> None:
    assert np.isnan(median(values))


def test_quantiles_are_those_of_the_distributions() -> None:
    quartile = NormalDist().inv_cdf(0.75)
    assert pytest.approx(1.0 / quartile, abs=1e-4) == MAD_FACTOR
    assert pytest.approx(quartile**2, abs=1e-4) == CHI2[1, 0.5]
    assert pytest.approx(2.0 * np.log(2.0), abs=1e-4) == CHI2[2, 0.5]
    assert {key: float(chdtri(key[0], 1.0 - key[1])) for key in CHI2} == pytest.approx(CHI2, rel=3e-3)


def test_robust_sigma_is_that_of_the_majority_and_within_its_bounds() -> None:
    residual = np.random.default_rng(0).normal(scale=0.5, size=1000)
    residual[::5] = 100.0
    assert robust_sigma(residual) == pytest.approx(0.5, rel=0.35)
    assert robust_sigma(residual, least=2.0) == 2.0
    assert robust_sigma(residual, most=0.1) == 0.1


def test_geman_mcclure_weights_keep_shape_and_type() -> None:
    residual = np.array([[0.0, 2.0, np.inf]], np.float32)
    weight = geman_mcclure(residual, 2.0)
    assert weight.tolist() == [[1.0, 0.25, 0.0]]
    assert weight.dtype == np.float32


@pytest.mark.parametrize("systems", [(), (3,)])
def test_robust_least_squares_ignores_a_minority_of_outliers(systems: tuple[int, ...]) -> None:
    rng = np.random.default_rng(1)
    truth = rng.normal(size=(*systems, 3))
    rows = rng.normal(size=(*systems, 200, 3))
    target = (rows @ truth[..., None])[..., 0] + 0.01 * rng.normal(size=(*systems, 200))
    target[..., :40] += 5.0
    found, sigma = robust_least_squares(rows, target, np.zeros_like(truth), (1e-3, np.inf), 20)
    np.testing.assert_allclose(found, truth, atol=0.01)
    np.testing.assert_allclose(sigma, 0.0125, rtol=0.3)


def test_robust_least_squares_survives_a_direction_that_no_row_tells() -> None:
    rows = np.array([[1.0, 0.0], [2.0, 0.0], [3.0, 0.0]])
    found, _ = robust_least_squares(rows, rows[:, 0], np.zeros(2), (1.0, 1.0), 20)
    np.testing.assert_allclose(found, [1.0, 0.0], atol=1e-6)
