"""A wrong camera is told from the matches alone, a right one is not suspected, and one plane tells nothing."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from campaign import seeds

from slopecli import load_camera, load_image
from slopecli.cli import result_table
from slopecli.findings import CameraTest, focal_note, focal_to_use
from slopecli.geometry import rays_from_pixels, rotation_angle, rotation_from_vector, solve_planes
from slopecli.geometry.solver import (
    Settled,
    Sightings,
    changed,
    free_focal,
    free_parameter,
    lines_explain,
    score_camera,
    start_by_lines,
    with_planes,
)
from slopecli.look import Images, focal_by_features
from slopecli.options import Options
from slopecli.patches import Given
from slopecli.pipeline import estimate, solve
from slopecli.products import report_to_csv
from slopecli.solving import Answer, contradicted
from slopecli.study import Scene, field_of_view_camera, make_scene
from slopecli.types import Camera, Report, Solution

SAMPLE = Path(__file__).parent.parent / "sample_data" / "descent"
PINHOLE = field_of_view_camera()
LENS = replace(PINHOLE, model="brown", distortion=(-0.15, 0.03, 0.001, -0.0005, 0.0))


def scene_of(seed: int = 0, camera: Camera = PINHOLE, **options: object) -> Scene:
    values: dict[str, object] = {"trajectory_deg": 45.0, "noise_px": 0.1, "points": 60, "camera": camera}
    return make_scene(np.random.default_rng(seed), **{**values, **options})  # type: ignore[arg-type]


def seen_through(scene: Scene, camera: Camera, relief: bool = False) -> tuple[Sightings, Solution]:
    sightings = Sightings(scene.uv1, scene.uv2, scene.patch, np.ones(len(scene.patch)), (camera, camera), 1.0)
    solution = solve_planes(*sightings.rays(), scene.patch, relief=relief)
    return sightings.take(solution.inlier), solution


def report_of(scene: Scene, camera: Camera, **options: object) -> Report:
    given = Given(scene.uv1, scene.uv2, scene.patch)
    return solve(given, (camera, camera), Options(**options))  # type: ignore[arg-type]


def test_rays_that_are_known_are_those_of_these_cameras_only() -> None:
    scene, longer = scene_of(camera=LENS), changed(LENS, "f", 0.1)
    every = Sightings(scene.uv1, scene.uv2, scene.patch, np.ones(len(scene.patch)), (LENS, LENS), 1.0)
    known, some = every.with_rays(), np.arange(3, 40, 5)
    for seen in (
        known.take(some),
        known.take(some).seen_by((longer, longer)),
        known.seen_by((longer, longer)).take(some),
    ):
        for x, uv, camera in zip(seen.rays(), (scene.uv1, scene.uv2), seen.cameras, strict=True):
            np.testing.assert_array_equal(x, rays_from_pixels(camera, uv[some]))


@pytest.mark.parametrize("factor", [0.6, 0.9, 1.3])
@pytest.mark.parametrize("camera", [PINHOLE, LENS], ids=["pinhole", "distorted"])
def test_a_false_focal_length_is_recovered_exactly_without_noise(camera: Camera, factor: float) -> None:
    false = changed(camera, "f", np.log(factor))
    sightings, solution = seen_through(scene_of(camera=camera, noise_px=0.0), false)
    freed = free_focal(sightings, Settled.of(solution))
    assert freed is not None
    assert factor * np.exp(freed.value) == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize(("parameter", "by"), [("cx", 0.05), ("cy", -0.03), ("k1", 0.05)])
def test_other_parameters_are_recovered_exactly_without_noise(parameter: str, by: float) -> None:
    sightings, solution = seen_through(scene_of(camera=LENS, noise_px=0.0), changed(LENS, parameter, by))
    freed = free_parameter(sightings, Settled.of(solution), parameter)
    assert freed is not None
    assert freed.value == pytest.approx(-by, abs=1e-5)


def test_matches_have_more_noise_under_a_false_focal_length() -> None:
    noises = []
    for factor in (1.0, 0.9):
        sightings, solution = seen_through(scene_of(8), changed(PINHOLE, "f", np.log(factor)))
        freed = free_focal(sightings, Settled.of(solution))
        assert freed is not None
        noises.append(freed.less_noise)
    assert noises[0] == pytest.approx(1.0, abs=0.02)
    assert noises[1] > 1.2


@pytest.mark.parametrize("factor", [0.6, 0.9, 1.3])
@pytest.mark.parametrize("camera", [PINHOLE, LENS], ids=["pinhole", "distorted"])
def test_epipolar_lines_tell_the_focal_length_and_the_motion(camera: Camera, factor: float) -> None:
    scene = scene_of(camera=camera, noise_px=0.0, points=100)
    false = changed(camera, "f", np.log(factor))
    every = Sightings(scene.uv1, scene.uv2, scene.patch, np.ones(len(scene.patch)), (false, false), 1.0)
    wrong = np.arange(0, len(scene.patch), 7 if camera is PINHOLE else 20)  # matches that are none
    every.uv2[wrong] = np.roll(every.uv2[wrong], 1, axis=0)
    found = start_by_lines(every, 1e-6, 0.7)
    assert found is not None
    value, (R, T) = found
    apart = 0.02 if camera is PINHOLE else 0.1  # half a step of the focal lengths tried
    assert value == pytest.approx(-np.log(factor), abs=apart)
    assert np.degrees(np.arccos(T @ scene.T)) < 60.0 * apart
    assert np.degrees(rotation_angle(R, scene.R)) < 40.0 * apart


def test_a_search_that_begins_at_a_motion_far_from_the_right_one_arrives() -> None:
    """As where a wrong camera has led to another motion, from which no step comes back."""
    scene = scene_of(1, noise_px=0.1)
    false = changed(PINHOLE, "f", np.log(0.6))
    every = Sightings(scene.uv1, scene.uv2, scene.patch, np.ones(len(scene.patch)), (false, false), 1.0)
    start = Settled.of(solve_planes(*every.rays(), scene.patch))
    turned = rotation_from_vector(np.array([0.0, np.radians(50.0), 0.0])) @ start.T
    freed = free_focal(every, start._replace(T=turned))
    assert freed is not None
    assert freed.value == pytest.approx(-np.log(0.6), abs=0.02)


@pytest.mark.parametrize(("factor", "explained"), [(1.0, False), (0.7, True)])
def test_lines_fitted_without_a_camera_explain_what_a_false_one_sees_but_no_mismatches(
    factor: float, explained: bool
) -> None:
    scene = scene_of(3)
    false = changed(PINHOLE, "f", np.log(factor))
    every = Sightings(scene.uv1, scene.uv2, scene.patch, np.ones(len(scene.patch)), (false, false), 1.0)
    every.uv2[::4] = np.roll(every.uv2[::4], 1, axis=0)
    start = Settled.of(solve_planes(*every.rays(), scene.patch))
    assert lines_explain(every, slice(None), start) is explained
    assert not lines_explain(every, slice(len(scene.patch), None), start)  # no points, no doubt


def test_lines_of_one_plane_tell_no_focal_length() -> None:
    scene = scene_of(4, slopes_deg=[0.0] * 9, height_spread=0.0)
    sightings, solution = seen_through(scene, changed(PINHOLE, "f", np.log(0.8)))
    freed = free_focal(sightings, Settled.of(solution))
    assert freed is None or freed.score.sigma[0] > 0.1


@pytest.mark.parametrize("left", ["two", "line"])
def test_a_plane_that_its_points_do_not_fix_is_none_for_the_test(left: str) -> None:
    sightings, solution = seen_through(scene_of(9), PINHOLE)
    on_it = np.flatnonzero(sightings.patch == 4)
    if left == "line":
        sightings.uv1[on_it] = sightings.uv1[on_it[0]] + np.arange(len(on_it))[:, None] * [1.0, 0.5]
        kept = np.ones(len(sightings.patch), bool)
    else:
        kept = (sightings.patch != 4) | (np.arange(len(sightings.patch)) <= on_it[1])
    found, settled = with_planes(sightings.take(kept), Settled.of(solution))
    assert len(settled.scaled_normals) == len(solution.scaled_normals) - 1
    assert found.patch.max() == len(settled.scaled_normals) - 1


def test_a_plane_with_two_points_left_does_not_stop_the_test() -> None:
    sightings, solution = seen_through(scene_of(9), PINHOLE)
    whole = score_camera(sightings, Settled.of(solution))
    kept = (sightings.patch != 4) | (np.cumsum(sightings.patch == 4) <= 2)
    left, settled = with_planes(sightings.take(kept), Settled.of(solution))
    assert len(settled.scaled_normals) == len(solution.scaled_normals) - 1
    assert (left.patch == -1).sum() == 2
    assert left.patch.max() == len(settled.scaled_normals) - 1
    score = score_camera(left, settled)
    assert abs(score.step[0]) < 4.0 * score.sigma[0]
    assert score.sigma[0] < 2.0 * whole.sigma[0]


def test_the_normals_follow_the_focal_length_as_the_score_says() -> None:
    scene = scene_of(1)
    sightings, solution = seen_through(scene, PINHOLE)
    score, step = score_camera(sightings, Settled.of(solution)), 0.01
    near = [seen_through(scene, changed(PINHOLE, "f", side * step))[1] for side in (1, -1)]
    slope = (near[0].scaled_normals - near[1].scaled_normals) / (2 * step)
    np.testing.assert_allclose(score.normals, slope, atol=0.03 * np.abs(slope).max())


def test_its_sigma_is_that_of_its_errors() -> None:
    pulls = []
    for seed in seeds(200, 25):
        sightings, solution = seen_through(scene_of(seed, noise_px=0.3), PINHOLE)
        score = score_camera(sightings, Settled.of(solution))
        pulls.append(score.step / score.sigma)
    # the largest of three sigmas is on average too large by a little
    assert (np.sqrt((np.array(pulls) ** 2).mean(axis=0)) < 1.3).all()
    assert (np.sqrt((np.array(pulls) ** 2).mean(axis=0)) > 0.5).all()


@pytest.mark.parametrize("trajectory_deg", [0.0, 45.0, 90.0])
def test_a_right_camera_is_not_suspected_on_rough_ground(trajectory_deg: float) -> None:
    for seed in seeds(60, 3):
        scene = scene_of(seed, trajectory_deg=trajectory_deg, noise_px=0.1, relief=0.005)
        assert "suspect-camera" not in {d.code for d in report_of(scene, PINHOLE).diagnostics}


@pytest.mark.parametrize("factor", [0.6, *(pytest.param(factor, marks=pytest.mark.slow) for factor in (0.8, 1.3))])
def test_a_false_focal_length_is_named_and_no_verdict_is_safe(factor: float) -> None:
    report = report_of(scene_of(2), changed(PINHOLE, "f", np.log(factor)))
    (warning,) = (d for d in report.diagnostics if d.code == "suspect-camera")
    assert warning.value == pytest.approx(1.0 / factor, rel=0.02)
    assert report.fit.focal_factor == warning.value
    assert "fit a focal length of" in warning.message
    assert "slopes are off by up to" in warning.message
    assert "--free-focal" in (warning.remedy or "")
    assert all(plane.verdict != "safe" for plane in report.planes)


@pytest.mark.parametrize("times", [0.38, 0.45, 2.2])
def test_a_focal_length_off_by_more_than_a_factor_of_two_is_found(times: float) -> None:
    """Beyond the steps that are tried, as the matches hold it; before, it was thrown away without a word."""
    report = report_of(scene_of(6), changed(PINHOLE, "f", np.log(times)))
    assert "suspect-camera" in {d.code for d in report.diagnostics}
    assert report.fit.focal_factor == pytest.approx(1.0 / times, rel=0.02)
    assert all(plane.verdict != "safe" for plane in report.planes)


def test_a_false_principal_point_is_named() -> None:
    report = report_of(scene_of(3), changed(PINHOLE, "cx", 0.08))
    (warning,) = (d for d in report.diagnostics if d.code == "suspect-camera")
    assert "principal point with cx" in warning.message


@pytest.mark.parametrize(("fx", "fy"), [(0.85, 1.0), (1.0, 1.12)])
def test_a_wrong_fx_or_fy_is_suspected_and_both_are_named(fx: float, fy: float) -> None:
    report = report_of(scene_of(3), replace(PINHOLE, fx=fx * PINHOLE.fx, fy=fy * PINHOLE.fy))
    (warning,) = (d for d in report.diagnostics if d.code in ("suspect-camera", "suspect-distortion"))
    assert "check fx and fy first" in (warning.remedy or "")
    assert all(plane.verdict != "safe" for plane in report.planes)


def test_one_plane_tells_no_focal_length() -> None:
    scene = scene_of(4, slopes_deg=[0.0] * 9, height_spread=0.0)
    report = report_of(scene, changed(PINHOLE, "f", np.log(0.7)))
    assert report.fit.focal_factor is None
    assert report.fit.focal_factor_sigma is None
    assert "suspect-camera" not in {d.code for d in report.diagnostics}


def test_rays_and_few_rows_tell_none() -> None:
    scene = scene_of(5)
    camera_less = Given(*(scene.uv1 / 700.0 - 0.5, scene.uv2 / 700.0 - 0.5), scene.patch)
    assert solve(camera_less, None, Options()).fit.focal_factor is None


@cache
def sample_with(focal_px: float | None, **options: object) -> Report:
    images = (load_image(SAMPLE / "image1.png"), load_image(SAMPLE / "image2.png"))
    camera = load_camera(SAMPLE / "camera.json")
    camera = camera if focal_px is None else replace(camera, fx=focal_px, fy=focal_px)
    return estimate(*images, camera, camera, Options(**options))  # type: ignore[arg-type]


def test_the_sample_is_right_and_said_to_be() -> None:
    report = sample_with(None)
    assert report.fit.focal_factor == pytest.approx(1.0, abs=0.005)
    assert [d.code for d in report.diagnostics if d.code.startswith("suspect")] == []


def test_the_sample_with_a_focal_length_of_400_px_is_suspect() -> None:
    report = sample_with(400.0)
    assert [d.code for d in report.diagnostics if d.code.startswith("suspect")] == ["suspect-camera"]
    assert not any("check fx and fy first" in (d.remedy or "") for d in report.diagnostics)
    assert 400.0 * (report.fit.focal_factor or 0.0) == pytest.approx(692.8, rel=0.05)
    assert all(plane.verdict != "safe" for plane in report.planes)
    # nowhere a probability or an "ok" alone that reads as confidence
    table = result_table(report)
    chance, note = (table.header.index(title) for title in ("P(safe)", "note"))
    for row, plane in zip(table.rows, report.planes, strict=True):
        assert row[chance] == ("0.000" if plane.verdict == "unsafe" else "-")
        assert row[note].endswith("suspect-camera")
    assert all(line.endswith("suspect-camera") for line in report_to_csv(report).splitlines()[1:])


# ---- a free focal length, and an uncertain one ----


@pytest.mark.parametrize("camera", [PINHOLE, LENS], ids=["pinhole", "distorted"])
def test_a_free_focal_length_gives_the_right_slopes(camera: Camera) -> None:
    scene = scene_of(6, camera=camera, noise_px=0.0)
    right = report_of(scene, camera)
    freed = report_of(scene, changed(camera, "f", np.log(0.7)), free_focal=True)
    assert freed.cameras[0].fx == pytest.approx(camera.fx, rel=1e-6)
    assert freed.cameras[0].source.endswith("focal length by the images")
    assert [p.slope_deg for p in freed.planes] == pytest.approx([p.slope_deg for p in right.planes], abs=1e-4)
    (note,) = (d for d in freed.diagnostics if d.code == "focal-length")
    assert note.value == pytest.approx(1 / 0.7, rel=1e-6)
    assert freed.fit.focal_factor == pytest.approx(1 / 0.7, rel=1e-6)
    assert "suspect-camera" not in {d.code for d in freed.diagnostics}


@pytest.mark.parametrize("given", [0.6, 1.0])
def test_features_tell_a_focal_length_under_which_no_motion_fits(given: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of views that turn by 60 degrees about the axis of a wide lens and tilt by 40; the right one stays."""
    rng = np.random.default_rng(5)
    camera = Camera(640, 480, 500.0, 500.0, 319.5, 239.5)
    P1 = rng.uniform(-1.0, 1.0, (100, 3)) * [3.0, 2.0, 2.0] + [0.0, 0.0, 6.0]
    R = rotation_from_vector(np.radians([0.0, 40.0, 0.0])) @ rotation_from_vector(np.radians([0.0, 0.0, 60.0]))
    P2 = (P1 - [0.0, 0.0, 6.0]) @ R.T + [0.3, -0.2, 6.5]
    uv1, uv2 = (500.0 * P[:, :2] / P[:, 2:] + [319.5, 239.5] for P in (P1, P2))
    monkeypatch.setattr("slopecli.look.scene_from_images.match_sift", lambda *images, **how: (uv1, uv2, (100, 100)))
    grey = np.zeros((480, 640), np.float32)
    wrong = changed(camera, "f", np.log(given))
    step = focal_by_features(Images(grey, grey, wrong, wrong), None)
    assert step == 0.0 if given == 1.0 else abs(step + np.log(given)) < 0.2


