"""Planes that explain the dense matches of a scene and whose tilt these tell, without the pixels that are on them."""

from __future__ import annotations

from slopecli.look.dense_depth import depth_cells
from slopecli.look.gradient_components import adaptive_threshold, connected_components, smooth_gradient
from slopecli.look.scene import Scene, whole_grid
from slopecli.look.scene_from_images import FINE
from slopecli.patches.regions.cell_lattice import lattice_of
from slopecli.patches.regions.plane_pieces import fewest_pieces, grown_pieces, tilt_sigma_rad
from slopecli.patches.regions.region_tunables import REGION
from slopecli.types import FloatArray


def surest_planes(scene: Scene, most_sigma_rad: float) -> list[FloatArray]:
    """Return the scaled normals (3,) of planes whose tilt has at most this 1-sigma, the surest first."""
    grid = whole_grid(scene, FINE.max_pixels)
    gradient = smooth_gradient(grid.grey)
    components = connected_components(gradient, adaptive_threshold(gradient), REGION.least_share * gradient.size)
    lattice = lattice_of(depth_cells(scene, grid, REGION.cell_px), grid.shape, scene)
    pieces = fewest_pieces(lattice, grown_pieces(lattice, components))
    sigmas = [tilt_sigma_rad(lattice, piece) for piece in pieces]
    told = [k for k in sorted(range(len(pieces)), key=sigmas.__getitem__) if sigmas[k] <= most_sigma_rad]
    return [pieces[k].plane for k in told]
