"""Small measurements on matches: brightness under them, an even choice among them, how far their errors are shared."""

from __future__ import annotations

import cv2
import numpy as np

from slopecli.geometry.statistics import median
from slopecli.look.features import Grey
from slopecli.types import FloatArray, IntArray

LAGS = ((0, 1), (1, 0), (1, 1), (1, -1), (0, 2), (2, 0), (0, 3), (3, 0))  # rows, columns between two cells
REACH = 3  # the largest of them, rows or columns
MAX_GAIN = 4.0  # errors shared by more cells than this stands for are no noise
MIN_GROUP = 8  # cells of a window that say anything of correlation
CLIP_SIGMAS = 3.0  # robust sigmas residuals are clipped at: one mismatch is no correlation


def sample_grey(grey: Grey, uv: FloatArray) -> FloatArray:
    """(n,) bilinear brightness of an image at pixels (n, 2)."""
    if len(uv) == 0:
        return np.empty(0)
    at = uv.astype(np.float32)[:, None]  # a column: OpenCV bears no more than 32767 points in a row
    return np.asarray(
        cv2.remap(grey, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)[:, 0], float
    )


def thin(uv: FloatArray, index: IntArray, limit: int) -> IntArray:
    """At most `limit` of the points `index`, spread evenly over the image: one a bin, round after round."""
    if len(index) <= limit:
        return index
    points = uv[index]
    low, extent = points.min(0), np.maximum(np.ptp(points, axis=0), 1.0)
    side = np.sqrt(extent.prod() / limit)
    bins = np.floor((points - low) / side).astype(np.int64)
    code = bins[:, 0] * (bins[:, 1].max() + 1) + bins[:, 1]
    order = np.argsort(code, kind="stable")
    starts = np.flatnonzero(np.r_[True, np.diff(code[order]) > 0])
    rank = np.arange(len(order)) - np.repeat(starts, np.diff(np.r_[starts, len(order)]))
    by_rank = np.argsort(rank, kind="stable")
    whole = by_rank[: np.searchsorted(rank[by_rank], rank[by_rank[limit]])]  # rounds that fit in full
    last = by_rank[rank[by_rank] == rank[by_rank[limit]]]
    evenly = last[np.linspace(0, len(last) - 1, limit - len(whole)).round().astype(int)]
    chosen = order[np.concatenate([whole, evenly])]
    return np.sort(index[chosen])


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
