"""From the tilt of a footprint and its covariance to the slope's sigma and the probability that it is safe."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import ndtr

from slopecli.geometry import disc_probability, rotation_from_vector, tangent_basis
from slopecli.ground import Tilts, least_limit, normal_cdf, probability_low, slope_sigma, tilts
from slopecli.types import FloatArray

TOLERANCE = float(np.radians(15.0))
UP = np.array([0.0, 0.0, -1.0])
NORTH = np.array([0.0, -1.0, 0.0])
DRAWS = 40_000


def tilts_of(
    slope_deg: FloatArray, along_deg: FloatArray, across_deg: FloatArray, correlation: FloatArray | float = 0.0
) -> Tilts:
    slope, along, across = (np.radians(np.asarray(part, float)) for part in (slope_deg, along_deg, across_deg))
    return Tilts(slope, np.full(slope.shape, np.nan), along**2, across**2, correlation * along * across)


def some_tilts(seed: int, count: int = 400) -> tuple[FloatArray, ...]:
    """Slope, sigmas along and across it, deg, and their correlation."""
    rng = np.random.default_rng(seed)
    sigmas = 10 ** rng.uniform(-1.5, 1.0, (2, count))
    return np.abs(rng.normal(0, 12, count)), *sigmas, rng.uniform(-0.9, 0.9, count)


# ---- of a slope ----


def test_the_normal_distribution_is_that_of_scipy() -> None:
    x = np.linspace(-45.0, 45.0, 4001)
    assert np.abs(normal_cdf(x) - ndtr(x)).max() < 2e-7
    assert np.isnan(normal_cdf(np.array([np.nan]))).all()
    assert normal_cdf(np.array([-np.inf, np.inf])).tolist() == [0.0, 1.0]


def test_the_probability_of_a_slope_below_the_tolerance_is_that_of_a_tilt_in_a_disc() -> None:
    slope, along, across, correlation = some_tilts(0, 4000)
    shared = correlation * along * across
    covariance = np.radians(np.radians(np.array([[along**2, shared], [shared, across**2]]).transpose(2, 0, 1)))
    exact = disc_probability(np.radians(slope), covariance, np.full(len(slope), TOLERANCE))
    found = tilts_of(slope, along, across, correlation).probability_below(TOLERANCE)
    assert np.abs(found - exact).max() < 2e-3


@pytest.mark.parametrize("correlation", [-0.7, 0.0, 0.7])
def test_it_is_the_share_of_drawn_tilts(correlation: float) -> None:
    rng = np.random.default_rng(3)
    slope, along, across = np.array([(2, 6, 1), (2, 1, 6), (10, 2, 4), (16, 3, 3), (25, 8, 2), (0.1, 5, 5)]).T
    first, second = rng.standard_normal((2, DRAWS, 1))
    drawn = np.hypot(slope + along * first, across * (correlation * first + np.sqrt(1 - correlation**2) * second))
    share = (drawn < 15.0).mean(0)
    found = tilts_of(slope, along, across, correlation).probability_below(TOLERANCE)
    assert np.abs(found - share).max() < 4 * 0.5 / np.sqrt(DRAWS)


def test_a_steeper_slope_is_less_probably_safe_and_a_larger_tolerance_makes_it_more() -> None:
    slopes = np.linspace(0.0, 40.0, 201)
    for along, across in ((0.3, 0.3), (3.0, 0.5), (0.5, 3.0), (8.0, 8.0)):
        chance = tilts_of(slopes, np.full(201, along), np.full(201, across)).probability_below(TOLERANCE)
        assert np.diff(chance).max() < 2e-3
        assert chance[0] > 0.8
        assert chance[-1] < 0.02
    same = tilts_of(np.full(1, 12.0), np.full(1, 2.0), np.full(1, 2.0))
    chances = [float(same.probability_below(np.radians(tolerance))[0]) for tolerance in range(1, 60)]
    assert np.diff(chances).min() > -2e-3


def test_a_larger_sigma_makes_a_gentle_slope_less_probably_safe() -> None:
    sigma = np.linspace(0.05, 20.0, 200)
    chance = tilts_of(np.full(200, 8.0), sigma, sigma).probability_below(TOLERANCE)
    assert np.diff(chance).max() < 2e-3
    assert chance[0] > 0.999
    assert chance[-1] < 0.3


def test_without_an_error_it_is_certain() -> None:
    none = np.zeros(3)
    chance = tilts_of(np.array([0.0, 14.999, 15.001]), none, none).probability_below(TOLERANCE)
    assert chance == pytest.approx([1.0, 1.0, 0.0], abs=1e-4)


def test_sigma_of_a_slope_is_that_of_drawn_tilts() -> None:
    rng = np.random.default_rng(4)
    slope, along, across, _ = some_tilts(1, 60)
    drawn = np.hypot(slope + along * rng.standard_normal((DRAWS, 1)), across * rng.standard_normal((DRAWS, 1)))
    direct = np.sqrt(((drawn - slope) ** 2).mean(0))
    assert slope_sigma(slope, along**2, across**2) == pytest.approx(direct, rel=0.1)


# ---- of a plane ----


def plane(slope_deg: float, azimuth_deg: float, distance: float = 5.0) -> FloatArray:
    """Scaled normal of a plane that falls off in this direction, clockwise from NORTH as seen from above."""
    tilt, azimuth = np.radians([slope_deg, azimuth_deg])
    downhill = np.array([np.sin(azimuth), -np.cos(azimuth), 0.0])
    return -(np.cos(tilt) * UP + np.sin(tilt) * downhill) / distance


@pytest.mark.parametrize("slope_deg", [0.5, 12.0, 60.0, 100.0])
@pytest.mark.parametrize("azimuth_deg", [0.0, 75.0, 200.0, 359.0])
def test_slope_and_aspect_are_those_of_the_plane(slope_deg: float, azimuth_deg: float) -> None:
    found = tilts(plane(slope_deg, azimuth_deg)[None], np.zeros((1, 3, 3)), UP, 0.0, NORTH)
    assert np.degrees(found.slope_rad[0]) == pytest.approx(slope_deg, abs=1e-9)
    off = (np.degrees(found.aspect_rad[0]) - azimuth_deg + 180) % 360 - 180
    assert off == pytest.approx(0.0, abs=1e-9)


def test_a_level_plane_has_no_aspect_and_a_sigma() -> None:
    covariance = 1e-6 * np.eye(3)[None]
    found = tilts(plane(0.0, 0.0)[None], covariance, UP, np.radians(0.5), NORTH)
    assert np.isnan(found.aspect_rad).all()
    one = np.hypot(np.degrees(1e-3 * 5.0), 0.5)
    assert np.degrees(np.sqrt([found.along[0], found.across[0]])) == pytest.approx([one, one])
    assert np.degrees(found.sigma_rad[0]) == pytest.approx(np.sqrt(2) * one, rel=0.02)


def test_variances_are_those_of_drawn_normals() -> None:
    rng = np.random.default_rng(5)
    normal = plane(20.0, 40.0)
    factor = 1e-3 * rng.standard_normal((3, 3))
    covariance = factor @ factor.T
    found = tilts(normal[None], covariance[None], UP, 0.0, NORTH)
    drawn = rng.multivariate_normal(normal, covariance, DRAWS)
    many = tilts(drawn, np.zeros((DRAWS, 3, 3)), UP, 0.0, NORTH)
    assert many.slope_rad.std() == pytest.approx(np.sqrt(found.along[0]), rel=0.03)
    turned = (many.aspect_rad - found.aspect_rad[0] + np.pi) % (2 * np.pi) - np.pi
    assert (turned * np.sin(found.slope_rad[0])).std() == pytest.approx(np.sqrt(found.across[0]), rel=0.03)
    shared = -np.mean(turned * np.sin(found.slope_rad[0]) * (many.slope_rad - found.slope_rad[0]))
    assert abs(shared) == pytest.approx(abs(found.both[0]), rel=0.1)


def test_a_turn_of_everything_changes_nothing() -> None:
    turn = rotation_from_vector(np.array([0.3, -0.5, 0.9]))
    rng = np.random.default_rng(6)
    factor = 1e-3 * rng.standard_normal((3, 3))
    covariance = factor @ factor.T
    one = tilts(plane(12.0, 130.0)[None], covariance[None], UP, 0.01, NORTH)
    other = tilts((turn @ plane(12.0, 130.0))[None], (turn @ covariance @ turn.T)[None], turn @ UP, 0.01, turn @ NORTH)
    for name in ("slope_rad", "aspect_rad", "along", "across", "both"):
        assert getattr(one, name) == pytest.approx(getattr(other, name), abs=1e-12)


def test_any_direction_may_be_up() -> None:
    for seed in range(5):
        up = rotation_from_vector(np.random.default_rng(seed).standard_normal(3)) @ UP
        level = tilts(-up[None] / 3.0, np.zeros((1, 3, 3)), up, 0.0, tangent_basis(up)[:, 0])
        assert level.slope_rad[0] == pytest.approx(0.0, abs=1e-12)


# ---- of heights ----


def test_the_least_limit_is_the_one_that_level_ground_just_meets() -> None:
    for confidence in (0.9, 0.99, 0.999):
        limit = least_limit(0.02, confidence)
        chance = probability_low(np.zeros(1), limit, np.full(1, 0.02), 0.0)
        assert chance[0] == pytest.approx(confidence, abs=1e-6)


def test_what_is_higher_is_less_probably_low_enough_and_so_it_is_on_coarser_ground_or_in_doubt_of_the_scale() -> None:
    heights = np.linspace(0.0, 1.0, 50)
    chance = probability_low(heights, 0.5, np.full(50, 0.02), 0.0)
    assert np.diff(chance).max() <= 0
    assert chance[0] > 0.999 > 0.001 > chance[-1]
    fine, coarse = (probability_low(np.full(1, 0.3), 0.5, np.full(1, px), 0.0)[0] for px in (0.02, 0.05))
    vague = probability_low(np.full(1, 0.3), 0.5, np.full(1, 0.02), 0.3)[0]
    assert fine > coarse
    assert fine > vague
