"""The paper's features (section IV): Förstner corners, matched by correlation and refined by least squares.

Source: Förstner and Gülch, "A fast operator for detection and precise location of distinct points, corners and centres
of circular features", Interlaken 1987.
"""

from __future__ import annotations

from collections.abc import Iterable

import cv2
import numpy as np

from slopecli.look.features import Grey, match_descriptors, shrink, to_full
from slopecli.look.least_squares_matching import RADIUS_PX, Blocks, normalised, refine_on_layers, similar, upright
from slopecli.look.noise import NOISE_GREY
from slopecli.look.warp import FloatImage, Layer, image_gradient
from slopecli.types import BoolArray, FloatArray, IntArray

GradientProducts = tuple[FloatImage, FloatImage, FloatImage]  # gx gx, gx gy, gy gy, (h, w) each, grey^2/px^2

WINDOW_SIGMA_PX = 1.5  # Gaussian window of the structure tensor, the extent of one corner
MAX_OFFSET_PX = 2.5  # from the maximum of w to where the edges meet, which lies inside the window
QUOTA_CELLS = 8  # the image is divided in 8 x 8 cells, each with a quota of corners
COARSE_PIXELS = 0.25e6  # of the images corners are matched on: a block then shows 34 px of a megapixel image
SCALES = (1.0, 0.8, 1.25, 0.625, 1.6)  # of image 2 relative to image 1, likely ones first


def match_foerstner(grey1: Grey, grey2: Grey) -> tuple[FloatArray, FloatArray, tuple[int, int]]:
    """Tentative matches, (n, 2) px of the full images each, few of them mismatches; number of corners per image.

    Tolerates any turn about the optical axis and changes of scale up to about 1.7, but no strong foreshortening.
    """
    coarse1, coarse2 = _shrunken_pair(grey1, grey2, COARSE_PIXELS)
    corners1, corners2 = (foerstner_corners(c.grey, n_features=2000, min_distance=4.0) for c in (coarse1, coarse2))
    i, j, similarity = match_corners(coarse1.grey, corners1, coarse2.grey, corners2)
    uv1 = to_full(corners1[i], coarse1.scale)
    start = similar(to_full(corners2[j], coarse2.scale), similarity)
    return (*refine_matches(grey1, grey2, uv1, start), (len(corners1), len(corners2)))


def foerstner_corners(grey: Grey, n_features: int, min_distance: float) -> FloatArray:
    """Corners of an image, strongest first, spread over it.

    Parameters
    ----------
    grey : (h, w) uint8 image.
    n_features : largest number of corners.
    min_distance : px, between maxima of w along either axis; the corner itself may lie up to MAX_OFFSET_PX off.

    Returns
    -------
    corners : (n, 2) px, pixel centres at integers; empty where there is no texture.
    """
    w, q = interest(products := gradient_products(grey))
    # w and q as of a corner that noise moves by less than 2/3 px, and that is no straight edge (0 is straight, 1 round)
    good = _maxima(w, min_distance) & (q > 0.3) & (w > (NOISE_GREY / (2 / 3)) ** 2)
    margin = _window_radius()
    row, column = (index + margin for index in np.nonzero(good[margin:-margin, margin:-margin]))
    cell = row * QUOTA_CELLS // w.shape[0] * QUOTA_CELLS + column * QUOTA_CELLS // w.shape[1]
    chosen = _strongest_of_cells(cell, w[row, column], n_features)
    at = np.stack([column, row], -1)[chosen]
    return np.asarray(at + _edge_intersection(products, at), float)


def _window_radius() -> int:
    """Px at which the Gaussian window of the structure tensor has decayed."""
    return round(4 * WINDOW_SIGMA_PX)


def gradient_products(grey: Grey) -> GradientProducts:
    """The structure tensor of every pixel, before it is summed over a window."""
    # smoothed just enough that single noisy pixels make no edges
    smooth = np.asarray(cv2.GaussianBlur(grey.astype(np.float32), (0, 0), 0.7), np.float32)
    gx, gy = image_gradient(smooth)
    return gx * gx, gx * gy, gy * gy


def interest(products: GradientProducts) -> tuple[FloatImage, FloatImage]:
    """Förstner's w = det N / tr N, grey^2/px^2, and roundness q = 4 det N / (tr N)^2, 0..1, both (h, w).

    N is the structure tensor summed over a Gaussian window. 1 / w is the trace of its inverse: the variance of a
    corner's position, px^2, for grey values of unit variance.
    """
    weight = 2 * np.pi * WINDOW_SIGMA_PX**2  # the blur averages; N is a sum
    nxx, nxy, nyy = (weight * cv2.GaussianBlur(product, (0, 0), WINDOW_SIGMA_PX) for product in products)
    trace = np.maximum(nxx + nyy, 1e-6)
    det = np.maximum(nxx * nyy - nxy * nxy, 0)
    return det / trace, 4 * det / trace**2


