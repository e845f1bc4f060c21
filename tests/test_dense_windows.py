"""Windows over rough ground: their planes through all pixels, where these tell more than the matches."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from depth_scenes import scene_of, true_depth
from scenery import Surface, make_camera, render, tilted, turn, unit

from slopecli import Image, Options, Report, estimate, load_camera, load_image
from slopecli.geometry import tangent_basis
from slopecli.ground import Root, fit_windows
from slopecli.look import DenseDepth, measure_depth
from slopecli.patches.windows import with_steps
from slopecli.pipeline import sequence_answer
from slopecli.sequence import Sequence

SAMPLE = Path(__file__).parent.parent / "sample_data" / "descent"
R, T, GROUND = turn(1, -2, 3), unit(0.8, 0.2, 0.4), tilted(0.2, -0.1)
ROOT = Root(R, T, np.zeros((5, 5)), tangent_basis(T), 0.0, np.zeros(5))
WINDOWS = [(130, 40, 60, 50), (200, 90, 37, 41), (131, 120, 90, 80)]


@lru_cache(maxsize=1)
def plane() -> DenseDepth:
    """The true depth of a plane."""
    pair = render(R, T, [GROUND])
    return true_depth(measure_depth(scene_of(pair)), pair)


@lru_cache(maxsize=4)
def answer(solver: str = "mle") -> Report:
    camera = load_camera(str(SAMPLE / "camera.json"))
    images = [load_image(str(SAMPLE / f"image{k}.png")) for k in (1, 2)]
    return estimate(*images, camera, camera, Options(solver=solver))  # type: ignore[arg-type]


def test_without_noise_the_plane_is_exact() -> None:
    fitted = fit_windows(plane(), WINDOWS, ROOT)
    assert fitted.told.all()
    assert fitted.normal == pytest.approx(np.tile(GROUND, (3, 1)), rel=1e-4, abs=1e-5)
    assert (fitted.relief < 1e-5).all()


def test_a_window_is_measured_the_same_in_the_whole_image_and_alone() -> None:
    scene = scene_of(render(R, T, [GROUND]))
    whole, alone = measure_depth(scene), measure_depth(scene, WINDOWS[:1])
    assert alone.grid.shape < whole.grid.shape
    first, second = (fit_windows(depth, WINDOWS[:1], ROOT).normal[0] for depth in (whole, alone))
    assert first == pytest.approx(second, abs=2e-3 * np.linalg.norm(GROUND))


def test_a_large_window_is_measured_on_fewer_pixels_at_the_same_place() -> None:
    scene = scene_of(render(R, T, [GROUND]))
    depth = measure_depth(scene, WINDOWS[2:], max_pixels=3000)
    assert depth.grid.mean_scale < 0.7
    normal = fit_windows(depth, WINDOWS[2:], ROOT).normal[0]
    assert normal == pytest.approx(GROUND, abs=0.01 * np.linalg.norm(GROUND))


def test_a_window_that_is_hardly_matched_has_no_plane() -> None:
    nothing = np.zeros_like(plane().known)
    part = nothing.copy()
    part[:, : 130 + 30] = True  # half of the first window
    for known in (nothing, part):
        assert not fit_windows(replace(plane(), known=known, sure=known), WINDOWS[:1], ROOT).told.any()


def test_ground_in_doubt_widens_the_sigma() -> None:
    sure = plane().sure.copy()
    sure[60:90, 130:150] = False
    rough = np.where(sure, plane().w, plane().w * np.float32(1.05))
    sigmas = [
        np.trace(fit_windows(replace(plane(), w=rough, sure=mask), WINDOWS[:1], ROOT).covariance[0])
        for mask in (plane().sure, sure)
    ]
    assert sigmas[1] > sigmas[0]


def test_rough_ground_seen_whole_is_known_better_than_by_its_matches() -> None:
    """The middle window of the descent, whose true slope is 23.85 deg."""
    truth = {one["id"]: one for one in json.loads((SAMPLE / "truth.json").read_text(encoding="utf-8"))["windows"]}
    errors, sigmas = [], []
    for one in answer().planes:
        normal = np.array(truth[one.id]["normal_cam1"])
        errors.append(np.degrees(np.arccos(np.clip(one.normal_cam1 @ normal, -1.0, 1.0))))
        sigmas.append(one.slope_sigma_deg)
    assert min(sigmas) < 0.05  # no plane through matches is as sure here
    best = int(np.argmin(sigmas))
    assert errors[best] < 0.1


def test_a_sequence_ends_with_the_planes_of_all_pixels() -> None:
    """After every frame planes are those of the points tracked; at the end those of `estimate` on the same images."""
    camera = load_camera(str(SAMPLE / "camera.json"))
    runner = Sequence(camera, Options(), keep_depth=True)
    for k in (1, 2):
        runner.add(load_image(str(SAMPLE / f"image{k}.png")).grey)
    while_running, at_end = runner.report(), sequence_answer(runner).report
    sigmas = [[one.slope_sigma_deg or 0.0 for one in report.planes] for report in (while_running, at_end, answer())]
    middle = int(np.argmin(sigmas[2]))
    assert sigmas[1][middle] < 0.2 * sigmas[0][middle]
    slopes = [report.planes[middle].slope_deg for report in (at_end, answer())]
    assert slopes[0] == pytest.approx(slopes[1], abs=0.1)


@pytest.mark.parametrize("solver", ["ha", "lh"])
def test_the_methods_of_the_paper_stay_as_printed(solver: str) -> None:
    """Their planes are those of the matches."""
    assert all(np.isnan(one.roughness) for one in answer(solver).planes)


def test_flat_windows_keep_the_planes_of_their_matches(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is measured but their matches."""
    pair = render(R, T, [GROUND])
    images = Image(pair.grey1), Image(pair.grey2)
    monkeypatch.setattr("slopecli.patches.windows.dense_planes.measure_depth", None)
    report = estimate(*images, pair.camera1, pair.camera2, Options(windows=((140, 40, 120, 150),)))
    assert report.planes[0].roughness < 1e-3


