"""Blocks of pixels labelled by plane: transfer error plus the cost of borders, low along edges of the image."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from slopecli.look.gradient_components import Labels
from slopecli.look.transfer_error import OUTSIDE, Box, Comparison
from slopecli.look.warp import NODE_STEP, FloatImage
from slopecli.patches.regions.region_tunables import REGION
from slopecli.types import FloatArray


@dataclass(frozen=True, eq=False)
class BorderCost:
    """Cost (h, w) of a border between every pixel and the one to its left, and the one above it."""

    left: FloatImage
    above: FloatImage

    @classmethod
    def along_edges(cls, gradient: FloatImage, threshold: float) -> BorderCost:
        """Return costs that are low where the smooth gradient (h, w) exceeds the threshold that ends a surface."""
        flat = np.exp(-((gradient / np.float32(threshold)) ** 2))
        at_edge = REGION.border_at_edge
        cost = (REGION.border * (at_edge + (1 - at_edge) * flat)).astype(np.float32)
        return cls(np.minimum(cost, np.roll(cost, 1, 1)), np.minimum(cost, np.roll(cost, 1, 0)))

    def of_blocks(self, side: int) -> BorderCost:
        """Return costs between blocks of `side` px: of the cheapest way across, for the whole length of the border."""
        height, width = (n // side for n in self.left.shape)
        left, above = (
            cost[: height * side, : width * side].reshape(height, side, width, side) for cost in (self.left, self.above)
        )
        return BorderCost(left.min(3).sum(1), above.min(1).sum(2))


def label_blocks(
    comparison: Comparison,
    planes: Sequence[FloatArray],
    borders: BorderCost,
    side: int,
    step: int = 1,
    boxes: Sequence[Box] | None = None,
) -> Labels:
    """Return the (h // side, w // side) number of the plane each block of `side` px lies on, 1..k, 0 for none.

    planes : scaled normals (3,).
    step : every so many of a block's rows and columns are compared; it divides `side`.
    boxes : the rectangle each plane may lie in, see `surroundings`; the image when None.
    """
    height, width = (n // side * side for n in comparison.shape)
    cost = np.full((height // side, width // side, len(planes) + 1), OUTSIDE * side**2, np.float32)
    cost[..., 0] = REGION.unexplained * side**2
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
    """Return the rectangle in which each of the planes 1..count is sought next, around its pixels in labels (h, w)."""
    boxes = []
    for number in range(1, count + 1):
        x, y, w, h = cv2.boundingRect((labels == number).astype(np.uint8))
        boxes.append((_widened(y, y + h, labels.shape[0]), _widened(x, x + w, labels.shape[1])))
    return boxes


def _widened(start: int, stop: int, end: int) -> slice:
    """Return rows or columns widened by `beside_px` and to nodes of the map, at most to the end of the image."""
    first, last = max(0, start - REGION.beside_px), stop + REGION.beside_px
    return slice(first // NODE_STEP * NODE_STEP, min(end, -(-last // NODE_STEP) * NODE_STEP))


def cheapest_labels(cost: FloatImage, borders: BorderCost) -> Labels:
    """Return labels (h, w) of nearly least cost, borders included, by min-sum belief propagation in sweeps.

    Source: Potts model; sweeps after Tappen and Freeman (2003), messages after Felzenszwalb and Huttenlocher (2006).

    Parameters
    ----------
    cost : (h, w, k) of every label at every block.
    """
    down, up, right, left = (np.zeros(cost.shape, np.float32) for _ in range(4))  # messages to each block
    height, width = cost.shape[:2]
    for _ in range(3):  # more sweeps change hardly a block
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
    """Write the message (n, k) of a line of blocks to the next line: no label costs more than a border to the best.

    here : cost and messages from both sides.  arrived : message from the line before.  border : (n,).
    """
    belief = here + arrived
    belief -= belief.min(1, keepdims=True)
    np.minimum(belief, border[:, None], out=message)


def enlarged(labels: Labels, side: int, shape: tuple[int, int]) -> Labels:
    """Return labels of blocks as labels of pixels (h, w); what is left at right and bottom like the last block."""
    full = labels.repeat(side, 0).repeat(side, 1)
    return np.pad(full, ((0, shape[0] - full.shape[0]), (0, shape[1] - full.shape[1])), mode="edge")
