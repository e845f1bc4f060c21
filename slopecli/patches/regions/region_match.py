"""Dense matches inside regions: image 2 is warped onto image 1 by the plane of each region, then matched."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from slopecli.geometry.epipolar import homogeneous, normal_angle
from slopecli.geometry.motion import inverse_depth
from slopecli.look.dense import Cells, dense_cells
from slopecli.look.depth_transfer import DepthTransfer
from slopecli.look.gradient_components import Labels, grown
from slopecli.look.matches import LEAST_MATCHES, Matches, pair_rays
from slopecli.look.noise import OVERVIEW_CELL_PX
from slopecli.look.scene import Scene, whole_grid
from slopecli.look.scene_from_images import FINE
from slopecli.look.warp import FloatImage, Grid, covered
from slopecli.patches.labelling.depth_planes import solve_regular
from slopecli.patches.patch import Patch, weight_of
from slopecli.patches.regions.region_tunables import REGION
from slopecli.patches.windows.tunables import TUNE
from slopecli.patches.windows.window_finder import with_cells
from slopecli.types import FloatArray


def match_labelled(labels: Labels, planes: list[FloatArray], scene: Scene) -> Cells:
    """Return the dense matches of all cells of the working grid, image 2 resampled by the plane of every region.

    Parameters
    ----------
    labels : (h, w) 1..k, 0 for none, of the pixels of the working grid.
    planes : scaled normals (3,) of the k planes.
    """
    grid = whole_grid(scene, FINE.max_pixels)
    # flow needs to see past a region's border, and over the holes in it
    mapping = _mapping(grid, grown(labels, REGION.reach_px), planes, scene)
    # under its own plane a region has hardly any flow left, which half the resolution tells as well
    return dense_cells(grid, mapping, scene.pyramid2, scene.shape2, REGION.cell_px, finest=0, check=1)


def match_regions(labels: Labels, cells: Cells, patches: list[Patch], scene: Scene) -> list[Patch]:
    """Return the regions with the matches of the cells inside them, or without matches and with the reason.

    patches : the regions 1, 2, ... of the label map, still without matches.
    """
    number = _own_label(labels, REGION.cell_px)[tuple(cells.index.T)]
    return [_matched(patch, cells.take(number == patch.id), scene) for patch in patches]


def on_known_orientation(patch: Patch, plane: FloatArray, sigma_rad: float, scene: Scene) -> Patch:
    """Return a region without matches with points of a plane (3,) of known orientation in place of them.

    sigma_rad : of the tilt of that plane.
    """
    inside = np.argwhere(patch.footprint.mask)[:, ::-1] + np.array(patch.footprint.corner)
    step = max(1, len(inside) // (4 * LEAST_MATCHES))  # few, as they must not determine the motion
    uv1 = inside[step // 2 :: step].astype(float)
    view = scene.view(whole_grid(scene, FINE.max_pixels))
    uv2 = view.transfer(view.bundle(uv1), plane)
    x1, x2, seen = pair_rays(scene.camera1, scene.camera2, uv1, uv2)
    # beyond a horizon inside the region the plane is in no place of image 2
    matches = Matches(uv1, uv2, x1, x2).take(seen & covered(uv2, scene.shape2, 0.0))
    if not len(matches) or not _spread(matches.x1):
        return patch.unmatched("too little texture: few of its pixels can be matched")
    spacing = np.sqrt(step)
    return replace(
        patch.unmatched("too little texture inside: orientation from elsewhere, depth by its grey values as a whole"),
        matches=matches,
        weight=weight_of(np.full(len(matches), OVERVIEW_CELL_PX**2)),
        cell=np.round(matches.uv1[:, ::-1] / spacing).astype(np.int64),
        origin="borrowed",
        tilt_sigma_rad=sigma_rad,
    )


def _mapping(grid: Grid, labels: Labels, planes: list[FloatArray], scene: Scene) -> FloatImage:
    """Return (h, w, 2) px of image 2 to which its own plane sends every pixel; `OUTSIDE_PX` where there is none."""
    transfer = DepthTransfer(scene, grid)
    plane = np.vstack([np.zeros(3), *planes]).astype(np.float32)[labels]
    return transfer.pixels2(
        transfer.rays[..., 0] * plane[..., 0] + transfer.rays[..., 1] * plane[..., 1] + plane[..., 2]
    )


def _own_label(labels: Labels, cell: int) -> Labels:
    """Return the (h // cell, w // cell) label of cells most of whose pixels have it and none another; else 0."""
    rows, columns = labels.shape[0] // cell, labels.shape[1] // cell
    blocks = labels[: rows * cell, : columns * cell].reshape(rows, cell, columns, cell)
    label = blocks.max((1, 3))
    own = blocks == label[:, None, :, None]
    return np.where((own | (blocks == 0)).all((1, 3)) & (own.mean((1, 3)) > 0.6), label, 0)


def _matched(patch: Patch, cells: Cells, scene: Scene) -> Patch:
    possible = patch.footprint.area_px * (cells.pixel_scale / REGION.cell_px) ** 2
    matched = with_cells(patch, cells, scene, max(1.0, possible))
    if matched.origin == "none":
        return patch.unmatched("too little texture: few of its pixels can be matched")
    if not _spread(matched.matches.x1):
        return patch.unmatched("its matches lie on a line, so they leave its tilt open")
    if matched.share < TUNE.scarce_share and matched.score < REGION.faint_score:
        return patch.unmatched("too little texture: few of its pixels can be matched, and those agree poorly")
    reason = "faint: its matches agree poorly" if matched.score < REGION.faint_score else ""
    sigma = matched.tilt_sigma_rad + np.hypot(_repeated_rad(matched.matches, scene), _uneven_rad(matched, scene))
    return replace(matched, tilt_sigma_rad=sigma, reason=reason)


def _repeated_rad(matches: Matches, scene: Scene) -> float:
    """Return the 1-sigma of the tilt, rad, due to flow that stays near the plane it started from on faint texture.

    It is the tilt when the matches are off by `flow_floor_px` in proportion to their place along either axis of the
    region: such errors lie on a plane and leave no residuals.
    """
    w, leverage = inverse_depth(scene.R, scene.T, matches.x1, matches.x2)
    rays = homogeneous(matches.x1)
    rows = rays * leverage[:, None]
    normal = np.asarray(np.linalg.lstsq(rows, w * leverage, rcond=None)[0], float)
    centred = matches.x1 - matches.x1.mean(0)
    drift = centred @ np.linalg.svd(centred, full_matrices=False)[2].T
    drift *= TUNE.flow_floor_px / scene.camera2.focal_px / drift.std(0)
    tilts = np.asarray(np.linalg.lstsq(rows, drift, rcond=None)[0].T, float)
    return float(np.hypot(*(normal_angle(normal, normal + tilt) for tilt in tilts)))


def _uneven_rad(patch: Patch, scene: Scene) -> float:
    """Return the 1-sigma of the tilt, rad, by the delete-one jackknife over the four quarters of a region.

    Residuals of a surface that is not quite one plane are shared by whole quarters, which single matches do not show.
    """
    w, leverage = inverse_depth(scene.R, scene.T, patch.matches.x1, patch.matches.x2)
    root = leverage * np.sqrt(patch.weight)
    rows, target = homogeneous(patch.matches.x1) * root[:, None], w * root
    centred = patch.matches.x1 - np.median(patch.matches.x1, axis=0)
    axes = np.linalg.svd(centred, full_matrices=False)[2]
    quarter = (centred @ axes[0] > 0) * 2 + (centred @ axes[1] > 0)
    systems = np.array([rows[quarter == k].T @ rows[quarter == k] for k in range(4)])
    rights = np.array([rows[quarter == k].T @ target[quarter == k] for k in range(4)])
    whole = solve_regular(systems.sum(0), rights.sum(0))
    tilts = [
        float(normal_angle(solve_regular(systems.sum(0) - system, rights.sum(0) - right), whole))
        for system, right in zip(systems, rights, strict=True)
    ]
    return float(np.sqrt(0.75 * np.sum(np.square(tilts)) / 2.0))


def _spread(x1: FloatArray) -> bool:
    """Return whether points (n, 2) span an area."""
    spread = np.linalg.svd(x1 - x1.mean(0), compute_uv=False)
    return bool(len(x1) >= 3 and spread[-1] > REGION.least_width * spread[0])
