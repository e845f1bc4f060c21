"""Discs around the cells of a map: their sums, their planes, and how high and low their ground is."""

from __future__ import annotations

import numpy as np
import pytest

from slopecli.errors import InputError
from slopecli.geometry import rotation_from_vector
from slopecli.ground import CellGrid, Cells, choose_cells, disc_area, disc_halves, disc_sums, fit_footprints, heights
from slopecli.look import Grid
from slopecli.types import BoolArray, FloatArray

SHAPE, FOCAL = (90, 120), 150.0
STONE = 0.02  # distance of a plane, height of what stands on it


def cells_of(radius_px: float, spacing: int = 7, first: int = 0, shape: tuple[int, int] = SHAPE) -> Cells:
    v, u = (np.arange(first, n, spacing) for n in shape)
    return Cells(u, v, radius_px)


def in_disc(u: int, v: int, radius_px: float, shape: tuple[int, int] = SHAPE) -> BoolArray:
    y, x = np.ogrid[: shape[0], : shape[1]]
    return np.asarray((x - u) ** 2 + (y - v) ** 2 <= radius_px**2 + 1e-9)


def rays(shape: tuple[int, int] = SHAPE, off: tuple[float, float] = (0.0, 0.0)) -> FloatArray:
    y, x = np.mgrid[: shape[0], : shape[1]]
    return np.stack([(x + off[0] - shape[1] / 2) / FOCAL, (y + off[1] - shape[0] / 2) / FOCAL, np.ones(shape)], -1)