def test_a_window_of_which_a_small_part_is_a_drop_is_not_safe() -> None:
    """A drop in 5 % of a window on gentle ground: the plane nearest to all of it has 40 degrees."""
    drop = Surface(tilted(0.0, 0.0, 8.0), (90.0, 70.0, 110.0, 14.0))
    ground = [Surface(tilted(0.1, 0.0)), Surface(tilted(-0.1, 0.1), (200.0, 0.0, 200.0, 320.0))]
    camera = make_camera(400, 320)
    pair = render(turn(1, 2, 2), unit(0.9, 0.2, 0.3), [*ground, drop], camera1=camera, noise=1.0)
    windows = (100, 80, 80, 80), (220, 80, 100, 80), (220, 180, 100, 80)
    report = estimate(Image(pair.grey1), Image(pair.grey2), camera, pair.camera2, Options(windows=windows))
    onto, *clear = report.planes
    assert (onto.verdict, onto.status) == ("undecided", "poor")
    assert "across a step" in (onto.reason or "")
    assert [one.message.partition(":")[0] for one in report.diagnostics if one.code == "non-planar-patch"] == [
        "window 1 is not one plane"
    ]
    assert all((plane.verdict, plane.status) == ("safe", "ok") for plane in clear)


def test_planes_that_were_found_have_no_step_in_the_rectangle_around_them() -> None:
    """Beside a flat roof, in that rectangle, are walls and the street: nothing is measured there."""
    roof, nothing = SimpleNamespace(id=1, source="region", left_out=0.1, verdict="safe"), SimpleNamespace()
    joined: Any = SimpleNamespace(patches=(roof,))
    assert with_steps(joined, solution=nothing, scene=nothing, planes=[roof]) is joined  # type: ignore[arg-type]
