"""Random numbers that are the same in every run, for samples of points.

By the standard library's generator: loading numpy's takes longer than all that is drawn here.
"""

from __future__ import annotations

from functools import lru_cache
from random import Random

import numpy as np

from slopecli.types import FloatArray, IntArray


@lru_cache(maxsize=4)
def uniform_draws(count: int, size: int) -> FloatArray:
    """(count, size) numbers from 0 to below 1."""
    generator = Random(0)
    draws = np.array([generator.random() for _ in range(count * size)]).reshape(count, size)
    draws.flags.writeable = False
    return draws


def random_samples(n: int, count: int, size: int) -> IntArray:
    """(count, size) indices below n, no two of a sample alike; n >= size."""
    samples = np.empty((count, size), np.int64)
    for k, draws in enumerate(uniform_draws(count, size).T):
        index = (draws * (n - k)).astype(np.int64)  # among those not yet in the sample
        for taken in np.sort(samples[:, :k], axis=1).T:
            index += index >= taken
        samples[:, k] = index
    return samples
