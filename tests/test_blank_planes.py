"""Planes of surfaces without matches: the orientation of another plane of the pair, or none."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scenery import Surface, make_camera, render, tilted, turn, unit

from slopecli.geometry import normal_angle
from slopecli.look import FINE, Images, build_scene, feature_matchers, find_motions, whole_grid
from slopecli.options import Options
from slopecli.patches.regions import REGION, KnownTilt, find_blank_planes, region_stages
from slopecli.types import FloatArray

WALL, OTHER = np.array([0.5, 0.0, 0.8]) / 6, np.array([-0.3, 0.2, 0.9]) / 5
BARE_BOX = (210, 40, 200, 250)


@cache
def answered(normal: tuple[float, float, float], contrast: float) -> list[KnownTilt]:
    """What is found of a faint surface beside ground and a textured wall, all matches on it left out."""
    x, y, w, h = BARE_BOX
    faint = Surface(np.array(normal), BARE_BOX, contrast=contrast)
    surfaces = [Surface(tilted(0.0, -0.25, 8.0)), Surface(WALL, (10, 10, 130, 220)), faint]
    pair = render(turn(0.5, 1, 0.3), unit(1, 0.15, 0.05), surfaces, camera1=make_camera(480, 360), noise=1.0)
    images = Images(pair.grey1, pair.grey2, pair.camera1, pair.camera2)
    scene, _ = build_scene(images, find_motions(images, feature_matchers("sift"), 0))
    stages, component = region_stages(scene, Options(planes="regions")), np.zeros(pair.grey1.shape, np.int32)
    component[y : y + h, x : x + w] = 1
    lattice, side = stages.lattice, REGION.cell_px
    on_it = component[side // 2 :: side, side // 2 :: side] > 0
    others = [piece for piece in stages.merged if not (piece.cells & on_it).any()]
    assert min(normal_angle(piece.plane, WALL) for piece in others) < 0.01
    lattice, cells = replace(lattice, known=lattice.known & ~on_it), np.zeros(lattice.shape, np.int32)
    view = scene.view(whole_grid(scene, FINE.max_pixels))
    return find_blank_planes(cells, component, others, lattice, view, scene, least=100.0)


def answer(normal: FloatArray, contrast: float) -> list[KnownTilt]:
    x, y, z = normal.tolist()
    return answered((x, y, z), contrast)


def test_a_faint_wall_has_the_orientation_of_another_at_its_own_distance() -> None:
    farther = 0.8 * WALL
    (found,) = answer(farther, 0.03)
    assert normal_angle(found.piece.plane, farther) < max(3.0 * found.sigma_rad, 0.003)
    assert found.sigma_rad < np.radians(1.0)
    assert np.linalg.norm(found.piece.plane) == pytest.approx(np.linalg.norm(farther), rel=0.01)


def test_a_surface_that_is_tilted_otherwise_than_all_others_has_none() -> None:
    assert answer(OTHER, 0.1) == []


def test_a_surface_without_any_texture_has_none() -> None:
    assert answer(0.8 * WALL, 0.0) == []
