"""Orientation of triangles of matches: what a mirrored image reverses, and no motion of a camera does.

An opaque surface shows one side to both cameras. Three points of one plane then turn the same way round in both images,
whatever the rotation and the baseline: with x2 ~ H x1, the areas have the ratio det(H) over the product of the three
depth ratios, which are positive for points in front of the cameras, as is det(H) = 1 - N.T for both on one side.
"""

from __future__ import annotations

import numpy as np

from slopecli.types import FloatArray, IntArray


def kept_orientation(x1: FloatArray, x2: FloatArray, surface: IntArray) -> float:
    """Share of triangles that turn the same way round in both images; NaN if no surface has three points.

    Near 1 for images of one scene, near 0 where one is mirrored, 1/2 by chance: mismatches and noise bring it nearer to
    that. The triangles are drawn at random, always the same ones, each from points of one surface.

    x1, x2 : (n, 2) in either image.  surface : (n,) which surface a point lies on, negative for none.
    """
    order = np.argsort(surface, kind="stable")
    order = order[np.searchsorted(surface[order], 0) :]
    count = np.unique(surface[order], return_counts=True)[1]
    first, enough = np.cumsum(count) - count, count >= 3
    if not enough.any():
        return float("nan")
    rng = np.random.default_rng(0)
    chosen = rng.choice(np.flatnonzero(enough), 3000, p=count[enough] / count[enough].sum())  # a share is known to 0.01
    # three different points of a surface of n: each draw skips the earlier ones
    n = count[chosen]
    a, b, c = (rng.integers(0, n - taken) for taken in range(3))
    b = (a + 1 + b) % n
    for earlier in np.sort([a, b], axis=0):
        c = c + (c >= earlier)
    corners = order[first[chosen] + np.array([a, b, c])]
    turns = np.sign(_areas(x1[corners]) * _areas(x2[corners]))
    return float(0.5 + 0.5 * turns.mean())


def _areas(corners: FloatArray) -> FloatArray:
    """(n,) twice the signed areas of triangles (3, n, 2)."""
    (x, y), (u, v) = (corners[1] - corners[0]).T, (corners[2] - corners[0]).T
    return np.asarray(x * v - y * u)
