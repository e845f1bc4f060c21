"""Least-squares matching: sub-pixel displacement, and shear, of small image blocks between two images.

Sources: Gruen, "Adaptive least squares correlation", 1985, in the inverse compositional form of Baker and Matthews,
"Lucas-Kanade 20 years on", IJCV 56(3), 2004.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from slopecli.look.features import Grey, to_full
from slopecli.look.warp import FloatImage, Layer
from slopecli.types import BoolArray, FloatArray

RADIUS_PX = 8  # of a block: 17 x 17 px hold enough texture to be told from others, and are about planar
MIN_CORRELATION = 0.8  # of two matched blocks; less is another surface
SEARCH_PX = 3  # largest displacement that `correlate_windows` finds, along either axis
EXACT = cv2.INTER_LANCZOS4  # for the last step: OpenCV's bicubic shifts smooth images by up to 0.05 px, this by 0.01


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


def refine_on_layers(layer1: Layer, layer2: Layer, uv1: FloatArray, start: Blocks) -> tuple[FloatArray, Blocks]:
    """Least-squares matches between shrunken images, in full px; blocks that drift, stretch or disagree are dropped.

    uv1 : (n, 2) px of image 1.  start : n blocks of image 2.
    """
    points1 = (uv1 + 0.5) * layer1.scale - 0.5
    began = Blocks((start.centre + 0.5) * layer2.scale - 0.5, start.shape)
    image1, image2 = layer1.grey.astype(np.float32), layer2.grey.astype(np.float32)
    found, correlation = least_squares_match(image1, image2, points1, began, affine=True)
    drift = np.linalg.norm(found.centre - began.centre, axis=1)
    stretch = np.linalg.svd(found.shape, compute_uv=False)
    sound = (drift < 3.0) & (stretch[:, 0] < 2.0) & (stretch[:, 1] > 0.5)  # beyond, a block has left its surface
    keep = sound & (correlation > MIN_CORRELATION)
    return uv1[keep], Blocks(to_full(found.centre[keep], layer2.scale), found.shape[keep])


def least_squares_match(
    image1: FloatImage, image2: FloatImage, points1: FloatArray, start: Blocks, affine: bool
) -> tuple[Blocks, FloatArray]:
    """Move blocks of image 2, and shear them if `affine`, until they equal those around points of image 1.

    Gain and offset of the grey values are estimated in every step.

    Parameters
    ----------
    points1 : (n, 2) px of image 1.
    start : n blocks of image 2, at most about 2 px off.

    Returns
    -------
    found : n blocks of image 2.
    correlation : (n,), -1 where a block left its image or did not converge.
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
    """Displacement of image 2, resampled onto the grid of image 1, around each corner.

    Parameters
    ----------
    grey1 : (h, w) uint8, image 1 or a window of it.
    pulled : (h, w) float32, the pixel of image 2 expected at every pixel of `grey1`; NaN where there is none.
    corners : (n, 2) px of `grey1`.

    Returns
    -------
    displacement : (n, 2) px; what `grey1` shows at a corner, `pulled` shows at corner + displacement.
    correlation : (n,) of the two blocks, -1 where there is none.
    ok : (n,) whether the displacement is reliable; it is then at most SEARCH_PX along either axis.
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
