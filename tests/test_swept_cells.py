"""Surfaces far off the depth of the matches around them: found by a sweep of planes."""

from __future__ import annotations

from functools import cache

import numpy as np
from scenery import Surface, make_camera, render, turn, unit

from slopecli.geometry import homogeneous, inverse_depth, rays_from_pixels
from slopecli.look import (
    FINE,
    Cells,
    Images,
    Scene,
    build_scene,
    depth_cells,
    feature_matchers,
    find_motions,
    whole_grid,
)
from slopecli.patches.regions import REGION, lattice_of, with_swept_cells
from slopecli.types import BoolArray, FloatArray

LEFT, RIGHT = np.array([0.5, 0.0, 0.8]) / 6, np.array([-0.6, 0.0, 0.7]) / 6
GROUND = np.array([0.0, 0.45, 0.0])  # perpendicular to both walls, near the camera
BOX = (120, 270, 240, 90)


@cache
def seen(contrast: float) -> tuple[Scene, Cells, BoolArray]:
    """Two walls and ground in front of them, without the matches of the ground; where it is, by cell."""
    surfaces = [Surface(LEFT), Surface(RIGHT, (240, 0, 240, 360)), Surface(GROUND, BOX, contrast=contrast)]
    pair = render(turn(0.5, 1, 0.3), unit(1, 0.15, 0.05), surfaces, camera1=make_camera(480, 360), noise=1.0)
    scene, _ = build_scene(
        images := Images(pair.grey1, pair.grey2, pair.camera1, pair.camera2),
        find_motions(images, feature_matchers("sift"), 0),
    )
    cells = depth_cells(scene, whole_grid(scene, FINE.max_pixels), REGION.cell_px)
    x, y, w, h = (side // REGION.cell_px for side in BOX)
    ground = np.zeros((360 // REGION.cell_px, 480 // REGION.cell_px), bool)
    ground[y : y + h, x : x + w] = True
    return scene, cells.take(~ground[tuple(cells.index.T)]), ground


def swept(contrast: float) -> tuple[Scene, Cells, Cells, BoolArray]:
    """The scene, its cells without those of the ground, and with those that the sweep finds; the ground."""
    scene, cells, ground = seen(contrast)
    grid = whole_grid(scene, FINE.max_pixels)
    lattice = lattice_of(cells, grid.shape, scene)
    found = with_swept_cells(cells, lattice, np.zeros(grid.shape, np.int32), scene, grid)
    return scene, cells, found, ground


def off_px(cells: Cells, scene: Scene, plane: FloatArray) -> FloatArray:
    """Distance (n,) of matches from a plane along their epipolar lines, px."""
    x1, x2 = (rays_from_pixels(camera, uv) for camera, uv in ((scene.camera1, cells.uv1), (scene.camera2, cells.uv2)))
    w, leverage = inverse_depth(scene.R, scene.T, x1, x2)
    return np.abs(w - homogeneous(x1) @ plane) * leverage * scene.camera2.focal_px


def test_ground_in_front_of_walls_is_matched_though_it_lies_far_off_their_depth() -> None:
    scene, cells, found, ground = swept(1.0)
    own = found.take(ground[tuple(found.index.T)])
    assert len(own) > 0.7 * ground.sum()
    assert np.quantile(off_px(own, scene, GROUND), 0.9) < 0.5
    assert np.median(off_px(own, scene, LEFT)) > 8.0
    assert len(np.unique(found.index, axis=0)) == len(found)  # a cell has one match
    beside = ~ground[tuple(found.index.T)]
    assert beside.sum() >= 0.99 * len(cells)


def test_ground_without_texture_is_left_without_matches() -> None:
    _, cells, found, _ = swept(0.0)
    assert found is cells
