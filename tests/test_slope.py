"""Slopes, aspects, intervals and probabilities."""

from __future__ import annotations

import math
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from campaign import seeds

from slopecli.errors import InputError
from slopecli.geometry import disc_probability, measure_slopes, probability_below, slope_interval, solve_planes
from slopecli.study import UP, make_scene
from slopecli.types import FloatArray, Slopes, Solution


def one_plane(normal: FloatArray, sigma: float = 0.01) -> Solution:
    """A solution holding planes with the given outward normals and the same independent error of their direction."""
    normals = np.atleast_2d(np.asarray(normal, dtype=float))
    normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    m = len(normals)
    return Solution(
        R=np.eye(3), T=np.array([1.0, 0.0, 0.0]), scaled_normals=-normals,
        normal_covariance=np.tile(sigma**2 * np.eye(3), (m, 1, 1)), motion_covariance=np.zeros((5, 5)),
        tangent=np.eye(3)[:, 1:], normal_gain=np.zeros((m, 3, 5)), noise=1e-3, relief=np.zeros(m), rms=1e-3, chi2=1.0,
        inlier=np.ones(1, dtype=bool), converged=True, iterations=1, noise_gain=1.0,
    )  # fmt: skip


def isotropic(slope: FloatArray, sigma: float) -> Slopes:
    slope = np.asarray(slope, dtype=float)
    return Slopes(slope, slope, slope, slope, np.tile(sigma**2 * np.eye(2), (len(slope), 1, 1)))


@pytest.mark.parametrize("degrees", [1e-7, 0.5, 15.0, 45.0, 90.0, 120.0, 179.0])
def test_slope_is_the_angle_between_outward_normal_and_up(degrees: float) -> None:
    angle = np.radians(degrees)
    slopes = measure_slopes(one_plane([np.sin(angle), 0.0, -np.cos(angle)]), 7.0 * UP)
    assert slopes.slope_rad[0] == pytest.approx(angle, rel=1e-9)


@pytest.mark.parametrize(
    ("downhill", "aspect_deg"),
    [([0.0, -1.0], 0.0), ([1.0, 0.0], 90.0), ([0.0, 1.0], 180.0), ([-1.0, 0.0], 270.0), ([1.0, -1.0], 45.0)],
)
def test_aspect_turns_clockwise_from_the_top_of_the_image(downhill: list[float], aspect_deg: float) -> None:
    """The camera looks down, so the image is a map: right of it is a quarter turn clockwise from its top."""
    horizontal = np.array(downhill) / np.linalg.norm(downhill)
    slopes = measure_slopes(one_plane([*(0.3 * horizontal), -1.0]), UP)
    assert np.degrees(slopes.aspect_rad[0]) == pytest.approx(aspect_deg, abs=1e-9)


def test_aspect_from_a_given_north_and_from_a_level_camera() -> None:
    plane = one_plane([0.3, 0.0, -1.0])
    east = measure_slopes(plane, UP, north=np.array([1.0, 0.0, 5.0]))
    assert np.degrees(east.aspect_rad[0]) == pytest.approx(0.0, abs=1e-9)
    # a camera looking at the horizon has its image's up direction vertical, so it counts from its viewing direction
    ahead = measure_slopes(one_plane([0.0, -1.0, 0.3]), np.array([0.0, -1.0, 0.0]))
    assert np.degrees(ahead.aspect_rad[0]) == pytest.approx(0.0, abs=1e-9)


def test_aspect_is_undefined_on_level_ground() -> None:
    slopes = measure_slopes(one_plane([[0.015, 0.0, -1.0], [0.03, 0.0, -1.0]], sigma=0.01), UP)
    assert np.isnan(slopes.aspect_rad[0])
    assert np.isnan(slopes.aspect_sigma_rad[0])
    assert np.isfinite(slopes.aspect_sigma_rad[1])


def turned(vector: FloatArray, by: FloatArray) -> FloatArray:
    """(n, 3) unit vector, or one a row, moved by tangent vectors (n, 3) along the sphere."""
    angle = np.linalg.norm(by, axis=1, keepdims=True)
    return np.cos(angle) * vector + np.sinc(angle / np.pi) * by


def across(vector: FloatArray, errors: FloatArray) -> FloatArray:
    """The part of errors (n, 3) that turns a unit vector."""
    return errors - (errors @ vector)[:, None] * vector


