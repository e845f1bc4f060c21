"""Working grids and maps: points stay where they are, and image 2 pulled through the truth looks like image 1."""

from __future__ import annotations

import numpy as np
import pytest
from scenery import Pair, make_camera, render, tilted, to_grey, turn, unit

from slopecli.look import (
    Grid,
    Layer,
    Pyramid,
    block_sum,
    covered,
    cut,
    magnification,
    resample,
    sample_map,
    shrink,
    transfer_map,
)
from slopecli.types import FloatArray

R, T, GROUND = turn(1, -2, 3), unit(0.8, 0.2, 0.4), tilted(0.2, -0.1)
BROWN = make_camera(model="brown", distortion=(-0.25, 0.08, 0.001, -0.001))
FULL = np.ones(2)


@pytest.fixture(scope="module")
def plane() -> Pair:
    return render(R, T, [GROUND])


def whole(grey: np.ndarray) -> Grid:
    return Grid(grey, 0, 0, FULL)


def points_of(grid: Grid) -> FloatArray:
    y, x = np.mgrid[: grid.shape[0], : grid.shape[1]]
    return np.stack([x, y], -1).reshape(-1, 2).astype(float)


def test_grid_and_full_pixels_convert_back_and_forth() -> None:
    grid = Grid(np.zeros((60, 80), np.uint8), 13, 7, np.array([0.4995, 0.5004]))
    points = np.random.default_rng(0).uniform(-5, 90, (50, 2))
    np.testing.assert_allclose(grid.inside(grid.full(points)), points, atol=1e-12)
    assert grid.inside(grid.full(points.reshape(5, 10, 2))).shape == (5, 10, 2)


@pytest.mark.parametrize("limit", [1e6, 2e4])
def test_a_cut_shows_what_image_1_shows_there(plane: Pair, limit: float) -> None:
    layer = Layer(*shrink(plane.grey1, limit))
    grid = cut(layer, 100, 60, 80, 40)
    whole_of_layer = Grid(layer.grey, 0, 0, layer.scale)
    at = np.round(whole_of_layer.inside(grid.full(points_of(grid)))).astype(int)
    assert np.array_equal(layer.grey[at[:, 1], at[:, 0]], grid.grey.ravel())


@pytest.mark.parametrize("limit", [1e6, 2e4])
@pytest.mark.parametrize("box", [(100, 60, 80, 40), (101, 63, 77, 41), (-30, -20, 60, 50), (300, 200, 90, 90)])
def test_a_cut_holds_its_rectangle_and_little_more(plane: Pair, box: tuple[int, int, int, int], limit: float) -> None:
    layer = Layer(*shrink(plane.grey1, limit))
    x, y, w, h = box
    grid = cut(layer, x, y, w, h)
    low, high = grid.full(np.array([-0.5, -0.5])), grid.full(np.array([grid.shape[1] - 0.5, grid.shape[0] - 0.5]))
    wanted_low, wanted_high = np.maximum([x, y], 0) - 0.5, np.minimum([x + w, y + h], [320, 240]) - 0.5
    more = 1 / layer.scale + 1e-9
    assert ((low <= wanted_low + 1e-9) & (low > wanted_low - more)).all()
    assert ((high >= wanted_high - 1e-9) & (high < wanted_high + more)).all()


@pytest.mark.parametrize("side", [40, 77])
def test_a_cut_averaged_down_shows_things_where_they_are(side: int) -> None:
    y, x = np.mgrid[:240, :320]
    blob = to_grey(220 * np.exp(-((x - 171.4) ** 2 + (y - 96.7) ** 2) / (2 * 9**2)))
    grid = cut(Layer(blob, FULL), 101, 53, 130, 80, side)
    weight = grid.grey.ravel().astype(float)
    middle = (grid.full(points_of(grid)) * weight[:, None]).sum(0) / weight.sum()
    assert grid.shape[1] == side
    np.testing.assert_allclose(middle, [171.4, 96.7], atol=0.05)
    np.testing.assert_allclose(grid.inside(grid.full(points_of(grid))), points_of(grid), atol=1e-9)


@pytest.mark.parametrize("camera", [make_camera(), BROWN], ids=["pinhole", "brown"])
@pytest.mark.parametrize("limit", [1e6, 2e4])
def test_maps_follow_the_truth_to_hundredths_of_a_grid_pixel(camera: object, limit: float) -> None:
    pair = render(R, T, [GROUND], camera1=camera)  # type: ignore[arg-type]
    grid = cut(Layer(*shrink(pair.grey1, limit)), 20, 10, 250, 200)
    mapping = transfer_map(grid, pair.transfer)
    truth = pair.transfer(grid.full(points_of(grid))).reshape(*grid.shape, 2)
    assert mapping.shape == truth.shape
    assert np.abs(mapping - truth).max() * grid.scale.min() < 0.06  # at the corners of the worst lens
    assert np.abs(mapping - truth).mean() * grid.scale.min() < 0.01


@pytest.mark.parametrize("shape", [(8, 8), (9, 17), (1, 1), (23, 5)])
def test_grids_of_any_size_are_mapped(shape: tuple[int, int]) -> None:
    grid = whole(np.zeros(shape, np.uint8))
    mapping = transfer_map(grid, lambda uv: 1.1 * uv + [3.0, -2.0])
    truth = (1.1 * points_of(grid) + [3.0, -2.0]).reshape(*shape, 2)
    np.testing.assert_allclose(mapping, truth, atol=1e-5)


