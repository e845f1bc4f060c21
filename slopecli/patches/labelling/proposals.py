"""Planes proposed from a few points that lie near each other, in both images where both are at hand."""

from __future__ import annotations

import numpy as np

from slopecli.patches.labelling.models import solve_regular
from slopecli.types import BoolArray, FloatArray, IntArray

CIRCLES = ((8, 6), (16, 6), (32, 4))  # of how many nearest points samples are drawn, and samples from each circle
SEEDS = 300  # points around which samples are drawn
FLAT = 1e-6  # volume of a sample's vectors over their lengths: less, and they fix no plane
# dense cells: places around which a surface is sought, triples tried there, rounds of refining
SURFACE_SEEDS, TRIPLES, REWEIGHTS = 800, 8, 3
LEAST_DEPTH_RATIO = 0.05  # of a homography within its own sample: the points of one plane face one side of a camera


def nearest_in_both(x1: FloatArray, x2: FloatArray, k: int) -> IntArray:
    """(n, k) indices of the k nearest other points, nearest first, by distance in both images together.

    Mismatches lie near others in one image or in the other, hardly ever in both.
    """
    x = np.hstack([x1, x2])
    k = min(k, len(x) - 1)
    near = np.empty((len(x), k), np.int64)
    length = (x**2).sum(axis=1)
    for first in range(0, len(x), 512):  # blocks that fit into the cache
        block = slice(first, first + 512)
        distance = length - 2 * x[block] @ x.T
        distance[np.arange(len(distance)), np.arange(first, first + len(distance))] = np.inf
        some = np.argpartition(distance, k - 1, axis=1)[:, :k]
        order = np.argsort(np.take_along_axis(distance, some, 1), axis=1, kind="stable")
        near[block] = np.take_along_axis(some, order, 1)
    return near


def local_samples(near: IntArray, size: int, seeds: IntArray, rng: np.random.Generator) -> tuple[IntArray, IntArray]:
    """(s, size) indices, every seed with others among its nearest, and (s,) the number of the circle they are from."""
    samples, place = [np.empty((0, size), np.int64)], [np.empty(0, np.int64)]
    for number, (circle, tries) in enumerate(CIRCLES):
        circle = min(circle, near.shape[1])
        if circle >= size - 1:
            pick = rng.random((len(seeds), tries, circle)).argpartition(size - 2, axis=2)[:, :, : size - 1]
            others = near[seeds][np.arange(len(seeds))[:, None, None], pick].reshape(-1, size - 1)
            samples.append(np.column_stack([np.repeat(seeds, tries), others]))
            place.append(np.repeat(np.arange(len(seeds)) + number * len(seeds), tries))
    return np.concatenate(samples), np.concatenate(place)


def propose_homographies(
    x1: FloatArray, x2: FloatArray, near: IntArray, rng: np.random.Generator
) -> tuple[FloatArray, IntArray]:
    """(c, 9) homographies, last entry 1, through four neighbours each, and (c,) the place each is from.

    x1, x2 : (n, 2) centred, of about unit size.
    """
    sample, place = local_samples(near, 4, rng.permutation(len(x1))[:SEEDS], rng)
    a, b = x1[sample], x2[sample]
    matrix, right = _four_point_system(a, b)
    with np.errstate(over="ignore"):
        solvable = (_spread(a) > FLAT) & (_spread(b) > FLAT) & (np.abs(np.linalg.det(matrix)) > np.finfo(float).tiny)
    h = np.linalg.solve(matrix[solvable], right[solvable][..., None])[..., 0]
    planes = np.column_stack([h, np.ones(len(h))])
    depth = (a[solvable] @ planes[:, 6:8, None])[..., 0] + 1.0
    good = (depth > LEAST_DEPTH_RATIO).all(axis=1) & np.isfinite(planes).all(axis=1)
    return planes[good], place[solvable][good]


