"""Correspondences of a user's own: no plane is safe whose rows, or whose noise, contradict it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from slopecli.errors import InputError, NoAnswer
from slopecli.geometry import rotation_from_vector
from slopecli.options import Options
from slopecli.patches import Given
from slopecli.pipeline import solve
from slopecli.study import Scene, make_scene
from slopecli.types import Camera, FloatArray, IntArray, Report

FLIGHTS = (0.0, 45.0, 90.0)


def facets(seed: int = 1, **changes: Any) -> Scene:
    return make_scene(np.random.default_rng(seed), **{"noise_px": 0.3, **changes})


def solved(
    scene: Scene, patch: IntArray | None = None, noise: float | None = None, rays: bool = False, **options: Any
) -> Report:
    labels = scene.patch if patch is None else patch
    xy1, xy2 = (scene.x1, scene.x2) if rays else (scene.uv1, scene.uv2)
    cameras = None if rays else (scene.camera, scene.camera)
    return solve(Given(xy1, xy2, labels), cameras, Options(**options), noise)


def warnings(report: Report) -> set[str]:
    return {one.code for one in report.diagnostics if one.severity == "warning"}


@pytest.mark.parametrize("flight", FLIGHTS)
@pytest.mark.parametrize("noise", [None, 0.3])
def test_nine_planes_called_one_are_no_plane(flight: float, noise: float | None) -> None:
    for seed in range(3):
        scene = facets(seed, trajectory_deg=flight, slopes_deg=[6, 9, 12, 16, 20, 23, 26, 29, 31])
        report = solved(scene, np.zeros_like(scene.patch), noise, tolerance_deg=60.0)
        (plane,) = report.planes
        assert (plane.status, plane.verdict) == ("poor", "undecided")
        assert "non-planar-patch" in warnings(report)
        assert noise is None or "poor-fit" in warnings(report)


def _over(height: FloatArray, xy: FloatArray, rng: np.random.Generator, move: tuple[float, float, float]) -> Given:
    """Rows of points at places (n, 2) and heights (n,), seen from 10 above by cameras that look down; 0.3 px noise."""
    camera = Camera(1024, 768, 800.0, 800.0, 511.5, 383.5)
    points = np.column_stack([xy, 10.0 - height])
    turned = (points - np.array(move)) @ rotation_from_vector(np.array([0.01, -0.02, 0.015])).T
    uv1, uv2 = (800.0 * p[:, :2] / p[:, 2:] + [camera.cx, camera.cy] for p in (points, turned))
    return Given(uv1, uv2 + rng.normal(0.0, 0.3, uv2.shape), np.zeros(len(xy), np.int64), has_patch=False)


@pytest.mark.parametrize("move", [(2.0, 0.0, 0.0), (1.5, 0.3, 1.5)])
def test_one_plane_through_a_ridge_or_a_bowl_is_none(move: tuple[float, float, float]) -> None:
    """Their mean is level, and the motion of a single plane takes part of what is off it across the lines, too."""
    camera, steep = Camera(1024, 768, 800.0, 800.0, 511.5, 383.5), np.tan(np.radians(20.0))
    for n in (20, 60):
        rng = np.random.default_rng(n)
        x, y = xy = rng.uniform([[-4.0], [-3.0]], [[4.0], [3.0]], (2, n))
        for height in (-np.abs(x) * steep, x**2 * steep / 8.0, (x**2 + y**2) * steep / 8.0):
            (plane,) = solve(_over(height, xy.T, rng, move), (camera, camera), Options(), None).planes
            assert plane.verdict != "safe"
        assert plane.status == "poor"  # the bowl
        report = solve(_over(x * steep / 3.0, xy.T, rng, move), (camera, camera), Options(), None)
        assert report.planes[0].status == "ok"


def test_points_outside_the_image_are_counted_and_most_of_them_refused() -> None:
    rows = np.loadtxt(Path(__file__).parents[1] / "sample_data" / "matches.csv", delimiter=",", skiprows=1)
    camera, patch = Camera(1024, 768, 800, 800, 511.5, 383.5), rows[:, 4].astype(np.int64)
    xy1, xy2 = rows[:, :2], rows[:, 2:4]
    whole = solve(Given(xy1, xy2, patch), (camera, camera), Options(), None)
    assert "outside-image" not in {one.code for one in whole.diagnostics}
    narrow = replace(camera, width=820)
    off = xy2[:, 0] > 820
    report = solve(Given(xy1, xy2, patch), (camera, narrow), Options(), None)
    (said,) = [one for one in report.diagnostics if one.code == "outside-image"]
    assert f"{off.sum()} of {len(rows)} rows lie outside image 2 of 820x768 px" in said.message
    # a camera without an image size cannot tell
    sizeless = Camera(0, 0, 800, 800, 511.5, 383.5)
    report = solve(Given(xy1, xy2, patch), (sizeless, sizeless), Options(), None)
    assert "outside-image" not in {one.code for one in report.diagnostics}

    doubled, rays = (2.2 * xy1, 2.2 * xy2), ((xy1 - 500) / 800, (xy2 - 500) / 800)
    for one, two, words in (
        (xy1[:, ::-1], xy2[:, ::-1], "x and y in each other's place"),
        (*doubled, "of another size"),
        (*rays, "as rays do"),
    ):
        with pytest.raises(InputError, match=f"^the correspondences: .*{words}"):
            solve(Given(one, two, patch[: len(one)]), (camera, camera), Options(), None)
        with pytest.raises(InputError, match=f"^rows.csv: .*{words}"):
            solve(Given(one, two, patch[: len(one)], path="rows.csv"), (camera, camera), Options(), None)


def test_planes_found_are_not_told_to_be_found() -> None:
    scene = facets(2, slopes_deg=[6, 9, 12, 16, 20, 23, 26, 29, 31])
    one = np.zeros_like(scene.patch)
    for planes, advised in (("one", True), ("found", False)):
        given = Given(scene.uv1, scene.uv2, one, options={"planes": planes})
        report = solve(given, (scene.camera, scene.camera), Options(tolerance_deg=60.0), None)
        texts = [f"{found.message}; {found.remedy}" for found in report.diagnostics]
        (said,) = [text for text in texts if "is not one plane" in text]
        assert "25 %" not in said
        assert any("--planes found" in text for text in texts) == advised


def test_rows_of_two_planes_on_one_are_told_how_to_part_them() -> None:
    """Two planes that one and a wrong motion nearly explain: residuals of 4 px are all that shows it."""
    rows = np.loadtxt(Path(__file__).parents[1] / "sample_data" / "matches.csv", delimiter=",", skiprows=1)[90:150]
    camera = Camera(1024, 768, 800, 800, 511.5, 383.5)
    one = Given(rows[:, :2], rows[:, 2:4], np.zeros(len(rows), np.int64))
    report = solve(one, (camera, camera), Options(), None)
    remedies = [found.remedy for found in report.diagnostics if found.code == "poor-fit"]
    assert any(remedy and "--planes found" in remedy for remedy in remedies)


@pytest.mark.parametrize("flight", FLIGHTS)
def test_rows_given_the_planes_of_others_make_no_plane_safe(flight: float) -> None:
    for seed in range(3):
        rng = np.random.default_rng(seed)
        scene = facets(seed, trajectory_deg=flight, slopes_deg=list(rng.uniform(0, 10, 9)))
        report = solved(scene, rng.permutation(scene.patch), tolerance_deg=60.0)
        assert {plane.verdict for plane in report.planes} <= {"undecided", "unsafe"}


def test_one_plane_of_two_windows_does_not_spoil_the_others() -> None:
    scene = facets(slopes_deg=[5, 30, 5, 8, 3, 10, 12, 6, 9])
    patch = np.where(scene.patch == 1, 0, scene.patch)
    for solver in ("mle", "ha"):
        report = solved(scene, patch, solver=solver)
        mixed, *others = report.planes
        assert (mixed.id, mixed.status, mixed.verdict) == (0, "poor", "undecided")
        assert {plane.status for plane in others} == {"ok"}
    off = np.array([plane.slope_deg for plane in others]) - np.degrees(scene.slopes[2:])
    assert np.abs(off).max() < 1.0


def test_residuals_far_beyond_the_noise_given_make_every_plane_poor() -> None:
    scene = facets(noise_px=1.5)
    report = solved(scene, noise=0.1, tolerance_deg=60.0)
    for plane in report.planes:
        assert (plane.status, plane.verdict) == ("poor", "undecided")
        assert (plane.reason or "").startswith("residuals are 1")
        assert (plane.reason or "").endswith("times the noise given")
    (warning,) = (one for one in report.diagnostics if one.code == "poor-fit" and one.value and one.value > 2)
    assert warning.value == pytest.approx(15, rel=0.1)


def test_noise_a_little_beyond_the_one_given_is_used_and_said() -> None:
    report = solved(facets(noise_px=0.3), noise=0.2)
    assert {plane.status for plane in report.planes} == {"ok"}
    (note,) = (one for one in report.diagnostics if one.code == "noise-exceeded")
    assert "0.2 px" in note.message
    assert note.value == pytest.approx(0.3, rel=0.1)
    assert report.fit.noise_px == note.value
    assert not [one for one in solved(facets(), noise=0.3).diagnostics if one.code == "noise-exceeded"]


def test_residuals_of_pixels_are_poor_unless_said_beforehand() -> None:
    scene = facets(noise_px=4.0, relief=0.0)
    assert {plane.status for plane in solved(scene, tolerance_deg=60.0).planes} == {"poor"}
    assert {plane.status for plane in solved(scene, noise=4.0, tolerance_deg=60.0).planes} == {"ok"}


@pytest.mark.parametrize("flight", FLIGHTS)
def test_honest_planes_and_rough_ground_are_answered(flight: float) -> None:
    """Relief that scatters from point to point is in the sigmas, and no plane of it is called poor."""
    inside = total = 0
    for seed in range(6):
        for relief in (0.0, 0.005):
            scene = facets(seed, trajectory_deg=flight, relief=relief, rotation_deg=3.0)
            report = solved(scene, rays=bool(seed % 2))
            assert [plane.status for plane in report.planes] == ["ok"] * 9
            off = np.array([plane.slope_deg for plane in report.planes]) - np.degrees(scene.slopes)
            sigma = np.array([plane.slope_sigma_deg for plane in report.planes])
            inside, total = inside + int((np.abs(off) < 1.96 * sigma).sum()), total + 9
            told = [one.message for one in report.diagnostics if one.code == "relief"]
            assert bool(told) == bool(relief)
            assert np.isfinite(report.planes[0].roughness) == bool(relief)
    # 108 slopes; 95 % of them, and planes of a scene share the error of its motion
    assert inside / total > 0.86


def test_rows_of_no_pair_have_no_answer() -> None:
    scene, rng = facets(), np.random.default_rng(1)
    for rays in (True, False):
        for unrelated in (rng.permutation(len(scene.x2)), np.r_[0:100, 100 + rng.permutation(170)]):
            with pytest.raises(NoAnswer, match="agree on no motion"):
                solved(replace(scene, x2=scene.x2[unrelated]), rays=rays)


def test_exact_rows_are_exact_whatever_the_noise_given() -> None:
    scene = facets(noise_px=0.0)
    for noise in (None, 0.3):
        report = solved(scene, noise=noise)
        assert [plane.slope_deg for plane in report.planes] == pytest.approx(np.degrees(scene.slopes), abs=1e-5)
        assert {plane.status for plane in report.planes} == {"ok"}


def test_what_is_not_one_plane_is_not_merged_with_others() -> None:
    scene = facets(slopes_deg=[0.0] * 4 + [12.0] + [0.0] * 4, height_spread=0.0, trajectory_deg=90.0)
    report = solved(scene, np.where(scene.patch == 5, 4, scene.patch), merge_coplanar=True)
    merged = " ".join(one.message.partition(" lie ")[0] for one in report.diagnostics if one.code == "coplanar")
    assert "0, 1, 2" in merged
    assert "4" not in merged
    assert [plane.id for plane in report.planes if plane.status == "poor"] == [4]


def test_a_noise_given_is_not_reported_as_measured() -> None:
    report = solved(facets(), noise=1.0)
    assert "poor-fit" not in {one.code for one in report.diagnostics}
    assert report.fit.noise_px == pytest.approx(1.0)


def test_what_is_flat_is_told_by_residuals_and_not_by_the_noise_given() -> None:
    scene = facets(3, trajectory_deg=45.0, slopes_deg=[10.0] * 9, height_spread=0.0)
    for noise in (None, 0.3, 5.0):
        assert "single-plane" not in {one.code for one in solved(scene, noise=noise).diagnostics}


@pytest.mark.parametrize("rays", [False, True])
def test_residuals_of_the_longuet_higgins_motion_are_not_blamed_on_the_rows(rays: bool) -> None:
    scene = facets(trajectory_deg=45.0, noise_px=1.0)
    borderless = replace(scene, camera=replace(scene.camera, width=0, height=0))  # as image 2 of the simulation is
    report = solved(borderless, rays=rays, solver="lh")
    assert warnings(report) == {"poor-fit"}
    assert "single-plane" not in {one.code for one in report.diagnostics}
    for one in report.diagnostics:
        assert one.severity != "warning" or one.remedy == "--solver lh does not minimise residuals; use mle"
    assert not any(plane.verdict == "safe" and plane.status == "poor" for plane in report.planes)