@pytest.mark.parametrize("slope_deg", [2.5, 4.0, 20.0, 60.0, 90.0, 150.0])
@pytest.mark.parametrize(
    ("sigmas_deg", "up", "north"),
    [
        ((1.0, 0.0, 0.0), [0.0, 0.0, -1.0], None),
        ((0.5, 1.0, 0.0), [0.0, -0.6, -0.8], [1.0, 0.0, 0.0]),  # as of metadata: north is level
        ((0.5, 1.0, 3.0), [0.0, -0.6, -0.8], None),  # the image's up direction leans by 37 degrees
    ],
)
def test_sigma_of_the_aspect_is_the_error_that_is_seen(
    slope_deg: float, sigmas_deg: tuple[float, float, float], up: list[float], north: list[float] | None
) -> None:
    """Monte-Carlo over errors of the normal, of up and of north's azimuth; 1 % of noise of its own."""
    rng, n = np.random.default_rng(7), 20_000
    of_normal, of_up, of_north = np.radians(sigmas_deg)
    vertical = np.array(up)
    level = np.cross(vertical, [0.2, 0.9, 0.3])
    level /= np.linalg.norm(level)
    slope = np.radians(slope_deg)
    normal = np.sin(slope) * level + np.cos(slope) * vertical
    given = None if north is None else np.array(north)
    told = measure_slopes(one_plane(normal, of_normal), vertical, of_up, given, north_sigma_rad=of_north)
    if np.isnan(told.aspect_rad[0]):
        assert slope_deg < 2.0 * np.degrees(told.sigma_rad[0])
        return
    normals = turned(normal, across(normal, rng.normal(0.0, of_normal, (n, 3))))
    verticals = turned(vertical, across(vertical, rng.normal(0.0, max(of_up, 1e-12), (n, 3))))
    start = np.array([0.0, -1.0, 0.0]) if given is None else given
    ahead = start - (verticals @ start)[:, None] * verticals
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    found = np.arctan2((normals * np.cross(ahead, verticals)).sum(1), (normals * ahead).sum(1))
    error = np.angle(np.exp(1j * (found + rng.normal(0.0, of_north, n) - told.aspect_rad[0])))
    assert np.sqrt(np.mean(error**2)) == pytest.approx(told.aspect_sigma_rad[0], rel=0.03)


def test_a_wall_keeps_its_strike_where_up_is_uncertain() -> None:
    wall = one_plane([0.0, -1.0, 0.0], sigma=1e-4)
    up, north = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
    assert measure_slopes(wall, up, 0.05, north).aspect_sigma_rad[0] == pytest.approx(1e-4, rel=0.01)
    doubted = measure_slopes(wall, up, 0.05, north, north_sigma_rad=0.02)
    assert doubted.aspect_sigma_rad[0] == pytest.approx(0.02, rel=0.01)


def test_sigma_is_first_order_on_slopes_and_finite_on_level_ground() -> None:
    slopes = measure_slopes(one_plane([[0.5, 0.0, -1.0], [0.0, 0.0, -1.0]], sigma=0.01), UP)
    assert slopes.sigma_rad[0] == pytest.approx(0.01, rel=0.001)
    assert slopes.sigma_rad[1] == pytest.approx(0.01 * np.sqrt(2.0), rel=0.01)


def test_uncertain_up_enters_slope_and_interval() -> None:
    certain = measure_slopes(one_plane([0.5, 0.0, -1.0], sigma=0.03), UP)
    doubtful = measure_slopes(one_plane([0.5, 0.0, -1.0], sigma=0.03), UP, up_sigma_rad=0.04)
    assert certain.sigma_rad[0] == pytest.approx(0.03, rel=0.01)
    assert doubtful.sigma_rad[0] == pytest.approx(0.05, rel=0.01)
    assert np.ptp(slope_interval(doubtful)[0]) > 1.5 * np.ptp(slope_interval(certain)[0])


def test_slope_against_another_plane_shares_the_motion() -> None:
    """Monte-Carlo over noise: the predicted sigma of the angle between two planes is the one that is seen."""
    found, predicted = [], []
    for seed in seeds(150, 60):
        scene = make_scene(
            np.random.default_rng(1),
            grid=(2, 1),
            points=60,
            slopes_deg=[5.0, 25.0],
            noise_rng=np.random.default_rng(seed),
        )
        solution = solve_planes(scene.x1, scene.x2, scene.patch, noise=scene.noise)
        slopes = measure_slopes(solution, up_plane=0)
        assert slopes.slope_rad[0] == slopes.sigma_rad[0] == 0.0
        found.append(slopes.slope_rad[1])
        predicted.append(slopes.sigma_rad[1])
    assert np.std(found) == pytest.approx(np.mean(predicted), rel=0.15)


