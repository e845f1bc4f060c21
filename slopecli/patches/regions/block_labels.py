"""Which plane every block of pixels lies on: transfer error, smoothness, and borders where the image has edges."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from slopecli.look.gradient_components import Labels
from slopecli.look.transfer_error import OUTSIDE, Box, Comparison
from slopecli.look.warp import NODE_STEP, FloatImage
from slopecli.types import FloatArray

UNEXPLAINED = 3.5  # cost of a pixel on no plane, variances: a plane explains it if it is off by less than 1.9 sigmas
BORDER = 3.0  # cost per px of a border between two planes amid a surface
BORDER_AT_EDGE = 0.1  # share of that where the image has a strong edge
BESIDE = 48  # working px beside what a plane has won in which it may win more
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
    comparison: Comparison,
    planes: Sequence[FloatArray],
    borders: BorderCost,
    side: int,
    step: int = 1,
    boxes: Sequence[Box] | None = None,
) -> Labels:
    """(h // side, w // side) number of the plane each block of `side` px lies on, 1..k, 0 for none.

    step : of a block's pixels every so many are compared, along rows and columns; it divides `side`.
    boxes : where each plane may lie, see `surroundings`; anywhere when None.
    """
    height, width = (n // side * side for n in comparison.shape)
    cost = np.full((height // side, width // side, len(planes) + 1), OUTSIDE * side**2, np.float32)
    cost[..., 0] = UNEXPLAINED * side**2
    for number, normal in enumerate(planes, 1):
        rows, columns = boxes[number - 1] if boxes else comparison.everywhere
        inside = slice(rows.start, min(rows.stop, height)), slice(columns.start, min(columns.stop, width))
        compared = comparison.cost(normal, step, inside)
        size = (compared.shape[1] * step // side, compared.shape[0] * step // side)
        blocks = cv2.resize(compared, size, interpolation=cv2.INTER_AREA)
        top, left = rows.start // side, columns.start // side
        cost[top : top + size[1], left : left + size[0], number] = blocks * np.float32(side**2)
    return cheapest_labels(cost, borders.of_blocks(side))


def surroundings(labels: Labels, count: int) -> list[Box]:
    """For labels 1..count: the rectangle each plane is sought in next, around the pixels (h, w) it has now."""
    boxes = []
    for number in range(1, count + 1):
        x, y, w, h = cv2.boundingRect((labels == number).astype(np.uint8))
        boxes.append((_widened(y, y + h, labels.shape[0]), _widened(x, x + w, labels.shape[1])))
    return boxes


def _widened(start: int, stop: int, end: int) -> slice:
    """Rows or columns and some beside them, from a node of the map to a node or to the end of the image."""
    return slice(
        max(0, start - BESIDE) // NODE_STEP * NODE_STEP, min(end, -(-(stop + BESIDE) // NODE_STEP) * NODE_STEP)
    )


def cheapest_labels(cost: FloatImage, borders: BorderCost) -> Labels:
    """(h, w) labels of least cost plus border cost, approximately: min-sum belief propagation in sweeps.

    Source: Potts model; sweeps after Tappen and Freeman (2003), messages after Felzenszwalb and Huttenlocher (2006).

    Parameters
    ----------
    cost : (h, w, k) of every label at every place.
    """
    down, up, right, left = (np.zeros(cost.shape, np.float32) for _ in range(4))  # messages, where they arrive
    height, width = cost.shape[:2]
    for _ in range(SWEEPS):
        across = cost + right + left
        for y in range(1, height):
            _send(across[y - 1], down[y - 1], borders.above[y], down[y])
        for y in range(height - 2, -1, -1):
            _send(across[y + 1], up[y + 1], borders.above[y + 1], up[y])
        along = np.add(cost, down, out=across)
        along += up
        for x in range(1, width):
            _send(along[:, x - 1], right[:, x - 1], borders.left[:, x], right[:, x])
        for x in range(width - 2, -1, -1):
            _send(along[:, x + 1], left[:, x + 1], borders.left[:, x + 1], left[:, x])
    along += right
    along += left
    return np.asarray(along.argmin(2), np.int32)


def _send(here: FloatImage, arrived: FloatImage, border: FloatImage, message: FloatImage) -> None:
    """What a line of places (n, k) tells its neighbours: no label costs them more than a border to the best one.

    here : cost and what comes from both sides.  arrived : from the line before it.  message : where the result goes.
    """
    belief = here + arrived
    belief -= belief.min(1, keepdims=True)
    np.minimum(belief, border[:, None], out=message)


def enlarged(labels: Labels, side: int, shape: tuple[int, int]) -> Labels:
    """Labels of blocks as labels of pixels (h, w); the rest at right and bottom as the last block."""
    full = labels.repeat(side, 0).repeat(side, 1)
    return np.pad(full, ((0, shape[0] - full.shape[0]), (0, shape[1] - full.shape[1])), mode="edge")
