"""Dense matches of all regions at once, image 2 pulled onto image 1 by the plane of each."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from slopecli.geometry.epipolar import homogeneous
from slopecli.geometry.metrics import normal_angle
from slopecli.geometry.motion import inverse_depth
from slopecli.look.dense import Cells, dense_cells
from slopecli.look.gradient_components import Labels, grown, resized
from slopecli.look.matches import Matches
from slopecli.look.scene import Scene, whole_grid
from slopecli.look.warp import NOWHERE, FloatImage, Grid, plane_transfer
from slopecli.patches.patch import Patch
from slopecli.patches.windows.matching import with_cells
from slopecli.types import FloatArray

MATCHED_PIXELS = 6.0e5  # of image 1 on which matches are measured
CELL = 6  # px of that grid: small enough to have several in a region of a thousandth of the image
LEAST_WIDTH = 1e-2  # smallest over largest spread of a region's matches: along a line they leave a tilt open
REACH_PX = 16.0  # of that grid around a region
SCARCE_SHARE, FAINT_SCORE = 0.3, 0.7  # a region matched over less, and agreeing less, leaves its plane open
REPEATED_PX = 0.03  # px of image 2
OWN_SHARE = 0.6  # of a cell that must lie in the region, and none of it in another


def match_labelled(labels: Labels, planes: list[FloatArray], scene: Scene) -> tuple[Labels, Cells]:
    """The labels on the grid matches are measured on, and matches of all its cells.

    Parameters
    ----------
    labels : (h, w) 1..k, 0 for none, of image 1 or of a smaller copy of it.
    planes : scaled normals (3,) of the k planes.
    """
    grid = whole_grid(scene, MATCHED_PIXELS)
    labels = resized(labels, grid.shape)
    # flow needs to see past a region's border, and over the holes in it
    mapping = _mapping(grid, grown(labels, REACH_PX), planes, scene)
    return labels, dense_cells(grid, mapping, scene.pyramid2, scene.shape2, CELL, finest=0)


def match_regions(labels: Labels, cells: Cells, patches: list[Patch], scene: Scene) -> list[Patch]:
    """The regions with the matches of the cells that lie inside them, or with none and the reason.

    patches : the regions 1, 2, ... of the label map, still without matches.
    """
    number = _own_label(labels, CELL)[tuple(cells.index.T)]
    return [_matched(patch, cells.take(number == patch.id), scene) for patch in patches]


def _mapping(grid: Grid, labels: Labels, planes: list[FloatArray], scene: Scene) -> FloatImage:
    """(h, w, 2) px of image 2 every pixel is sent to by its own plane."""
    rows, columns = np.nonzero(labels)
    uv1 = grid.full(np.column_stack([columns, rows]).astype(float))
    rays = homogeneous(scene.rays1(uv1))
    w = np.einsum("ni,ni->n", rays, np.array(planes)[labels[rows, columns] - 1])
    mapping = np.full((*grid.shape, 2), NOWHERE, np.float32)
    mapping[rows, columns] = plane_transfer(rays @ scene.R.T, w, scene.R @ scene.T, scene.pixels2)
    return mapping


def _own_label(labels: Labels, cell: int) -> NDArray[np.int32]:
    """(h // cell, w // cell) label of the cells most of which lie on one plane, 0 for the others."""
    rows, columns = labels.shape[0] // cell, labels.shape[1] // cell
    blocks = labels[: rows * cell, : columns * cell].reshape(rows, cell, columns, cell)
    most = blocks.max((1, 3))
    share = (blocks == most[:, None, :, None]).mean((1, 3))
    mixed = blocks.min((1, 3), where=blocks > 0, initial=np.iinfo(np.int32).max) != most
    return np.where((share > OWN_SHARE) & ~mixed, most, 0)


def _matched(patch: Patch, cells: Cells, scene: Scene) -> Patch:
    possible = patch.footprint.area_px * (cells.pixel_scale / CELL) ** 2
    matched = with_cells(patch, cells, scene, max(1.0, possible))
    if matched.origin == "none":
        return patch.unmatched("too little texture: few of its pixels can be matched")
    if not _spread(matched.matches.x1):
        return patch.unmatched("its matches lie on a line, so they leave its tilt open")
    if matched.share < SCARCE_SHARE and matched.score < FAINT_SCORE:
        return patch.unmatched("too little texture: few of its pixels can be matched, and those agree poorly")
    return replace(matched, tilt_sigma_rad=matched.tilt_sigma_rad + _repeated_rad(matched.matches, scene))


def _repeated_rad(matches: Matches, scene: Scene) -> float:
    """1-sigma of the tilt that flow leaves as it was: on faint texture it repeats the plane it started from.

    Matches that drift by REPEATED_PX along either axis of the region tilt its plane by this much, though its residuals
    show nothing of it.
    """
    w, leverage = inverse_depth(scene.R, scene.T, matches.x1, matches.x2)
    rays = homogeneous(matches.x1)
    rows = rays * leverage[:, None]
    normal = np.asarray(np.linalg.lstsq(rows, w * leverage, rcond=None)[0], float)
    centred = matches.x1 - matches.x1.mean(0)
    drift = centred @ np.linalg.svd(centred, full_matrices=False)[2].T
    drift *= REPEATED_PX / scene.camera2.focal_px / drift.std(0)
    tilts = np.asarray(np.linalg.lstsq(rows, drift, rcond=None)[0].T, float)
    return float(np.hypot(*(normal_angle(normal, normal + tilt) for tilt in tilts)))


def _spread(x1: FloatArray) -> bool:
    """Whether points (n, 2) span an area."""
    spread = np.linalg.svd(x1 - x1.mean(0), compute_uv=False)
    return bool(len(x1) >= 3 and spread[-1] > LEAST_WIDTH * spread[0])
