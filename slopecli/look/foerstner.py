"""The paper's features (section IV): Förstner corners, matched by correlation and refined by least-squares matching:
sub-pixel displacement, and shear, of small image blocks.

Sources: Förstner and Gülch, "A fast operator for detection and precise location of distinct points, corners and centres
of circular features", Interlaken 1987. Gruen, "Adaptive least squares correlation", 1985, in the inverse compositional
form of Baker and Matthews, "Lucas-Kanade 20 years on", IJCV 56(3), 2004.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np

from slopecli.look.features import Grey, match_descriptors, shrink, to_full
from slopecli.look.noise import NOISE_GREY
from slopecli.look.warp import FloatImage, Layer, gaussian_reach, image_gradient
from slopecli.types import BoolArray, FloatArray, IntArray

GradientProducts = tuple[FloatImage, FloatImage, FloatImage]  # gx gx, gx gy, gy gy, (h, w) each, grey^2/px^2

WINDOW_SIGMA_PX = 1.5  # Gaussian window of the structure tensor, the extent of one corner
WINDOW_RADIUS_PX = round(gaussian_reach(WINDOW_SIGMA_PX))  # where that window has decayed
MAX_OFFSET_PX = 2.5  # from the maximum of w to where the edges meet, which lies inside the window
QUOTA_CELLS = 8  # the image is divided in 8 x 8 cells, each with a quota of corners
COARSE_PIXELS = 0.25e6  # of the images corners are matched on: a block then shows 34 px of a megapixel image
SCALES = (1.0, 0.8, 1.25, 0.625, 1.6)  # of image 2 relative to image 1, likely ones first
RADIUS_PX = 8  # of a block: 17 x 17 px hold enough texture to be told from others, and are about planar
MIN_CORRELATION = 0.8  # of two matched blocks; less is another surface
SEARCH_PX = 3  # largest displacement that `correlate_windows` finds, along either axis
EXACT = cv2.INTER_LANCZOS4  # for the last step: OpenCV's bicubic shifts smooth images by up to 0.05 px, this by 0.01


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
    """At most `n_features` corners (n, 2) px, strongest first, spread over the image; none where there is no texture.

    min_distance : px, between maxima of w along either axis; the corner itself may lie up to MAX_OFFSET_PX off.
    """
    w, q = interest(products := gradient_products(grey))
    # w and q as of a corner that noise moves by less than 2/3 px, and that is no straight edge (0 is straight, 1 round)
    good = _maxima(w, min_distance) & (q > 0.3) & (w > (NOISE_GREY / (2 / 3)) ** 2)
    margin = WINDOW_RADIUS_PX
    row, column = (index + margin for index in np.nonzero(good[margin:-margin, margin:-margin]))
    cell = row * QUOTA_CELLS // w.shape[0] * QUOTA_CELLS + column * QUOTA_CELLS // w.shape[1]
    chosen = _strongest_of_cells(cell, w[row, column], n_features)
    at = np.stack([column, row], -1)[chosen]
    return np.asarray(at + _edge_intersection(products, at), float)


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
    radius = WINDOW_RADIUS_PX
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
        layer1, layer2 = _shrunken_pair(grey1, grey2, full / 4**level)
        began = Blocks((start.centre + 0.5) * layer2.scale - 0.5, start.shape)
        image1, image2 = layer1.grey.astype(np.float32), layer2.grey.astype(np.float32)
        found, correlation = least_squares_match(image1, image2, (uv1 + 0.5) * layer1.scale - 0.5, began, affine=True)
        drift = np.linalg.norm(found.centre - began.centre, axis=1)
        stretch = np.linalg.svd(found.shape, compute_uv=False)
        sound = (drift < 3.0) & (stretch[:, 0] < 2.0) & (stretch[:, 1] > 0.5)  # beyond, a block has left its surface
        keep = sound & (correlation > MIN_CORRELATION)
        uv1, start = uv1[keep], Blocks(to_full(found.centre[keep], layer2.scale), found.shape[keep])
    return uv1, start.centre


# ---- least-squares matching of blocks ----


@dataclass(frozen=True, eq=False)
class Blocks:
    """Blocks of an image: pixel d of block k lies at `centre[k] + shape[k] d`; centre (n, 2) px, shape (n, 2, 2)."""

    centre: FloatArray
    shape: FloatArray

    def sample(self, image: FloatImage, radius: int, interpolation: int = cv2.INTER_LINEAR) -> FloatImage:
        """Grey values (n, (2 radius + 1)^2); outside the image its border repeats."""
        at = (self.centre[:, None] + _offsets(radius) @ self.shape.transpose(0, 2, 1)).astype(np.float32)
        if at.size == 0:
            return np.empty(at.shape[:2], np.float32)
        values = cv2.remap(image, at[..., 0], at[..., 1], interpolation, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(values, np.float32)

    def inside(self, image: FloatImage) -> BoolArray:
        """(n,) whether the image holds the whole block."""
        reach = RADIUS_PX * np.abs(self.shape).sum(2)
        last = np.array([image.shape[1], image.shape[0]]) - 1
        return np.asarray(((self.centre >= reach) & (self.centre + reach <= last)).all(1))


def similar(centre: FloatArray, shape: FloatArray) -> Blocks:
    """Blocks around points (n, 2) px, all of one shape (2, 2)."""
    return Blocks(np.asarray(centre, float), np.broadcast_to(shape, (len(centre), 2, 2)))


def upright(centre: FloatArray) -> Blocks:
    """Blocks around points (n, 2) px, along the axes of the image."""
    return similar(centre, np.eye(2))


def _offsets(radius: int) -> FloatArray:
    y, x = np.mgrid[-radius : radius + 1, -radius : radius + 1]
    return np.stack([x, y], -1).reshape(-1, 2).astype(float)


def normalised(values: FloatImage) -> FloatImage:
    """Rows with their mean removed and of unit length, so that dot products are correlations; flat rows become 0."""
    centred = values - values.mean(1, keepdims=True)
    length = np.linalg.norm(centred, axis=1, keepdims=True)
    return np.asarray(np.where(length > 1e-2, centred / np.maximum(length, 1e-2), 0), np.float32)


def least_squares_match(
    image1: FloatImage, image2: FloatImage, points1: FloatArray, start: Blocks, affine: bool
) -> tuple[Blocks, FloatArray]:
    """Move blocks of image 2, and shear them if `affine`, until they equal those around points of image 1.

    Gain and offset of the grey values are estimated in every step. Returns the n blocks of image 2 and their
    correlation (n,), -1 where a block left its image or did not converge.

    points1 : (n, 2) px of image 1.  start : n blocks of image 2, at most about 2 px off.
    """
    template = upright(points1)
    unit, solver = _linearise(template.sample(image1, RADIUS_PX, EXACT), affine)
    centre, shape = start.centre.copy(), start.shape.copy()
    moving = np.arange(len(points1))
    for _ in range(10):
        seen = Blocks(centre[moving], shape[moving]).sample(image2, RADIUS_PX)
        step = _step(seen, unit[moving], solver[moving])
        centre[moving], shape[moving] = _compose(centre[moving], shape[moving], step)
        # OpenCV samples images at 1/32 px: steps below that do not converge to 0
        moving = moving[np.linalg.norm(step[:, :2], axis=1) > 1 / 32]
    step = _step(Blocks(centre, shape).sample(image2, RADIUS_PX, EXACT), unit, solver)
    found = Blocks(*_compose(centre, shape, step))
    correlation = (unit * normalised(found.sample(image2, RADIUS_PX, EXACT))).sum(1)
    good = template.inside(image1) & found.inside(image2)
    good[moving] = False
    return found, np.where(good, correlation, -1.0).astype(float)


def _linearise(template: FloatImage, affine: bool) -> tuple[FloatImage, FloatImage]:
    """The normalised template (n, k) and matrices (n, p, k) that turn grey values over their gain into steps.

    The Jacobian is made orthogonal to a constant and to the template, which eliminates offset and gain of image 2.
    """
    side = 2 * RADIUS_PX + 1
    gy, gx = (g.reshape(template.shape) for g in np.gradient(template.reshape(-1, side, side), axis=(1, 2)))
    x, y = _offsets(RADIUS_PX).astype(np.float32).T
    jacobian = np.stack([gx, gy, gx * x, gx * y, gy * x, gy * y] if affine else [gx, gy], 1)
    jacobian -= jacobian.mean(2, keepdims=True)
    unit = normalised(template)
    jacobian -= (jacobian @ unit[..., None]) * unit[:, None]
    system = jacobian @ jacobian.transpose(0, 2, 1)
    scale = np.trace(system, axis1=1, axis2=2)[:, None, None]
    solver = np.linalg.solve(system + (1e-6 * scale + 1e-3) * np.eye(system.shape[1]), jacobian)
    length = np.linalg.norm(template - template.mean(1, keepdims=True), axis=1)
    return unit, np.asarray(solver * length[:, None, None], np.float32)


def _step(seen: FloatImage, unit: FloatImage, solver: FloatImage) -> FloatArray:
    """Warp (n, p) of the template that would make it equal `seen`; no pixel moves by more than 1.5 px."""
    gain = np.maximum((unit * seen).sum(1), 1.0)  # times the template's contrast
    step = (solver @ seen[..., None])[..., 0] / gain[:, None]
    reach = np.linalg.norm(step[:, :2], axis=1) + RADIUS_PX * np.abs(step[:, 2:]).sum(1)
    return np.asarray(step * np.minimum(1, 1.5 / np.maximum(reach, 1e-9))[:, None], float)


def _compose(centre: FloatArray, shape: FloatArray, step: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The block after the inverse of the template's warp (tx, ty) or (tx, ty, dxx, dxy, dyx, dyy)."""
    if step.shape[1] == 6:
        shape = shape @ np.linalg.inv(np.eye(2) + step[:, 2:].reshape(-1, 2, 2))
    return centre - (shape @ step[:, :2, None])[..., 0], shape