def test_a_focal_length_that_is_not_told_is_not_freed() -> None:
    scene = scene_of(4, slopes_deg=[0.0] * 9, height_spread=0.0)
    report = report_of(scene, PINHOLE, free_focal=True)
    assert report.cameras[0].fx == PINHOLE.fx
    (note,) = (d for d in report.diagnostics if d.code == "focal-length")
    assert "do not tell" in note.message
    assert "as if it were known to 40 %" in note.message
    assert "--focal-sigma" in (note.remedy or "")


@pytest.mark.parametrize("by", [0.0, 0.001])
def test_a_focal_length_given_that_the_images_agree_with_is_used_with_the_sigma_of_theirs(by: float) -> None:
    given = changed(PINHOLE, "f", by)
    exact, freed = report_of(scene_of(6), given), report_of(scene_of(6), given, free_focal=True)
    assert freed.cameras[0].fx == given.fx
    (note,) = (d for d in freed.diagnostics if d.code == "focal-length")
    assert note.value == 1.0
    assert f"the {given.focal_px:.5g} px given differ by less, so they were used" in note.message
    assert 0.0 < abs(freed.fit.focal_factor - 1.0) < freed.fit.focal_factor_sigma
    assert [p.slope_deg for p in freed.planes] == [p.slope_deg for p in exact.planes]
    assert all(wide.slope_sigma_deg > one.slope_sigma_deg for wide, one in zip(freed.planes, exact.planes, strict=True))


