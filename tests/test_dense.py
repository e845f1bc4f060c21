"""Dense matches in cells: where they lie, what they claim to know, and what they refuse to say."""

from __future__ import annotations

import numpy as np
import pytest
from scenery import Pair, Surface, make_camera, pixel_grid, render, texture_at, tilted, to_grey, turn, unit

from slopecli.look import (
    Cells,
    Grey,
    Grid,
    Layer,
    Pyramid,
    Transfer,
    block_sum,
    covered,
    dense_cells,
    flow,
    match_exposure,
    shrink,
    transfer_map,
)
from slopecli.types import FloatArray

R, T, GROUND = turn(1, -2, 3), unit(0.8, 0.2, 0.4), tilted(0.2, -0.1)
CELL = 8
FULL = np.ones(2)


@pytest.fixture(scope="module")
def plane() -> Pair:
    return render(R, T, [GROUND])


def cells_of(
    pair: Pair,
    off_px: tuple[float, float] = (0.0, 0.0),
    *,
    cell: int = CELL,
    finest: int = 0,
    layer: Layer | None = None,
    guide: Transfer | None = None,
) -> Cells:
    """Cells of a pair, guided by the truth or by `guide`, wrong by `off_px` everywhere."""
    layer = layer or Layer(pair.grey1, FULL)
    grid = Grid(layer.grey, 0, 0, layer.scale)
    mapping = transfer_map(grid, lambda uv: (guide or pair.transfer)(uv) + np.array(off_px))
    return dense_cells(grid, mapping, Pyramid(pair.grey2), pair.grey2.shape, cell, finest)


def offsets(pair: Pair, cells: Cells) -> FloatArray:
    return cells.uv2 - pair.transfer(cells.uv1)


def percentile(error: FloatArray, q: float) -> float:
    return float(np.percentile(np.linalg.norm(error, axis=1), q))


def self_match(grey: Grey, cell: int = 16) -> Cells:
    grid = Grid(grey, 0, 0, FULL)
    return dense_cells(grid, transfer_map(grid, lambda uv: uv), Pyramid(grey), grey.shape, cell, 0)


@pytest.mark.parametrize("off_px", [(0.0, 0.0), (1.5, -1.0), (4.0, -3.0)])
@pytest.mark.parametrize(("finest", "margins_px"), [(0, (0.03, 0.06)), (1, (0.05, 0.15))])
def test_cells_are_matched_to_hundredths_of_a_pixel(
    plane: Pair, off_px: tuple[float, float], finest: int, margins_px: tuple[float, float]
) -> None:
    cells = cells_of(plane, off_px, finest=finest)
    error = offsets(plane, cells)
    assert len(cells) > 800  # of 1200, the others out of view
    assert percentile(error, 50) < margins_px[0]
    assert percentile(error, 95) < margins_px[1]
    assert np.abs(error.mean(0)).max() < 0.02


def test_two_grey_levels_of_noise_cost_hundredths_of_a_pixel() -> None:
    pair = render(R, T, [GROUND], noise=2.0)
    assert percentile(offsets(pair, cells_of(pair, (1.5, -1.0))), 50) < 0.04


@pytest.mark.parametrize(("gain", "offset"), [(0.5, 20.0), (1.5, -60.0), (1.0, 40.0)])
def test_gain_and_offset_of_the_grey_values_do_not_count(plane: Pair, gain: float, offset: float) -> None:
    other = render(R, T, [GROUND], gain=gain, offset=offset)
    cells = cells_of(other, (1.5, -1.0))
    assert len(cells) > 0.98 * len(cells_of(plane, (1.5, -1.0)))
    assert percentile(offsets(other, cells), 50) < 0.03
    assert np.median(cells.agreement) > 0.98


def test_ground_with_relief_is_followed() -> None:
    waves = Surface(tilted(0, 0), bump=lambda uv: 0.01 * np.sin(uv[:, 0] / 25) * np.cos(uv[:, 1] / 30))
    pair = render(R, T, [waves])
    flat = render(R, T, [tilted(0, 0)])
    cells = cells_of(pair, guide=flat.transfer)
    assert np.linalg.norm(pair.transfer(cells.uv1) - flat.transfer(cells.uv1), axis=1).max() > 2.0
    assert percentile(offsets(pair, cells), 50) < 0.04


def test_a_distorting_lens_is_followed() -> None:
    camera = make_camera(model="brown", distortion=(-0.25, 0.08, 0.001, -0.001))
    pair = render(R, T, [GROUND], camera1=camera)
    assert percentile(offsets(pair, cells_of(pair)), 50) < 0.03


def test_matches_of_a_shrunken_image_are_full_pixels_without_shift() -> None:
    pair = render(R, T, [GROUND], camera1=make_camera(1001, 777), coarseness=2.0)
    layer = Layer(*shrink(pair.grey1, 2e5))
    cells = cells_of(pair, layer=layer)
    error = offsets(pair, cells)
    assert cells.pixel_scale == pytest.approx(0.507, abs=0.001)
    assert cells.uv1.max() > 900
    assert percentile(error, 50) < 0.03
    assert np.abs(error.mean(0)).max() < 0.02  # px of the full image