def test_maps_are_sampled_between_pixels_without_loss() -> None:
    grid = whole(np.zeros((50, 70), np.uint8))
    mapping = transfer_map(grid, lambda uv: uv @ np.array([[1.1, 0.1], [-0.2, 0.9]]) + [300.0, -200.0])
    at = np.random.default_rng(0).uniform([0, 0], [69, 49], (100, 2))
    np.testing.assert_allclose(
        sample_map(mapping, at), at @ np.array([[1.1, 0.1], [-0.2, 0.9]]) + [300.0, -200.0], atol=1e-4
    )


def test_going_through_a_map_and_back_ends_where_it_began(plane: Pair) -> None:
    forward = transfer_map(whole(plane.grey1), plane.transfer)
    at = np.random.default_rng(0).uniform([10, 10], [309, 229], (200, 2))
    back_R, back_T = R.T, -R @ T
    rays2 = np.column_stack([(sample_map(forward, at) - [159.5, 119.5]) / plane.camera1.fx, np.ones(200)])
    normal2 = R @ GROUND / (1 - GROUND @ T)
    moved = (rays2 - (rays2 @ normal2)[:, None] * back_T) @ back_R.T
    again = moved[:, :2] / moved[:, 2:] * plane.camera1.fx + [159.5, 119.5]
    assert np.abs(again - at).max() < 0.01


def test_image_2_pulled_through_the_truth_is_image_1(plane: Pair) -> None:
    grid = whole(plane.grey1)
    mapping = transfer_map(grid, plane.transfer)
    seen = covered(mapping, plane.grey2.shape)
    off = (resample(Pyramid(plane.grey2), mapping, grid) - plane.grey1)[seen]
    assert seen.mean() > 0.7
    assert np.abs(off.mean()) < 0.1
    assert off.std() < 4.0  # of 35 grey levels of texture


def test_a_shrunken_grid_sees_image_2_averaged_not_skipped() -> None:
    """Noise finer than the grid averages out, and what is coarser than the grid stays where it is."""
    rng = np.random.default_rng(0)
    y, x = np.mgrid[:400, :400]
    coarse = 128 + 30 * np.sin(x / 20) * np.cos(y / 25)
    noisy = [to_grey(coarse + 20 * rng.standard_normal((400, 400))) for _ in range(2)]
    layer = Layer(*shrink(noisy[0], 100 * 100))
    grid = Grid(layer.grey, 0, 0, layer.scale)
    pulled = resample(Pyramid(noisy[1]), transfer_map(grid, lambda uv: uv), grid)
    inner = (slice(2, -2), slice(2, -2))
    assert (pulled - layer.grey)[inner].std() < 20 * np.sqrt(2) / 4 * 1.15
    assert np.corrcoef(pulled[inner].ravel(), layer.grey[inner].ravel())[0, 1] > 0.87  # 0.90 if nothing else differs


@pytest.mark.parametrize(("scale", "limit"), [(1.0, 1e6), (1.6, 1e6), (0.5, 1e6), (1.6, 2e4)])
def test_magnification_is_the_size_in_image_2_of_a_pixel_of_image_1(plane: Pair, scale: float, limit: float) -> None:
    layer = Layer(*shrink(plane.grey1, limit))
    grid = Grid(layer.grey, 0, 0, layer.scale)
    turned = scale * turn(z_deg=40)[:2, :2]
    mapping = transfer_map(grid, lambda uv: uv @ turned.T + 7)
    assert magnification(mapping, grid) == pytest.approx(scale, rel=1e-3)


def test_magnification_of_a_sliver_is_not_guessed() -> None:
    grid = whole(np.zeros((2, 90), np.uint8))
    assert magnification(transfer_map(grid, lambda uv: 3 * uv), grid) == 1.0


@pytest.mark.parametrize("shrink_by", [0.3, 1.0, 1.5, 2.0, 3.0, 4.0, 7.0])
def test_pyramid_gives_a_layer_about_as_fine_as_asked(shrink_by: float) -> None:
    layer = Pyramid(np.zeros((401, 601), np.uint8)).at(shrink_by)
    assert layer.scale.tolist() == [layer.grey.shape[1] / 601, layer.grey.shape[0] / 401]
    coarser = 1 / (layer.scale[0] * max(shrink_by, 1.0))
    assert 0.55 < coarser < 1.21


def test_layers_of_a_pyramid_show_the_same_place() -> None:
    y, x = np.mgrid[:203, :301]
    blob = to_grey(220 * np.exp(-((x - 250.4) ** 2 + (y - 160.7) ** 2) / (2 * 12**2)))
    for shrink_by in (1, 2, 4):
        layer = Pyramid(blob).at(shrink_by)
        grid = Grid(layer.grey, 0, 0, layer.scale)
        weight = layer.grey.ravel().astype(float)
        middle = (grid.full(points_of(grid)) * weight[:, None]).sum(0) / weight.sum()
        np.testing.assert_allclose(middle, [250.4, 160.7], atol=0.1)


def test_covered_is_inside_image_2_less_a_margin() -> None:
    mapping = np.array([[[2, 2], [1.9, 50], [97, 57], [97.1, 57], [50, 58], [-1e4, -1e4]]], np.float32)
    assert covered(mapping, (60, 100)).tolist() == [[True, False, True, False, False, False]]
    assert covered(mapping, (60, 100), margin=0.0).tolist() == [[True, True, True, True, True, False]]


def test_block_sums_drop_what_does_not_fill_a_block() -> None:
    layer = np.arange(5 * 7, dtype=np.float32).reshape(5, 7)
    sums = block_sum(layer, 2)
    assert sums.tolist() == [[layer[j : j + 2, i : i + 2].sum() for i in (0, 2, 4)] for j in (0, 2)]
    assert block_sum(layer, 8).size == 0