@pytest.mark.parametrize(("noise_px", "focal_px"), [(1.0, 400.0), (1.2, 400.0), (1.0, 500.0)])
def test_answers_are_compared_by_the_noise_of_their_matches_in_pixels(noise_px: float, focal_px: float) -> None:
    camera = replace(PINHOLE, fx=focal_px, fy=focal_px)
    solution = seen_through(scene_of(6), PINHOLE)[1]
    first, second = (
        Answer(
            None,
            replace(solution, noise=px / f),
            (changed(camera, "f", np.log(f / focal_px)),) * 2,
            [],
            CameraTest(),
            0.0,
        )  # type: ignore[arg-type]
        for px, f in ((noise_px, focal_px), (1.0, 400.0))
    )
    assert first.noisier(second) is (noise_px > 1.05)
    assert not second.noisier(first)


def test_a_focal_length_is_known_no_better_than_an_eighth_of_the_noise_tells_it() -> None:
    """What lenses, shutters and matching leave alike everywhere does not average out."""
    sightings, solution = seen_through(scene_of(6), PINHOLE)
    score = score_camera(sightings, Settled.of(solution))
    score = score._replace(px=np.full(4, 2.0), noise_px=0.4)
    assert focal_to_use(CameraTest(0.05, 0.001, score=score), prior=0.0, free=True).sigma == pytest.approx(
        0.4 / 8 / 2, rel=0.01
    )
    assert focal_to_use(CameraTest(0.05, 0.001, score=score._replace(noise_px=0.01)), 0.0, True).sigma < 0.006