def test_own_up_is_as_good_as_the_given_one_when_it_is_the_same() -> None:
    scene = make_scene(np.random.default_rng(2), noise_px=0.0, slopes_deg=[0.0] + [12.0] * 8)
    solution = solve_planes(scene.x1, scene.x2, scene.patch)
    assert measure_slopes(solution, up_plane=0).slope_rad[1:] == pytest.approx(np.radians(12.0), abs=1e-9)


def test_disc_probability_against_closed_forms() -> None:
    unit = np.eye(2)[None]
    # centred: Rayleigh; far away and large: one-dimensional Gaussian; one axis without noise: an interval
    for radius in (0.3, 1.0, 3.0):
        assert disc_probability(np.zeros(1), unit, np.array([radius]))[0] == pytest.approx(1 - np.exp(-(radius**2) / 2))
    narrow = np.diag([4.0, 1e-14])[None]
    expected = 0.5 * (math.erf(0.75 / np.sqrt(2)) + math.erf(0.25 / np.sqrt(2)))
    assert disc_probability(np.array([0.5]), narrow, np.array([1.0]))[0] == pytest.approx(expected, abs=1e-6)
    assert disc_probability(np.zeros(1), unit, np.zeros(1))[0] == 0.0


def test_disc_probability_against_sampling() -> None:
    rng = np.random.default_rng(0)
    covariance = np.array([[0.5, 0.3], [0.3, 2.0]])
    e = rng.multivariate_normal([0.0, 0.0], covariance, 400_000)
    for distance, radius in ((0.0, 1.0), (1.0, 2.0), (3.0, 2.5)):
        seen = np.mean(np.hypot(e[:, 0] + distance, e[:, 1]) < radius)
        got = disc_probability(np.array([distance]), covariance[None], np.array([radius]))[0]
        assert got == pytest.approx(seen, abs=4e-3)


@pytest.mark.parametrize("slope_sigmas", [0.0, 1.0, 3.0, 10.0])
def test_probability_below_never_beats_the_one_dimensional_gaussian(slope_sigmas: float) -> None:
    sigma = 0.02
    slopes = isotropic([slope_sigmas * sigma], sigma)
    for z in (1.0, 2.326, 3.0, 3.719):
        tolerance = (slope_sigmas + z) * sigma
        gaussian = 0.5 * (1.0 + math.erf(z / np.sqrt(2.0)))
        p = probability_below(slopes, tolerance)[0]
        assert p <= gaussian
        if slope_sigmas == 10.0:
            assert gaussian - p < 0.06 * (1.0 - gaussian) ** 0.5


def test_how_level_the_reference_plane_is_counts_for_it_too() -> None:
    scene = make_scene(np.random.default_rng(4), noise_px=0.1)
    solution = solve_planes(scene.x1, scene.x2, scene.patch)
    sure = measure_slopes(solution, up_plane=2)
    doubtful = measure_slopes(solution, None, np.radians(20.0), up_plane=2)
    assert sure.sigma_rad[2] == 0.0
    assert probability_below(sure, np.radians(15.0))[2] == pytest.approx(1.0)
    assert np.degrees(doubtful.sigma_rad[2]) > 15.0
    assert probability_below(doubtful, np.radians(15.0))[2] < 0.5


def test_probability_below_is_sharp_without_noise() -> None:
    assert probability_below(isotropic([0.1, 0.3], 0.0), 0.2).tolist() == pytest.approx([1.0, 0.0])


@pytest.mark.parametrize("ratio", [1.0, pytest.param(3.0, marks=pytest.mark.slow), 10.0])
@pytest.mark.parametrize("slope_sigmas", [0.0, 0.3, 1.0, 2.0, 3.0, 6.0, 20.0])
def test_interval_covers_at_small_slopes_too(slope_sigmas: float, ratio: float) -> None:
    """95 % intervals cover between 93 and 98 % at every slope, with errors up to ten times narrower one way."""
    rng = np.random.default_rng(int(10 * slope_sigmas + ratio))
    n, sigma = 3000, 0.01
    azimuth = rng.uniform(0.0, 2.0 * np.pi, n)
    true = slope_sigmas * sigma * np.column_stack([np.cos(azimuth), np.sin(azimuth)])
    found = true + rng.standard_normal((n, 2)) * [sigma, sigma / ratio]
    slope = np.hypot(*found.T)
    along = found / slope[:, None]
    axes = np.stack([along, along[:, ::-1] * [-1.0, 1.0]], axis=1)
    covariance = axes @ np.diag([sigma**2, (sigma / ratio) ** 2]) @ axes.swapaxes(1, 2)
    interval = slope_interval(Slopes(slope, slope, slope, slope, covariance))
    truth = slope_sigmas * sigma
    covered = np.mean((interval[:, 0] <= truth) & (truth <= interval[:, 1]))
    assert 0.93 < covered < 0.98


