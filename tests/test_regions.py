"""Planes found in the image itself: on made-up scenes whose planes are exact, and on the urban sample."""

from __future__ import annotations

import json
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scenery import Pair, Surface, make_camera, pixel_grid, render, tilted, turn, unit

from slopecli.errors import InputError, NoAnswer
from slopecli.geometry import normal_angle
from slopecli.io import load_image
from slopecli.io.cameras import load_camera
from slopecli.options import Options
from slopecli.patches import PLANE_FINDERS
from slopecli.pipeline import estimate
from slopecli.products import report_to_json
from slopecli.types import Image, Plane, Report

URBAN = Path(__file__).resolve().parent.parent / "sample_data" / "urban"
R, T = turn(0.5, 1.0, 0.3), unit(1.0, 0.15, 0.05)
GROUND = tilted(0.0, -0.25, 8.0)
RAISED = GROUND * 1.1  # parallel to the ground, nearer: a platform of a tenth of the distance
WALL = np.array([0.1, 0.0, 0.1])
LEFT_PIECE, RIGHT_PIECE, WALL_BOX = (60, 60, 130, 110), (250, 200, 120, 110), (300, 40, 120, 120)


@cache
def town(**changes: Any) -> Pair:
    """Ground, a platform in two pieces, a wall."""
    surfaces = [Surface(GROUND), Surface(RAISED, LEFT_PIECE), Surface(RAISED, RIGHT_PIECE), Surface(WALL, WALL_BOX)]
    return render(R, T, surfaces, **{"camera1": make_camera(480, 360), "noise": 1.0, **changes})


def run(pair: Pair, **options: Any) -> Report:
    chosen = Options(**{"planes": "regions", "up": "dominant-plane", **options})
    return estimate(Image(pair.grey1), Image(pair.grey2), pair.camera1, pair.camera2, chosen)


@lru_cache(maxsize=4)
def found(finder: str = "regions") -> Report:
    return run(town(), planes=finder)


def plane_in(report: Report, x: int, y: int) -> Plane:
    number = int(report.labels[y, x])
    return next(plane for plane in report.planes if plane.id == number)


def off_deg(plane: Plane, normal: np.ndarray) -> float:
    return float(np.degrees(normal_angle(plane.normal_cam1, -normal)))


def test_the_finders_are_named() -> None:
    assert set(PLANE_FINDERS) >= {"windows", "ransac", "regions"}  # values that users have written down


@pytest.mark.parametrize("finder", ["regions", "ransac"])
def test_exactly_the_planes_that_are_there(finder: str) -> None:
    report = found(finder)
    assert len(report.planes) == 3
    limit = {"regions": 0.2, "ransac": 0.8}[finder]
    for x, y, normal in ((220, 320, GROUND), (120, 110, RAISED), (360, 100, WALL)):
        assert off_deg(plane_in(report, x, y), normal) < limit
    assert {plane.source for plane in report.planes} == {{"regions": "region"}.get(finder, finder)}


@pytest.mark.parametrize("finder", ["regions", "ransac"])
def test_parallel_planes_stay_apart_and_one_plane_in_two_pieces_is_one(finder: str) -> None:
    report = found(finder)
    ground, left, right = (plane_in(report, *at) for at in ((220, 320), (120, 110), (310, 250)))
    assert left.id == right.id != ground.id
    assert ground.distance / left.distance == pytest.approx(1.1, rel=0.01)


def test_the_label_map_is_the_scene() -> None:
    report, pair = found(), town()
    shown = pair.surface_at(pixel_grid(480, 360).reshape(-1, 2)).reshape(360, 480)
    for x, y, surfaces in ((220, 320, [0]), (120, 110, [1, 2]), (360, 100, [3])):
        ours, truth = report.labels == plane_in(report, x, y).id, np.isin(shown, surfaces)
        seen = np.s_[20:-20, 80:-20]  # of image 1 in image 2
        assert (ours & truth)[seen].sum() > 0.85 * (ours | truth)[seen].sum()


def test_ids_run_from_the_largest_and_are_those_of_the_labels() -> None:
    report = found()
    assert [plane.id for plane in report.planes] == [1, 2, 3]
    areas = [(report.labels == plane.id).sum() for plane in report.planes]
    assert areas == sorted(areas, reverse=True)
    assert set(np.unique(report.labels)) == {0, 1, 2, 3}


def test_what_lies_on_no_plane_is_said() -> None:
    report = found()
    told = next(d for d in report.diagnostics if d.code == "unexplained")
    assert told.value == pytest.approx((report.labels == 0).mean(), abs=0.01)


def test_the_same_seed_gives_the_same_answer() -> None:
    again = run(town())
    assert report_to_json(again) == report_to_json(found())
    assert np.array_equal(again.labels, found().labels)