def test_a_field_of_view_is_known_to_three_percent() -> None:
    scene = scene_of(4, slopes_deg=[12.0] * 9, height_spread=0.0, noise_px=0.05)
    exact, rounded = replace(PINHOLE, source="given"), replace(PINHOLE, source="field of view")
    sigmas = [[p.slope_sigma_deg for p in report_of(scene, camera).planes] for camera in (exact, rounded)]
    told = [p.slope_sigma_deg for p in report_of(scene, rounded, focal_sigma_percent=0.0).planes]
    assert told == sigmas[0]
    assert (np.array(sigmas[1]) > np.array(sigmas[0])).all()


def test_where_images_contradict_an_uncertain_focal_length_the_sigma_spans_both_and_all_three_are_named() -> None:
    report = report_of(scene_of(6), changed(PINHOLE, "f", np.log(0.75)), focal_sigma_percent=3.0)
    (warning,) = (d for d in report.diagnostics if d.code == "suspect-camera")
    (note,) = (d for d in report.diagnostics if d.code == "focal-length")
    preferred = re.search(r"fit a focal length of ([\d.]+) ", warning.message)
    said = re.search(
        r"of ([\d.]+) ± ([\d.]+) px, the mean, .* of the ([\d.]+) px that .* the ([\d.]+) px given", note.message
    )
    assert preferred is not None
    assert said is not None
    used, sigma, same, given = map(float, said.groups())
    assert float(preferred[1]) == same == pytest.approx(PINHOLE.fx, rel=0.01)
    assert given == pytest.approx(0.75 * PINHOLE.fx, rel=1e-4)
    assert abs(used - PINHOLE.fx) < 2.0 * sigma


