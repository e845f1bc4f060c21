"""Segmentation of an image by its gradient: smoothed gradient, threshold, connected components.

Source: Cheng, experiment 3, steps 1-3.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from slopecli.look.features import Grey
from slopecli.look.noise import NOISE_GREY
from slopecli.look.warp import Box, FloatImage, image_gradient
from slopecli.types import IntArray

INTERIOR_SHARE = 0.6  # of all pixels are taken to lie inside surfaces if no threshold is given

Labels = NDArray[np.int32]


def smooth_gradient(grey: Grey) -> FloatImage:
    """Gradient magnitude (h, w) of the smoothed image, grey levels per px."""
    # 1.5 px removes the grain of asphalt and brick and keeps the borders of surfaces
    smooth = np.asarray(cv2.GaussianBlur(grey.astype(np.float32), (0, 0), 1.5), np.float32)
    gx, gy = image_gradient(smooth)
    return np.asarray(np.hypot(gx, gy), np.float32)


def adaptive_threshold(gradient: FloatImage) -> float:
    """Threshold, grey levels per px: the quantile INTERIOR_SHARE of the gradient, at least what noise alone reaches."""
    return max(float(np.quantile(gradient, INTERIOR_SHARE)), NOISE_GREY / 4)


def connected_components(gradient: FloatImage, threshold: float, least_px: float) -> Labels:
    """Labels (h, w) of connected regions below the threshold, largest first from 1; 0 elsewhere and if < `least_px`."""
    interior = (gradient < threshold).astype(np.uint8)
    _, labels = cv2.connectedComponents(interior, connectivity=4)
    return renumbered_by_size(labels, least_px)[0]


def renumbered_by_size(labels: NDArray[Any], least: float = 1) -> tuple[Labels, IntArray]:
    """Return labels 0..k with 1 the most frequent; those of fewer than `least` elements become 0.

    Also returns the former labels, in the order of the new ones.
    """
    size = np.bincount(labels.ravel(), minlength=1)
    size[0] = 0
    order = np.argsort(-size, kind="stable")
    order = order[size[order] >= max(least, 1)]
    number = np.zeros(len(size), np.int32)
    number[order] = np.arange(1, len(order) + 1)
    return number[labels], order


def resized(labels: Labels, shape: tuple[int, int]) -> Labels:
    """Labels resampled to another size (rows, columns), nearest neighbour."""
    if labels.shape == shape:
        return labels
    size = (shape[1], shape[0])
    return np.asarray(cv2.resize(labels.astype(np.uint16), size, interpolation=cv2.INTER_NEAREST), np.int32)


def boxes_of(labels: NDArray[np.generic]) -> dict[int, Box]:
    """Return the bounding box of every id in a label map (h, w), 0 left out, in the order of the ids."""
    # runs of equal pixels along the rows
    row, left = np.nonzero(np.insert(labels[:, 1:] != labels[:, :-1], 0, True, axis=1))
    right = np.append(left[1:], 0)
    right[right == 0] = labels.shape[1]
    order = np.argsort(labels[row, left], kind="stable")
    ids, first = np.unique(labels[row, left][order], return_index=True)
    top, start = (np.minimum.reduceat(values[order], first) for values in (row, left))
    bottom, end = (np.maximum.reduceat(values[order], first) for values in (row + 1, right))
    boxes = zip(ids.tolist(), top.tolist(), bottom.tolist(), start.tolist(), end.tolist(), strict=True)
    return {i: (slice(a, b), slice(c, d)) for i, a, b, c, d in boxes if i > 0}


def grown(labels: Labels, reach_px: float) -> Labels:
    """Labels with each unlabelled pixel given that of the nearest labelled one, if at most `reach_px` away."""
    if not labels.any():
        return labels
    distance, nearest = cv2.distanceTransformWithLabels(
        (labels == 0).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    of_seed = np.zeros(int(nearest.max()) + 1, np.int32)
    of_seed[nearest[labels > 0]] = labels[labels > 0]
    return np.where(distance <= reach_px, of_seed[nearest], 0).astype(np.int32)


def without_small_pieces(labels: Labels, least_px: float) -> Labels:
    """Labels with connected pieces smaller than `least_px` set to 0."""
    cleaned = labels.copy()
    for number in range(1, int(labels.max()) + 1):
        count, pieces, stats, _ = cv2.connectedComponentsWithStats((labels == number).astype(np.uint8), connectivity=4)
        small = np.flatnonzero(stats[:, cv2.CC_STAT_AREA] < least_px)
        if count > 1 and len(small):
            cleaned[np.isin(pieces, small[small > 0])] = 0
    return cleaned
