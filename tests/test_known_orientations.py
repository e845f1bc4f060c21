"""Windows that show nothing to match, beside others that do: which orientation they get, and how sure it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scenery import Pair, Surface, render, tilted, turn, unit
from test_window_matching import scene_of, tilt_error_deg

from slopecli.options import Options
from slopecli.patches import PLANE_FINDERS, Patch
from slopecli.patches.windows import REMATCHERS, known_planes, with_known_orientations
from slopecli.types import FloatArray
from slopecli.windows import Window

R, T = turn(1, -1, 1), unit(0.9, 0.2, 0.1)
LEFT, RIGHT, FLOOR = tilted(0.6, 0.0, 5.5), tilted(-0.5, 0.1, 5.5), tilted(0.0, 0.2, 6.0)
BARE: Window = (125, 60, 64, 64)
ASKED: tuple[Window, ...] = ((30, 50, 70, 90), (215, 50, 70, 90), BARE)


def room(normal: FloatArray, contrast: float, coarseness: float = 16.0, noise: float = 1.0, seed: int = 0) -> Pair:
    """Two textured walls, a floor before them, and a bare surface between them."""
    walls = [Surface(RIGHT), Surface(LEFT, (0, 0, 110, 240)), Surface(FLOOR, (0, 170, 320, 70))]
    bare = Surface(normal, (110, 40, 95, 110), contrast=contrast, coarseness=coarseness)
    return render(R, T, [*walls, bare], noise=noise, noise_seed=seed)


def asked(pair: Pair, windows: tuple[Window, ...] = ASKED) -> list[Patch]:
    return PLANE_FINDERS["windows"](scene_of(pair), Options(windows=windows)).patches


# no window shows the floor: its orientation is that of the matches on it, which hold some of the walls' borders
@pytest.mark.parametrize(
    ("normal", "nearer", "within_deg"), [(LEFT, 1.0, 1.0), (LEFT, 1.15, 1.0), (RIGHT, 1.15, 1.0), (FLOOR, 1.0, 6.0)]
)
def test_a_shaded_wall_has_the_orientation_of_the_textured_one_it_is_parallel_to(
    normal: FloatArray, nearer: float, within_deg: float
) -> None:
    pair = room(nearer * normal, 0.35)
    bare = asked(pair)[2]
    assert bare.origin == "borrowed"
    assert "elsewhere" in bare.reason or "around" in bare.reason
    assert tilt_error_deg(bare, pair, normal) < within_deg
    assert bare.tilt_sigma_rad < np.radians(30)


def test_a_wall_that_shines_into_one_camera_still_has_the_orientation_of_the_textured_one() -> None:
    pair = room(1.15 * LEFT, 0.35)
    shining = pair.grey2.astype(float)
    shining[15:138, 36:162] += 8.0  # where image 2 shows the bare surface
    bare = asked(replace(pair, grey2=shining.astype(np.uint8)))[2]
    assert tilt_error_deg(bare, pair, LEFT) < 1.0
    assert bare.tilt_sigma_rad < np.radians(10)


def test_a_surface_perpendicular_to_two_walls_is_found_though_nothing_else_shows_it() -> None:
    ceiling = np.cross(LEFT, RIGHT)
    ceiling /= 5.5 * float(ceiling @ [0.0, -0.25, 1.0])  # 5.5 baselines off in its middle
    walls = [Surface(RIGHT), Surface(LEFT, (0, 0, 110, 240)), Surface(ceiling, (110, 0, 95, 100), None, 0.35, 16.0)]
    pair = render(R, T, walls, noise=1.0)
    found = asked(pair, (*ASKED[:2], (125, 20, 64, 64)))[2]
    assert tilt_error_deg(found, pair, ceiling) < 1.0
    assert "perpendicular to window" in found.reason


@pytest.mark.parametrize("normal", [tilted(0.3, 1.0, 5.5), tilted(1.6, 0.0, 5.5)])
def test_an_orientation_that_nothing_else_shows_is_within_three_sigmas(normal: FloatArray) -> None:
    pair = room(normal, 0.35)
    bare = asked(pair)[2]
    error = tilt_error_deg(bare, pair, normal)
    assert bare.origin == "own" or error < 3 * np.hypot(5.0, np.degrees(bare.tilt_sigma_rad))


def test_a_wall_without_any_shading_is_no_better_known_than_the_walls_agree() -> None:
    bare = asked(room(FLOOR, 0.0))[2]
    assert bare.origin == "none" or np.degrees(bare.tilt_sigma_rad) > Options().max_sigma_deg


@pytest.mark.parametrize(("normal", "most_deg"), [(RIGHT, 10.0), (LEFT, 90.0), (FLOOR, 90.0)])
def test_a_bare_surface_amid_one_wall_is_that_wall_as_surely_as_its_shading_tells(
    normal: FloatArray, most_deg: float
) -> None:
    as_far = normal * (RIGHT[2] / normal[2])
    bare = Surface(as_far, (130, 90, 60, 60), contrast=0.35, coarseness=16.0)
    pair = render(R, T, [Surface(RIGHT), bare], noise=1.0)
    found = asked(pair, ((20, 40, 70, 70), (230, 40, 70, 70), (134, 94, 52, 52)))[2]
    assert found.origin == "borrowed"
    sigma = float(np.hypot(5.0, np.degrees(found.tilt_sigma_rad)))  # as reported
    assert tilt_error_deg(found, pair, normal) < 3 * sigma
    assert sigma < most_deg


@pytest.mark.parametrize("seed", range(2))
def test_faint_texture_that_matches_by_chance_gives_way_to_a_known_orientation(seed: int) -> None:
    pair = room(1.1 * LEFT, 0.05, coarseness=1.0, noise=2.0, seed=seed)
    faint = asked(pair)[2]
    error, sigma = tilt_error_deg(faint, pair, LEFT), np.degrees(faint.tilt_sigma_rad)
    assert error < 3 * np.hypot(5.0, sigma)
    if "elsewhere" in faint.reason:
        assert faint.origin == "borrowed"


def test_faint_texture_led_to_a_wrong_plane_is_aligned_from_the_known_ones() -> None:
    pair = room(1.1 * LEFT, 0.5, coarseness=1.0)
    scene, patches = scene_of(pair), asked(pair)
    # as if flow had settled on the other wall
    wrong = replace(patches[2], matches=patches[1].matches, weight=patches[1].weight, score=0.6, tilt_sigma_rad=0.2)
    wrong = replace(wrong, unmatched_sigma_rad=0.0)
    found = with_known_orientations([*patches[:2], wrong], scene, REMATCHERS["sift"], Options().max_sigma_deg)
    assert found[:2] == patches[:2]
    assert found[2].origin == "own"
    assert tilt_error_deg(found[2], pair, LEFT) < 0.5


@pytest.mark.parametrize(("most_sigma_deg", "origin"), [(10.0, "borrowed"), (30.0, "own")])
def test_matches_that_leave_more_open_than_a_user_takes_give_way(most_sigma_deg: float, origin: str) -> None:
    pair = room(1.1 * LEFT, 0.35)
    scene, patches = scene_of(pair), asked(pair)
    clear = patches[1].matches
    shaken = clear.x2 + 0.02 * np.random.default_rng(0).standard_normal(clear.x2.shape)
    noisy = replace(patches[2], matches=replace(clear, x2=shaken), weight=patches[1].weight, origin="own", score=0.95)
    found = with_known_orientations([*patches[:2], noisy], scene, REMATCHERS["sift"], most_sigma_deg)
    assert found[2].origin == origin


@pytest.mark.parametrize(("share", "origin"), [(0.1, "borrowed"), (0.9, "own")])
def test_a_few_matches_on_something_else_give_way_to_the_orientation_that_the_pixels_confirm(
    share: float, origin: str
) -> None:
    pair = room(1.1 * LEFT, 0.35)
    scene, patches = scene_of(pair), asked(pair)
    few = replace(patches[2], matches=patches[1].matches, weight=patches[1].weight, origin="own", score=0.96)
    few = replace(few, share=share, tilt_sigma_rad=0.5)
    found = with_known_orientations([*patches[:2], few], scene, REMATCHERS["sift"], Options().max_sigma_deg)[2]
    assert found.origin == origin
    assert origin == "own" or tilt_error_deg(found, pair, LEFT) < 1.0


def test_a_window_mostly_outside_image_2_has_the_wall_that_the_rest_of_it_is_on_and_stays_as_unsure() -> None:
    pair = room(FLOOR, 1.0, coarseness=1.0)
    scene, patches = scene_of(pair), asked(pair, (*ASKED[:2], (0, 60, 64, 64)))
    strip = replace(patches[2], share=0.2, tilt_sigma_rad=0.4)
    found = with_known_orientations([*patches[:2], strip], scene, REMATCHERS["sift"], Options().max_sigma_deg)[2]
    assert found.origin == "borrowed"
    assert "mostly not in image 2" in found.reason
    assert found.tilt_sigma_rad == 0.4
    assert tilt_error_deg(found, pair, LEFT) < 0.5


def test_without_a_clear_window_the_orientation_is_that_of_a_plane_through_dense_matches() -> None:
    pair = room(1.15 * LEFT, 0.35)
    bare = asked(pair, (BARE,))[0]
    assert "that of a plane of the scene" in bare.reason
    assert tilt_error_deg(bare, pair, LEFT) < 1.0


def test_planes_of_clear_windows_are_known_before_those_of_the_scene() -> None:
    pair = room(FLOOR, 0.0)
    scene, patches = scene_of(pair), asked(pair)
    known = known_planes(patches, scene)
    assert {plane.name for plane in known[:2]} == {"window 1", "window 2"}
    assert [plane.sigma_rad for plane in known] == sorted(plane.sigma_rad for plane in known)
    assert "a plane of the scene" in {plane.name for plane in known}


def test_windows_that_are_clearly_matched_stay_as_they_are() -> None:
    pair = room(FLOOR, 1.0, coarseness=1.0)
    for patch, normal in zip(asked(pair), (LEFT, RIGHT, FLOOR), strict=True):
        assert patch.origin == "own"
        assert tilt_error_deg(patch, pair, normal) < 0.5