def test_one_plane_carries_all_of_an_uncertain_focal_length() -> None:
    scene = scene_of(7, slopes_deg=[20.0] * 9, height_spread=0.0, noise_px=0.02, trajectory_deg=90.0)
    sigma_deg = report_of(scene, PINHOLE, focal_sigma_percent=3.0).planes[4].slope_sigma_deg
    step = 0.03
    slopes = [report_of(scene, changed(PINHOLE, "f", side * step)).planes[4].slope_deg for side in (1, -1)]
    assert sigma_deg == pytest.approx(abs(slopes[0] - slopes[1]) / 2, rel=0.15)


def test_two_sigmas_cover_when_focal_lengths_are_off_by_three_percent() -> None:
    within = []
    for seed in seeds(150, 6):
        rng = np.random.default_rng(1000 + seed)
        trajectory = float(rng.choice([0.0, 45.0, 90.0]))
        flat = {"slopes_deg": [15.0] * 9, "height_spread": 0.0} if seed % 2 else {}
        scene = scene_of(seed, trajectory_deg=trajectory, noise_px=0.1, **flat)
        false = changed(PINHOLE, "f", 0.03 * rng.standard_normal())
        report = report_of(scene, false, focal_sigma_percent=3.0)
        if report.ambiguity.status == "unresolved":
            continue
        for plane in report.planes:
            true = -scene.normals[plane.id] / np.linalg.norm(scene.normals[plane.id])
            slope = np.degrees(np.arccos(np.clip(-true[2], -1.0, 1.0)))
            within.append(abs(plane.slope_deg - slope) < 2.0 * plane.slope_sigma_deg)
    assert np.mean(within) >= 0.93