@pytest.mark.parametrize("ratio", [1.0, 5.0])
@pytest.mark.parametrize("slope_sigmas", [0.0, 0.2, 0.5, 1.0, 2.0, 4.0])
def test_interval_covers_a_truth_that_varies_about_what_is_laid_down(slope_sigmas: float, ratio: float) -> None:
    """Up is taken from a plane that is level to a sigma: the tilt found is always the same, the true one is not."""
    rng = np.random.default_rng(int(10 * slope_sigmas + ratio))
    sigma = np.array([0.01, 0.01 / ratio])
    laid_down = np.array([slope_sigmas * 0.01])
    truth = np.hypot(*([laid_down[0], 0.0] + rng.standard_normal((20_000, 2)) * sigma).T)
    covariance = np.diag(sigma**2)[None]
    low, high = slope_interval(Slopes(laid_down, laid_down, laid_down, laid_down, covariance))[0]
    assert 0.94 < np.mean((low <= truth) & (truth <= high)) < 0.98


@pytest.mark.parametrize("ratio", [0.0, 0.01, 0.1, 1.0])
@pytest.mark.parametrize("narrow", [0, 1])
def test_limits_rise_smoothly_with_the_slope_however_thin_the_error_is(ratio: float, narrow: int) -> None:
    slope = np.linspace(0.0, 0.079, 159)  # from eight sigmas on it is Gaussian
    covariance = np.broadcast_to(np.diag(np.roll([0.01**2, (ratio * 0.01) ** 2], narrow - 1)), (159, 2, 2))
    interval = slope_interval(Slopes(slope, slope, slope, slope, covariance))
    steps = np.diff(interval, axis=0)
    assert steps.min() > -1e-4
    assert steps[:, 1].max() < 0.002


def test_interval_starts_at_zero_on_level_ground_and_is_gaussian_on_slopes() -> None:
    interval = slope_interval(isotropic([0.005, 0.5], 0.01))
    assert interval[0, 0] == 0.0
    assert interval[1] == pytest.approx([0.5 - 0.0196, 0.5 + 0.0196], abs=1e-4)
    wider = slope_interval(isotropic([0.005, 0.5], 0.01), level=0.99)
    assert (wider[:, 1] > interval[:, 1]).all()


@pytest.mark.slow
def test_intervals_cover_on_gentle_terrain() -> None:
    covered = []
    for seed in range(150):
        scene = make_scene(np.random.default_rng([3, seed]), max_slope_deg=3.0, height_spread=0.1, noise_px=0.5)
        solution = solve_planes(scene.x1, scene.x2, scene.patch)
        interval = slope_interval(measure_slopes(solution, UP))
        covered.append((interval[:, 0] <= scene.slopes) & (scene.slopes <= interval[:, 1]))
    assert 0.93 < np.mean(covered) < 0.97


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"up_cam1": np.zeros(3)}, "up is"),
        ({"up_cam1": np.array([1.0, 0.0])}, "up is"),
        ({}, "either the up direction or the plane"),
        ({"up_plane": 4}, "planes 0..0"),
        ({"up_cam1": UP, "north": UP}, "north is vertical"),
        ({"up_cam1": UP, "up_sigma_rad": -1.0}, "uncertainty of up"),
    ],
)
def test_unusable_directions_are_named(arguments: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        measure_slopes(one_plane([0.0, 0.1, -1.0]), **arguments)  # type: ignore[arg-type]


def test_level_must_be_a_probability() -> None:
    with pytest.raises(InputError, match="confidence level"):
        slope_interval(isotropic([0.1], 0.01), level=95.0)


def test_geometry_needs_neither_opencv_nor_scipy() -> None:
    code = (
        "import sys, numpy as np\n"
        "from slopecli.geometry import solve_planes, measure_slopes, slope_interval\n"
        "from slopecli.study.scenes import make_scene\n"
        "s = make_scene(np.random.default_rng(0), outliers=0.1)\n"
        "slope_interval(measure_slopes(solve_planes(s.x1, s.x2, s.patch), [0, 0, -1]))\n"
        "print([m for m in ('cv2', 'scipy', 'click', 'matplotlib') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_solution_cross_covariance_is_consistent() -> None:
    scene = make_scene(np.random.default_rng(4))
    solution = solve_planes(scene.x1, scene.x2, scene.patch)
    assert np.array_equal(solution.cross_covariance(2, 2), solution.normal_covariance[2])
    assert solution.cross_covariance(1, 3) == pytest.approx(solution.cross_covariance(3, 1).T)
    stripped = replace(solution, normal_gain=np.zeros_like(solution.normal_gain))
    assert not stripped.cross_covariance(1, 3).any()
