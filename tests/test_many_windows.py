"""Grids of 64 windows and more: answered together by one dense depth, and shown as a map."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from scenery import Pair, Surface, make_camera, render, tilted, turn, unit

from slopecli import Image, Options, Report, estimate
from slopecli.cli import classes_table
from slopecli.products import draw_overlay
from slopecli.windows import grid_windows

LEFT, RIGHT = tilted(0.3, 0.0), tilted(-0.15, 0.1)
SIZE, GRID = (400, 320), (10, 8)


@lru_cache(maxsize=1)
def pair() -> Pair:
    """Ground of two slopes that meet in the middle, of which image 2 shows all but the leftmost part."""
    left, right = Surface(LEFT), Surface(RIGHT, (200.0, 0.0, 200.0, 320.0))
    return render(turn(1, 6, 2), unit(0.9, 0.2, 0.3), [left, right], camera1=make_camera(*SIZE))


@lru_cache(maxsize=4)
def answer(grid: tuple[int, int] = GRID) -> Report:
    images = Image(pair().grey1), Image(pair().grey2)
    return estimate(*images, pair().camera1, pair().camera2, Options(grid=grid))


def errors_deg(report: Report) -> dict[int, float]:
    """Angle between the normal of every window on one slope and the true one."""
    windows = grid_windows(*GRID, *SIZE)
    found = {}
    for plane in report.planes:
        x, _, w, _ = windows[plane.id - 1]
        if x + w <= 200 or x >= 200:
            truth = LEFT if x < 200 else RIGHT
            cosine = abs(plane.normal_cam1 @ truth) / np.linalg.norm(truth)
            found[plane.id] = float(np.degrees(np.arccos(min(cosine, 1.0))))
    return found


def test_every_window_has_its_slope_within_its_sigma() -> None:
    ok = [plane for plane in answer().planes if plane.status == "ok"]
    wrong = errors_deg(answer())
    assert len(ok) >= 55
    assert np.median([wrong[plane.id] for plane in ok]) < 0.3
    assert np.mean([wrong[plane.id] < 2.5 * max(plane.slope_sigma_deg or 0.0, 0.05) for plane in ok]) > 0.9


@pytest.mark.parametrize(("left", "width"), [(396, 4), (237, 83)])
def test_windows_onto_ground_without_texture_are_poor_as_it_may_be_a_drop(left: int, width: int) -> None:
    """Level ground with a bare strip far below it, at the border or reaching 3 px into windows: none is called safe."""
    strip = Surface(tilted(0.0, 0.0, 9.0), (left, 0.0, width, 320.0), contrast=0.0)
    scene = render(turn(), unit(0.9, 0.2, 0.3), [Surface(tilted(0, 0)), strip], camera1=make_camera(*SIZE), noise=1.0)
    report = estimate(Image(scene.grey1), Image(scene.grey2), scene.camera1, scene.camera2, Options(grid=GRID))
    windows = grid_windows(*GRID, *SIZE)
    onto = {k for k, (x, _, w, _) in enumerate(windows, start=1) if x + w > left and x < left + width + 10}
    on_strip = [plane for plane in report.planes if plane.id in onto]
    shown = {k for k, (x, y, *_) in enumerate(windows, start=1) if x >= 120 and y >= 40}
    elsewhere = [plane for plane in report.planes if plane.id in shown - onto]
    assert on_strip
    assert all(plane.status == "poor" and plane.verdict != "safe" for plane in on_strip)
    assert any("may be a drop" in (plane.reason or "") for plane in on_strip)
    assert np.mean([plane.status == "ok" for plane in elsewhere]) > 0.9


def test_a_window_that_image_2_shows_in_part_is_in_more_doubt_the_less_of_it_is_shown() -> None:
    """Image 2 misses the left of this pair, where the first column of windows is."""
    sigma = {plane.id: plane.slope_sigma_deg or 0.0 for plane in answer().planes}
    columns = [[sigma[k] for k in range(first, 81, GRID[0]) if k in sigma] for first in (1, 2, 3)]
    assert np.median(columns[0] + columns[1]) > 3 * np.median(columns[2])


def test_ids_and_outlines_are_those_of_the_grid_row_by_row() -> None:
    report = answer()
    assert sorted([one.id for one in report.planes] + [one.id for one in report.rejected]) == [*range(1, 81)]
    for plane in report.planes:
        x, y, w, h = grid_windows(*GRID, *SIZE)[plane.id - 1]
        assert plane.polygon_px[0].tolist() == [x - 0.5, y - 0.5]
        assert plane.polygon_px[2].tolist() == [x + w - 0.5, y + h - 0.5]


def test_what_image_2_does_not_show_is_poor_and_never_safe() -> None:
    hidden = [plane for plane in answer().planes if plane.reason and "not in image 2" in plane.reason]
    assert hidden
    for plane in hidden:
        assert plane.status == "poor"
        assert plane.verdict != "safe"
        assert (plane.slope_sigma_deg or 0.0) >= 5.0


def test_the_motion_is_that_of_a_few_large_windows() -> None:
    few = answer((3, 3)).motion
    many = answer().motion
    assert many.rotation_cam2_from_cam1 == pytest.approx(few.rotation_cam2_from_cam1)
    assert many.baseline_cam1 == pytest.approx(few.baseline_cam1)


def test_windows_given_one_by_one_are_those_of_the_same_grid() -> None:
    images = Image(pair().grey1), Image(pair().grey2)
    windows = tuple(grid_windows(*GRID, *SIZE))
    report = estimate(*images, pair().camera1, pair().camera2, Options(windows=windows))
    for one, other in zip(report.planes, answer().planes, strict=True):
        assert one.id == other.id
        assert one.slope_deg == pytest.approx(other.slope_deg)


def test_a_window_across_a_step_is_called_so() -> None:
    plate = Surface(tilted(0.0, 0.0, 4.0), (150.0, 100.0, 110.0, 110.0))
    stepped = render(turn(1, 2, 2), unit(0.9, 0.2, 0.3), [Surface(tilted(0, 0)), plate], camera1=make_camera(*SIZE))
    images = Image(stepped.grey1), Image(stepped.grey2)
    report = estimate(*images, stepped.camera1, stepped.camera2, Options(grid=GRID))
    across = {plane.id for plane in report.planes if plane.reason and "across a step" in plane.reason}
    assert len(across) >= 8
    edge = {24, 25, 26, 34, 37, 44, 47}  # 40 px wide, and 10 px or more of the plate and of the ground in each
    assert all(plane.status == "poor" for plane in report.planes if plane.id in edge)
    assert all(plane.verdict != "safe" for plane in report.planes if plane.id in across | edge)


def test_no_texture_at_all_leaves_every_window_without_a_plane_of_its_own() -> None:
    bare = Surface(RIGHT, (240.0, 0.0, 160.0, 320.0), contrast=0.0)
    faint = render(turn(1, 2, 2), unit(0.9, 0.2, 0.3), [Surface(RIGHT), bare], camera1=make_camera(*SIZE))
    images = Image(faint.grey1), Image(faint.grey2)
    report = estimate(*images, faint.camera1, faint.camera2, Options(grid=GRID))
    inside = [plane for plane in report.planes if (plane.id - 1) % 10 in (7, 8)]
    assert inside
    assert all(plane.status == "poor" for plane in inside)


def test_the_table_counts_every_window_once() -> None:
    rows = classes_table(answer()).rows
    assert sum(int(row[1]) for row in rows) == 80
    for _, windows, _, *verdicts in rows[:-1]:
        assert sum(map(int, verdicts)) == int(windows)


def test_the_overlay_is_a_map_of_classes() -> None:
    """One colour for all windows of a slope, which ids and numbers do not cover."""
    picture = draw_overlay(answer(), Image(pair().grey1))
    assert picture.shape[1] == 1200
    left, right = (picture[400:500, x : x + 60].reshape(-1, 3).mean(0) for x in (420, 900))
    assert np.abs(left - right).max() > 30  # 17 and 10 degrees lie on either side of the tolerance
    assert right[0] > right[2] + 30  # BGR: gentle ground is blue
    assert left[2] > left[0] + 30  # steep ground is orange


def test_verdicts_follow_from_slope_and_sigma_alone() -> None:
    report = answer()
    for plane in report.planes:
        if plane.status == "ok" and plane.p_safe is not None:
            assert (plane.verdict == "safe") == (plane.p_safe >= 0.99)


def test_an_altitude_gives_lengths_in_metres() -> None:
    images = Image(pair().grey1), Image(pair().grey2)
    report = estimate(*images, pair().camera1, pair().camera2, replace(Options(grid=GRID), altitude_m=10.0))
    assert report.scale.unit == "m"
    assert report.planes[30].distance == pytest.approx(10.0, rel=0.3)
