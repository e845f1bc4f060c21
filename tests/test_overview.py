"""The overview: all of image 1 matched from a handful of sparse matches."""

from __future__ import annotations

import numpy as np
import pytest
from scenery import Pair, Surface, make_camera, pixel_grid, render, tilted, turn, unit

from slopecli.look import Cells, Layer, Pyramid, overview_cells, shrink, sparse_transfer
from slopecli.types import FloatArray

R, T, GROUND = turn(1, -2, 3), unit(0.8, 0.2, 0.4), tilted(0.2, -0.1)
EDGE_PX = 2


@pytest.fixture(scope="module")
def plane() -> Pair:
    return render(R, T, [GROUND])


def sparse(pair: Pair, n: int, noise_px: float = 0.1) -> tuple[FloatArray, FloatArray]:
    """n matches (n, 2) of what both images show, as sparse features would give them."""
    rng = np.random.default_rng(0)
    size1, size2 = (np.array([c.width, c.height]) - 1 for c in (pair.camera1, pair.camera2))
    uv1 = rng.uniform([0, 0], size1, (3 * n + 20, 2))
    uv2 = pair.transfer(uv1)
    shown = ((uv2 > EDGE_PX) & (uv2 < size2 - EDGE_PX)).all(1) & ~pair.hidden(uv1)
    return uv1[shown][:n], (uv2 + noise_px * rng.standard_normal(uv2.shape))[shown][:n]


def overview(pair: Pair, n: int, noise_px: float = 0.1, max_pixels: float = 1e6) -> Cells:
    layer = Layer(*shrink(pair.grey1, max_pixels))
    return overview_cells(layer, Pyramid(pair.grey2), pair.grey2.shape, *sparse(pair, n, noise_px))


@pytest.mark.parametrize("n", [200, 30, 8])
def test_a_handful_of_matches_is_enough_for_a_plane(plane: Pair, n: int) -> None:
    cells = overview(plane, n)
    error = plane.error_px(cells.uv1, cells.uv2)
    assert len(cells) > 800  # of 1200, the others out of view
    assert np.median(error) < 0.03
    assert np.mean(error < 0.3) > 0.98


def test_matches_wrong_by_a_pixel_do_no_harm(plane: Pair) -> None:
    cells = overview(plane, 200, noise_px=1.0)
    assert np.median(plane.error_px(cells.uv1, cells.uv2)) < 0.08


def test_relief_far_beyond_a_homography_is_followed() -> None:
    waves = Surface(tilted(0, 0), bump=lambda uv: 0.03 * np.sin(uv[:, 0] / 40) * np.cos(uv[:, 1] / 50))
    pair = render(R, T, [waves])
    flat = render(R, T, [tilted(0, 0)])
    cells = overview(pair, 300)
    error = pair.error_px(cells.uv1, cells.uv2)
    assert np.linalg.norm(pair.transfer(cells.uv1) - flat.transfer(cells.uv1), axis=1).max() > 7
    assert np.median(error) < 0.08
    assert np.mean(error < 0.3) > 0.93


def test_both_sides_of_a_step_are_matched_and_most_of_its_rim_is_not() -> None:
    pair = render(R, T, [tilted(0.1, 0), Surface(tilted(0, 0, 4.2), (110, 70, 100, 100))])
    cells = overview(pair, 300)
    error = pair.error_px(cells.uv1, cells.uv2)
    inside = (np.abs(cells.uv1 - [159.5, 119.5]) < 36).all(1)
    outside = (np.abs(cells.uv1 - [159.5, 119.5]) > 74).any(1)
    assert inside.sum() > 50
    assert np.median(error[inside]) < 0.3  # of a disparity 24 px off that of the ground
    assert np.median(error[outside]) < 0.08
    assert np.mean(error > 1.0) < 0.15


def test_a_shrunken_overview_answers_in_full_pixels() -> None:
    pair = render(R, T, [GROUND], camera1=make_camera(1001, 777), coarseness=2.0)
    cells = overview(pair, 200, max_pixels=2e5)
    error = pair.error_px(cells.uv1, cells.uv2)
    assert len(cells) > 2000
    assert np.median(error) < 0.05
    assert np.abs((cells.uv2 - pair.transfer(cells.uv1))[error < 0.3].mean(0)).max() < 0.02


def test_gain_and_offset_of_the_grey_values_do_not_count() -> None:
    pair = render(R, T, [GROUND], gain=0.5, offset=20)
    cells = overview(pair, 60)
    assert len(cells) > 800
    assert np.median(pair.error_px(cells.uv1, cells.uv2)) < 0.03


def test_a_map_through_exact_matches_of_a_plane_is_that_plane(plane: Pair) -> None:
    transfer = sparse_transfer(*sparse(plane, 40, noise_px=0.0), np.ones(2), (240, 320))
    everywhere = pixel_grid(320, 240)[::6, ::6].reshape(-1, 2)
    assert np.linalg.norm(transfer(everywhere) - plane.transfer(everywhere), axis=1).max() < 0.01


def test_a_map_off_its_homography_passes_near_its_matches() -> None:
    waves = Surface(tilted(0, 0), bump=lambda uv: 0.03 * np.sin(uv[:, 0] / 40) * np.cos(uv[:, 1] / 50))
    pair = render(R, T, [waves])
    uv1, uv2 = sparse(pair, 400)
    transfer = sparse_transfer(uv1, uv2, np.ones(2), (240, 320))
    missed = np.linalg.norm(transfer(uv1) - uv2, axis=1)
    assert np.median(missed) < 0.8  # flow does the rest
    assert missed.max() < 5


def test_a_map_does_not_depend_on_how_far_image_1_is_shrunken(plane: Pair) -> None:
    uv1, uv2 = sparse(plane, 40)
    full = sparse_transfer(uv1, uv2, np.ones(2), (240, 320))
    half = sparse_transfer(uv1, uv2, np.array([0.5, 0.5]), (120, 160))
    at = pixel_grid(320, 240)[::12, ::12].reshape(-1, 2)
    assert np.linalg.norm(full(at) - half(at), axis=1).max() < 0.3