def ground(normal: FloatArray, off: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    """Points (h, w, 3) of the plane with this scaled normal."""
    seen = rays(off=off)
    return (seen / (seen @ normal)[..., None]).astype(np.float32)


# ---- sums ----


@pytest.mark.parametrize("radius_px", [1.0, 2.5, 6.0, 17.3, 40.0, 47.9])
def test_sums_over_discs_equal_those_of_brute_force_at_the_borders_too(radius_px: float) -> None:
    layer = np.random.default_rng(0).standard_normal(SHAPE)
    cells = cells_of(radius_px, 13)
    (total,) = disc_sums([layer], cells)
    direct = [[layer[in_disc(u, v, radius_px)].sum() for u in cells.u] for v in cells.v]
    np.testing.assert_allclose(total, direct, atol=1e-9)


def test_the_sum_of_ones_is_the_area_of_a_disc_inside_and_less_at_the_border() -> None:
    cells = cells_of(12.0, 5)
    (count,) = disc_sums([np.ones(SHAPE, bool)], cells)
    whole = (cells.v[:, None] >= 12) & (cells.v[:, None] < SHAPE[0] - 12) & (cells.u >= 12) & (cells.u < SHAPE[1] - 12)
    assert (count[whole] == disc_area(12.0)).all()
    assert (count[~whole] < disc_area(12.0)).all()


@pytest.mark.parametrize("radius_px", [60.0, 150.0, 500.0])
def test_large_discs_are_exact_too(radius_px: float) -> None:
    assert len(disc_halves(radius_px)) == 2 * radius_px + 1
    assert disc_area(radius_px) == pytest.approx(np.pi * radius_px**2, rel=0.005)
    shape = (int(radius_px) + 9, 2 * int(radius_px) + 11)
    centre = shape[1] // 2, 5
    weight = np.hypot(*np.meshgrid(np.arange(shape[1]) - centre[0], np.arange(shape[0]) - centre[1]))
    cells = Cells(np.array([centre[0]]), np.array([centre[1]]), radius_px)
    assert disc_sums([weight], cells)[0] == pytest.approx(weight[in_disc(*centre, radius_px, shape)].sum(), rel=1e-6)


def test_cells_need_not_be_evenly_spaced() -> None:
    layer = np.random.default_rng(8).standard_normal(SHAPE)
    cells = Cells(np.array([3, 10, 50, 51, 119]), np.array([0, 2, 30, 89]), 8.0)
    (total,) = disc_sums([layer], cells)
    direct = [[layer[in_disc(u, v, 8.0)].sum() for u in cells.u] for v in cells.v]
    np.testing.assert_allclose(total, direct, atol=1e-9)


def test_many_rows_of_cells_are_summed_in_parts_without_a_seam() -> None:
    layer = np.random.default_rng(1).standard_normal((700, 40))
    cells = cells_of(9.0, 1, shape=(700, 40))
    (total,) = disc_sums([layer], cells)
    for row in (0, 255, 256, 257, 511, 512, 699):
        assert total[row, 20] == pytest.approx(layer[in_disc(20, row, 9.0, layer.shape)].sum(), abs=1e-9)


# ---- planes ----


@pytest.mark.parametrize("tilt", [(0, 0, 0), (20, 0, 0), (0, -35, 0), (55, 20, 5), (-60, 40, 90)])
def test_the_plane_of_noiseless_ground_is_that_plane(tilt: tuple[float, float, float]) -> None:
    normal = rotation_from_vector(np.radians(np.array(tilt) * 0.7)) @ [0.0, 0.0, 0.2]
    every = np.ones(SHAPE, bool)
    planes = fit_footprints(ground(normal), every, every, cells_of(9.0, first=10))
    np.testing.assert_allclose(planes.scaled_normal, np.broadcast_to(normal, (*planes.cells.shape, 3)), atol=2e-5)
    assert (planes.normal[..., 2] < 0).all()
    assert planes.relief.max() < 2e-3
    assert planes.answered[1:-2, 1:-2].all()


def test_a_shift_of_the_cells_does_not_change_the_planes_of_the_same_ground() -> None:
    normal, every = np.array([0.05, -0.02, 0.2]), np.ones(SHAPE, bool)
    rough = 0.003 * np.random.default_rng(2).standard_normal(SHAPE).astype(np.float32)
    points = ground(normal) + rough[..., None]
    one = fit_footprints(points, every, every, cells_of(12.0, 10, 20))
    moved = np.roll(points, (3, 5), (0, 1))
    other = fit_footprints(moved, every, every, Cells(one.cells.u + 5, one.cells.v + 3, 12.0))
    inner = np.s_[:5, :7]
    np.testing.assert_allclose(one.scaled_normal[inner], other.scaled_normal[inner], atol=1e-6)
    np.testing.assert_allclose(one.relief[inner], other.relief[inner], atol=1e-6)


def test_relief_is_the_root_mean_square_off_the_plane_and_what_is_not_known_does_not_count() -> None:
    normal, every = np.array([0.0, 0.0, 0.2]), np.ones(SHAPE, bool)
    points = ground(normal)
    points[..., 2] += 0.05 * np.random.default_rng(3).standard_normal(SHAPE).astype(np.float32)
    known = every.copy()
    known[::9, ::5] = False
    points[~known] = 1e3
    planes = fit_footprints(points, known, known, cells_of(14.0, 10, 20))
    assert np.median(planes.relief) == pytest.approx(0.05, rel=0.05)
    assert planes.share.max() < 1.0
    assert planes.share[2, 3] == pytest.approx(known[in_disc(50, 40, 14.0)].mean(), abs=0.001)


def test_the_plane_is_the_nearest_by_perpendicular_distance() -> None:
    points = ground(np.array([0.12, 0.0, 0.15])) + 0.05 * np.random.default_rng(4).standard_normal((*SHAPE, 3))
    every, cells = np.ones(SHAPE, bool), cells_of(15.0, 20, 30)
    planes = fit_footprints(points.astype(np.float32), every, every, cells)
    for i, j in np.ndindex(cells.shape):
        part = points[in_disc(cells.u[j], cells.v[i], 15.0)]
        offsets = part - part.mean(0)
        normal = np.linalg.svd(offsets, full_matrices=False)[2][2]
        assert abs(normal @ planes.normal[i, j]) == pytest.approx(1.0, abs=1e-6)
        assert np.sqrt(((offsets @ normal) ** 2).mean()) == pytest.approx(planes.relief[i, j], rel=1e-3)


@pytest.mark.parametrize(("told", "off_deg"), [(0.0, (4.0, 20.0)), (1.0, (-0.5, 0.5)), (5.0, (-0.5, 0.5))])
def test_errors_of_distance_do_not_tilt_planes_if_their_variance_is_known(
    told: float, off_deg: tuple[float, float]
) -> None:
    """Whether it is told to be what it is, or larger, when what is left is the plane of the least squared errors."""
    rng, every = np.random.default_rng(6), np.ones(SHAPE, bool)
    points = ground(np.array([0.06, 0.0, 0.2]))
    far = np.exp(0.03 * rng.standard_normal(SHAPE)).astype(np.float32)
    variance = np.full(SHAPE, told * 0.03**2, np.float32)
    planes = fit_footprints(points * far[..., None], every, every, cells_of(14.0, 6, 16), variance=variance)
    slopes = np.degrees(np.arctan2(np.linalg.norm(planes.normal[..., :2], axis=-1), -planes.normal[..., 2]))
    low, high = off_deg
    assert low < np.median(slopes[planes.answered]) - np.degrees(np.arctan(0.3)) < high


def test_a_footprint_of_which_too_little_is_known_has_no_plane() -> None:
    known = np.ones(SHAPE, bool)
    known[:, 60:] = False
    planes = fit_footprints(ground(np.array([0.0, 0.0, 0.2])), known, known, cells_of(10.0, 10, 20))
    assert planes.answered[:, :3].all()  # at 20, 30 and 40 px
    assert not planes.answered[:, 4:].any()
    nothing = fit_footprints(ground(np.array([0.0, 0.0, 0.2])), ~known & known, known, cells_of(10.0, 10, 20))
    assert not nothing.answered.any()


# ---- heights ----


def bumpy(seed: int = 5) -> tuple[np.ndarray, FloatArray]:
    rng = np.random.default_rng(seed)
    points = ground(np.array([0.03, 0.02, 0.2]))
    for _ in range(30):
        v, u = rng.integers(0, SHAPE[0] - 3), rng.integers(0, SHAPE[1] - 3)
        points[v : v + 3, u : u + 3] *= np.float32(1 + STONE * rng.uniform(-1, 1))
    return points, np.array([0.03, 0.02, 0.2])


def test_heights_of_small_footprints_equal_those_of_brute_force() -> None:
    points, every = bumpy()[0], np.ones(SHAPE, bool)
    cells = cells_of(9.0, 6, 3)  # blocks are then single pixels
    planes = fit_footprints(points, every, every, cells)
    above, below = heights(points, every, planes)
    for i, j in np.ndindex(cells.shape):
        off = (points[in_disc(cells.u[j], cells.v[i], 9.0)] - planes.middle[i, j]) @ planes.normal[i, j]
        assert above[i, j] == pytest.approx(off.max(), abs=2e-5)
        assert below[i, j] == pytest.approx(-off.min(), abs=2e-5)


@pytest.mark.parametrize("radius_px", [18.0, 31.0])
def test_heights_of_large_footprints_are_those_of_a_disc_with_a_rim_of_a_block(radius_px: float) -> None:
    points, known = bumpy()[0], np.ones(SHAPE, bool)
    known[:, 90:] = False  # cells near there have no plane, but footprints that have one reach there
    cells = cells_of(radius_px, 5, 2)
    planes = fit_footprints(points, known, known, cells)
    assert 0.2 < planes.answered.mean() < 0.8
    side = int(2 * radius_px / 12)
    for found, sign in zip(heights(points, known, planes), (1, -1), strict=True):
        for i, j in np.argwhere(planes.answered):
            off = sign * ((points - planes.middle[i, j]) @ planes.normal[i, j])
            inner, wider = (in_disc(cells.u[j], cells.v[i], radius_px + more) & known for more in (-side, 1.5 * side))
            assert max(off[inner].max(), 0.0) - 0.002 < found[i, j] < off[wider].max() + 1e-4


def test_what_is_not_known_has_no_height() -> None:
    points, known = ground(np.array([0.0, 0.0, 0.2])), np.ones(SHAPE, bool)
    points[40:43, 60:63] *= np.float32(0.5)
    known[40:43, 60:63] = False
    planes = fit_footprints(points, known, known, cells_of(9.0, 6, 3))
    above, below = heights(points, known, planes)
    assert max(above.max(), below.max()) < 1e-3


# ---- cells of a map ----


def test_cells_lie_where_a_map_says_they_do() -> None:
    grey = np.zeros((600, 800), np.uint8)
    grid = Grid(grey, 0.0, 0.0, np.ones(2))
    wanted = choose_cells(800, 600, 1.0, 40.0, 7)
    cells = wanted.over(800, 600, grid)
    assert cells.shape == (600 // 7, 800 // 7)
    assert cells.radius_px == 20.0
    np.testing.assert_array_equal(cells.u, 7 * np.arange(114) + 3)
    np.testing.assert_array_equal(cells.v, 7 * np.arange(85) + 3)


def test_cells_of_a_shrunken_grid_are_on_it_and_have_smaller_footprints() -> None:
    grid = Grid(np.zeros((300, 400), np.uint8), 0.0, 0.0, np.full(2, 0.5))
    cells = CellGrid(1, 40.0).over(800, 600, grid)
    assert cells.shape == (600, 800)
    assert cells.radius_px == 10.0
    assert (cells.u.min(), cells.u.max(), cells.v.min(), cells.v.max()) == (0, 399 + 1 - 1, 0, 299)


def test_a_footprint_is_a_sixteenth_of_the_short_side_and_spacing_an_eighth_of_it_unless_given() -> None:
    assert choose_cells(1600, 800, 1.0, None, None) == CellGrid(6, 50.0)
    assert choose_cells(160, 120, 1.0, None, None).footprint_px == 12.0
    assert choose_cells(160, 120, 1.0, 30.0, 1) == CellGrid(1, 30.0)


@pytest.mark.parametrize(
    ("footprint", "spacing", "told"),
    [
        (401.0, None, "must be between 12 and 400 px"),
        (5.0, None, "must be between 12 and 400 px"),
        (50.0, 801, "lower --spacing"),
    ],
)
def test_sizes_that_an_image_cannot_serve_are_refused_with_those_it_can(
    footprint: float, spacing: int | None, told: str
) -> None:
    with pytest.raises(InputError, match=told):
        choose_cells(1000, 800, 1.0, footprint, spacing)


def test_more_cells_than_memory_holds_are_refused() -> None:
    with pytest.raises(InputError, match="raise --spacing"):
        choose_cells(4000, 3000, 1.0, 50.0, 1)
