"""Planes proposed by the dense cells of the overview: by every neighbourhood, and by every connected component."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slopecli.geometry.epipolar import homogeneous
from slopecli.geometry.motion import epipolar_residual, inverse_depth
from slopecli.look.dense import Cells
from slopecli.look.gradient_components import Labels, grown
from slopecli.look.matches import pair_rays
from slopecli.look.noise import DIFFERENCE_GREY
from slopecli.look.scene import Scene, axis_variance
from slopecli.look.warp import Grid
from slopecli.patches.labelling.energy import cover
from slopecli.types import FloatArray, IntArray

FLOOR_PX = 0.08  # of a cell, px of the overview's grid: see axis_variance
MAX_SIGMA_PX = 1.0  # cells known worse along the epipolar line say nothing of a plane
EPIPOLAR_PX, EPIPOLAR_SIGMAS, MOST_EPIPOLAR_PX = 1.0, 3.0, 2.0  # by which a cell may miss its epipolar line
SEEDS = 600  # neighbourhoods that propose a plane
NEIGHBOURS = (6, 12, 24)  # cells in them: small ones for small planes, large ones against noise
GATE = 2.5  # sigmas at which a cell has lost most of its weight
REWEIGHTS = 6
TINY = 1e-12  # sigmas^-2: keeps cells that all lie far off a plane from leaving it undefined
TRUNCATED = 9.0  # squared sigmas: a cell on another plane costs no more, however far off it is
UNEXPLAINED = 7.0  # cost of a cell that no plane explains
LEAST_GAIN = 25.0  # a proposal must explain this much more, in squared sigmas: three or four cells
MOST_PLANES = 70  # from neighbourhoods: the most a picture of a million pixels shows
LEAST_CELLS = 6  # of a component that proposes a plane
RIM_PX = 4.0  # working px around a component whose cells belong to it: its border carries the texture


@dataclass(frozen=True, eq=False)
class RegionCells:
    """Cells that obey the motion: uv1 (n, 2) px, and inverse depth as rows (n, 3) . normal = target (n,), in sigmas."""

    uv1: FloatArray
    rows: FloatArray
    target: FloatArray

    def __len__(self) -> int:
        return len(self.uv1)

    def take(self, index: IntArray) -> RegionCells:
        """The cells of these numbers (m,)."""
        return RegionCells(self.uv1[index], self.rows[index], self.target[index])

    def cost(self, normals: FloatArray) -> FloatArray:
        """(n, k) squared distance of every cell from every plane, truncated; the values of a plane lie together."""
        cost = normals.astype(np.float32) @ self.rows.astype(np.float32).T
        cost -= self.target.astype(np.float32)
        cost *= cost
        return np.minimum(cost, np.float32(TRUNCATED), out=cost).T


def region_cells(cells: Cells, scene: Scene) -> tuple[RegionCells, IntArray]:
    """Cells that obey the motion, those of faint texture with the sigma that goes with it, and which (m,) they are."""
    focal = scene.camera1.focal_px  # flow errs in px of the grid over image 1, however many image 2 has
    variance = axis_variance(cells.information, cells.uv1, scene, FLOOR_PX, DIFFERENCE_GREY) / cells.pixel_scale**2
    x1, x2, seen = pair_rays(scene.camera1, scene.camera2, cells.uv1, cells.uv2)
    residual = np.abs(epipolar_residual(scene.R, scene.T, x1, x2)) * focal
    allowed = np.minimum(np.maximum(EPIPOLAR_PX, EPIPOLAR_SIGMAS * np.sqrt(variance[:, 1])), MOST_EPIPOLAR_PX)
    w, leverage = inverse_depth(scene.R, scene.T, x1, x2)
    keep = seen & (residual < allowed) & (w > 0) & (leverage > 0) & (variance[:, 0] < MAX_SIGMA_PX**2)
    scale = (leverage * focal / np.sqrt(variance[:, 0]))[keep]
    return RegionCells(cells.uv1[keep], homogeneous(x1[keep]) * scale[:, None], w[keep] * scale), np.flatnonzero(keep)


def neighbourhood_planes(cells: RegionCells, rng: np.random.Generator) -> FloatArray:
    """(k, 3) robust planes through cells near one another."""
    planes = []
    for size in NEIGHBOURS:
        if len(cells) < size:
            continue
        seeds = rng.permutation(len(cells))[: SEEDS // len(NEIGHBOURS)]
        near = nearest(cells.uv1, seeds, size)
        planes.append(robust_planes(cells.rows[near], cells.target[near]))
    return np.vstack(planes) if planes else np.empty((0, 3))


def nearest(uv1: FloatArray, seeds: IntArray, size: int) -> IntArray:
    """(len(seeds), size) indices of the cells nearest to each seed, itself among them."""
    squared = ((uv1[seeds, None] - uv1[None]) ** 2).sum(2)
    return np.argpartition(squared, size - 1, axis=1)[:, :size]


def robust_planes(rows: FloatArray, target: FloatArray) -> FloatArray:
    """(k, 3) planes through k groups of cells, rows (k, m, 3), by reweighted least squares."""
    weight = np.ones(target.shape)
    normals = np.empty((len(rows), 3))
    for _ in range(REWEIGHTS):
        weighted = rows * weight[..., None]
        system = weighted.transpose(0, 2, 1) @ rows
        damping = np.maximum(1e-9 * np.trace(system, axis1=1, axis2=2), TINY)[:, None, None] * np.eye(3)
        right = (weighted * target[..., None]).sum(1)
        normals = np.linalg.solve(system + damping, right[..., None])[..., 0]
        residual = np.einsum("kmi,ki->km", rows, normals) - target
        weight = 1 / (1 + (residual / GATE) ** 2) ** 2
    return normals


def fewest_planes(cells: RegionCells, proposals: FloatArray) -> FloatArray:
    """(k, 3) of the proposals that together explain the cells, each the one that adds most to those before it."""
    unexplained = np.full(len(cells), UNEXPLAINED, np.float32)
    return proposals[cover(cells.cost(proposals), unexplained, LEAST_GAIN)[:MOST_PLANES]]


def component_planes(cells: RegionCells, components: Labels, grid: Grid, proposals: FloatArray) -> FloatArray:
    """(k, 3) plane of every component with enough cells: the proposal that suits them best, fitted to them."""
    at = np.rint(grid.inside(cells.uv1)).astype(int)
    column, row = np.clip(at[:, 0], 0, grid.shape[1] - 1), np.clip(at[:, 1], 0, grid.shape[0] - 1)
    component = grown(components, RIM_PX)[row, column]
    planes = []
    for number in range(1, int(components.max()) + 1):
        of = component == number
        if np.count_nonzero(of) >= LEAST_CELLS and len(proposals):
            planes.append(_component_plane(cells.rows[of], cells.target[of], proposals))
    return np.array(planes).reshape(-1, 3)


def _component_plane(rows: FloatArray, target: FloatArray, proposals: FloatArray) -> FloatArray:
    cost = np.minimum((target[:, None] - rows @ proposals.T) ** 2, TRUNCATED).sum(0)
    normal = proposals[cost.argmin()]
    for _ in range(REWEIGHTS):
        residual = target - rows @ normal
        scale = max(1.0, 1.4826 * float(np.median(np.abs(residual))))
        weighted = rows * (1 / (1 + (residual / (GATE * scale)) ** 2) ** 2)[:, None]
        system = weighted.T @ rows
        normal = np.linalg.solve(system + 1e-9 * np.trace(system) * np.eye(3), weighted.T @ target)
    return normal