def test_the_sample_with_a_focal_length_of_400_px_is_right_with_it_free() -> None:
    report = sample_with(400.0, free_focal=True)
    right = sample_with(None)
    assert report.cameras[0].fx == pytest.approx(692.8, rel=0.01)
    assert [p.slope_deg for p in report.planes] == pytest.approx([p.slope_deg for p in right.planes], abs=0.2)


@pytest.mark.parametrize(
    ("name", "free"), [("cy", False), *(pytest.param("cx", free, marks=pytest.mark.slow) for free in (False, True))]
)
def test_a_wrong_principal_point_is_named_and_nothing_is_safe(name: str, free: bool) -> None:
    """By 8 % of the width; a free focal length must not hide it."""
    sample = Path(__file__).resolve().parent.parent / "sample_data" / "descent"
    images, camera = [load_image(sample / f"image{k}.png") for k in (1, 2)], load_camera(sample / "camera.json")
    wrong = replace(camera, **{name: getattr(camera, name) + 0.08 * camera.width})
    report = estimate(*images, wrong, wrong, Options(free_focal=free))
    (warning,) = (d for d in report.diagnostics if d.code == "suspect-camera")
    assert f"principal point with {name} = " in warning.message
    assert not [plane.id for plane in report.planes if plane.verdict == "safe"]


