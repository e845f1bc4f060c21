"""Brightness under matches, an even choice among them, and how much their errors are shared."""

from __future__ import annotations

import numpy as np
import pytest

from slopecli.look import MAX_GAIN, correlation_gain, sample_grey, thin
from slopecli.types import FloatArray, IntArray

SIDE = 40  # cells of a window


def test_brightness_between_pixels_is_bilinear() -> None:
    y, x = np.mgrid[:60, :90]
    ramp = (2 * x + y).astype(np.uint8)
    at = np.random.default_rng(0).uniform([0, 0], [89, 59], (200, 2))
    assert np.abs(sample_grey(ramp, at) - at @ [2, 1]).max() <= 0.6  # rounded to a grey level


def test_brightness_past_the_border_is_that_of_the_border() -> None:
    grey = np.array([[10, 200], [30, 40]], np.uint8)
    assert sample_grey(grey, np.array([[-5.0, -5.0], [9.0, 0.0], [0.0, 9.0]])).tolist() == [10, 200, 30]


@pytest.fixture(scope="module")
def uneven() -> FloatArray:
    """3000 points, nine tenths of them crowded into one corner."""
    rng = np.random.default_rng(0)
    return np.vstack([rng.uniform(0, [100, 80], (2700, 2)), rng.uniform(0, [1000, 800], (300, 2))])


def test_few_points_are_all_kept(uneven: FloatArray) -> None:
    index = np.array([5, 3, 2999])
    assert thin(uneven, index, 3).tolist() == [5, 3, 2999]
    assert thin(uneven, index[:0], 3).size == 0


@pytest.mark.parametrize("limit", [50, 200, 1000])
def test_chosen_points_are_among_those_asked_and_no_more_than_the_limit(uneven: FloatArray, limit: int) -> None:
    index = np.flatnonzero(np.arange(3000) % 2)
    chosen = thin(uneven, index, limit)
    assert len(chosen) == limit == len(np.unique(chosen))
    assert np.isin(chosen, index).all()


def test_crowds_are_thinned_and_the_rest_is_spared(uneven: FloatArray) -> None:
    chosen = thin(uneven, np.arange(3000), 200)
    crowded = (uneven[chosen] < [100, 80]).all(1)
    assert crowded.mean() < 0.15  # of all points it is 0.9, of the area 0.01
    outside = np.flatnonzero((uneven >= [100, 80]).any(1))
    assert np.isin(outside, chosen).mean() > 0.5


def test_every_part_of_the_image_is_represented(uneven: FloatArray) -> None:
    chosen = uneven[thin(uneven, np.arange(3000), 200)]
    quarter = np.floor(chosen / [500, 400]).astype(int) @ [2, 1]
    assert np.bincount(quarter).min() > 25


def test_same_points_same_choice(uneven: FloatArray) -> None:
    assert np.array_equal(thin(uneven, np.arange(3000), 200), thin(uneven, np.arange(3000), 200))


def test_points_in_one_place_can_be_thinned() -> None:
    assert len(thin(np.zeros((100, 2)), np.arange(100), 10)) == 10


def window(values: FloatArray) -> tuple[IntArray, FloatArray]:
    """Cell indices (n, 2) and residuals (n,) of a full window."""
    return np.argwhere(np.isfinite(values)), values[np.isfinite(values)]


def smoothed(rng: np.random.Generator, cells: int) -> FloatArray:
    """White noise averaged over `cells` neighbours to the right: the variance of its mean is that of the white noise,
    its own is `cells` times smaller."""
    white = rng.standard_normal((SIDE, SIDE + cells - 1))
    return np.mean([white[:, k : k + SIDE] for k in range(cells)], axis=0)


def test_independent_errors_are_not_enlarged() -> None:
    rng = np.random.default_rng(0)
    gain = correlation_gain([window(rng.standard_normal((SIDE, SIDE))) for _ in range(9)])
    assert 1.0 <= gain < 1.08


@pytest.mark.parametrize("cells", [2, 3])
def test_moving_averages_are_enlarged_by_the_root_of_their_length(cells: int) -> None:
    rng = np.random.default_rng(1)
    gain = correlation_gain([window(smoothed(rng, cells)) for _ in range(9)])
    assert gain == pytest.approx(np.sqrt(cells), rel=0.07)


def test_errors_shared_both_ways_are_enlarged_by_both() -> None:
    rng = np.random.default_rng(2)
    white = [rng.standard_normal((SIDE + 1, SIDE + 1)) for _ in range(9)]
    box = [(w[1:, 1:] + w[1:, :-1] + w[:-1, 1:] + w[:-1, :-1]) / 4 for w in white]
    assert correlation_gain([window(b) for b in box]) == pytest.approx(2.0, rel=0.07)


def test_gaps_between_the_cells_do_not_count_as_agreement() -> None:
    rng = np.random.default_rng(3)
    groups = []
    for _ in range(12):
        values = smoothed(rng, 2)
        values[rng.random(values.shape) < 0.4] = np.nan
        groups.append(window(values))
    assert correlation_gain(groups) == pytest.approx(np.sqrt(2), rel=0.08)


def test_where_the_window_lies_and_the_unit_of_errors_do_not_count() -> None:
    index, values = window(smoothed(np.random.default_rng(4), 3))
    elsewhere = index + np.array([700, -30])
    assert correlation_gain([(elsewhere, 1e-5 * values)]) == pytest.approx(correlation_gain([(index, values)]))


def test_a_few_wild_errors_do_not_hide_what_is_shared() -> None:
    rng = np.random.default_rng(5)
    groups = []
    for _ in range(9):
        index, values = window(smoothed(rng, 3))
        values[rng.random(len(values)) < 0.01] *= 100
        groups.append((index, values))
    assert correlation_gain(groups) == pytest.approx(np.sqrt(3), rel=0.1)


def test_errors_shared_by_all_have_a_limit() -> None:
    assert correlation_gain([window(np.full((SIDE, SIDE), 0.3))]) == MAX_GAIN


def test_alternating_errors_are_not_called_better_than_independent() -> None:
    alternating = (-1.0) ** np.indices((SIDE, SIDE)).sum(0)
    assert correlation_gain([window(alternating)]) == 1.0


def test_too_few_cells_tell_nothing() -> None:
    assert correlation_gain([]) == 1.0
    assert correlation_gain([(np.argwhere(np.ones((1, 7))), np.full(7, 0.3))]) == 1.0
    assert correlation_gain([window(np.zeros((SIDE, SIDE)))]) == 1.0
