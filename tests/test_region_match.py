"""Matches of regions: on their own plane and inside their own border, or none with the reason."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from scenery import Pair, Surface, make_camera, pixel_grid, render, tilted, turn, unit

from slopecli.look import (
    FINE,
    Images,
    Scene,
    build_scene,
    depth_cells,
    feature_matchers,
    find_motions,
    whole_grid,
)
from slopecli.patches import Patch, region_footprints
from slopecli.patches.regions import (
    REGION,
    Piece,
    lattice_of,
    match_labelled,
    match_regions,
    on_known_orientation,
    with_pixel_borders,
)
from slopecli.types import FloatArray

CELL = REGION.cell_px
R, T = turn(0.5, 1.0, 0.3), unit(1.0, 0.15, 0.05)
GROUND, WALL = tilted(0.0, -0.25, 8.0), np.array([0.1, 0.0, 0.1])
BARE = GROUND * 1.1
PLANES = [GROUND, WALL, BARE]
WALL_BOX, BARE_BOX = (260, 40, 130, 130), (100, 190, 110, 90)


@lru_cache(maxsize=1)
def seen() -> tuple[Pair, Scene, np.ndarray]:
    """Ground, a wall and a bare platform; what is known of the pair; the true label map."""
    surfaces = [Surface(GROUND), Surface(WALL, WALL_BOX), Surface(BARE, BARE_BOX, contrast=0.0)]
    pair = render(R, T, surfaces, camera1=make_camera(480, 360), noise=1.0)
    images = Images(pair.grey1, pair.grey2, pair.camera1, pair.camera2)
    sparse = find_motions(images, feature_matchers("sift"), 0)
    scene, _ = build_scene(images, sparse)
    labels = 1 + pair.surface_at(pixel_grid(480, 360).reshape(-1, 2)).reshape(360, 480)
    return pair, scene, labels.astype(np.int32)


def matched(labels: np.ndarray, planes: list[FloatArray] = PLANES) -> list[Patch]:
    _, scene, _ = seen()
    patches = [Patch(k, "region", footprint) for k, footprint in enumerate(region_footprints(labels, scene.shape1), 1)]
    return match_regions(labels, match_labelled(labels, planes, scene), patches, scene)


@pytest.mark.parametrize("off", [1.0, 1.015], ids=["true planes", "planes half a pixel off"])
def test_matches_are_where_the_surface_is_and_not_where_the_plane_sends_them(off: float) -> None:
    pair, _, labels = seen()
    for patch in matched(labels, [plane * off for plane in PLANES])[:2]:
        assert patch.origin == "own"
        assert np.median(pair.error_px(patch.matches.uv1, patch.matches.uv2)) < 0.06


def test_every_match_lies_inside_its_own_region() -> None:
    _, _, labels = seen()
    for number, patch in enumerate(matched(labels)[:2], 1):
        assert len(patch.matches.uv1) > 200
        for row, column in patch.cell:
            block = labels[row * CELL : (row + 1) * CELL, column * CELL : (column + 1) * CELL]
            assert (block == number).all()


def test_the_share_matched_is_that_of_the_region() -> None:
    wall = matched(seen()[2])[1]
    assert wall.share == pytest.approx(len(wall.matches.uv1) * CELL**2 / (WALL_BOX[2] * WALL_BOX[3]), abs=0.05)
    assert wall.share > 0.75


def test_a_bare_region_has_no_matches_and_the_reason() -> None:
    bare = matched(seen()[2])[2]
    assert bare.origin == "none"
    assert bare.code == "low-texture"
    assert "texture" in bare.reason


def test_a_region_a_cell_wide_leaves_its_tilt_open() -> None:
    _, _, labels = seen()
    strip = np.zeros_like(labels)
    strip[10 * CELL : 11 * CELL, 120:400] = 1
    (patch,) = matched(strip, [GROUND])
    assert patch.origin == "none"
    assert "line" in patch.reason


@pytest.mark.parametrize("size", [1.0, 2.0, 3.0])
def test_cells_are_no_worse_than_their_sigmas_say_whatever_the_size_of_image_2(size: float) -> None:
    other = make_camera(int(320 * size), int(240 * size))
    pair = render(R, T, [GROUND], camera1=make_camera(), camera2=other, noise=1.0)
    images = Images(pair.grey1, pair.grey2, pair.camera1, pair.camera2)
    sparse = find_motions(images, feature_matchers("sift"), 0)
    scene = replace(build_scene(images, sparse)[0], R=R, T=T)  # an error of the motion moves all cells alike
    grid = whole_grid(scene, FINE.max_pixels)
    lattice = lattice_of(depth_cells(scene, grid, CELL), grid.shape, scene)
    off = lattice.off(GROUND)[lattice.known]
    assert len(off) > 500
    assert 1.4826 * np.median(off) < 1.0


@pytest.mark.parametrize("explained", [True, False])
def test_borders_by_cells_move_to_an_edge_of_the_image_if_the_plane_explains_it(explained: bool) -> None:
    """A slanted edge between two surfaces, borders in steps of cells: with planes that fit, and with others."""
    x, y = pixel_grid(90, 90).transpose(2, 0, 1)
    true = 1 + (x + y / 3 > 60)
    grey = (80 * true + np.random.default_rng(0).normal(0, 2, true.shape)).astype(np.uint8)

    class Alike:
        def cost(self, plane: FloatArray, box: tuple[slice, slice]) -> FloatArray:
            return np.full(true[box].shape, 0.0 if explained else 9.0, np.float32)

    by_cells = true[CELL // 2 :: CELL, CELL // 2 :: CELL].repeat(CELL, 0).repeat(CELL, 1)
    found = with_pixel_borders(by_cells, grey, Alike(), [Piece(plane, 1.0, true > 0) for plane in PLANES])  # type: ignore[arg-type]
    assert np.array_equal(found == by_cells, found == found) != explained
    assert np.mean(found != true) <= (0.4 if explained else 1.0) * np.mean(by_cells != true)


def test_points_of_a_plane_that_ends_at_a_horizon_lie_in_image_2() -> None:
    _, scene, labels = seen()
    patch = Patch(1, "region", region_footprints(labels, scene.shape1)[0])
    found = on_known_orientation(patch, np.array([0.0, 0.1, 0.0025]), 0.1, scene)
    assert (found.origin, found.tilt_sigma_rad) == ("borrowed", 0.1)
    assert found.reason
    assert (found.matches.uv2 >= 0.0).all()
    assert (found.matches.uv2 < [480.0, 360.0]).all()
