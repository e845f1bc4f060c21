"""Planes of surfaces without matches: the orientation of another plane of the pair, or none."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scenery import Surface, make_camera, render, tilted, turn, unit

from slopecli.geometry import normal_angle
from slopecli.look import (
    FINE,
    Comparison,
    Images,
    Scene,
    adaptive_threshold,
    build_scene,
    feature_matchers,
    find_motions,
    smooth_gradient,
    whole_grid,
)
from slopecli.options import Options
from slopecli.patches.regions import (
    REGION,
    BorderCost,
    CellLattice,
    KnownTilt,
    Piece,
    find_blank_planes,
    label_cells,
    region_stages,
)
from slopecli.types import BoolArray, FloatArray

WALL, OTHER = np.array([0.5, 0.0, 0.8]) / 6, np.array([-0.3, 0.2, 0.9]) / 5
BARE_BOX = (210, 40, 200, 250)


@cache
def seen(normal: tuple[float, float, float], contrast: float) -> tuple[Scene, CellLattice, list[Piece], BoolArray]:
    """A faint surface beside ground and a textured wall, without its matches; the pieces beside it, its pixels."""
    x, y, w, h = BARE_BOX
    faint = Surface(np.array(normal), BARE_BOX, contrast=contrast)
    surfaces = [Surface(tilted(0.0, -0.25, 8.0)), Surface(WALL, (10, 10, 130, 220)), faint]
    pair = render(turn(0.5, 1, 0.3), unit(1, 0.15, 0.05), surfaces, camera1=make_camera(480, 360), noise=1.0)
    images = Images(pair.grey1, pair.grey2, pair.camera1, pair.camera2)
    scene, _ = build_scene(images, find_motions(images, feature_matchers("sift"), 0))
    stages, own = region_stages(scene, Options(planes="regions")), np.zeros(pair.grey1.shape, bool)
    own[y : y + h, x : x + w] = True
    on_it = middles(own)
    others = [piece for piece in stages.merged if not (piece.cells & on_it).any()]
    assert min(normal_angle(piece.plane, WALL) for piece in others) < 0.01
    return scene, replace(stages.lattice, known=stages.lattice.known & ~on_it), others, own


def middles(mask: BoolArray) -> BoolArray:
    return mask[REGION.cell_px // 2 :: REGION.cell_px, REGION.cell_px // 2 :: REGION.cell_px]


def answer(normal: FloatArray, contrast: float, beyond: int = 0) -> list[KnownTilt]:
    """What is found of the faint surface; its component flows over to the ground around, so many pixels to the left."""
    x, y, z = normal.tolist()
    scene, lattice, others, own = seen((x, y, z), contrast)
    component = own.astype(np.int32)
    component[:, BARE_BOX[0] - beyond :] |= beyond > 0
    cells = (middles(component > 0) & ~middles(own)).astype(np.int32)
    view = scene.view(whole_grid(scene, FINE.max_pixels))
    return find_blank_planes(cells, component, others, lattice, view, scene, least=100.0)


def test_a_faint_wall_has_the_orientation_of_another_at_its_own_distance() -> None:
    farther = 0.8 * WALL
    (found,) = answer(farther, 0.03)
    assert normal_angle(found.piece.plane, farther) < max(3.0 * found.sigma_rad, 0.003)
    assert found.sigma_rad < np.radians(1.0)
    assert np.linalg.norm(found.piece.plane) == pytest.approx(np.linalg.norm(farther), rel=0.01)


def test_a_component_that_flows_over_to_another_plane_has_one_where_it_is_blank() -> None:
    (alone,), (found,) = answer(0.8 * WALL, 0.03), answer(0.8 * WALL, 0.03, beyond=18)
    assert normal_angle(found.piece.plane, 0.8 * WALL) < max(3.0 * found.sigma_rad, 0.003)
    np.testing.assert_array_equal(found.piece.cells, alone.piece.cells)


def test_a_surface_that_is_tilted_otherwise_than_all_others_has_none() -> None:
    assert answer(OTHER, 0.1) == []


def test_a_surface_without_any_texture_has_none() -> None:
    assert answer(0.8 * WALL, 0.0) == []


def test_a_plane_goes_on_where_unmatched_texture_bears_it_out_and_not_on_another_surface() -> None:
    scene, lattice, (wall,), own = seen((0.8 * WALL[0], 0.0, 0.8 * WALL[2]), 0.03)
    lower, beside = np.zeros(own.shape, bool), np.zeros(own.shape, bool)
    lower[186:204, 24:126], beside[24:216, 150:168] = True, True
    on_wall, on_ground = middles(lower), middles(beside)
    lattice = replace(lattice, known=lattice.known & ~on_wall & ~on_ground)
    grid = whole_grid(scene, FINE.max_pixels)
    gradient = smooth_gradient(grid.grey)
    comparison = Comparison(scene.view(grid), (scene.camera1.focal_px, scene.camera2.focal_px))
    borders, none = BorderCost.along_edges(gradient, adaptive_threshold(gradient)), np.zeros(own.shape, np.int32)
    labels, apart = label_cells(comparison, lattice, [replace(wall, cells=wall.cells & ~on_wall)], borders, none)
    assert ((labels + apart)[on_wall] == 1).mean() > 0.9
    assert (apart[on_wall] == 1).mean() > 0.25
    assert (labels + apart)[on_ground].max() == 0
