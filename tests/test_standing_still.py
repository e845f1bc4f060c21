"""What belongs to the camera or the image stands still in both: it is found, left out and told; ground is not."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
import pytest
from scenery import Grey, Pair, make_camera, render, tilted, turn, unit

from slopecli import Options, slope_map
from slopecli.look import find_still
from slopecli.options import MapOptions
from slopecli.pipeline import estimate
from slopecli.sequence import Sequence
from slopecli.types import FloatArray, Image, Report

CODE = "stands-still"
ASKED = Options(tolerance_deg=30.0)  # of the answer and of the map, so that they are solved once
SIDEWAYS = unit(1.0, 0.1, 0.1)
CORNER, MIDDLE, STRIP = np.s_[140:, :120], np.s_[80:160, 120:210], np.s_[190:, :]

pytestmark = pytest.mark.usefixtures("_solved_once")


@cache
def ground(T: tuple[float, ...] = tuple(SIDEWAYS), angles_deg: tuple[float, float, float] = (1.0, 0.5, 1.0)) -> Pair:
    camera, plane = make_camera(320, 240), tilted(0.15, 0.2)
    return render(turn(*angles_deg), np.array(T), [plane], camera1=camera, noise=1.5, coarseness=1.0)


def ground_kept_in_view() -> Pair:
    """The camera turns towards the ground that it passes: what stands still then has a depth as ground may have."""
    return ground(angles_deg=(0.0, 5.0, 0.0))


def glued(greys: tuple[Grey, Grey], part: tuple[slice, slice], noise: float = 1.5) -> tuple[Grey, Grey]:
    """Both images with the same thing of many edges before them, each with noise of its own."""
    rng = np.random.default_rng(5)
    shape = greys[0][part].shape
    thing = cv2.resize(
        rng.uniform(20, 230, (shape[0] // 8, shape[1] // 8)), shape[::-1], interpolation=cv2.INTER_NEAREST
    )
    seen = []
    for grey in greys:
        changed = grey.copy()
        changed[part] = np.clip(thing + noise * rng.standard_normal(shape), 0, 255).astype(np.uint8)
        seen.append(changed)
    return seen[0], seen[1]


def answer(greys: tuple[Grey, Grey], pair: Pair) -> Report:
    return estimate(Image(greys[0]), Image(greys[1]), pair.camera1, pair.camera2, ASKED)


def off_deg(normal: FloatArray) -> float:
    true = tilted(0.15, 0.2)
    return float(np.degrees(np.arccos(min(1.0, -normal @ true / np.linalg.norm(true)))))


@pytest.mark.parametrize("part", [CORNER, MIDDLE, STRIP], ids=["corner", "middle", "strip"])
def test_a_thing_before_the_camera_is_found_where_it_is(part: tuple[slice, slice]) -> None:
    pair = ground()
    still = find_still(*glued((pair.grey1, pair.grey2), part))
    thing = np.zeros(pair.grey1.shape, bool)
    thing[part] = True
    assert still is not None
    y, x = np.indices(thing.shape, np.float32)
    held = still.holds(np.dstack([x, y]))
    assert held[thing].mean() > 0.98
    # around it, where the window of a correlation sees both
    assert not held[~cv2.dilate(thing.astype(np.uint8), np.ones((33, 33), np.uint8)).astype(bool)].any()
    assert np.isclose(still.share, held.mean(), atol=0.01)


@pytest.mark.parametrize(
    ("T", "angle_deg"),
    [(SIDEWAYS, 1.0), (unit(0.02, 0.01, 1.0), 0.0), (0.1 * SIDEWAYS, 0.0), (unit(0.02, 0.01, 1.0), 1.0)],
    ids=["sideways", "focus of expansion", "hardly moved", "forward and turned"],
)
def test_ground_does_not_stand_still(T: FloatArray, angle_deg: float) -> None:
    pair = ground(tuple(T), (angle_deg, 0.5 * angle_deg, angle_deg))
    assert find_still(pair.grey1, pair.grey2) is None


def test_edges_along_the_motion_and_the_whole_scene_do_not_count() -> None:
    pair = ground()
    stripes = np.repeat(np.random.default_rng(2).uniform(20, 230, 30), 3)[:80, None]
    first, second = pair.grey1.copy(), pair.grey2.copy()
    first[:80], second[:80] = stripes, stripes
    assert find_still(first, second) is None
    noise = np.random.default_rng(3).normal(0, 2, pair.grey1.shape)
    assert find_still(pair.grey1, np.clip(pair.grey1 + noise, 0, 255).astype(np.uint8)) is None
    assert find_still(pair.grey1, np.zeros((100, 80), np.uint8)) is None


def test_slopes_beside_it_are_those_without_it_and_a_note_tells_its_share() -> None:
    pair = ground_kept_in_view()
    report = answer(glued((pair.grey1, pair.grey2), CORNER), pair)
    (note,) = [d for d in report.diagnostics if d.code == CODE]
    assert note.severity == "info"
    assert 0.15 < float(note.value or 0.0) < 0.25
    beside = [plane for plane in report.planes if plane.id not in (7, 8)]
    assert len(beside) == 7
    assert max(off_deg(plane.normal_cam1) for plane in beside) < 0.6
    (under,) = [plane for plane in report.planes if plane.id == 7]
    assert under.status == "poor"
    assert under.verdict != "safe"


def test_a_map_knows_nothing_of_it_and_lands_nowhere_on_it() -> None:
    pair = ground_kept_in_view()
    first, second = glued((pair.grey1, pair.grey2), CORNER)
    images = Image(first), Image(second)
    result = slope_map(*images, pair.camera1, pair.camera2, ASKED, MapOptions(footprint_px=32))
    rows, columns = result.slope_deg.shape
    u, v = np.meshgrid(*((np.arange(count) + 0.5) * result.spacing_px - 0.5 for count in (columns, rows)))
    assert not result.known[(u < 120) & (v > 140)].any()
    assert result.known[(u > 150) | (v < 110)].mean() > 0.5
    assert result.sites
    for site in result.sites:  # none reaches onto the corner, to 2 px
        x, y = site.centre_px
        assert np.hypot(max(x - 120.0, 0.0), max(140.0 - y, 0.0)) > site.radius_px - 2.0
    wrong = np.abs(result.slope_deg - np.degrees(np.arctan2(0.25, 1.0)))[result.known]
    assert np.median(wrong) < 0.3


def test_a_sequence_follows_the_ground_past_it() -> None:
    pair = ground()
    run = Sequence(pair.camera1, Options(grid=(2, 2)))
    assert [run.add(frame).status for frame in glued((pair.grey1, pair.grey2), STRIP)] == ["reference", "used"]
    report = run.report()
    assert CODE in [d.code for d in report.diagnostics]
    assert max(off_deg(plane.normal_cam1) for plane in report.planes if plane.id < 3) < 1.0
    assert all(plane.verdict != "safe" or off_deg(plane.normal_cam1) < 1.0 for plane in report.planes)