# ---- places matched before any window was chosen ----


@pytest.mark.parametrize(("by", "suspect"), [(0.0, False), (0.05, True)])
def test_fewer_sigmas_are_enough_where_the_overview_contradicts(
    monkeypatch: pytest.MonkeyPatch, by: float, suspect: bool
) -> None:
    scene, false = scene_of(13, noise_px=0.9), changed(PINHOLE, "f", by)
    assert "suspect-camera" not in {d.code for d in report_of(scene, false).diagnostics}
    contradicts = iter([True])  # and no longer with the focal length found
    monkeypatch.setattr("slopecli.findings.camera_test._overview_contradicts", lambda *facts: next(contradicts, False))
    assert ("suspect-camera" in {d.code for d in report_of(scene, false).diagnostics}) is suspect


def test_what_is_suspected_of_an_exact_focal_length_may_agree_with_one_known_to_a_few_percent() -> None:
    test = CameraTest(step=0.06, sigma=0.03, suspect=True)
    assert contradicted(test, prior=0.0)
    assert not contradicted(test, prior=0.03)
    assert contradicted(replace(test, step=0.2), prior=0.03)


def test_a_contradiction_that_the_focal_length_to_use_leaves_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("slopecli.findings.camera_test._overview_contradicts", lambda *facts: True)
    scene = scene_of(13, noise_px=0.9)
    (warning,) = (d for d in report_of(scene, PINHOLE, free_focal=True).diagnostics if d.code == "suspect-camera")
    assert "no focal length explains both" in warning.message
    assert "suspect-camera" not in {d.code for d in report_of(scene, PINHOLE).diagnostics}  # mismatches may be it
    monkeypatch.setattr("slopecli.findings.camera_test.lines_explain", lambda *facts: True)  # and here they are not
    (warning,) = (d for d in report_of(scene, PINHOLE).diagnostics if d.code == "suspect-camera")
    assert "no focal length explains both" in warning.message


def test_a_contradiction_that_no_focal_length_explains_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("slopecli.findings.camera_test._overview_contradicts", lambda *facts: True)
    monkeypatch.setattr("slopecli.findings.camera_test.free_focal", lambda *facts: None)
    report = report_of(scene_of(2), PINHOLE)
    (warning,) = (d for d in report.diagnostics if d.code == "suspect-camera")
    assert "no focal length explains both" in warning.message
    assert report.fit.focal_factor is None
    assert all(plane.verdict != "safe" for plane in report.planes)


def test_a_contradiction_is_no_fault_of_a_camera_that_the_windows_do_not_tell(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("slopecli.findings.camera_test._overview_contradicts", lambda *facts: True)
    monkeypatch.setattr("slopecli.findings.camera_test.free_focal", lambda *facts: None)
    report = report_of(scene_of(4, slopes_deg=[0.0] * 9, height_spread=0.0), PINHOLE)
    assert "suspect-camera" not in {d.code for d in report.diagnostics}


def test_a_focal_length_that_was_to_be_free_and_is_not_told_is_known_no_better_than_what_was_tried() -> None:
    assert focal_to_use(CameraTest(), prior=0.0, free=True).sigma == pytest.approx(0.404, abs=0.001)
    assert focal_to_use(CameraTest(), prior=0.03, free=True).sigma == 0.03
    assert focal_to_use(CameraTest(), prior=0.0, free=False).sigma == 0.0


def test_a_focal_length_that_was_freed_and_is_not_told_in_the_end_is_not_called_preferred() -> None:
    freed = changed(PINHOLE, "f", 0.4)
    told, untold = (
        focal_note((PINHOLE, PINHOLE), (freed, freed), 0.4, Options(free_focal=True), known) for known in (True, False)
    )
    assert "that the images prefer" in told[0].message
    assert "prefer" not in untold[0].message
    assert "the images do not tell it" in untold[0].message
    assert "--focal-sigma" in (untold[0].remedy or "")
