"""Noise of images and matches: the physical constants of the package, and the correlation of errors between cells.

Every constant is a 1-sigma. Values in px hold for the image that was matched, which may be a shrunken one.
"""

from __future__ import annotations

import numpy as np

from slopecli.geometry.statistics import robust_sigma
from slopecli.types import FloatArray, IntArray

NOISE_GREY = 2.0  # of a grey value of one image: sensor noise and compression, as measured in photographs
DIFFERENCE_GREY = 2.5  # of the difference of two aligned images of one surface: noise of both, one of them interpolated
ROUNDING_GREY = 0.5  # of that difference without any noise: grey values are rounded to whole levels in both images
SYSTEMATIC_PX = 0.02  # RMS misfit that lens models, interpolation and shading leave in the best of pairs
LEAST_MATCH_PX = 0.05  # lower bound of the sigma of a single match, sparse or of the overview
WORST_MATCH_PX = 0.7  # largest: residuals beyond a few of these are mismatches
OVERVIEW_CELL_PX = 0.1  # of a match of the overview, and of dense flow, px of their working grid; at least, of features
APART = 0.02  # of the distance, from which on one surface lies behind another, or off it
# correlation of texture from which on both images show the same ground. With image 2 laid 40 to 75 px off, 2 of 100
# places of eighteen pairs have more, in windows of the dense depth and in blocks of changes alike
SAME_GROUND = 0.6

LAGS = ((0, 1), (1, 0), (1, 1), (1, -1), (0, 2), (2, 0), (0, 3), (3, 0))  # rows, columns between two cells
MAX_GAIN = 4.0  # of standard errors by correlation; errors shared by more cells are not noise


def correlation_gain(groups: list[tuple[IntArray, FloatArray]]) -> float:
    """Factor by which standard errors exceed those of independent cells, 1..MAX_GAIN.

    Each group is a window: cell indices (n, 2) and residuals (n,) across the epipolar lines, which hold matching noise
    and no relief; groups of fewer than 8 cells are skipped. Correlation multiplies the variance of a mean by one plus
    twice the sum of the autocorrelations over all lags.
    """
    products, pairs = np.zeros(len(LAGS)), np.zeros(len(LAGS))
    square, count = 0.0, 0
    for index, residual in groups:
        if len(residual) < 8:
            continue
        limit = 3 * robust_sigma(residual) + 1e-15  # one mismatch is not correlation
        value = np.clip(residual, -limit, limit)
        square, count = square + float(value @ value), count + len(value)
        reach = np.abs(LAGS).max()
        row, column = (index - index.min(0) + reach).T
        table = np.full(tuple(np.ptp(index, axis=0) + 1 + 2 * reach), np.nan)
        table[row, column] = value
        both = np.array([value * table[row + down, column + right] for down, right in LAGS])
        products, pairs = products + np.nansum(both, axis=1), pairs + np.isfinite(both).sum(1)
    if count == 0 or square == 0.0:
        return 1.0
    correlation = products / np.maximum(pairs, 1) / (square / count)
    return float(np.sqrt(np.clip(1 + 2 * correlation.sum(), 1.0, MAX_GAIN**2)))
