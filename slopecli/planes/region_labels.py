"""Which plane every block of pixels lies on: transfer error, smoothness, and borders where the image has edges."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from slopecli.types import FloatArray
from slopecli.vision.comparison import Comparison
from slopecli.vision.segmentation import Labels
from slopecli.vision.warp import FloatImage

UNEXPLAINED = 3.5  # cost of a pixel on no plane, variances: a plane explains it if it is off by less than 1.9 sigmas
BORDER = 3.0  # cost per px of a border between two planes amid a surface
BORDER_AT_EDGE = 0.1  # share of that where the image has a strong edge
SWEEPS = 3  # over the image in each direction; further ones change hardly a block


@dataclass(frozen=True, eq=False)
class BorderCost:
    """Cost (h, w) of a border between every pixel and the one to its left, and the one above it."""

    left: FloatImage
    above: FloatImage

    @classmethod
    def along_edges(cls, gradient: FloatImage, threshold: float) -> BorderCost:
        """Borders are cheap where the smooth gradient exceeds the threshold that ends a surface."""
        flat = np.exp(-((gradient / np.float32(threshold)) ** 2))
        cost = (BORDER * (BORDER_AT_EDGE + (1 - BORDER_AT_EDGE) * flat)).astype(np.float32)
        return cls(np.minimum(cost, np.roll(cost, 1, 1)), np.minimum(cost, np.roll(cost, 1, 0)))

    def of_blocks(self, side: int) -> BorderCost:
        """The same between blocks of `side` px: the cheapest way across, for the whole length of the border."""
        if side == 1:
            return self
        h, w = self.left.shape[0] // side, self.left.shape[1] // side
        cut = lambda cost: cost[: h * side, : w * side].reshape(h, side, w, side)  # noqa: E731
        return BorderCost(cut(self.left).min(3).sum(1), cut(self.above).min(1).sum(2))


def label_blocks(
    comparison: Comparison, planes: Sequence[FloatArray], borders: BorderCost, side: int, step: int = 1
) -> Labels:
    """(h // side, w // side) number of the plane each block of `side` px lies on, 1..k, 0 for none.

    step : of a block's pixels every so many are compared, along rows and columns; it divides `side`.
    """
    height, width = (n // side * side for n in comparison.shape)
    size = (width // side, height // side)
    cost = np.empty((size[1], size[0], len(planes) + 1), np.float32)
    cost[..., 0] = UNEXPLAINED * side**2
    for number, normal in enumerate(planes, 1):
        compared = comparison.cost(normal, step)[: height // step, : width // step]
        cost[..., number] = cv2.resize(compared, size, interpolation=cv2.INTER_AREA)
        cost[..., number] *= side**2
    return cheapest_labels(cost, borders.of_blocks(side))


def cheapest_labels(cost: FloatImage, borders: BorderCost) -> Labels:
    """(h, w) labels of least cost plus border cost, approximately: min-sum belief propagation in sweeps.

    Source: Potts model; sweeps after Tappen and Freeman (2003), messages after Felzenszwalb and Huttenlocher (2006).

    Parameters
    ----------
    cost : (h, w, k) of every label at every place.
    """
    from_left, from_right, from_above, from_below = (np.zeros_like(cost) for _ in range(4))
    height, width = cost.shape[:2]
    for _ in range(SWEEPS):
        for y in range(1, height):
            belief = cost[y - 1] + from_left[y - 1] + from_right[y - 1] + from_above[y - 1]
            from_above[y] = _message(belief, borders.above[y])
        for y in range(height - 2, -1, -1):
            belief = cost[y + 1] + from_left[y + 1] + from_right[y + 1] + from_below[y + 1]
            from_below[y] = _message(belief, borders.above[y + 1])
        for x in range(1, width):
            belief = cost[:, x - 1] + from_above[:, x - 1] + from_below[:, x - 1] + from_left[:, x - 1]
            from_left[:, x] = _message(belief, borders.left[:, x])
        for x in range(width - 2, -1, -1):
            belief = cost[:, x + 1] + from_above[:, x + 1] + from_below[:, x + 1] + from_right[:, x + 1]
            from_right[:, x] = _message(belief, borders.left[:, x + 1])
    total = cost + from_left + from_right + from_above + from_below
    return np.asarray(total.argmin(2), np.int32)


def _message(belief: FloatImage, border: FloatImage) -> FloatImage:
    """What a row of places (n, k) tells its neighbours: no label costs them more than a border to the best one."""
    return np.asarray(np.minimum(belief - belief.min(1, keepdims=True), border[:, None]))


def enlarged(labels: Labels, side: int, shape: tuple[int, int]) -> Labels:
    """Labels of blocks as labels of pixels (h, w); the rest at right and bottom as the last block."""
    full = labels.repeat(side, 0).repeat(side, 1)
    return np.pad(full, ((0, shape[0] - full.shape[0]), (0, shape[1] - full.shape[1])), mode="edge")
