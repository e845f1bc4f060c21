"""Landing sites: discs of safe ground, their order and numbers, landers on them, and what is said without any."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from slopecli.geometry import rotation_from_vector
from slopecli.ground import Ground, Site, find_sites, least_around, least_within, nearest_miss, safe_radii
from slopecli.options import Lander, MapOptions
from slopecli.types import BoolArray, FloatArray

SPACING, FOOTPRINT, GSD, DEPTH = 4, 32.0, 0.05, 10.0  # px, px, m per px, m: a camera straight down
Height = Callable[[FloatArray, FloatArray], FloatArray]


def level(x: FloatArray, y: FloatArray) -> FloatArray:
    return np.zeros_like(x)


def tilted(slope_deg: float, azimuth_deg: float = 0.0) -> Height:
    rise, azimuth = np.tan(np.radians(slope_deg)), np.radians(azimuth_deg)
    return lambda x, y: rise * (x * np.cos(azimuth) + y * np.sin(azimuth))


def with_stone(ground: Height, x0: float, y0: float, radius: float, height: float) -> Height:
    return lambda x, y: ground(x, y) + height * (np.hypot(x - x0, y - y0) <= radius)


def ground_of(
    p_safe: FloatArray, height: Height = level, spacing: int = SPACING, grid_scale: float = 1.0, **changes: Any
) -> Ground:
    """Ground of this height (m, from x and y on the ground, 0 in the middle of the image) under a camera straight
    down, with the probabilities of its cells."""
    rows, columns = p_safe.shape
    shape = rows * spacing, columns * spacing

    def points(u: FloatArray, v: FloatArray) -> FloatArray:
        x, y = GSD * (u - (shape[1] - 1) / 2), GSD * (v - (shape[0] - 1) / 2)
        return np.stack([x, y, DEPTH - height(x, y)], -1)

    pixels = lambda n: (np.arange(round(n * grid_scale)) + 0.5) / grid_scale - 0.5  # noqa: E731
    cells = lambda n: (np.arange(n) + 0.5) * spacing - 0.5  # noqa: E731
    surface = points(*np.meshgrid(pixels(shape[1]), pixels(shape[0]))).astype(np.float32)
    known = np.isfinite(p_safe)
    nothing = np.where(known, 0.0, np.nan)
    ground = Ground(
        slope_deg=nothing + 2.0,
        sigma_deg=nothing + 0.5,
        p_safe=p_safe,
        above_plane_max=nothing,
        below_plane_max=nothing,
        step=np.zeros_like(known),
        points=points(*np.meshgrid(cells(columns), cells(rows))),
        spacing_px=spacing,
        footprint_px=FOOTPRINT,
        surface=surface,
        known=np.ones(surface.shape[:2], bool),
        grid_scale=np.full(2, grid_scale),
        shape1=shape,
        shape2=shape,
        up=np.array([0.0, 0.0, -1.0]),
        confidence=0.99,
        tolerance_rad=float(np.radians(15.0)),
        max_height=None,
        pixels2=lambda P: P[:, :2] / P[:, 2:] * DEPTH / GSD + (np.array(shape[::-1]) - 1) / 2,
        R=np.eye(3),
        T=np.array([1.0, 0.0, 0.0]),
    )
    return replace(ground, **changes)


def probabilities(safe: BoolArray) -> FloatArray:
    return np.where(safe, 0.999, 0.2)


def disc_of_cells(shape: tuple[int, int], row: float, column: float, radius: float) -> BoolArray:
    y, x = np.ogrid[: shape[0], : shape[1]]
    return np.hypot(y - row, x - column) <= radius


def random_mask(seed: int, shape: tuple[int, int] = (40, 56), unsafe: int = 25) -> FloatArray:
    rng = np.random.default_rng(seed)
    p_safe = rng.uniform(0.99, 1.0, shape)
    p_safe.ravel()[rng.choice(p_safe.size, unsafe, replace=False)] = rng.uniform(0.0, 0.98, unsafe)
    p_safe.ravel()[rng.choice(p_safe.size, 5, replace=False)] = np.nan
    return p_safe


def overlap(a: Site, b: Site) -> float:
    return a.radius_px + b.radius_px - float(np.hypot(*np.subtract(a.centre_px, b.centre_px)))


def test_two_pads_of_flat_ground() -> None:
    shape = (60, 80)
    safe = disc_of_cells(shape, 25, 20, 15) | disc_of_cells(shape, 35, 60, 10)
    first, second = find_sites(ground_of(probabilities(safe)), MapOptions(sites=2))
    assert first.id == 1
    assert first.centre_px == (20.5 * SPACING - 0.5, 25.5 * SPACING - 0.5)
    assert second.centre_px == (60.5 * SPACING - 0.5, 35.5 * SPACING - 0.5)
    assert first.radius_px == pytest.approx((np.hypot(15, 1) - 0.5) * SPACING + FOOTPRINT / 2, abs=1e-9)
    assert first.radius == pytest.approx(first.radius_px * GSD, rel=1e-6)
    assert (first.verdict, first.p_safe, first.slope_sigma_deg) == ("safe", 0.999, 0.5)
    assert first.slope_deg == pytest.approx(0.0, abs=1e-3)
    assert first.lander_slope_deg is None
    assert first.lander_clearance is None


@pytest.mark.parametrize("seed", range(5))
def test_radii_equal_those_of_brute_force(seed: int) -> None:
    p_safe = random_mask(seed)
    ground = ground_of(p_safe)
    radii, safe = safe_radii(ground), p_safe >= 0.99
    rows, columns = p_safe.shape
    outside = [(i, j) for i in range(-1, rows + 1) for j in range(-1, columns + 1) if not (0 <= i < rows)]
    outside += [(i, j) for i in range(rows) for j in (-1, columns)]
    bad = np.vstack([np.argwhere(~safe), outside])
    for i, j in np.argwhere(safe)[::7]:
        distance = np.sqrt(((bad - (i, j)) ** 2).sum(axis=1)).min()
        u, v = ((np.array([j, i]) + 0.5) * SPACING).tolist()
        border = min(u, v, ground.shape1[1] - u, ground.shape1[0] - v)
        assert radii[i, j] == pytest.approx(min((distance - 0.5) * SPACING + FOOTPRINT / 2, border), abs=1e-9)
    assert np.array_equal(np.isfinite(radii), safe)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("radius_px", [None, 30.0])
def test_sites_do_not_overlap_and_stay_in_the_image_and_come_in_order(seed: int, radius_px: float | None) -> None:
    ground = ground_of(random_mask(seed))
    sites = find_sites(ground, MapOptions(sites=12), radius_px)
    assert len(sites) >= 4
    assert [site.id for site in sites] == list(range(1, len(sites) + 1))
    assert max(overlap(a, b) for a in sites for b in sites if a is not b) < 1e-9
    for site in sites:
        low, high = np.subtract(site.centre_px, site.radius_px), np.add(site.centre_px, site.radius_px)
        assert (low >= -0.5 - 1e-9).all()
        assert (high <= np.array(ground.shape1[::-1]) - 0.5 + 1e-9).all()
        assert site.radius_px >= FOOTPRINT / 2
    order = [-site.radius_px if radius_px is None else -site.p_safe for site in sites]
    assert min(np.diff(order)) >= -1e-8
    again = find_sites(ground, MapOptions(sites=12), radius_px)
    assert [vars(site) for site in sites] == [vars(site) for site in again]


@pytest.mark.parametrize("radius_px", [None, 30.0])
def test_every_cell_whose_footprint_is_in_a_site_is_safe_and_its_probability_is_the_least(
    radius_px: float | None,
) -> None:
    ground = ground_of(random_mask(3))
    for site in find_sites(ground, MapOptions(sites=12), radius_px):
        v, u = (np.indices(ground.p_safe.shape) + 0.5) * SPACING - 0.5
        away = np.hypot(u - site.centre_px[0], v - site.centre_px[1])
        inside = ground.p_safe[away <= site.radius_px - FOOTPRINT / 2 + 1e-6]
        assert inside.min() == site.p_safe >= 0.99


def test_a_wanted_radius_takes_the_safest_first_and_more_fit() -> None:
    safe = np.full((60, 80), 0.992)
    safe[:, 50:] = 0.9999
    ground = ground_of(safe)
    largest = find_sites(ground, MapOptions(sites=3))
    wanted = find_sites(ground, MapOptions(sites=20), 30.0)
    assert largest[0].p_safe == 0.992
    assert wanted[0].p_safe == 0.9999
    assert {site.radius_px for site in wanted} == {30.0}
    assert len(wanted) > 10
    assert find_sites(ground, MapOptions(), 125.0) == ()


def test_equally_safe_discs_are_taken_by_the_room_around_them() -> None:
    safe = probabilities(disc_of_cells((60, 80), 25, 20, 15) | disc_of_cells((60, 80), 35, 60, 10))
    largest = find_sites(ground_of(safe), MapOptions(sites=1))[0]
    assert find_sites(ground_of(safe), MapOptions(sites=1), 30.0)[0].centre_px == largest.centre_px


def test_the_sigma_of_a_site_is_the_largest_of_its_footprints() -> None:
    sigma = np.full((60, 80), 0.5)
    sigma[30, 45], sigma[30, 54] = 1.25, 3.0  # within the site, and beyond it
    ground = ground_of(probabilities(disc_of_cells((60, 80), 30, 40, 12)), sigma_deg=sigma)
    assert find_sites(ground, MapOptions(sites=1))[0].slope_sigma_deg == 1.25


def test_equally_large_discs_are_taken_by_their_probability() -> None:
    safe = np.zeros((40, 120))
    for column, p in ((20, 0.993), (60, 0.999), (100, 0.996)):
        safe[disc_of_cells(safe.shape, 20, column, 12)] = p
    sites = find_sites(ground_of(safe), MapOptions(sites=3))
    assert [site.p_safe for site in sites] == [0.999, 0.996, 0.993]


def test_unknown_ground_is_not_safe() -> None:
    whole = np.full((50, 50), 0.999)
    ring = np.where(disc_of_cells(whole.shape, 25, 25, 12) & ~disc_of_cells(whole.shape, 25, 25, 10), np.nan, whole)
    site = find_sites(ground_of(ring), MapOptions(sites=1))[0]
    assert site.radius_px <= 10.5 * SPACING + FOOTPRINT / 2
    assert len(find_sites(ground_of(np.full((9, 9), np.nan)), MapOptions())) == 0


def test_a_disc_ends_at_the_border_of_the_image() -> None:
    site = find_sites(ground_of(np.full((40, 40), 0.999)), MapOptions(sites=1))[0]
    assert site.radius_px == 19.5 * SPACING
    corner = np.zeros((40, 40))
    corner[:3, :3] = 0.999
    assert find_sites(ground_of(corner), MapOptions()) == ()
    assert "reaches beyond the image" in nearest_miss(ground_of(corner), MapOptions())


def test_the_least_of_a_disc_of_cells() -> None:
    values = np.random.default_rng(0).random((17, 23))
    padded = np.pad(values, 30)
    y, x = np.indices(padded.shape) - 30
    for radius in (0.0, 0.9, 1.0, 1.5, 5.0, np.hypot(3, 4), 7.3, 25.0):
        least = least_within(values, radius)
        for row, column in [(0, 0), (8, 11), (16, 22), (5, 2)]:
            near = (y - row) ** 2 + (x - column) ** 2 <= radius**2 + 1e-9
            assert least[row, column] == padded[near].min()
        chosen = np.array([3, 9]), np.array([20, 4])
        assert np.array_equal(least_around(values, *chosen, radius), least[chosen])


@pytest.mark.parametrize("grid_scale", [1.0, 0.5])
def test_the_plane_of_a_site_and_what_stands_out_of_it(grid_scale: float) -> None:
    safe = probabilities(disc_of_cells((60, 80), 30, 40, 15))
    for azimuth in (0.0, 130.0):
        site = find_sites(ground_of(safe, tilted(7.0, azimuth), grid_scale=grid_scale), MapOptions(sites=1))[0]
        assert site.slope_deg == pytest.approx(7.0, abs=1e-3)
        assert site.above_plane_max == pytest.approx(0.0, abs=1e-4)
        assert site.radius == pytest.approx(site.radius_px * GSD, rel=1e-4)
    x, y = GSD * (40.5 * SPACING - 160.0), GSD * (30.5 * SPACING - 120.0)
    stony = find_sites(ground_of(safe, with_stone(level, x, y, 0.16, 0.3), grid_scale=grid_scale), MapOptions(sites=1))[
        0
    ]
    assert stony.above_plane_max == pytest.approx(0.3, rel=0.02)
    assert stony.below_plane_max == pytest.approx(0.3 * 0.16**2 / stony.radius**2, abs=5e-4)
    hollow = find_sites(ground_of(safe, with_stone(level, x, y, 0.16, -0.3)), MapOptions(sites=1))[0]
    assert hollow.below_plane_max == pytest.approx(0.3, rel=0.02)


def test_pixels_that_are_not_known_do_not_count() -> None:
    ground = ground_of(probabilities(disc_of_cells((60, 80), 30, 40, 15)), tilted(5.0))
    known = np.random.default_rng(1).random(ground.known.shape) < 0.9
    surface = np.where(known[..., None], ground.surface, 100.0).astype(np.float32)
    site = find_sites(replace(ground, known=known, surface=surface), MapOptions(sites=1))[0]
    assert site.slope_deg == pytest.approx(5.0, abs=1e-3)
    assert site.above_plane_max < 1e-4


def test_the_centre_in_image_2_and_the_directions_to_it() -> None:
    ground = ground_of(probabilities(disc_of_cells((60, 80), 30, 40, 15)))
    site = find_sites(ground, MapOptions(sites=1))[0]
    assert site.centre_image2_px == pytest.approx(site.centre_px)
    centre = ground.points[30, 40]
    assert site.direction_cam1 == pytest.approx(centre / np.linalg.norm(centre))
    assert site.direction_cam2 == pytest.approx((centre - [1, 0, 0]) / np.linalg.norm(centre - [1, 0, 0]))
    u, v = site.centre_px
    for shape2, shown in (((v + 0.6, u + 0.6), True), ((v + 0.6, u + 0.4), False), ((v + 0.4, u + 0.6), False)):
        there = find_sites(replace(ground, shape2=shape2), MapOptions(sites=1))[0]
        assert (there.centre_image2_px is not None) == shown
    behind = replace(ground, pixels2=lambda P: np.full((len(P), 2), np.nan))
    assert find_sites(behind, MapOptions(sites=1))[0].centre_image2_px is None


def test_the_spacing_of_cells_hardly_matters() -> None:
    coarse = disc_of_cells((60, 80), 30, 40, 15)
    fine = np.kron(coarse, np.ones((2, 2), bool))
    one = find_sites(ground_of(probabilities(coarse)), MapOptions(sites=1))[0]
    other = find_sites(ground_of(probabilities(fine), spacing=SPACING // 2), MapOptions(sites=1))[0]
    assert one.radius_px == pytest.approx(other.radius_px, abs=SPACING)
    assert one.centre_px == pytest.approx(other.centre_px, abs=SPACING)
    assert one.radius == pytest.approx(other.radius, abs=SPACING * GSD)


SAFE = probabilities(disc_of_cells((60, 80), 30, 40, 12))
MIDDLE = GSD * (40.5 * SPACING - 160.0), GSD * (30.5 * SPACING - 120.0)


def landed(height: Height, lander: Lander, **changes: Any) -> Site:
    return find_sites(ground_of(SAFE, height, **changes), MapOptions(sites=1, lander=lander))[0]


@pytest.mark.parametrize("pads", [3, 4, 5, 6, 8])
@pytest.mark.parametrize("azimuth", [0.0, 33.0, 200.0])
def test_a_lander_on_a_plane_stands_as_steep_as_the_plane(pads: int, azimuth: float) -> None:
    site = landed(tilted(8.0, azimuth), Lander(pads, 3.0, 0.3))
    assert site.lander_slope_deg == pytest.approx(8.0, abs=0.3)
    assert site.lander_clearance == pytest.approx(0.0, abs=0.03)
    assert landed(level, Lander(pads, 3.0)).lander_slope_deg == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize(("pads", "lever"), [(3, 1.5), (4, np.sqrt(2.0))])
def test_a_stone_under_one_pad(pads: int, lever: float) -> None:
    """One pad raised by h tilts three pads by atan(h / 1.5 r) and four, which rest on three, by atan(h / sqrt(2) r)."""
    for azimuth in np.radians([0.0, 71.0, 245.0]):
        at = MIDDLE[0] + 1.5 * np.cos(azimuth), MIDDLE[1] + 1.5 * np.sin(azimuth)
        site = landed(with_stone(level, *at, 0.15, 0.2), Lander(pads, 3.0, 0.2))
        assert site.centre_px == (40.5 * SPACING - 0.5, 30.5 * SPACING - 0.5)
        assert site.lander_slope_deg == pytest.approx(np.degrees(np.arctan(0.2 / (lever * 1.5))), abs=1e-3)


def test_a_stone_under_the_belly() -> None:
    site = landed(with_stone(level, *MIDDLE, 0.2, 0.4), Lander(3, 3.0, 0.2), max_height=0.5)
    assert site.lander_clearance == pytest.approx(0.4, abs=1e-4)
    assert site.lander_slope_deg == pytest.approx(0.0, abs=1e-3)
    hollow = landed(with_stone(level, *MIDDLE, 0.2, -0.4), Lander(4, 3.0, 0.2), max_height=0.1)
    assert hollow.lander_clearance == pytest.approx(0.0, abs=1e-4)


def test_where_the_lander_cannot_stand_the_next_best_place_is_tried() -> None:
    lander = Lander(3, 2.0, 0.2)
    ground = ground_of(SAFE, with_stone(level, *MIDDLE, 0.2, 0.4), max_height=0.3)
    site = find_sites(ground, MapOptions(sites=1, lander=lander))[0]
    away = np.subtract(site.centre_px, (40.5 * SPACING - 0.5, 30.5 * SPACING - 0.5)) * GSD
    assert np.hypot(*away) > 1.0
    assert site.lander_clearance is not None
    assert site.lander_clearance <= 0.3
    assert find_sites(ground, MapOptions(sites=1))[0].centre_px == (40.5 * SPACING - 0.5, 30.5 * SPACING - 0.5)


def test_an_unmatched_speck_under_a_pad_takes_the_ground_beside_it() -> None:
    ground = ground_of(SAFE, tilted(5.0))
    u, v = 40.5 * SPACING - 0.5 + 1.5 / GSD, 30.5 * SPACING - 0.5
    known = ground.known.copy()
    known[int(v) - 4 : int(v) + 5, int(u) - 4 : int(u) + 5] = False
    site = find_sites(replace(ground, known=known), MapOptions(sites=1, lander=Lander(3, 3.0)))[0]
    assert site.lander_slope_deg == pytest.approx(5.0, abs=0.5)


def test_what_came_nearest_is_said() -> None:
    options, nothing = MapOptions(), np.full((20, 20), 0.1)
    nothing[7, 12] = 0.9877

    def miss(**changes: Any) -> str:
        ground = ground_of(nothing, **changes)
        assert find_sites(ground, options) == ()
        return nearest_miss(ground, options)

    at = f"({12.5 * SPACING - 0.5:g}, {7.5 * SPACING - 0.5:g}) px"
    steep, flat = np.full((20, 20), 17.0), np.zeros((20, 20))
    assert at in miss()
    assert "slope of 17.0 deg, 1-sigma 0.5 deg" in miss(slope_deg=steep)
    assert "0.987, less than 0.99: it is steeper than 15 deg" in miss(slope_deg=steep)
    assert "not known well enough to be below 15 deg" in miss(slope_deg=flat + 14.0, sigma_deg=flat + 1.2)
    assert "step" in miss(step=np.ones((20, 20), bool))
    assert "stands 0.4 m above its plane, more than 0.3" in miss(max_height=0.3, above_plane_max=flat + 0.4)
    assert "lies 0.4 m below its plane, more than 0.3" in miss(max_height=0.3, below_plane_max=flat + 0.4)
    assert "not known well enough to be below 0.3" in miss(max_height=0.3, below_plane_max=flat + 0.29)
    assert "no ground is known" in nearest_miss(ground_of(np.full((5, 5), np.nan)), options)


def test_a_disc_that_is_too_small_is_said() -> None:
    ground = ground_of(SAFE)
    largest = find_sites(ground, MapOptions(sites=1))[0]
    assert find_sites(ground, MapOptions(), 100.0) == ()
    assert nearest_miss(ground, MapOptions(), 100.0) == (
        f"the largest disc of safe ground, at ({largest.centre_px[0]:g}, {largest.centre_px[1]:g}) px, has a radius "
        f"of {largest.radius_px:.4g} px, less than the 100 px that are wanted"
    )


def test_a_lander_that_cannot_stand_is_said() -> None:
    def miss(height: Height, lander: Lander, **changes: Any) -> str:
        ground, options = ground_of(SAFE, height, **changes), MapOptions(lander=lander)
        assert find_sites(ground, options) == ()
        return nearest_miss(ground, options)

    assert "less than that of the lander, 5" in miss(level, Lander(3, 10.0))
    assert "deg, more than 15" in miss(tilted(20.0), Lander(3, 3.0))
    dome = lambda x, y: -0.5 * (x**2 + y**2)  # noqa: E731
    assert "m above the plane of the lander's pads, more than 0.1" in miss(
        lambda x, y: dome(x - MIDDLE[0], y - MIDDLE[1]), Lander(3, 3.0), max_height=0.1
    )


def test_only_up_tells_what_is_steep() -> None:
    """Ground, up and camera turned together give the same site."""
    ground, options = ground_of(SAFE, tilted(6.0, 50.0)), MapOptions(sites=1, lander=Lander(4, 3.0, 0.3))
    turn = rotation_from_vector(np.array([0.5, -0.3, 0.2]))
    turned = replace(
        ground, surface=ground.surface @ turn.T, points=ground.points @ turn.T, up=turn @ ground.up, T=turn @ ground.T
    )
    one, other = (find_sites(each, options)[0] for each in (ground, turned))
    assert other.slope_deg == pytest.approx(one.slope_deg, abs=1e-3)
    assert other.radius == pytest.approx(one.radius, rel=1e-6)
    assert other.direction_cam1 == pytest.approx(turn @ one.direction_cam1)
    assert other.lander_slope_deg == pytest.approx(6.0, abs=0.3)
    axis = np.array([np.sin(np.radians(50.0)), -np.cos(np.radians(50.0)), 0.0])  # along the contour lines
    for lean, slope in ((6.0, 12.0), (-6.0, 0.0)):
        up = rotation_from_vector(np.radians(lean) * axis) @ ground.up
        leaning = find_sites(replace(ground, up=up), options)[0]
        assert leaning.slope_deg == pytest.approx(slope, abs=1e-3)
        assert leaning.lander_slope_deg == pytest.approx(slope, abs=0.3)


def test_the_radius_on_the_ground_is_that_of_a_circle_inside_the_disc() -> None:
    """A disc of image 1 is an ellipse on ground seen at an angle; its short half axis is the radius."""
    ground = ground_of(SAFE)
    narrow = np.array([1.0, 0.4, 1.0])
    site = find_sites(
        replace(ground, surface=ground.surface * narrow.astype(np.float32), points=ground.points * narrow),
        MapOptions(sites=1),
    )[0]
    assert site.radius == pytest.approx(0.4 * site.radius_px * GSD, rel=1e-5)