def _four_point_system(a: FloatArray, b: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(s, 8, 8) and (s, 8): equations of the first eight entries of H, from four points (s, 4, 2) of each image."""
    matrix = np.zeros((len(a), 2, 4, 8))
    p = np.concatenate([a, np.ones((*a.shape[:2], 1))], axis=2)
    matrix[:, 0, :, :3] = matrix[:, 1, :, 3:6] = p
    matrix[:, 0, :, 6:], matrix[:, 1, :, 6:] = -b[..., :1] * a, -b[..., 1:] * a
    return matrix.reshape(-1, 8, 8), b.transpose(0, 2, 1).reshape(-1, 8)


def _spread(a: FloatArray) -> FloatArray:
    """(s,): the smallest triangle of four points (s, 4, 2), as twice its area over the square of their extent."""
    triples = ((0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3))
    sides = [(a[:, j] - a[:, i], a[:, k] - a[:, i]) for i, j, k in triples]
    area = np.min([np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]) for u, v in sides], axis=0)
    extent = np.ptp(a, axis=1).max(axis=1)
    return np.asarray(area / np.maximum(extent**2, np.finfo(float).tiny))


def propose_depth_planes(
    rows: FloatArray, target: FloatArray, near: IntArray, usable: BoolArray, rng: np.random.Generator
) -> tuple[FloatArray, IntArray]:
    """(c, 3) scaled normals through three usable neighbours each, rows (n, 3) @ normal = target (n,), and (c,) the
    place each is from."""
    sample, place = local_samples(near, 3, rng.permutation(np.flatnonzero(usable))[:SEEDS], rng)
    matrix = rows[sample]
    solvable = np.abs(np.linalg.det(matrix)) > FLAT * np.linalg.norm(matrix, axis=2).prod(axis=1)
    solvable &= usable[sample].all(axis=1)
    planes = np.linalg.solve(matrix[solvable], target[sample[solvable]][..., None])[..., 0]
    return np.asarray(planes), place[solvable]


def propose_surfaces(rows: FloatArray, target: FloatArray, near: IntArray, rng: np.random.Generator) -> FloatArray:
    """(c, 3) scaled normals of the surfaces around seeds: through three near points each, then all near it.

    Of the triples around a seed the one is taken that half of the points there are nearest to (Rousseeuw's least
    median of squares); reweighting makes it the plane of that half.
    """
    seeds = rng.permutation(len(rows))[:SURFACE_SEEDS]
    around = np.column_stack([seeds, near[seeds]])
    A, b = rows[around], target[around]
    pick = rng.random((len(seeds), TRIPLES, around.shape[1])).argpartition(3, axis=2)[:, :, :3]
    each = np.arange(len(seeds))[:, None, None]
    planes = _through_three(A[each, pick], b[each, pick])
    misfit = np.median(np.abs(planes @ A.transpose(0, 2, 1) - b[:, None]), axis=2)
    planes = planes[np.arange(len(seeds)), misfit.argmin(axis=1)]
    for _ in range(REWEIGHTS):
        residual = (A @ planes[..., None])[..., 0] - b
        scale = np.median(np.abs(residual), axis=1, keepdims=True)
        weighted = A.transpose(0, 2, 1) * (1 / (1 + (residual / np.maximum(3 * scale, 1e-9)) ** 2) ** 2)[:, None]
        planes = solve_regular(weighted @ A, (weighted @ b[..., None])[..., 0])
    return planes


def _through_three(matrix: FloatArray, right: FloatArray) -> FloatArray:
    """(..., 3) solutions of (..., 3, 3) systems, by least squares where a triple is collinear."""
    transposed = np.swapaxes(matrix, -1, -2)
    return solve_regular(transposed @ matrix, (transposed @ right[..., None])[..., 0])


def conditioner(x: FloatArray) -> tuple[FloatArray, float]:
    """Centre (2,) and size of points (n, 2): subtracted and divided by, they lie around the origin at mean sqrt 2."""
    centre = x.mean(axis=0)
    size = float(np.linalg.norm(x - centre, axis=1).mean() / np.sqrt(2.0))
    return centre, size
