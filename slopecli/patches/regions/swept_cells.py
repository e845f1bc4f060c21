"""Cells without a match matched again, from the depth at which a sweep of planes finds both images alike.

Matching starts from the depth of the matches around. Ground in front of a wall may lie far off it. A sweep over all
depths compares image 1, shrunk to a pixel a cell, with image 2, on planes of a few orientations: those of the planes
that explain most cells, the directions perpendicular to two of them (two walls tell the ground), and facing the camera.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from slopecli.geometry.epipolar import normal_angle
from slopecli.look.dense import Cells, dense_cells
from slopecli.look.depth_transfer import DepthTransfer
from slopecli.look.gradient_components import Labels
from slopecli.look.matches import Evidence
from slopecli.look.noise import ROUNDING_GREY
from slopecli.look.photometric import detrend
from slopecli.look.scene import Scene
from slopecli.look.transfer_error import SHADING_PX, Box
from slopecli.look.warp import FloatImage, Grid, covered
from slopecli.patches.regions.cell_lattice import CellLattice
from slopecli.patches.regions.plane_seeds import plane_seeds
from slopecli.patches.regions.region_tunables import REGION
from slopecli.patches.windows.raw_grey import KNOWN
from slopecli.patches.windows.tunables import TUNE
from slopecli.types import BoolArray, FloatArray


def with_swept_cells(cells: Cells, lattice: CellLattice, components: Labels, scene: Scene, grid: Grid) -> Cells:
    """Return the cells of the working grid, with those that the sweep finds where the lattice has none.

    components : (h, w) working px, 1..k.
    """
    missing = _large_pieces(_squares_of(~lattice.known))
    if not missing.any():
        return cells
    box = _around(missing)
    sweep = _Sweep.of(scene, grid, box, missing[box])
    found, depth = np.zeros(lattice.shape, bool), np.zeros(lattice.shape, np.float32)
    depth[missing], found[missing] = sweep.clearest(_orientations(lattice, components))
    found = _large_pieces(_squares_of(found))
    if not found.any():
        return cells
    again = _matched_again(scene, grid, lattice, found, depth)
    return cells.take(~found[tuple(cells.index.T)]).joined(again)


def _squares_of(mask: BoolArray) -> BoolArray:
    """Return the cells (h, w) of a mask that lie in squares of it: gaps along borders are no surfaces."""
    square = np.ones((REGION.near_cells, REGION.near_cells), np.uint8)
    opened = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, square)
    return np.asarray(opened > 0)


def _large_pieces(mask: BoolArray) -> BoolArray:
    """Return the cells (h, w) of a mask that are connected to enough others: a few may be alike by chance."""
    pieces = cv2.connectedComponents(mask.astype(np.uint8), connectivity=4)[1]
    size = np.bincount(pieces.ravel())
    size[0] = 0
    return np.asarray((size >= REGION.swept_share * mask.size)[pieces])


def _around(mask: BoolArray) -> Box:
    """Return the rows and columns of the cells of a mask, with a margin."""
    x, y, w, h = cv2.boundingRect(mask.astype(np.uint8))
    rows, columns = mask.shape
    return (
        slice(max(0, y - REGION.near_cells), min(y + h + REGION.near_cells, rows)),
        slice(max(0, x - REGION.near_cells), min(x + w + REGION.near_cells, columns)),
    )


def _orientations(lattice: CellLattice, components: Labels) -> list[FloatArray]:
    """Return unit normals: facing the camera, of the planes that explain most cells, and perpendicular to any two."""
    seeds = plane_seeds(lattice, components)
    current, planes = np.where(lattice.known, lattice.unexplained, 0.0), list[FloatArray]()
    for _ in range(KNOWN.most_known if len(seeds) else 0):
        saving = seeds.saving(current)
        k = int(saving.argmax())
        if saving[k] < lattice.price or len(planes) == KNOWN.starts:
            break
        cost = lattice.cost(lattice.off(seeds.planes[k]), max(REGION.tolerances))
        current = np.where(lattice.known & seeds.part(k), np.minimum(current, cost), current)
        planes = _distinct([*planes, seeds.planes[k]])
    across = [np.cross(one, other) for one, other in combinations(planes, 2)]
    return _distinct([np.array([0.0, 0.0, 1.0]), *planes, *across])


def _distinct(normals: Sequence[FloatArray]) -> list[FloatArray]:
    """Return unit vectors along those that differ from all before them in their direction, either sign."""
    found = list[FloatArray]()
    for normal in normals:
        unit = normal / np.linalg.norm(normal)
        apart = [normal_angle(unit, other) for other in found]
        if all(KNOWN.parallel_rad < angle < np.pi - KNOWN.parallel_rad for angle in apart):
            found.append(unit)
    return found


class _Orientation(NamedTuple):
    """Planes of one orientation: inverse depths nearness (k, 1) * along (n,) of n cells, and correlations (k, n)."""

    along: FloatImage
    nearness: FloatImage
    alike: NDArray[np.float16]


@dataclass(frozen=True, eq=False)
class _Sweep:
    """Image 1 at a pixel a cell, and image 2 about as coarse, both without shading.

    scale2 (2,) : px of `second` per full px.  wanted (h, w) : the cells whose depth is sought.
    """

    evidence: Evidence
    shape2: tuple[int, int]
    transfer: DepthTransfer
    first: FloatImage
    second: FloatImage
    scale2: FloatImage
    wanted: BoolArray

    @classmethod
    def of(cls, scene: Scene, grid: Grid, box: Box, wanted: BoolArray) -> _Sweep:
        """Return the sweep over the cells of a box."""
        side = REGION.cell_px
        part = _part(grid, box)
        grey = cv2.resize(part.grey, wanted.shape[::-1], interpolation=cv2.INTER_AREA)
        small = Grid(np.asarray(grey, np.uint8), part.x0 / side, part.y0 / side, part.scale / side)
        layer = scene.pyramid2.at(1.0 / small.mean_scale)
        first, second = (detrend(image.astype(np.float32), SHADING_PX / side) for image in (grey, layer.grey))
        transfer = DepthTransfer(scene, small)
        return cls(scene.evidence, scene.shape2, transfer, first, second, layer.scale.astype(np.float32), wanted)

    def clearest(self, normals: Sequence[FloatArray]) -> tuple[FloatImage, BoolArray]:
        """Return the inverse depth (n,) of the wanted cells at which they are most alike, and whether this is clear.

        It is if no depth that displaces by 1.5 px more or less, which is the next plane but one, is nearly as good.
        """
        per_w = float(self.transfer.grid.mean_scale * np.median(self.evidence.leverage) * self.evidence.focal_px)
        swept = list(self._swept(normals, per_w))
        depth, most = np.zeros(swept[0].along.shape, np.float32), np.full(swept[0].along.shape, -1.0, np.float32)
        for one in swept:
            best = one.alike.argmax(0)
            value = np.take_along_axis(one.alike, best[None], 0)[0]
            better = value > most
            depth = np.where(better, one.nearness[best] * one.along, depth)
            most = np.where(better, value, most)
        other = np.full(most.shape, -1.0, np.float32)
        for one in swept:
            apart = np.abs(one.nearness[:, None] * one.along - depth) * np.float32(per_w) > 1.5
            other = np.maximum(other, np.where(apart, one.alike, -1.0).max(0))
        return depth, (most > TUNE.same_ground_score) & (most - other > 2.0 * KNOWN.better)

    def _swept(self, normals: Sequence[FloatArray], per_w: float) -> Iterator[_Orientation]:
        """Yield the planes of each orientation, a px apart.

        per_w : px by which an inverse depth of 1 displaces.
        """
        low, high = np.percentile(self.evidence.w, [1, 99])
        low, high = 0.5 * low, 2.0 * high  # what has no match may lie before, or behind, all that has
        number = int(np.clip((high - low) * per_w, 8, 400))
        variance = _mean(self.first * self.first) + np.float32(ROUNDING_GREY**2)
        weight = self.wanted.astype(np.float32)
        side = REGION.windows[2]  # cells over which planes are compared: fewer are alike by chance, more cross edges
        total = np.maximum(_mean(weight, side), 1e-6)[self.wanted]
        for normal in normals:
            along = self.transfer.rays @ normal[:2].astype(np.float32) + np.float32(normal[2])
            along *= np.sign(np.median(along[self.wanted])) or 1.0
            # not the largest: of planes seen edge-on a few cells near the horizon would take nearly all of the depths
            steepest = max(float(np.quantile(along[self.wanted], 0.98)), 1e-6)
            nearness = np.linspace(low / steepest, high / steepest, number, dtype=np.float32)
            alike = np.empty((number, np.count_nonzero(self.wanted)), np.float16)
            for k, factor in enumerate(nearness):
                alike[k] = _mean(self._correlation(factor * along, variance) * weight, side)[self.wanted] / total
            yield _Orientation(along[self.wanted], nearness, alike)

    def _correlation(self, w: FloatImage, variance: FloatImage) -> FloatImage:
        """Return the correlation (h, w) of the images around every cell at inverse depths w (h, w)."""
        uv2 = self.transfer.pixels2(w)
        at = (uv2 + np.float32(0.5)) * self.scale2 - np.float32(0.5)
        pulled = np.asarray(cv2.remap(self.second, at, None, cv2.INTER_LINEAR), np.float32)  # type: ignore[call-overload]
        rounding = np.float32(ROUNDING_GREY**2)
        alike = _mean(self.first * pulled) / np.sqrt(variance * (_mean(pulled * pulled) + rounding))
        alike[~covered(uv2, self.shape2)] = -1.0
        return np.asarray(alike, np.float32)


def _mean(image: FloatImage, side: int = REGION.near_cells) -> FloatImage:
    """Return the mean (h, w) over the square around each pixel."""
    return np.asarray(cv2.blur(image, (side, side)), np.float32)


def _part(grid: Grid, box: Box) -> Grid:
    """Return the part of a working grid in a box of cells."""
    rows, columns = (slice(part.start * REGION.cell_px, part.stop * REGION.cell_px) for part in box)
    return replace(
        grid,
        grey=np.ascontiguousarray(grid.grey[rows, columns]),
        x0=grid.x0 + columns.start,
        y0=grid.y0 + rows.start,
    )


def _matched_again(scene: Scene, grid: Grid, lattice: CellLattice, found: BoolArray, depth: FloatImage) -> Cells:
    """Return the cells found (h, w), matched from the inverse depths (h, w) of the sweep."""
    box = _around(found)
    own = np.where(found, depth, lattice.target / np.maximum(lattice.rows[..., 2], 1e-12))[box].astype(np.float32)
    told = (found | lattice.known)[box]
    _, nearest = cv2.distanceTransformWithLabels(
        (~told).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    of_nearest = np.zeros(int(nearest.max()) + 1, np.float32)
    of_nearest[nearest[told]] = own[told]
    part = _part(grid, box)
    start = cv2.resize(
        cv2.medianBlur(of_nearest[nearest], REGION.near_cells), part.shape[::-1], interpolation=cv2.INTER_LINEAR
    )
    mapping = DepthTransfer(scene, part).pixels2(start)
    cells = dense_cells(part, mapping, scene.pyramid2, scene.shape2, REGION.cell_px, finest=0, check=1)
    cells = replace(cells, index=cells.index + np.array([box[0].start, box[1].start]))
    return cells.take(found[tuple(cells.index.T)])
