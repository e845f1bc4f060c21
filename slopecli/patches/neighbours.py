"""Nearest neighbours of points, by a k-d tree."""

from __future__ import annotations

import numpy as np

from slopecli.types import FloatArray, IntArray


def nearest(points: FloatArray, k: int, queries: IntArray | None = None) -> IntArray:
    """Return the indices (m, min(k, n)) of the points (n, d) nearest to some of them, nearest first, itself included.

    queries : (m,) indices of the points whose neighbours are wanted; all n when None.
    """
    from scipy.spatial import KDTree

    asked = points if queries is None else points[queries]
    _, index = KDTree(points).query(asked, range(1, min(k, len(points)) + 1))
    return np.asarray(index, np.int64).reshape(len(asked), -1)
