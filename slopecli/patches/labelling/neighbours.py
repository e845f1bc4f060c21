"""Neighbours in the plane, by NumPy alone."""

from __future__ import annotations

import numpy as np

from slopecli.patches.labelling.energy import Graph
from slopecli.types import FloatArray, IntArray

REACH = 8  # points to either side, in a strip, among which neighbours are sought


def nearest(uv: FloatArray, k: int) -> IntArray:
    """(n, k) indices of about the k nearest other points, nearest first; the point itself where there are fewer.

    The points are cut into vertical strips of equal numbers, and sought in five strips among those at nearly the
    same height: exact where the density changes little over the distance to a neighbour.
    """
    n = len(uv)
    reach = max(REACH, k)
    n_strips = max(int(np.sqrt(1.5 * n / reach)), 1)
    strip = np.empty(n, np.int64)
    strip[np.argsort(uv[:, 0], kind="stable")] = np.arange(n) * n_strips // n
    height = np.empty(n)
    order = np.argsort(uv[:, 1], kind="stable")
    height[order] = np.arange(n) / n  # ranks below 1, so that strip and height sort as one number
    key = strip + height
    order = np.argsort(key, kind="stable")
    found = []
    for step in (-2, -1, 0, 1, 2):
        at = np.searchsorted(key[order], key + step)
        window = np.clip(at[:, None] + np.arange(-reach, reach + 1), 0, n - 1)
        found.append(order[window])
    candidate = np.sort(np.hstack(found), axis=1)
    distance = ((uv[candidate] - uv[:, None]) ** 2).sum(axis=2)
    distance[:, 1:][candidate[:, 1:] == candidate[:, :-1]] = np.inf  # seen twice
    distance[candidate == np.arange(n)[:, None]] = np.inf
    near = np.argpartition(distance, min(k, distance.shape[1] - 1), axis=1)[:, :k]
    near = np.take_along_axis(near, np.argsort(np.take_along_axis(distance, near, 1), axis=1, kind="stable"), 1)
    index = np.take_along_axis(candidate, near, 1)
    missing = ~np.isfinite(np.take_along_axis(distance, near, 1))
    return np.where(missing, np.arange(n)[:, None], index)


def mutual_graph(near: IntArray, weight: float) -> Graph:
    """The graph in which two points are neighbours when either names the other: near (n, k)."""
    n, k = near.shape
    a, b = np.repeat(np.arange(n), k), near.ravel()
    a, b = a[a != b], b[a != b]
    pair = np.unique(np.concatenate([a * n + b, b * n + a]))
    a, b = pair // n, pair % n
    first = np.searchsorted(a, np.arange(n))
    place = np.arange(len(a)) - first[a]
    width = int(place.max(initial=0)) + 1
    neighbour = np.repeat(np.arange(n)[:, None], width, axis=1)
    weights = np.zeros((n, width))
    neighbour[a, place] = b
    weights[a, place] = weight
    return Graph(neighbour, weights)