def test_smaller_regions_are_reported_when_asked_for_and_larger_ones_only_when_not() -> None:
    assert len(run(town(), min_region_percent=10.0).planes) == 2


def test_a_merge_distance_of_many_pixels_merges_nothing_that_transfers_badly_and_a_threshold_is_used() -> None:
    report = run(town(), merge_px=30.0, gradient_threshold=0.6)
    assert len(report.planes) == 3
    assert report.segmentation is not None
    assert report.segmentation.threshold == 0.6


def test_the_dominant_plane_is_level() -> None:
    report = found()
    assert report.planes[0].slope_deg < 0.01
    assert plane_in(report, 360, 100).slope_deg == pytest.approx(np.degrees(normal_angle(GROUND, WALL)), abs=0.3)


def test_a_bare_wall_gets_no_slope_of_its_own_that_is_surely_wrong() -> None:
    surfaces = [Surface(GROUND), Surface(WALL, WALL_BOX, contrast=0.0)]
    report = run(render(R, T, surfaces, camera1=make_camera(480, 360), noise=1.0))
    ground = plane_in(report, 220, 320)
    inside = np.unique(report.labels[60:140, 320:400])
    for plane in (p for p in report.planes if p.id in inside and p.id != ground.id):
        assert plane.status == "poor" or off_deg(plane, WALL) < 1 + 4 * plane.slope_sigma_deg
    assert off_deg(ground, GROUND) < 0.1


def test_a_pair_without_parallax_is_refused_as_ever() -> None:
    pair = town()
    with pytest.raises(NoAnswer):
        estimate(Image(pair.grey1), Image(pair.grey1), pair.camera1, pair.camera2, Options(planes="regions"))


def test_a_pure_rotation_is_refused_as_ever() -> None:
    with pytest.raises(NoAnswer) as refusal:
        run(render(turn(2.0, 3.0, 1.0), 1e-9 * T, [GROUND], camera1=make_camera(480, 360), noise=1.0))
    assert refusal.value.code == "pure-rotation"


def test_no_region_as_large_as_asked_for_is_no_answer() -> None:
    with pytest.raises(NoAnswer) as refusal:
        run(town(), min_region_percent=99.0)
    assert refusal.value.remedy


def test_planes_through_a_lens_are_planes() -> None:
    lens = make_camera(480, 360, model="brown", distortion=(-0.12, 0.04, 0.001, -0.001))
    report = run(town(camera1=lens))
    assert len(report.planes) == 3
    for x, y, normal in ((220, 320, GROUND), (120, 110, RAISED), (360, 100, WALL)):
        assert off_deg(plane_in(report, x, y), normal) < 0.3


@pytest.mark.parametrize("size", [0.5, pytest.param(2.0, marks=pytest.mark.slow)])
def test_an_image_2_of_another_size_shows_the_same_planes(size: float) -> None:
    report = run(town(camera2=make_camera(int(480 * size), int(360 * size))))
    assert len(report.planes) == 3
    for x, y, normal in ((220, 320, GROUND), (120, 110, RAISED), (360, 100, WALL)):
        assert off_deg(plane_in(report, x, y), normal) < 0.4
    assert (report.labels == 0).mean() < (found().labels == 0).mean() + 0.03


def test_windows_are_still_checked() -> None:
    pair = town()
    with pytest.raises(InputError):
        run(pair, planes="windows", windows=((400, 300, 200, 200),))


# ---- the urban sample ----


@lru_cache(maxsize=1)
def urban() -> Report:
    camera = load_camera(URBAN / "camera.json")
    images = load_image(URBAN / "image1.png"), load_image(URBAN / "image2.png")
    return estimate(*images, camera, camera, Options(planes="regions", up="dominant-plane"))


@pytest.mark.slow
def test_the_planes_of_the_urban_sample_are_found() -> None:
    truth = json.loads((URBAN / "truth.json").read_text(encoding="utf-8"))
    labels = load_image(URBAN / "labels.png").grey
    report, errors = urban(), []
    large = [plane for plane in truth["planes"] if (labels == plane["id"]).mean() >= 0.01]
    for plane in large:
        ids, counts = np.unique(report.labels[labels == plane["id"]], return_counts=True)
        counts[ids == 0] = 0
        if counts.max() >= 0.3 * (labels == plane["id"]).sum():
            ours = next(p for p in report.planes if p.id == ids[counts.argmax()])
            errors.append(float(np.degrees(normal_angle(ours.normal_cam1, np.array(plane["normal_cam1"])))))
    assert len(errors) >= 0.85 * len(large)
    assert np.median(errors) < 0.5
    assert np.mean(np.array(errors) < 5) >= 0.9
