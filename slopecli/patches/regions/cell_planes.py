"""Planes proposed by dense cells: by neighbourhoods of them, and by those in each connected component."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slopecli.geometry.epipolar import homogeneous
from slopecli.geometry.motion import epipolar_residual, inverse_depth
from slopecli.geometry.statistics import robust_least_squares
from slopecli.look.dense import Cells
from slopecli.look.gradient_components import Labels, grown
from slopecli.look.matches import pair_rays
from slopecli.look.noise import DIFFERENCE_GREY
from slopecli.look.scene import Scene, axis_variance
from slopecli.look.warp import Grid
from slopecli.patches.labelling.depth_planes import robust_planes
from slopecli.patches.labelling.energy import cover
from slopecli.patches.neighbours import nearest
from slopecli.patches.regions.region_tunables import REGION
from slopecli.types import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class RegionCells:
    """Dense cells consistent with the motion, as equations of planes.

    uv1 : (n, 2) px of image 1.  rows (n, 3), target (n,) : rows @ scaled normal - target is the residual, in sigmas.
    """

    uv1: FloatArray
    rows: FloatArray
    target: FloatArray

    def __len__(self) -> int:
        return len(self.uv1)

    def take(self, index: IntArray) -> RegionCells:
        """Return the cells of these numbers (m,)."""
        return RegionCells(self.uv1[index], self.rows[index], self.target[index])

    def cost(self, normals: FloatArray) -> FloatArray:
        """Return (n, k) truncated squared residuals of all cells for planes (k, 3); stored plane by plane."""
        cost = normals.astype(np.float32) @ self.rows.astype(np.float32).T
        cost -= self.target.astype(np.float32)
        cost *= cost
        return np.minimum(cost, np.float32(REGION.truncated), out=cost).T


def region_cells(cells: Cells, scene: Scene) -> tuple[RegionCells, IntArray]:
    """Return the cells consistent with the motion, with a sigma by their texture, and their numbers (m,)."""
    focal = scene.camera1.focal_px  # flow errs in px of the grid over image 1, however many image 2 has
    variance = axis_variance(cells.information, cells.uv1, scene, REGION.cell_floor_px, DIFFERENCE_GREY)
    variance /= cells.pixel_scale**2
    x1, x2, seen = pair_rays(scene.camera1, scene.camera2, cells.uv1, cells.uv2)
    residual = np.abs(epipolar_residual(scene.R, scene.T, x1, x2)) * focal
    allowed = np.clip(3 * np.sqrt(variance[:, 1]), *REGION.epipolar_px)
    w, leverage = inverse_depth(scene.R, scene.T, x1, x2)
    keep = seen & (residual < allowed) & (w > 0) & (leverage > 0) & (variance[:, 0] < REGION.most_sigma_px**2)
    scale = (leverage * focal / np.sqrt(variance[:, 0]))[keep]
    return RegionCells(cells.uv1[keep], homogeneous(x1[keep]) * scale[:, None], w[keep] * scale), np.flatnonzero(keep)


def neighbourhood_planes(cells: RegionCells, count: int, rng: np.random.Generator) -> FloatArray:
    """Return (k, 3) robust planes, k <= count, each through cells near one another."""
    planes = [np.empty((0, 3))]
    for size in REGION.neighbourhoods:
        if len(cells) >= size:
            seeds = rng.permutation(len(cells))[: count // len(REGION.neighbourhoods)]
            near = nearest(cells.uv1, size, seeds)
            planes.append(robust_planes(cells.rows[near], cells.target[near]))
    return np.vstack(planes)


def fewest_planes(cells: RegionCells, proposals: FloatArray) -> FloatArray:
    """Return (k, 3) of the proposals that together explain the cells, in the order of what they add."""
    unexplained = np.full(len(cells), REGION.cell_unexplained, np.float32)
    return proposals[cover(cells.cost(proposals), unexplained, REGION.cell_gain)[: REGION.most_planes]]


def component_planes(cells: RegionCells, components: Labels, grid: Grid, proposals: FloatArray) -> FloatArray:
    """Return (k, 3) planes of the components with enough cells: the best proposal of each, fitted to its cells."""
    at = np.rint(grid.inside(cells.uv1)).astype(int)
    column, row = np.clip(at[:, 0], 0, grid.shape[1] - 1), np.clip(at[:, 1], 0, grid.shape[0] - 1)
    component = grown(components, REGION.rim_px)[row, column]
    planes = [np.empty((0, 3))]
    for number in range(1, int(components.max()) + 1):
        own = cells.take(np.flatnonzero(component == number))
        if len(own) >= REGION.neighbourhoods[0] and len(proposals):
            best = proposals[own.cost(proposals).sum(0).argmin()]
            planes.append(robust_least_squares(own.rows, own.target, best, (1.0, np.inf), 6)[0][None])
    return np.vstack(planes)
