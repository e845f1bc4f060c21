"""Nearest neighbours of points: by a k-d tree, or of a few points without SciPy."""

from __future__ import annotations

import numpy as np

from slopecli.types import FloatArray, IntArray


def nearest(points: FloatArray, k: int, queries: IntArray | None = None) -> IntArray:
    """Return the indices (m, min(k, n)) of the points (n, d) nearest to some of them, nearest first, itself included.

    queries : (m,) indices of the points whose neighbours are wanted; all n when None.
    """
    return nearest_by_tree(points, points if queries is None else points[queries], k)[1]


def nearest_by_tree(others: FloatArray, places: FloatArray, count: int) -> tuple[FloatArray, IntArray]:
    """As `nearest_of`, for many points `others` (k, d), by SciPy's k-d tree; of fewer than `count` all."""
    from scipy.spatial import KDTree

    distance, index = KDTree(others).query(places, range(1, min(count, len(others)) + 1))
    return np.asarray(distance).reshape(len(places), -1), np.asarray(index, np.int64).reshape(len(places), -1)


def nearest_of(others: FloatArray, places: FloatArray, count: int) -> tuple[FloatArray, IntArray]:
    """Distances (n, count) of the points `others` (k, 2) nearest to places (n, 2), nearest first, and their indices."""
    every, found = np.arange(len(others)), list[tuple[FloatArray, IntArray]]()
    for some in np.array_split(places, 1 + len(places) * len(others) // 2**20):  # a million distances at a time
        u, v = (some[:, None, k] - others[None, :, k] for k in (0, 1))
        distance = np.sqrt(u * u + v * v)
        order = distance + 1e-9 * every  # the first of equal ones
        near = np.argpartition(order, count - 1, axis=1)[:, :count]
        near = np.take_along_axis(near, np.take_along_axis(order, near, 1).argsort(axis=1), 1)
        found.append((np.take_along_axis(distance, near, 1), near))
    return np.concatenate([one[0] for one in found]), np.concatenate([one[1] for one in found])
