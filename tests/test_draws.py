"""Samples of points: distinct, even, and the same every time."""

from __future__ import annotations

import numpy as np
import pytest

from slopecli.geometry import random_samples, uniform_draws


@pytest.mark.parametrize("n", [4, 5, 7, 1000])
def test_no_index_comes_twice_in_a_sample(n: int) -> None:
    samples = random_samples(n, 300, 4)
    assert samples.shape == (300, 4)
    assert samples.min() >= 0
    assert samples.max() < n
    assert all(len(set(sample)) == 4 for sample in samples.tolist())


def test_every_index_comes_as_often_in_every_place() -> None:
    """Of 3000 samples of 3 in 10, each index is due 300 times a place, give or take 16; limit: four of these."""
    samples = random_samples(10, 3000, 3)
    counts = np.array([np.bincount(place, minlength=10) for place in samples.T])
    assert np.abs(counts - 300).max() < 66


def test_pairs_come_equally_often() -> None:
    """Of the 20 ordered pairs of 5, each 150 times in 3000, give or take 12."""
    samples = random_samples(5, 3000, 2)
    counts = np.bincount(samples @ [5, 1], minlength=25).reshape(5, 5)
    assert (np.diag(counts) == 0).all()
    assert np.abs(counts[~np.eye(5, dtype=bool)] - 150).max() < 48


def test_samples_are_the_same_every_time_and_cannot_be_changed() -> None:
    first = random_samples(50, 20, 3)
    uniform_draws.cache_clear()
    assert np.array_equal(random_samples(50, 20, 3), first)
    with pytest.raises(ValueError, match="read-only"):
        uniform_draws(20, 3)[0, 0] = 0.5
