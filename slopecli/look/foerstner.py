"""The paper's own features (section IV): Förstner corners matched by correlation, made sub-pixel by least squares.

Sources: Förstner and Gülch, "A fast operator for detection and precise location of distinct points, corners and
centres of circular features", Interlaken 1987; Gruen, "Adaptive least squares correlation", 1985, in the inverse
compositional form of Baker and Matthews, "Lucas-Kanade 20 years on", IJCV 56(3), 2004.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np

from slopecli.look.features import Grey, match_descriptors, shrink, to_full
from slopecli.look.noise import NOISE_GREY
from slopecli.look.warp import FloatImage, Layer, image_gradient
from slopecli.types import BoolArray, FloatArray, IntArray

GradientProducts = tuple[FloatImage, FloatImage, FloatImage]  # gx gx, gx gy, gy gy, (h, w) each, grey^2/px^2

# Corners
GRADIENT_SIGMA_PX = 0.7  # just enough that single noisy pixels make no edges
WINDOW_SIGMA_PX = 1.5  # of the structure tensor: what one corner is made of
WINDOW_RADIUS_PX = 6  # where that Gaussian has faded
CORNER_ITERATIONS, MAX_OFFSET_PX = 4, 2.5  # from the maximum of w to where the edges meet, inside the window
MIN_ROUNDNESS = 0.3  # 0 is a straight edge, along which nothing can be located; 1 is alike in all directions
MIN_PRECISION_PX = 2 / 3  # a corner that noise of the grey values moves by more than this is no corner
QUOTA_CELLS = 8  # the image is divided in 8 x 8, and each cell has its share of the corners first

# Matching, on shrunken images
COARSE_PIXELS = 0.25e6  # a patch then shows 34 px of a megapixel image, enough to tell it from the others
COARSE_RADIUS_PX = 8
N_CORNERS = 2000
CORNER_DISTANCE_PX = 4.0
RATIO = 0.85  # of the distances of best and second-best patch
LIKELY_SCALES, LIKELY_TURNS_DEG = (1.0, 0.8, 1.25), (0, -12, 12)  # correlation bears half the way to the next
ALL_SCALES, ALL_TURNS_DEG = (1.0, 0.8, 1.25, 0.625, 1.6), range(-168, 169, 24)
N_TRIAL = 300  # of the strongest corners decide on scale and turn
LIKELY_SHARE = 0.15  # of them at least find a partner if scale and turn are about right

# Sub-pixel matching
FINE_RADIUS_PX = 8
MAX_ITERATIONS = 10
SETTLED_PX = 0.03  # OpenCV 4 samples images at 32nds of a pixel: steps below that do not end there
EXACT = cv2.INTER_LANCZOS4  # for the last step: OpenCV's bicubic shifts smooth images by up to 0.05 px, this by 0.01
MAX_STEP_PX = 1.5  # the image is linear no further
MAX_DRIFT_PX = 3.0  # from where a patch began
MAX_STRETCH = 2.0  # in any direction; beyond, the patch has wandered off
MIN_CORRELATION = 0.8
SEARCH_PX = 3  # of `correlate_windows`


def match_foerstner(grey1: Grey, grey2: Grey) -> tuple[FloatArray, FloatArray, tuple[int, int]]:
    """Tentative matches as pixels of the full images, (n, 2) each, few of them wrong; corners per image.

    Bears any turn about the optical axis and changes of scale to about 1.7, but no strong foreshortening.
    """
    coarse1, coarse2 = _shrunken_pair(grey1, grey2, COARSE_PIXELS)
    corners1 = foerstner_corners(coarse1.grey, N_CORNERS, CORNER_DISTANCE_PX)
    corners2 = foerstner_corners(coarse2.grey, N_CORNERS, CORNER_DISTANCE_PX)
    i, j, similarity = match_corners(coarse1.grey, corners1, coarse2.grey, corners2)
    uv1 = to_full(corners1[i], coarse1.scale)
    start = similar(to_full(corners2[j], coarse2.scale), similarity)
    return (*refine_matches(grey1, grey2, uv1, start), (len(corners1), len(corners2)))


def foerstner_corners(grey: Grey, n_features: int, min_distance: float) -> FloatArray:
    """Corners of an image, strongest first, spread over it.

    Source: Förstner and Gülch 1987.

    Parameters
    ----------
    grey : (h, w) uint8 image.
    n_features : the most to return.
    min_distance : px, between maxima of w along either axis; the corner itself may lie up to MAX_OFFSET_PX off.

    Returns
    -------
    corners : (n, 2) px, pixel centres at integers; empty where there is no texture.
    """
    w, q = interest(products := gradient_products(grey))
    good = _maxima(w, min_distance) & (q > MIN_ROUNDNESS) & (w > (NOISE_GREY / MIN_PRECISION_PX) ** 2)
    margin = WINDOW_RADIUS_PX
    row, column = (index + margin for index in np.nonzero(good[margin:-margin, margin:-margin]))
    cell = row * QUOTA_CELLS // w.shape[0] * QUOTA_CELLS + column * QUOTA_CELLS // w.shape[1]
    chosen = _strongest_of_cells(cell, w[row, column], n_features)
    at = np.stack([column, row], -1)[chosen]
    return np.asarray(at + _edge_intersection(products, at), float)


def gradient_products(grey: Grey) -> GradientProducts:
    """The structure tensor of every single pixel, before it is summed over a window."""
    smooth = np.asarray(cv2.GaussianBlur(grey.astype(np.float32), (0, 0), GRADIENT_SIGMA_PX), np.float32)
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
    """Largest within `min_distance` rows and columns; of equals the first, row by row."""
    side = 2 * max(1, int(np.ceil(min_distance)) - 1) + 1
    before = np.zeros((side, side), np.uint8)
    before.reshape(-1)[: side * side // 2] = 1
    return np.asarray((w >= cv2.dilate(w, np.ones((side, side), np.uint8))) & (w > cv2.dilate(w, before)))


def _strongest_of_cells(cell: IntArray, strength: FloatImage, limit: int) -> IntArray:
    """Indices of at most `limit`, strongest first: the quota of every cell, then the strongest of the rest."""
    by_cell = np.lexsort((-strength, cell))
    rank = np.empty(len(cell), int)
    rank[by_cell] = np.arange(len(cell)) - np.searchsorted(cell[by_cell], cell[by_cell])
    beyond_quota = rank >= -(-limit // QUOTA_CELLS**2)
    chosen = np.lexsort((-strength, beyond_quota))[:limit]
    return np.asarray(chosen[np.argsort(-strength[chosen], kind="stable")])


def _edge_intersection(products: GradientProducts, at: IntArray) -> FloatArray:
    """Offset (n, 2) px from pixels `at` (n, 2) to the point nearest to all edges of the window around it.

    Solves sum(g g^T) d = sum(g g^T p) over pixels p, and again with the window moved there, since it draws the point
    to its own centre. A far offset says that the edges do not meet here (a blob); the maximum of w then stays.
    """
    p = _offsets(WINDOW_RADIUS_PX)
    column, row = (at[:, None] + p.astype(int)).transpose(2, 0, 1)
    xx, xy, yy = (product[row, column] for product in products)
    system = np.stack([xx, xy, xy, yy], -1).reshape(*xx.shape, 2, 2)
    right = system @ p[..., None]
    offset = np.zeros(at.shape)
    for _ in range(CORNER_ITERATIONS):
        weight = np.exp(-((p - offset[:, None]) ** 2).sum(2) / (2 * WINDOW_SIGMA_PX**2))
        normal = np.einsum("nk,nkij->nij", weight, system)
        offset = np.linalg.solve(normal, np.einsum("nk,nkij->nij", weight, right))[..., 0]
        offset = np.clip(offset, -MAX_OFFSET_PX, MAX_OFFSET_PX)
    return np.where(np.abs(offset).max(1, keepdims=True) < MAX_OFFSET_PX, offset, 0.0)


@dataclass(frozen=True, eq=False)
class Patches:
    """Patches of an image: pixel d of patch k lies at `centre[k] + shape[k] d`; centre (n, 2) px, shape (n, 2, 2)."""

    centre: FloatArray
    shape: FloatArray

    def sample(self, image: FloatImage, radius: int, interpolation: int = cv2.INTER_LINEAR) -> FloatImage:
        """Grey values (n, (2 radius + 1)^2); beyond the border it repeats."""
        at = (self.centre[:, None] + _offsets(radius) @ self.shape.transpose(0, 2, 1)).astype(np.float32)
        if at.size == 0:
            return np.empty(at.shape[:2], np.float32)
        values = cv2.remap(image, at[..., 0], at[..., 1], interpolation, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(values, np.float32)

    def inside(self, image: FloatImage, radius: int) -> BoolArray:
        """(n,) whether the image holds the whole patch."""
        reach = radius * np.abs(self.shape).sum(2)
        last = np.array([image.shape[1], image.shape[0]]) - 1
        return np.asarray(((self.centre >= reach) & (self.centre + reach <= last)).all(1))


def similar(centre: FloatArray, shape: FloatArray) -> Patches:
    """Patches around points (n, 2) px, all of one shape (2, 2)."""
    return Patches(np.asarray(centre, float), np.broadcast_to(shape, (len(centre), 2, 2)))


def upright(centre: FloatArray) -> Patches:
    """Patches around points (n, 2) px, along the axes of the image."""
    return similar(centre, np.eye(2))


def _offsets(radius: int) -> FloatArray:
    y, x = np.mgrid[-radius : radius + 1, -radius : radius + 1]
    return np.stack([x, y], -1).reshape(-1, 2).astype(float)


def normalised(values: FloatImage) -> FloatImage:
    """Rows less their mean and of unit length, so that dot products are correlations; flat rows become zero."""
    centred = values - values.mean(1, keepdims=True)
    length = np.linalg.norm(centred, axis=1, keepdims=True)
    return np.asarray(np.where(length > 1e-2, centred / np.maximum(length, 1e-2), 0), np.float32)


def match_corners(
    grey1: Grey, corners1: FloatArray, grey2: Grey, corners2: FloatArray
) -> tuple[IntArray, IntArray, FloatArray]:
    """Index pairs of corners whose patches correlate best, and the similarity (2, 2) at which most of them do."""
    image1, image2 = grey1.astype(np.float32), grey2.astype(np.float32)
    patches1 = normalised(upright(corners1).sample(image1, COARSE_RADIUS_PX))

    def pairs(similarity: FloatArray, n_first: int) -> tuple[IntArray, IntArray]:
        patches2 = normalised(similar(corners2, similarity).sample(image2, COARSE_RADIUS_PX))
        return match_descriptors(patches1[:n_first], patches2, RATIO)

    def support(similarity: FloatArray) -> int:
        return len(pairs(similarity, N_TRIAL)[0])

    best = max(_similarities(LIKELY_SCALES, LIKELY_TURNS_DEG), key=support)
    if support(best) < LIKELY_SHARE * min(len(corners1), N_TRIAL):
        best = max([best, *_similarities(ALL_SCALES, ALL_TURNS_DEG)], key=support)
    return (*pairs(best, len(corners1)), best)


def _similarities(scales: Iterable[float], turns_deg: Iterable[float]) -> list[FloatArray]:
    turns = np.radians(list(turns_deg))
    return [s * np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]]) for s in scales for a in turns]


def _shrunken_pair(grey1: Grey, grey2: Grey, max_pixels: float) -> tuple[Layer, Layer]:
    """Both images shrunk alike, so that their scales still compare, the larger to `max_pixels`."""
    share = max_pixels / max(grey1.size, grey2.size)
    return Layer(*shrink(grey1, share * grey1.size)), Layer(*shrink(grey2, share * grey2.size))


def refine_matches(grey1: Grey, grey2: Grey, uv1: FloatArray, start: Patches) -> tuple[FloatArray, FloatArray]:
    """Sub-pixel matches, (n, 2) px each, from shrunken images on to the full ones; the doubtful are left out."""
    full = max(grey1.size, grey2.size)
    halvings = max(0, round(np.log(full / COARSE_PIXELS) / np.log(4)))
    for level in range(halvings, -1, -1):
        uv1, start = _refine_on(*_shrunken_pair(grey1, grey2, full / 4**level), uv1, start)
    return uv1, start.centre


def _refine_on(layer1: Layer, layer2: Layer, uv1: FloatArray, start: Patches) -> tuple[FloatArray, Patches]:
    points1 = (uv1 + 0.5) * layer1.scale - 0.5
    began = Patches((start.centre + 0.5) * layer2.scale - 0.5, start.shape)
    image1, image2 = layer1.grey.astype(np.float32), layer2.grey.astype(np.float32)
    found, correlation = least_squares_match(image1, image2, points1, began, affine=True)
    drift = np.linalg.norm(found.centre - began.centre, axis=1)
    stretch = np.linalg.svd(found.shape, compute_uv=False)
    sound = (drift < MAX_DRIFT_PX) & (stretch[:, 0] < MAX_STRETCH) & (stretch[:, 1] > 1 / MAX_STRETCH)
    keep = sound & (correlation > MIN_CORRELATION)
    return uv1[keep], Patches(to_full(found.centre[keep], layer2.scale), found.shape[keep])


def least_squares_match(
    image1: FloatImage, image2: FloatImage, points1: FloatArray, start: Patches, affine: bool
) -> tuple[Patches, FloatArray]:
    """Move, and with `affine` also shear, patches of image 2 until they look like those around points of image 1.

    Source: Gruen 1985, inverse compositional. Gain and offset of the grey values are part of every step.

    Parameters
    ----------
    points1 : (n, 2) px of image 1.
    start : n patches of image 2, at most some 2 px off.

    Returns
    -------
    found : n patches of image 2.
    correlation : (n,), -1 where a patch left its image or did not come to rest.
    """
    template = upright(points1)
    unit, solver = _linearise(template.sample(image1, FINE_RADIUS_PX, EXACT), affine)
    centre, shape = start.centre.copy(), start.shape.copy()
    moving = np.arange(len(points1))
    for _ in range(MAX_ITERATIONS):
        seen = Patches(centre[moving], shape[moving]).sample(image2, FINE_RADIUS_PX)
        step = _step(seen, unit[moving], solver[moving])
        centre[moving], shape[moving] = _compose(centre[moving], shape[moving], step)
        moving = moving[np.linalg.norm(step[:, :2], axis=1) > SETTLED_PX]
    step = _step(Patches(centre, shape).sample(image2, FINE_RADIUS_PX, EXACT), unit, solver)
    found = Patches(*_compose(centre, shape, step))
    correlation = (unit * normalised(found.sample(image2, FINE_RADIUS_PX, EXACT))).sum(1)
    good = template.inside(image1, FINE_RADIUS_PX) & found.inside(image2, FINE_RADIUS_PX)
    good[moving] = False
    return found, np.where(good, correlation, -1.0).astype(float)


def _linearise(template: FloatImage, affine: bool) -> tuple[FloatImage, FloatImage]:
    """The normalised template (n, k) and the matrices (n, p, k) that turn grey values over their gain into steps.

    The Jacobian is made orthogonal to a constant and to the template, so that offset and gain of image 2 drop out.
    """
    side = 2 * FINE_RADIUS_PX + 1
    gy, gx = (g.reshape(template.shape) for g in np.gradient(template.reshape(-1, side, side), axis=(1, 2)))
    x, y = _offsets(FINE_RADIUS_PX).astype(np.float32).T
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
    """Warp of the template (n, p) that would make it look like `seen`; no pixel of it by more than MAX_STEP_PX."""
    gain = np.maximum((unit * seen).sum(1), 1.0)  # times the template's contrast
    step = (solver @ seen[..., None])[..., 0] / gain[:, None]
    reach = np.linalg.norm(step[:, :2], axis=1) + FINE_RADIUS_PX * np.abs(step[:, 2:]).sum(1)
    return np.asarray(step * np.minimum(1, MAX_STEP_PX / np.maximum(reach, 1e-9))[:, None], float)


def _compose(centre: FloatArray, shape: FloatArray, step: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The patch after the inverse of the template's warp (tx, ty) or (tx, ty, dxx, dxy, dyx, dyy)."""
    if step.shape[1] == 6:
        shape = shape @ np.linalg.inv(np.eye(2) + step[:, 2:].reshape(-1, 2, 2))
    return centre - (shape @ step[:, :2, None])[..., 0], shape