@pytest.mark.parametrize("direction", [(1, 0, 0), (-1, 0, 0), (0, 1, 0)])
def test_what_something_nearer_hides_is_not_matched(direction: tuple[float, float, float]) -> None:
    towards = unit(*direction)
    ground = render(turn(), towards, [tilted(0, 0)])
    pair = render(turn(), towards, [tilted(0, 0), Surface(tilted(0, 0, 4.5), (110, 70, 100, 100))])
    cells = cells_of(pair, cell=4, guide=ground.transfer)
    hidden = pair.hidden(pixel_grid(320, 240).reshape(-1, 2)).reshape(240, 320)
    wholly_hidden = block_sum(hidden.astype(np.float32), 4) == 16
    matched = np.zeros(wholly_hidden.shape, bool)
    matched[cells.index[:, 0], cells.index[:, 1]] = True
    assert wholly_hidden.sum() > 40
    assert matched[wholly_hidden].mean() < 0.05
    # what stands beside it, and the nearer thing itself, 15 px from where the guide has it, is matched
    error = pair.error_px(cells.uv1, cells.uv2)
    assert np.mean(error < 0.2) > 0.97
    assert matched[25:34, 33:45].mean() > 0.9


def test_what_image_2_does_not_show_is_not_matched(plane: Pair) -> None:
    cells = cells_of(plane)
    grid = Grid(plane.grey1, 0, 0, FULL)
    seen = covered(transfer_map(grid, plane.transfer), plane.grey2.shape, margin=0.0)
    outside = block_sum(seen.astype(np.float32), CELL) == 0
    matched = np.zeros(outside.shape, bool)
    matched[cells.index[:, 0], cells.index[:, 1]] = True
    assert outside.sum() > 50
    assert not matched[outside].any()


def test_other_ground_hardly_matches(plane: Pair) -> None:
    other = render(R, T, [GROUND], seed=5)
    mixed = Pair(plane.grey1, other.grey2, plane.camera1, plane.camera2, R, T, plane.surfaces)
    cells = cells_of(mixed)
    assert np.sum(cells.agreement > 0.8) < 0.05 * len(cells_of(plane))


def test_texture_alike_in_all_directions_informs_alike() -> None:
    values = 35 * texture_at(pixel_grid(256, 256))
    cells = self_match(to_grey(128 + values), cell=32)
    gy, gx = np.gradient(values)
    mean = cells.information.mean(0)
    assert mean[0, 0] == pytest.approx(mean[1, 1], rel=0.1)
    assert abs(mean[0, 1]) < 0.05 * mean[0, 0]
    # summed over the pixels of a cell, in grey levels per pixel; the operator smooths a little
    assert mean[0, 0] / 32**2 == pytest.approx((gx**2 + gy**2).mean() / 2, rel=0.2)


@pytest.mark.parametrize("angle_deg", [0.0, 53.0, 90.0])
def test_stripes_inform_across_and_not_along(angle_deg: float) -> None:
    across = np.array([np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))])
    cells = self_match(to_grey(128 + 40 * np.sin(2 * np.pi / 9 * pixel_grid(128, 128) @ across)))
    values, vectors = np.linalg.eigh(cells.information)
    assert (values[:, 0] < 0.002 * values[:, 1]).all()
    assert (np.abs(vectors[:, :, 1] @ across) > 0.999).all()


def test_bare_ground_informs_of_nothing() -> None:
    cells = self_match(np.full((64, 64), 90, np.uint8))
    assert cells.information.max(initial=0.0) == 0.0
    assert cells.agreement.max(initial=0.0) == 0.0


def test_cells_know_their_place_and_share(plane: Pair) -> None:
    cells = cells_of(plane)
    middle = cells.index[:, ::-1] * CELL + (CELL - 1) / 2
    whole = cells.share == 1.0
    assert whole.mean() > 0.9
    np.testing.assert_allclose(cells.uv1[whole], middle[whole], atol=1e-4)
    assert np.abs(cells.uv1 - middle).max() <= CELL / 3
    assert cells.share.min() >= 1 / 3
    assert len(np.unique(cells.index, axis=0)) == len(cells)


def test_some_cells_can_be_taken(plane: Pair) -> None:
    cells = cells_of(plane)
    keep = cells.uv1[:, 0] > 150
    taken = cells.take(keep)
    assert len(taken) == keep.sum()
    assert taken.pixel_scale == cells.pixel_scale
    for name in ("uv1", "uv2", "information", "index", "share", "agreement"):
        assert np.array_equal(getattr(taken, name), getattr(cells, name)[keep])


@pytest.mark.parametrize("shape", [(16, 16), (24, 300), (31, 1000), (300, 24)])
def test_narrow_strips_are_measured(shape: tuple[int, int]) -> None:
    """OpenCV reads beyond an image of fewer rows than its patches have at the finest scale, and ends the process."""
    grey = np.random.default_rng(2).integers(0, 256, shape).astype(np.uint8)
    assert np.abs(flow(grey, grey, finest=2)).max() < 0.1


def test_same_images_same_cells(plane: Pair) -> None:
    first, second = cells_of(plane, (1.5, -1.0)), cells_of(plane, (1.5, -1.0))
    assert np.array_equal(first.uv2, second.uv2)


@pytest.mark.parametrize(("gain", "offset"), [(0.6, 40.0), (1.6, -70.0)])
def test_exposure_is_matched_where_both_are_seen(gain: float, offset: float) -> None:
    grey = to_grey(128 + 25 * texture_at(pixel_grid(100, 80)))
    valid = np.ones(grey.shape, bool)
    valid[:, 50:] = False
    pulled = (gain * grey + offset).astype(np.float32)
    pulled[:, 50:] = 255.0
    assert np.abs(match_exposure(pulled, grey, valid)[:, :50].astype(float) - grey[:, :50]).max() <= 1


def test_exposure_of_hardly_any_pixels_is_left_alone() -> None:
    pulled = np.full((20, 20), 77.4, np.float32)
    matched = match_exposure(pulled, np.full((20, 20), 200, np.uint8), np.zeros((20, 20), bool))
    assert (matched == 77).all()
