"""Cells of image 1 with an inverse depth each, as equations of planes, and the noise of the pair that they show."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slopecli.geometry.epipolar import homogeneous
from slopecli.geometry.motion import epipolar_residual, inverse_depth
from slopecli.geometry.statistics import GATE_SIGMAS, median, robust_sigma
from slopecli.look.dense import Cells
from slopecli.look.gradient_components import Labels
from slopecli.look.matches import MIN_ON_PLANE, ON_PLANE_PX, pair_rays
from slopecli.look.noise import ROUNDING_GREY, SYSTEMATIC_PX, correlation_gain
from slopecli.look.scene import Scene, axis_variance
from slopecli.look.warp import FloatImage
from slopecli.patches.regions.region_tunables import REGION
from slopecli.patches.windows.tunables import TUNE
from slopecli.types import BoolArray, FloatArray


@dataclass(frozen=True, eq=False)
class CellLattice:
    """Inverse depths of the cells of a grid over image 1.

    rows (h, w, 3), target (h, w) : rows @ scaled normal - target is the residual along the epipolar line, in sigmas.
    known (h, w) : cells with a match; the others are 0 in `rows` and `target`.
    sharing : number of cells that share one error, by the autocorrelation of what is left across the lines.
    unexplained : cost of a cell on no plane: its depth may be any that the scene shows.
    width : of a cell, normalised coordinates.  sigma_px : median 1-sigma of a cell, px of image 2.
    """

    rows: FloatImage
    target: FloatImage
    known: BoolArray
    sharing: float
    unexplained: float
    width: float
    sigma_px: float

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of cells."""
        return int(self.known.shape[0]), int(self.known.shape[1])

    @property
    def price(self) -> float:
        """Least cost that a plane must save: three parameters, as the Bayesian information criterion has it."""
        independent = max(np.count_nonzero(self.known) / self.sharing, 2.0)
        return float(3.0 * self.sharing * np.log(independent))

    def off(self, plane: FloatArray) -> FloatImage:
        """Return the distance (h, w) of all cells from a plane, in sigmas; of no meaning where not known."""
        return np.asarray(np.abs(self.rows @ plane.astype(np.float32) - self.target))

    def cost(self, off: FloatImage, tolerance: float) -> FloatImage:
        """Return the cost (...) of cells `off` sigmas (...) off a plane whose surface has a tolerance, sigmas."""
        cost = (off / np.float32(tolerance)) ** 2 + np.float32(2.0 * np.log(tolerance))
        return np.minimum(cost, np.float32(self.unexplained))

    def on_plane(self, plane: FloatArray, tolerance: float) -> BoolArray:
        """Return (h, w) whether a cell is known and lies on the plane."""
        return np.asarray(self.known & (self.off(plane) < GATE_SIGMAS * tolerance))


def lattice_of(cells: Cells, shape: tuple[int, int], scene: Scene) -> CellLattice:
    """Return the lattice of the cells of a grid of `shape` px that are consistent with the motion."""
    focal = scene.camera2.focal_px * cells.pixel_scale
    x1, x2, seen = pair_rays(scene.camera1, scene.camera2, cells.uv1, cells.uv2)
    across = epipolar_residual(scene.R, scene.T, x1, x2) * focal
    w, leverage = inverse_depth(scene.R, scene.T, x1, x2)
    # this much noise explains the errors of cells of faint texture: grey values of both images are rounded, and
    # resampled, and flow compares more pixels than those of the cell
    texture = axis_variance(cells.information, cells.uv1, scene, 0.0, 2.0 * ROUNDING_GREY)
    good = seen & (w > 0) & (leverage > 0) & (cells.agreement > TUNE.fair_score)
    noise = _noise_px(across[good], texture[good, 1])
    good &= np.abs(across) < 3.0 * np.sqrt(noise**2 + texture[:, 1])
    variance = noise**2 + texture[:, 0]
    good &= variance < max(ON_PLANE_PX, 3.0 * noise) ** 2
    index, scale = cells.index[good], (leverage * focal / np.sqrt(variance))[good]
    size = shape[0] // REGION.cell_px, shape[1] // REGION.cell_px
    rows, target, known = np.zeros((*size, 3), np.float32), np.zeros(size, np.float32), np.zeros(size, bool)
    at = tuple(index.T)
    rows[at], target[at], known[at] = homogeneous(x1[good]) * scale[:, None], w[good] * scale, True
    gain = correlation_gain([(index, (across / np.sqrt(noise**2 + texture[:, 1]))[good])])
    width = REGION.cell_px / (scene.camera1.focal_px * cells.pixel_scale)
    sigma_px = float(np.sqrt(median(variance[good]))) / cells.pixel_scale
    return CellLattice(rows, target, known, gain**2, _unexplained(w[good], scale), width, sigma_px)


def _noise_px(across: FloatArray, texture: FloatArray) -> float:
    """Return the 1-sigma of a match of ideal texture, grid px, by the residuals (n,) of textured cells.

    texture : (n,) variance of the residuals due to noise of grey values.
    """
    if not len(across):
        return REGION.least_noise_px
    clear = texture <= max(SYSTEMATIC_PX**2, float(np.quantile(texture, 0.1)))
    return robust_sigma(across[clear], REGION.least_noise_px)


def _unexplained(w: FloatArray, scale: FloatArray) -> float:
    """Return the cost of a cell of any depth; w (n,) inverse depths of all cells, scale (n,) inverse sigmas."""
    if len(w) < MIN_ON_PLANE:
        return 0.0
    low, high = np.quantile(w, [0.01, 0.99])
    span = max((high - low) * median(scale), 10.0 * max(REGION.tolerances))
    return float(2.0 * np.log(span / np.sqrt(2.0 * np.pi)))


def component_of_cells(components: Labels, shape: tuple[int, int]) -> Labels:
    """Return the component (h, w) that a cell lies wholly in, 0 for none."""
    side = REGION.cell_px
    blocks = components[: shape[0] * side, : shape[1] * side].reshape(shape[0], side, shape[1], side)
    return np.where(blocks.min((1, 3)) == blocks.max((1, 3)), blocks[:, 0, :, 0], 0)