def correlate_windows(grey1: Grey, pulled: FloatImage, corners: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray]:
    """How far image 2, resampled onto the grid of image 1, is off around each corner.

    Parameters
    ----------
    grey1 : (h, w) uint8, image 1 or a window of it.
    pulled : (h, w) float32, the pixel of image 2 expected at every pixel of `grey1`; NaN where there is none.
    corners : (n, 2) px of `grey1`.

    Returns
    -------
    displacement : (n, 2) px; what `grey1` shows at a corner, `pulled` shows at corner + displacement.
    correlation : (n,) of the two patches, -1 where there is none.
    ok : (n,) whether the displacement can be believed; it is then at most SEARCH_PX along either axis.
    """
    hidden = ~np.isfinite(pulled)
    image1, image2 = grey1.astype(np.float32), np.where(hidden, 0, pulled).astype(np.float32)
    start = upright(corners + _whole_pixel_shift(image1, image2, corners))
    found, correlation = least_squares_match(image1, image2, corners, start, affine=False)
    correlation[found.sample(hidden.astype(np.float32), FINE_RADIUS_PX).any(1)] = -1.0
    displacement = found.centre - corners
    ok = (correlation > MIN_CORRELATION) & (np.abs(displacement) <= SEARCH_PX).all(1)
    return displacement, correlation, np.asarray(ok)


def _whole_pixel_shift(image1: FloatImage, image2: FloatImage, corners: FloatArray) -> FloatArray:
    """The shift (n, 2), whole pixels up to SEARCH_PX, of the highest correlation."""
    template = normalised(upright(corners).sample(image1, FINE_RADIUS_PX))
    side, searched = 2 * FINE_RADIUS_PX + 1, FINE_RADIUS_PX + SEARCH_PX
    block = upright(corners).sample(image2, searched).reshape(-1, 2 * searched + 1, 2 * searched + 1)
    shifts = _offsets(SEARCH_PX)
    first = (shifts + SEARCH_PX).astype(int)
    patches = (block[:, y : y + side, x : x + side].reshape(template.shape) for x, y in first)
    score = [(template * normalised(patch)).sum(1) for patch in patches]
    return np.asarray(shifts[np.argmax(score, axis=0)])
