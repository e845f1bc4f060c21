"""How much of the reference's fine detail a frame shows: what blur takes away, and noise, light and zoom do not."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from slopecli.geometry.statistics import median
from slopecli.look.features import Grey
from slopecli.sequence.tracking_tunables import TRACKING
from slopecli.types import FloatArray


def detail_shown(
    reference: Grey, pulled: Grey, places: NDArray[np.float32], uv: FloatArray, found: FloatArray
) -> FloatArray:
    """(4,) contrast of fine detail in a frame over that in the reference: along x, along y, along both diagonals.

    pulled : the frame, resampled at places (2, h, w) px to look like the reference, and as bright.  uv (n, 2) : points
    of the reference, whole px; found (n, 2) : the same points in `pulled`. One for a frame as sharp as the reference,
    also where its noise is another, or where the points are not quite found. Ones where there are no points.
    """
    some = slice(None, None, max(2 * len(uv) // TRACKING.coarse_points, 1))
    uv, found = uv[some], found[some]
    if not len(uv):
        return np.ones(4)
    between, size = _sampling(places, uv)
    # where the frame shows the ground smaller, as from aside, it lacks detail without blur
    large = size >= median(size)
    # between pixels the reference is interpolated as the frame is: that takes detail, too
    one = _patches(reference, (uv + between)[large], cv2.INTER_LINEAR)
    other = _patches(pulled, (found + between)[large], cv2.INTER_CUBIC)
    steps = ((0, 2), (2, 0), (2, 2), (2, -2))  # px: detail of about four px, finer is noise and interpolation
    return np.array([_share(_difference(one, *step), _difference(other, *step)) for step in steps])


def _sampling(places: NDArray[np.float32], uv: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Fractional parts (n, 2) of the px of the frame where it shows points, and its px^2 to one of the reference (n,).

    The latter are up to a constant factor, the same for all.
    """
    u, v = uv.astype(np.int64).T
    reach = TRACKING.lk_px // 2
    here = places[:, v, u]
    right, below = places[:, v, u + reach] - here, places[:, v + reach, u] - here
    return np.asarray(here.T % 1.0, float), np.asarray(np.abs(right[0] * below[1] - right[1] * below[0]), float)


def _patches(grey: Grey, uv: FloatArray, interpolation: int) -> FloatArray:
    """(side, side, n) grey values of squares around places (n, 2), px, as large as windows of alignment."""
    side = np.arange(TRACKING.lk_px) - TRACKING.lk_px // 2
    v, u = np.broadcast_arrays(uv[:, 1] + side[:, None, None], uv[:, 0] + side[None, :, None])
    map1, map2 = (np.ascontiguousarray(part.reshape(len(side), -1), np.float32) for part in (u, v))
    values = cv2.remap(grey, map1, map2, interpolation, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(values, float).reshape(len(side), len(side), -1)


def _difference(patches: FloatArray, down: int, right: int) -> FloatArray:
    """Differences of grey values so many rows and columns apart."""
    rows, columns = patches.shape[0] - down, patches.shape[1] - abs(right)
    start, end = max(-right, 0), max(right, 0)
    return patches[down:, end : end + columns] - patches[:rows, start : start + columns]


def _share(one: FloatArray, other: FloatArray) -> float:
    """Contrast of the signal in `other` over that in `one`, both with independent noise of the same variance.

    With b this ratio, and s the share of signal in the variance of `one`, the covariance is b s and the variance of
    `other` b^2 s + 1 - s, both over the variance of `one`. Without s: c b^2 + (1 - v) b - c = 0, c and v being these.
    """
    variance = max(float(np.vdot(one, one)), 1e-9)
    common, less = float(np.vdot(one, other)) / variance, 1.0 - float(np.vdot(other, other)) / variance
    if common <= 0.0:
        return 1.0  # nothing in common, which is not blur
    return float(np.hypot(less, 2.0 * common) - less) / (2.0 * common)
