"""Cells labelled by plane: depth and transfer error, plus the cost of borders, low along edges of the image."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from slopecli.look.gradient_components import Labels, grown
from slopecli.look.transfer_error import OUTSIDE, Comparison
from slopecli.look.warp import NODE_STEP, Box, FloatImage
from slopecli.patches.regions.cell_lattice import CellLattice, component_of_cells
from slopecli.patches.regions.plane_pieces import Piece, around
from slopecli.patches.regions.region_tunables import REGION
from slopecli.types import BoolArray, FloatArray


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


def label_cells(
    comparison: Comparison, lattice: CellLattice, pieces: Sequence[Piece], borders: BorderCost, components: Labels
) -> tuple[Labels, Labels]:
    """Return the (h, w) number of the piece on whose plane each cell lies, 1..k, 0 for none; and of cells apart.

    A cell costs by its depth, where it has one, and by the transfer error of its pixels. Cells without a match count
    to a piece only where its matched cells are around them, or near in the same component; or, apart (h, w) from these,
    where their texture bears the plane out, such as slats along the epipolar lines, which tell no depth.

    components : (h, w) working px, 1..k: the insides of surfaces.
    """
    none = REGION.unexplained * REGION.pixels
    cost = np.full((*lattice.shape, len(pieces) + 1), OUTSIDE * REGION.pixels + lattice.unexplained, np.float32)
    cost[..., 0] = np.where(lattice.known, lattice.unexplained, 0.0) + none
    for number, piece in enumerate(pieces, 1):
        near = grown(piece.cells.astype(np.int32), REGION.beside_cells) > 0
        box = _box(near)
        depth = np.where(lattice.known, lattice.cost(lattice.off(piece.plane), piece.tolerance), 0.0)[box]
        pixels = _transfer_cost(comparison, piece.plane, box)
        if piece.tolerance > 1.0:  # relief displaces the pixels of the surface, too
            pixels = np.minimum(pixels, REGION.unexplained)
        layer = cost[(*box, number)]
        layer[near[box]] = (depth + REGION.pixels * pixels)[near[box]]
    labels = cheapest_labels(cost, borders.of_blocks(REGION.cell_px))
    inside = component_of_cells(components, lattice.shape)
    borne_out, apart = _borne_out(comparison, lattice, cost, labels), np.zeros(lattice.shape, np.int32)
    for number, piece in enumerate(pieces, 1):
        own = labels == number
        matched = own & lattice.on_plane(piece.plane, piece.tolerance)
        matched &= around(matched) >= REGION.dense_cells
        count, total = (np.bincount(inside[mask], minlength=components.max() + 1) for mask in (matched, inside > 0))
        held = (count >= REGION.held * np.maximum(total, 1))[inside] & (inside > 0)
        among = _among(matched)
        beyond = own & ~among & ~_reached(matched & held, held)
        apart[beyond & _reached(among, borne_out & own)] = number
        labels[beyond] = 0
    return labels, apart


def _borne_out(comparison: Comparison, lattice: CellLattice, cost: FloatImage, labels: Labels) -> BoolArray:
    """Return the cells (h, w) without a match whose pixels would tell a px of displacement, and agree with their label.

    cost : (h, w, k) of all labels.
    """
    of_label = np.take_along_axis(cost, labels[..., None], 2)[..., 0] / REGION.pixels
    contrast = cv2.resize(comparison.contrast, lattice.shape[::-1], interpolation=cv2.INTER_AREA)
    return np.asarray(~lattice.known & (of_label < 1.0) & (contrast > 1.0))


def _box(mask: BoolArray) -> Box:
    """Return the rows and columns of the cells of a mask."""
    x, y, w, h = cv2.boundingRect(mask.astype(np.uint8))
    return slice(y, y + h), slice(x, x + w)


def _transfer_cost(comparison: Comparison, plane: FloatArray, box: Box) -> FloatImage:
    """Return the mean photometric cost (h, w) of the pixels of the cells of a box."""
    side = REGION.cell_px
    inner = [slice(part.start * side, part.stop * side) for part in box]
    wide = [
        slice(part.start // NODE_STEP * NODE_STEP, min(end, -(-part.stop // NODE_STEP) * NODE_STEP))
        for part, end in zip(inner, comparison.shape, strict=True)
    ]
    compared = comparison.cost(plane, (wide[0], wide[1]))
    rows, columns = (slice(a.start - b.start, a.stop - b.start) for a, b in zip(inner, wide, strict=True))
    size = (box[1].stop - box[1].start, box[0].stop - box[0].start)
    return np.asarray(cv2.resize(compared[rows, columns], size, interpolation=cv2.INTER_AREA), np.float32)


def _among(matched: BoolArray) -> BoolArray:
    """Return (h, w) cells between matched cells or next to one, gaps of one cell between them closed."""
    margin = 3  # so that closing does not see the border
    mask = np.pad(matched.astype(np.uint8), margin)
    closed = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, _cross())
    return np.asarray(cv2.dilate(closed, _cross())[margin:-margin, margin:-margin] > 0)


def _reached(start: BoolArray, inside: BoolArray) -> BoolArray:
    """Return the cells (h, w) at most `inside_cells` from the start through cells that are inside."""
    for _ in range(REGION.inside_cells):
        start = (cv2.dilate(start.astype(np.uint8), _cross()) > 0) & inside
    return np.asarray(start)


def _cross() -> NDArray[np.uint8]:
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3)), np.uint8)


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
