"""Windows that show nothing to match, beside others that do: which orientation they get, and how sure it is."""

from __future__ import annotations

import numpy as np
import pytest
from scenery import Pair, Surface, render, tilted, turn, unit
from test_window_matching import scene_of, tilt_error_deg

from slopecli.options import Options
from slopecli.patches import PLANE_FINDERS, Patch
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


@pytest.mark.parametrize(("normal", "nearer"), [(LEFT, 1.0), (LEFT, 1.15), (RIGHT, 1.15), (FLOOR, 1.0)])
def test_a_shaded_wall_has_the_orientation_of_the_textured_one_it_is_parallel_to(
    normal: FloatArray, nearer: float
) -> None:
    pair = room(nearer * normal, 0.35)
    bare = asked(pair)[2]
    assert bare.origin == "borrowed"
    assert "elsewhere" in bare.reason or "around" in bare.reason
    assert tilt_error_deg(bare, pair, normal) < 3.0
    assert bare.tilt_sigma_rad < np.radians(30)


@pytest.mark.parametrize("normal", [tilted(0.3, 1.0, 5.5), tilted(1.6, 0.0, 5.5)])
def test_an_orientation_that_nothing_else_shows_is_within_three_sigmas(normal: FloatArray) -> None:
    pair = room(normal, 0.35)
    bare = asked(pair)[2]
    error = tilt_error_deg(bare, pair, normal)
    assert bare.origin == "own" or error < 3 * np.hypot(5.0, np.degrees(bare.tilt_sigma_rad))


def test_a_wall_without_any_shading_is_no_better_known_than_the_walls_agree() -> None:
    bare = asked(room(FLOOR, 0.0))[2]
    assert bare.origin == "none" or np.degrees(bare.tilt_sigma_rad) > Options().max_sigma_deg


@pytest.mark.parametrize("seed", range(2))
def test_faint_texture_that_matches_by_chance_gives_way_to_a_known_orientation(seed: int) -> None:
    pair = room(1.1 * LEFT, 0.05, coarseness=1.0, noise=2.0, seed=seed)
    faint = asked(pair)[2]
    error, sigma = tilt_error_deg(faint, pair, LEFT), np.degrees(faint.tilt_sigma_rad)
    assert error < 3 * np.hypot(5.0, sigma)
    if "elsewhere" in faint.reason:
        assert faint.origin == "borrowed"


def test_windows_that_are_clearly_matched_stay_as_they_are() -> None:
    pair = room(FLOOR, 1.0, coarseness=1.0)
    for patch, normal in zip(asked(pair), (LEFT, RIGHT, FLOOR), strict=True):
        assert patch.origin == "own"
        assert tilt_error_deg(patch, pair, normal) < 0.5
