"""Slope, uncertainty, heights and safety of every cell of a map, from the dense depth of a pair."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from slopecli.geometry.epipolar import homogeneous
from slopecli.ground.cell_causes import cell_causes
from slopecli.ground.footprint_planes import FootprintPlanes, fit_footprints, heights
from slopecli.ground.footprints import Cells
from slopecli.ground.safety import Tilts, probability_low, tilts
from slopecli.ground.slope_map import CellArrays
from slopecli.ground.tilt_uncertainty import (
    Root,
    across_step,
    beside_bare,
    gradient_parts,
    largest_jump,
    normal_covariance,
    normals_under,
)
from slopecli.look.dense_depth import DenseDepth
from slopecli.types import BoolArray, FloatArray

WITHHELD = 0.5  # largest probability of a safe footprint that nothing speaks against, and too little for


@dataclass(frozen=True, eq=False)
class Demand:
    """What ground is measured against.

    ups : directions of up (3,), unit, all of which a safe footprint must be level to; the first one is reported.
    up_sigma_rad : of each about a horizontal axis.  north : (3,) horizontal unit vector, aspects count from it.
    length : of the baseline, in the unit of the scale.  scale_sigma : its relative 1-sigma.
    max_height : of what stands above or lies below the plane of a safe footprint, in that unit; None: any.
    """

    ups: Sequence[FloatArray]
    up_sigma_rad: float
    north: FloatArray
    length: float
    scale_sigma: float
    tolerance_rad: float
    max_height: float | None


@dataclass(frozen=True, eq=False)
class CellMap(CellArrays):
    """The arrays of a map, lengths in the unit of the scale, and ground_px (rows, columns): size of a grid pixel;
    sigma_causes_deg: see `SlopeMap`."""

    ground_px: FloatArray
    sigma_causes_deg: dict[str, float] | None = None


def map_cells(depth: DenseDepth, cells: Cells, roots: Sequence[Root], demand: Demand) -> CellMap:
    """Measure every cell.

    roots : the motion that the depth was measured with, and the other if it explains the images as well; a footprint
        is safe only where it is so under both.
    """
    planes = fit_footprints(depth.points, depth.known, depth.sure, cells, variance=depth.variance)
    jump = largest_jump(depth, planes)
    across = across_step(depth, planes, jump)
    gradient = gradient_parts(depth, planes, np.where(across, jump, 0.0))
    covariance = normal_covariance(planes, roots[0], gradient.total)
    told = planes.answered & np.isfinite(covariance).all((-1, -2))
    under = [planes.scaled_normal, *(normals_under(planes, roots[0], root.R, root.T) for root in roots[1:])]
    seen = [tilts(N, covariance, up, demand.up_sigma_rad, demand.north) for N in under for up in demand.ups]
    above, below = (demand.length * height for height in heights(depth.points, depth.known, planes))
    ground_px = demand.length * planes.middle[..., 2] / depth.focal_px
    p_safe = np.min([one.probability_below(demand.tolerance_rad) for one in seen], axis=0)
    if demand.max_height is not None:
        both = [probability_low(height, demand.max_height, ground_px, demand.scale_sigma) for height in (above, below)]
        p_safe = p_safe * np.minimum(*both)
    step = told & across
    p_safe = np.where(step, 0.0, p_safe)
    p_safe = np.where(beside_bare(depth, planes), np.minimum(p_safe, WITHHELD), p_safe)
    cells_of = _assembled(depth, planes, seen[0], told, demand, above, below, p_safe, step, ground_px)
    causes = cell_causes(planes, gradient, roots[0], seen[0], told, demand.ups[0], demand.up_sigma_rad)
    return replace(cells_of, sigma_causes_deg=causes)


def _assembled(
    depth: DenseDepth,
    planes: FootprintPlanes,
    tilt: Tilts,
    told: BoolArray,
    demand: Demand,
    above: FloatArray,
    below: FloatArray,
    p_safe: FloatArray,
    step: BoolArray,
    ground_px: FloatArray,
) -> CellMap:
    cells = planes.cells
    rays = homogeneous(depth.rays[np.ix_(cells.v, cells.u)].reshape(-1, 2).astype(float)).reshape(*cells.shape, 3)
    points = demand.length * rays / (rays * planes.scaled_normal).sum(-1, keepdims=True)

    def known(values: FloatArray) -> FloatArray:
        return np.where(told, values, np.nan)

    return CellMap(
        slope_deg=known(np.degrees(tilt.slope_rad)),
        sigma_deg=known(np.degrees(tilt.sigma_rad)),
        p_safe=known(p_safe),
        aspect_deg=known(np.degrees(tilt.aspect_rad)),
        roughness=known(demand.length * planes.relief),
        above_plane_max=known(above),
        below_plane_max=known(below),
        distance=known(np.linalg.norm(points, axis=-1)),
        valid_share=planes.share,
        step=step,
        points=np.where(told[..., None], points, np.nan),
        ground_px=known(ground_px),
    )