def correlate_windows(grey1: Grey, pulled: FloatImage, corners: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Displacement of image 2, resampled onto the grid of image 1, around each corner (n, 2) px of `grey1`.

    pulled : (h, w) float32, the pixel of image 2 expected at every pixel of `grey1`; NaN where there is none.

    Returns the displacement (n, 2) px: what `grey1` shows at a corner, `pulled` shows at corner + displacement; the
    correlation (n,) of the two blocks, -1 where there is none; and (n,) whether the displacement is reliable: it is
    then at most SEARCH_PX along either axis.
    """
    hidden = ~np.isfinite(pulled)
    image1, image2 = grey1.astype(np.float32), np.where(hidden, 0, pulled).astype(np.float32)
    start = upright(corners + _whole_pixel_shift(image1, image2, corners))
    found, correlation = least_squares_match(image1, image2, corners, start, affine=False)
    correlation[found.sample(hidden.astype(np.float32), RADIUS_PX).any(1)] = -1.0
    displacement = found.centre - corners
    ok = (correlation > MIN_CORRELATION) & (np.abs(displacement) <= SEARCH_PX).all(1)
    return displacement, correlation, np.asarray(ok)


def _whole_pixel_shift(image1: FloatImage, image2: FloatImage, corners: FloatArray) -> FloatArray:
    """The shift (n, 2) of highest correlation, whole pixels up to SEARCH_PX."""
    template = normalised(upright(corners).sample(image1, RADIUS_PX))
    side, searched = 2 * RADIUS_PX + 1, RADIUS_PX + SEARCH_PX
    block = upright(corners).sample(image2, searched).reshape(-1, 2 * searched + 1, 2 * searched + 1)
    shifts = _offsets(SEARCH_PX)
    first = (shifts + SEARCH_PX).astype(int)
    shifted = (block[:, y : y + side, x : x + side].reshape(template.shape) for x, y in first)
    score = [(template * normalised(values)).sum(1) for values in shifted]
    return np.asarray(shifts[np.argmax(score, axis=0)])
