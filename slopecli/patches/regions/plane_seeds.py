"""Planes proposed by the cells of squares of several sizes, and by those of each connected component."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from slopecli.look.gradient_components import Labels
from slopecli.look.matches import MIN_ON_PLANE
from slopecli.patches.labelling.depth_planes import solve_regular
from slopecli.patches.regions.cell_lattice import CellLattice
from slopecli.patches.regions.region_tunables import REGION
from slopecli.types import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class PlaneSeeds:
    """Planes (k, 3) of parts of the lattice, with the cost (k,) of the cells of the part on it.

    boxes (s, 4) : first and end row, first and end column of the first s parts, which are squares.
    component (h, w), numbers (k - s,) : the other parts are the components of these numbers.
    """

    planes: FloatArray
    cost: FloatArray
    boxes: IntArray
    component: Labels
    numbers: IntArray

    def __len__(self) -> int:
        return len(self.planes)

    def saving(self, current: FloatArray) -> FloatArray:
        """Return by how much (k,) each plane may lower the present costs (h, w) of the cells of its part."""
        table = np.pad(current.cumsum(0).cumsum(1), ((1, 0), (1, 0)))
        top, bottom, left, right = self.boxes.T
        squares = table[bottom, right] - table[top, right] - table[bottom, left] + table[top, left]
        components = np.bincount(self.component.ravel(), current.ravel(), self.component.max() + 1)[self.numbers]
        return np.concatenate([squares, components]) - self.cost

    def part(self, k: int) -> BoolArray:
        """Return the cells (h, w) of the part of seed k."""
        if k >= len(self.boxes):
            return np.asarray(self.component == self.numbers[k - len(self.boxes)])
        top, bottom, left, right = self.boxes[k]
        mask = np.zeros(self.component.shape, bool)
        mask[top:bottom, left:right] = True
        return mask


def plane_seeds(lattice: CellLattice, components: Labels) -> PlaneSeeds:
    """Return the planes of squares and of components (h, w) working px, 1..k, by least squares."""
    moments = _moments(lattice)
    boxes, sums = zip(*(_squares(moments, side) for side in REGION.windows), strict=True)
    box = np.concatenate(boxes)
    component = component_of_middles(components, lattice.shape)
    count = int(component.max()) + 1
    own = np.stack([np.bincount(component.ravel(), layer.ravel(), count) for layer in moments], -1)
    numbers = np.flatnonzero((own[:, -1] >= MIN_ON_PLANE) & (np.arange(count) > 0))
    planes, cost = _fitted(np.concatenate([*sums, own[numbers]]))
    return PlaneSeeds(planes, cost, box, component, numbers)


def _moments(lattice: CellLattice) -> list[FloatArray]:
    """Return layers (h, w): products of rows, of rows and target, square of the target, count."""
    x, y, z = (lattice.rows[..., k].astype(np.float64) for k in range(3))
    t = lattice.target.astype(np.float64)
    return [x * x, x * y, x * z, y * y, y * z, z * z, x * t, y * t, z * t, t * t, lattice.known.astype(np.float64)]


def _squares(moments: list[FloatArray], side: int) -> tuple[IntArray, FloatArray]:
    """Return the boxes (s, 4) of squares of `side` cells that hold enough cells, and the sums (s, 11) in them."""
    height, width = moments[0].shape
    step, half = max(1, side // 4), side // 2
    layers = [
        cv2.boxFilter(layer, -1, (side, side), normalize=False, borderType=cv2.BORDER_CONSTANT)[::step, ::step]
        for layer in moments
    ]
    row, column = np.mgrid[0:height:step, 0:width:step]
    enough = layers[-1] >= max(MIN_ON_PLANE, 0.4 * side * side)
    i, j = row[enough], column[enough]
    box = (
        np.maximum(i - half, 0),
        np.minimum(i + half + 1, height),
        np.maximum(j - half, 0),
        np.minimum(j + half + 1, width),
    )
    return np.stack(box, -1), np.stack([layer[enough] for layer in layers], -1)


def _fitted(sums: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the planes (k, 3) of sums (k, 11), and the cost (k,) of their cells, at the tolerance that fits them."""
    system = sums[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(-1, 3, 3)
    planes = solve_regular(system, sums[:, 6:9])
    squares = np.maximum(sums[:, 9] - (planes * sums[:, 6:9]).sum(1), 0.0)
    variance = np.maximum(squares / np.maximum(sums[:, 10] - 3.0, 1.0), 1.0)
    return planes, squares / variance + sums[:, 10] * np.log(variance)


def component_of_middles(components: Labels, shape: tuple[int, int]) -> Labels:
    """Return the component (h, w) that the pixel in the middle of each cell is in, 0 for none."""
    middle, side = REGION.cell_px // 2, REGION.cell_px
    return components[middle : shape[0] * side : side, middle : shape[1] * side : side]
