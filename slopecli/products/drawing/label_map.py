"""Operations on label maps and masks: bounding boxes, outlines, largest piece, distance to the border."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from slopecli.types import FloatArray

Mask = NDArray[np.uint8]
Box = tuple[slice, slice]  # rows and columns


def boxes_of(labels: NDArray[np.generic]) -> dict[int, Box]:
    """Return the bounding box of every id in a label map (h, w), 0 left out, in the order of the ids."""
    flat = labels.ravel()
    order = np.argsort(flat, kind="stable")  # pixels of one id lie together, in reading order
    ids, rows, columns = flat[order], *np.divmod(order, labels.shape[1])
    starts = np.flatnonzero(np.r_[True, ids[1:] != ids[:-1]])
    lefts, rights = np.minimum.reduceat(columns, starts), np.maximum.reduceat(columns, starts)
    ends = np.r_[starts[1:], len(flat)] - 1
    sides = np.column_stack([ids[starts], rows[starts], rows[ends] + 1, lefts, rights + 1]).tolist()
    return {i: (slice(top, bottom), slice(left, right)) for i, top, bottom, left, right in sides if i != 0}


def mask_of(labels: NDArray[np.generic], label: int) -> Mask:
    """Return (h, w) uint8, 255 where the map has this id."""
    return np.multiply(labels == label, 255, dtype=np.uint8)


def largest_piece(mask: Mask) -> Mask:
    """Return the mask of the largest piece (8-connected) of a mask (h, w); empty if it is."""
    count, pieces, stats, _ = cv2.connectedComponentsWithStats(mask)
    if count < 2:
        return np.zeros_like(mask)
    return mask_of(pieces, 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA])))


def inner_distance(mask: Mask) -> NDArray[np.float32]:
    """Return (h, w) distance from every pixel of a mask to the nearest one outside it, or beyond its sides, px."""
    return np.asarray(cv2.distanceTransform(np.pad(mask, 1), cv2.DIST_L2, cv2.DIST_MASK_PRECISE), np.float32)[
        1:-1, 1:-1
    ]


def outlines_of(mask: Mask, step: float = 1.0) -> list[FloatArray]:
    """Trace a mask (h, w): one closed outline (k, 2) px per piece, largest first, then one per hole.

    They run along the centres of the outermost pixels, with staircases straightened, whose steps are `step` px high.
    """
    contours, hierarchy = cv2.findContours(mask, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    if hierarchy is None:
        return []
    hole = hierarchy.reshape(-1, 4)[:, 3] >= 0
    tolerance = 0.7 * step  # steps of one pixel become the line they stand for
    order = sorted(range(len(contours)), key=lambda i: (bool(hole[i]), -cv2.contourArea(contours[i])))
    return [cv2.approxPolyDP(contours[i], tolerance, True).reshape(-1, 2).astype(float) for i in order]
