"""Image 1 divided where its brightness changes: smooth gradient, threshold, connected components.

Source: Cheng, experiment 3, steps 1-3.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from slopecli.look.features import Grey
from slopecli.look.noise import NOISE_GREY
from slopecli.look.warp import FloatImage, image_gradient

SMOOTH_PX = 1.5  # sigma: the grain of asphalt and brick is smoothed away, borders of surfaces are not
INTERIOR_SHARE = 0.6  # of all pixels lie inside surfaces where no threshold is given

Labels = NDArray[np.int32]


def smooth_gradient(grey: Grey) -> FloatImage:
    """Gradient magnitude (h, w) of the smoothed image, grey levels per px."""
    smooth = np.asarray(cv2.GaussianBlur(grey.astype(np.float32), (0, 0), SMOOTH_PX), np.float32)
    gx, gy = image_gradient(smooth)
    return np.asarray(np.hypot(gx, gy), np.float32)


def adaptive_threshold(gradient: FloatImage) -> float:
    """Gradient, grey levels per px, below which a pixel is inside a surface: that of `INTERIOR_SHARE` of the image."""
    return max(float(np.quantile(gradient, INTERIOR_SHARE)), NOISE_GREY / 4)  # noise alone reaches this


def connected_components(gradient: FloatImage, threshold: float, least_px: float) -> Labels:
    """Connected regions (h, w) below the threshold, 1 the largest; 0 above it and where they are smaller."""
    interior = (gradient < threshold).astype(np.uint8)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(interior, connectivity=4)
    size = stats[1:, cv2.CC_STAT_AREA]
    kept = 1 + np.argsort(-size, kind="stable")[: np.count_nonzero(size >= least_px)]
    number = np.zeros(count, np.int32)
    number[kept] = np.arange(1, len(kept) + 1)
    return np.asarray(number[labels], np.int32)


def resized(labels: Labels, shape: tuple[int, int]) -> Labels:
    """A label map at another size (rows, columns): every pixel takes the label under it."""
    if labels.shape == shape:
        return labels
    size = (shape[1], shape[0])
    return np.asarray(cv2.resize(labels.astype(np.uint16), size, interpolation=cv2.INTER_NEAREST), np.int32)


def grown(labels: Labels, reach_px: float) -> Labels:
    """Labels spread to unlabelled pixels at most `reach_px` away, each to the nearest."""
    if not labels.any():
        return labels
    distance, nearest = cv2.distanceTransformWithLabels(
        (labels == 0).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    of_seed = np.zeros(int(nearest.max()) + 1, np.int32)
    of_seed[nearest[labels > 0]] = labels[labels > 0]
    return np.where(distance <= reach_px, of_seed[nearest], 0).astype(np.int32)


def without_small_pieces(labels: Labels, least_px: float) -> Labels:
    """Labels without their connected pieces smaller than `least_px`, which become 0."""
    cleaned = labels.copy()
    for number in range(1, int(labels.max()) + 1):
        count, pieces, stats, _ = cv2.connectedComponentsWithStats((labels == number).astype(np.uint8), connectivity=4)
        small = np.flatnonzero(stats[:, cv2.CC_STAT_AREA] < least_px)
        if count > 1 and len(small):
            cleaned[np.isin(pieces, small[small > 0])] = 0
    return cleaned