def _maxima(w: FloatImage, min_distance: float) -> BoolArray:
    """(h, w) whether a pixel is the largest within `min_distance` rows and columns; of equals the first."""
    side = 2 * max(1, int(np.ceil(min_distance)) - 1) + 1
    before = np.zeros((side, side), np.uint8)
    before.reshape(-1)[: side * side // 2] = 1
    return np.asarray((w >= cv2.dilate(w, np.ones((side, side), np.uint8))) & (w > cv2.dilate(w, before)))


def _strongest_of_cells(cell: IntArray, strength: FloatImage, limit: int) -> IntArray:
    """Indices of at most `limit` corners, strongest first: the quota of every cell, then the strongest of the rest."""
    by_cell = np.lexsort((-strength, cell))
    rank = np.empty(len(cell), int)
    rank[by_cell] = np.arange(len(cell)) - np.searchsorted(cell[by_cell], cell[by_cell])
    beyond_quota = rank >= -(-limit // QUOTA_CELLS**2)
    chosen = np.lexsort((-strength, beyond_quota))[:limit]
    return np.asarray(chosen[np.argsort(-strength[chosen], kind="stable")])


def _edge_intersection(products: GradientProducts, at: IntArray) -> FloatArray:
    """Offset (n, 2) px from pixels `at` (n, 2) to the point nearest to all edges of the window around it.

    Solves sum(g g^T) d = sum(g g^T p) over pixels p, and again with the window moved there, as it draws the point
    to its own centre. A large offset means that the edges do not meet (a blob); the maximum of w is then kept.
    """
    radius = _window_radius()
    y, x = np.mgrid[-radius : radius + 1, -radius : radius + 1].reshape(2, -1)
    column, row = at[:, :1] + x, at[:, 1:] + y
    p = np.stack([x, y], -1).astype(float)
    xx, xy, yy = (product[row, column] for product in products)
    system = np.stack([xx, xy, xy, yy], -1).reshape(*xx.shape, 2, 2)
    right = system @ p[..., None]
    offset = np.zeros(at.shape)
    for _ in range(4):
        weight = np.exp(-((p - offset[:, None]) ** 2).sum(2) / (2 * WINDOW_SIGMA_PX**2))
        normal = np.einsum("nk,nkij->nij", weight, system)
        offset = np.linalg.solve(normal, np.einsum("nk,nkij->nij", weight, right))[..., 0]
        offset = np.clip(offset, -MAX_OFFSET_PX, MAX_OFFSET_PX)
    return np.where(np.abs(offset).max(1, keepdims=True) < MAX_OFFSET_PX, offset, 0.0)


def match_corners(
    grey1: Grey, corners1: FloatArray, grey2: Grey, corners2: FloatArray
) -> tuple[IntArray, IntArray, FloatArray]:
    """Index pairs of corners whose blocks correlate best, and the similarity (2, 2) at which most of them do."""
    image1, image2 = grey1.astype(np.float32), grey2.astype(np.float32)
    blocks1 = normalised(upright(corners1).sample(image1, RADIUS_PX))
    n_trial = min(300, len(corners1))  # the strongest corners, which decide on scale and turn

    def pairs(similarity: FloatArray, n_first: int) -> tuple[IntArray, IntArray]:
        blocks2 = normalised(similar(corners2, similarity).sample(image2, RADIUS_PX))
        return match_descriptors(blocks1[:n_first], blocks2, ratio=0.85)

    def support(similarity: FloatArray) -> int:
        return len(pairs(similarity, n_trial)[0])

    # correlation tolerates half a step of scale and of turn (deg)
    best = max(_similarities(SCALES[:3], (0, -12, 12)), key=support)
    if support(best) < 0.15 * n_trial:
        best = max([best, *_similarities(SCALES, range(-168, 169, 24))], key=support)
    return (*pairs(best, len(corners1)), best)


def _similarities(scales: Iterable[float], turns_deg: Iterable[float]) -> list[FloatArray]:
    turns = np.radians(list(turns_deg))
    return [s * np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]]) for s in scales for a in turns]


def _shrunken_pair(grey1: Grey, grey2: Grey, max_pixels: float) -> tuple[Layer, Layer]:
    """Both images shrunk by the same factor, the larger to `max_pixels`."""
    share = max_pixels / max(grey1.size, grey2.size)
    return Layer(*shrink(grey1, share * grey1.size)), Layer(*shrink(grey2, share * grey2.size))


def refine_matches(grey1: Grey, grey2: Grey, uv1: FloatArray, start: Blocks) -> tuple[FloatArray, FloatArray]:
    """Sub-pixel matches, (n, 2) px each, refined from shrunken to full images; unreliable ones are dropped."""
    full = max(grey1.size, grey2.size)
    halvings = max(0, round(np.log(full / COARSE_PIXELS) / np.log(4)))
    for level in range(halvings, -1, -1):
        uv1, start = refine_on_layers(*_shrunken_pair(grey1, grey2, full / 4**level), uv1, start)
    return uv1, start.centre
