"""Few rows a plane: what is left out, what their noise is worth, and whether the truth lies within what is stated."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from campaign import seeds

from slopecli.errors import DegenerateConfiguration, NoAnswer
from slopecli.geometry import solve_planes, tilt_growth
from slopecli.geometry.solver import small_sample
from slopecli.options import Options
from slopecli.patches import Given
from slopecli.pipeline import solve
from slopecli.study import Scene, make_scene
from slopecli.types import IntArray, Report

NOISE_PX = 0.3
ALL = tuple(range(9))


def some_rows(scene: Scene, planes: tuple[int, ...], rows: int) -> IntArray:
    return np.concatenate([np.flatnonzero(scene.patch == plane)[:rows] for plane in planes])


def reports(
    planes: tuple[int, ...], rows: int, scenes: int, noise: float | None = None
) -> Iterator[tuple[Scene, Report]]:
    rng = np.random.default_rng(40)
    for _ in range(scenes):
        scene = make_scene(rng, trajectory_deg=float(rng.uniform(0, 90)), noise_px=NOISE_PX)
        use = some_rows(scene, planes, rows)
        given = Given(scene.uv1[use], scene.uv2[use], scene.patch[use])
        camera = replace(scene.camera, width=0, height=0)  # of no image: some points leave that of the scene
        try:
            yield scene, solve(given, (camera, camera), Options(), noise)
        except NoAnswer:
            continue


@pytest.mark.slow
def test_clean_rows_are_all_kept_where_few_are_left_to_tell() -> None:
    for planes, rows in (((4,), 5), ((4,), 6), ((0, 8), 4)):
        for _, report in reports(planes, rows, 20):
            assert report.fit.n_inliers == rows * len(planes)
            assert report.fit.noise_px > 1e-3


def test_a_gross_mismatch_among_few_rows_is_still_found() -> None:
    for seed in seeds(10, 4):
        scene = make_scene(np.random.default_rng(seed), noise_px=NOISE_PX, trajectory_deg=45.0)
        use = some_rows(scene, (0, 8), 8)
        x2 = scene.x2[use].copy()
        x2[3] += 0.1
        solution = solve_planes(scene.x1[use], x2, (scene.patch[use] == 8).astype(np.int64))
        assert np.flatnonzero(~solution.inlier).tolist() == [3]


def test_a_noise_told_by_few_residuals_widens_sigmas_as_student_does() -> None:
    scene = make_scene(np.random.default_rng(2), noise_px=NOISE_PX, trajectory_deg=45.0)
    for rows in (5, 30):
        use = some_rows(scene, (0, 4, 8), rows)
        labels = np.repeat(np.arange(3), rows)
        estimated = solve_planes(scene.x1[use], scene.x2[use], labels, robust=False)
        known = solve_planes(scene.x1[use], scene.x2[use], labels, noise=estimated.noise, robust=False)
        ratio = np.sqrt(estimated.normal_covariance / known.normal_covariance)
        assert ratio == pytest.approx(small_sample(6 * rows - 14))
    assert small_sample(1) == pytest.approx(12.7062 / 1.95996, rel=1e-4)
    assert small_sample(300) == small_sample(np.inf) == 1.0


def test_what_is_just_determined_asks_for_the_noise() -> None:
    scene = make_scene(np.random.default_rng(2), noise_px=NOISE_PX, trajectory_deg=45.0)
    use = some_rows(scene, (4,), 4)
    with pytest.raises(DegenerateConfiguration, match=r"1 patch and a motion need 9 .*\(--noise\)"):
        solve_planes(scene.x1[use], scene.x2[use], np.zeros(4, np.int64))
    assert len(solve_planes(scene.x1[use], scene.x2[use], np.zeros(4, np.int64), noise=3e-4).scaled_normals) == 1


@pytest.mark.parametrize("seed", [60, 175, 189, 272, 394])
def test_three_rows_nearly_on_a_line_leave_their_tilt_open(seed: int) -> None:
    """A scaled normal many times too long looks sharp: one plane of each of these was off by 25 sigmas and more."""
    scene = make_scene(np.random.default_rng(seed), trajectory_deg=45.0, noise_px=NOISE_PX)
    use = some_rows(scene, ALL, 3)
    given = Given(scene.uv1[use], scene.uv2[use], scene.patch[use])
    report = solve(given, (scene.camera, scene.camera), Options(), NOISE_PX)
    for plane in report.planes:
        off = abs(plane.slope_deg - np.degrees(scene.slopes[plane.id]))
        assert plane.status == "poor" or off < 4.0 * plane.slope_sigma_deg


def test_a_normal_known_well_grows_by_nothing() -> None:
    normals = np.array([[0.1, 0.2, 1.0], [0.0, 0.0, 10.0]])
    covariance = np.array([1e-4 * np.eye(3), np.diag([0.1, 0.1, 36.0])])
    growth = tilt_growth(normals, covariance)
    assert growth[0] == 1.0
    assert growth[1] > 3.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("planes", "rows", "at_least"), [((4,), 5, 0.85), ((4,), 6, 0.85), ((0, 8), 4, 0.85), ((0, 4), 30, 0.94)]
)
def test_intervals_of_few_rows_hold_the_truth(planes: tuple[int, ...], rows: int, at_least: float) -> None:
    """That of the answer, or of either where two are left: 89 to 93 % measured of few rows, not yet the 95 % stated.

    The limits lie two to three standard errors below that. Without Student's factor it was 73 to 84 %.
    """
    inside = []
    for scene, report in reports(planes, rows, 200):
        other = report.ambiguity.alternative
        seconds = other.planes if other and report.ambiguity.status == "unresolved" else report.planes
        for both in zip(report.planes, seconds, strict=True):
            if all(plane.slope_known for plane in both) and both[0].status == "ok":
                truth = np.degrees(scene.slopes[both[0].id])
                inside.append(any(p.slope_ci95_deg[0] <= truth <= p.slope_ci95_deg[1] for p in both))
    assert len(inside) > 60
    assert np.mean(inside) >= at_least
