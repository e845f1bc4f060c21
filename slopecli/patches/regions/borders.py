"""Borders of labels at single pixels: cells are too coarse for them."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from slopecli.look.features import Grey
from slopecli.look.gradient_components import Labels
from slopecli.look.transfer_error import Comparison
from slopecli.look.warp import NODE_STEP
from slopecli.patches.regions.plane_pieces import Piece
from slopecli.patches.regions.region_tunables import REGION


def with_pixel_borders(labels: Labels, grey: Grey, comparison: Comparison, pieces: Sequence[Piece]) -> Labels:
    """Return labels (h, w) whose borders follow the edges of the image (h, w), half a cell off the old ones at most.

    Labels, and what is on no plane, flood the strip between them, edges of the image last (watershed). A pixel keeps
    the label that it gets there if the plane of that piece explains it.

    labels : 1..k by piece, 0 for none, in steps of cells.
    """
    side = REGION.cell_px
    square = np.ones((2 * (side // 2) + 1, 2 * (side // 2) + 1), np.uint8)
    numbered = labels.astype(np.float32) + 1.0  # 1 is no plane, and 0 is to be flooded
    inner = cv2.erode(numbered, square) == cv2.dilate(numbered, square)
    seeds = np.where(inner, labels + 1, 0).astype(np.int32)
    smooth = cv2.GaussianBlur(grey, (0, 0), 1.0)  # 1 px: noise of single pixels is no edge
    flooded = cv2.watershed(cv2.merge([smooth] * 3), seeds)
    flooded = _without_lines(np.asarray(flooded)) - 1
    changed = np.where((flooded > 0) & (flooded != labels), flooded, 0)
    for number in np.unique(changed[changed > 0]):
        new = changed == number
        x, y, w, h = cv2.boundingRect(new.astype(np.uint8))
        top, left = (max(0, at - side) // NODE_STEP * NODE_STEP for at in (y, x))
        box = slice(top, min(y + h + side, labels.shape[0])), slice(left, min(x + w + side, labels.shape[1]))
        cost = cv2.blur(comparison.cost(pieces[number - 1].plane, box), (side - 1, side - 1))
        refused = new[box] & (cost > REGION.unexplained)
        flooded[box][refused] = np.where(labels[box][refused] == 0, 0, labels[box][refused])
    return np.asarray(np.maximum(flooded, 0), np.int32)


def _without_lines(flooded: Labels) -> Labels:
    """Return the labels with the lines of -1 that a watershed leaves between them, and along the border, filled."""
    filled = cv2.dilate(flooded.astype(np.float32), np.ones((3, 3), np.uint8))
    return np.where(flooded < 0, filled, flooded).astype(np.int32)
