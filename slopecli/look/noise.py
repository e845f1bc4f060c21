"""Noise of images and matches: the physical constants of the package, and the correlation of errors between cells.

Every constant is a 1-sigma. Values in px hold for the image that was matched, which may be a shrunken one.
"""

from __future__ import annotations

import numpy as np

from slopecli.geometry.statistics import median
from slopecli.types import FloatArray, IntArray

NOISE_GREY = 2.0  # of a grey value of one image: sensor noise and compression, as measured in photographs
DIFFERENCE_GREY = 2.5  # of the difference of two aligned images of one surface: noise of both, one of them interpolated
ROUNDING_GREY = 0.5  # of that difference without any noise: grey values are rounded to whole levels in both images
SYSTEMATIC_PX = 0.02  # RMS misfit that lens models, interpolation and shading leave in the best of pairs
LEAST_MATCH_PX = 0.05  # smallest sigma of a single match, sparse or of the overview, that is believed
WORST_MATCH_PX = 0.7  # largest: residuals beyond a few of these are mismatches
OVERVIEW_CELL_PX = 0.1  # of a match of the overview, px of its working grid

LAGS = ((0, 1), (1, 0), (1, 1), (1, -1), (0, 2), (2, 0), (0, 3), (3, 0))  # rows, columns between two cells
REACH = 3  # the largest of them, rows or columns
MAX_GAIN = 4.0  # errors shared by more cells than this stands for are no noise
MIN_GROUP = 8  # cells of a window that say anything of correlation
CLIP_SIGMAS = 3.0  # robust sigmas residuals are clipped at: one mismatch is no correlation


def correlation_gain(groups: list[tuple[IntArray, FloatArray]]) -> float:
    """How much larger standard errors are than if errors of neighbouring cells were independent.

    Each group is a window: cell indices (n, 2) and residuals (n,) across the epipolar lines, which hold matching noise
    and no relief. The variance of a mean over correlated samples grows by one plus twice the sum of their
    autocorrelations over all lags.
    """
    products, pairs = np.zeros(len(LAGS)), np.zeros(len(LAGS))
    square, count = 0.0, 0
    for index, residual in groups:
        if len(residual) < MIN_GROUP:
            continue
        limit = CLIP_SIGMAS * 1.4826 * median(np.abs(residual)) + 1e-15
        value = np.clip(residual, -limit, limit)
        square, count = square + float(value @ value), count + len(value)
        product, known = _lagged_products(index, value)
        products, pairs = products + product, pairs + known
    if count == 0 or square == 0.0:
        return 1.0
    correlation = products / np.maximum(pairs, 1) / (square / count)
    return float(np.sqrt(np.clip(1 + 2 * correlation.sum(), 1.0, MAX_GAIN**2)))


def _lagged_products(index: IntArray, value: FloatArray) -> tuple[FloatArray, FloatArray]:
    """For every lag: the sum of products of values that far apart, and how many such pairs there are."""
    row, column = (index - index.min(0) + REACH).T
    table = np.full(tuple(np.ptp(index, axis=0) + 1 + 2 * REACH), np.nan)
    table[row, column] = value
    both = np.array([value * table[row + down, column + right] for down, right in LAGS])
    return np.nansum(both, axis=1), np.isfinite(both).sum(1).astype(float)
