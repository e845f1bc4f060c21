"""Cells without matches: whether they look in image 2 as the plane of their window has them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scenery import Pair, Surface, make_camera, render, tilted, turn, unit

from slopecli.geometry import homogeneous, rays_from_pixels
from slopecli.look import Cells, Matches, Pyramid, Scene, gather_evidence
from slopecli.patches.windows import confirmed_cells, contradicting_cells
from slopecli.types import FloatArray

R, T, GROUND = turn(1, -2, 3), unit(0.8, 0.2, 0.4), tilted(0.2, -0.1)
BOX = (130, 90, 60, 60)
SIDE_PX = 12.0


def scene_of(pair: Pair) -> Scene:
    """A scene of which nothing is known but the motion."""
    none, nothing = np.zeros((0, 2)), np.zeros(0)
    evidence = gather_evidence(Matches.none(), nothing, pair.R, pair.T, pair.camera2.focal_px)
    cells = Cells(none, none, np.zeros((0, 2, 2)), np.zeros((0, 2), np.int64), nothing, nothing, 1.0)
    pyramids = Pyramid(pair.grey1), Pyramid(pair.grey2)
    return Scene(pair.camera1, pair.camera2, *pyramids, pair.R, pair.T, evidence, lambda: [], cells)


def lattice(box: tuple[int, int, int, int]) -> FloatArray:
    """Centres of cells well inside a box."""
    x, y, w, h = box
    u, v = np.meshgrid(np.arange(x + 8.0, x + w - 8, 9.0), np.arange(y + 8.0, y + h - 8, 9.0))
    return np.column_stack([u.ravel(), v.ravel()])


def share_against(pair: Pair, box: tuple[int, int, int, int], side_px: float = SIDE_PX) -> float:
    return float(contradicting_cells(lattice(box), side_px, GROUND, scene_of(pair)).mean())


@pytest.mark.parametrize("gain", [1.0, 0.6])
@pytest.mark.parametrize("side_px", [6.0, 12.0, 20.0])
def test_ground_on_the_plane_does_not_contradict_it(side_px: float, gain: float) -> None:
    pair = render(R, T, [GROUND], noise=2.0, gain=gain, offset=20.0)
    assert share_against(pair, BOX, side_px) == 0.0


def test_ground_a_pixel_off_the_plane_does_not_contradict_it() -> None:
    """Relief, which the flow would have followed."""
    pair = render(R, T, [replace_depth(1.0)], noise=2.0)
    assert share_against(pair, BOX) < 0.1


def replace_depth(shift_px: float) -> Surface:
    """The ground, moved so far along its epipolar lines in image 2."""
    per_px = 1.0 / make_camera().focal_px
    return Surface(GROUND, bump=lambda uv1: np.full(len(uv1), shift_px * per_px))


@pytest.mark.parametrize("shift_px", [8.0, 20.0])
def test_what_stands_off_the_plane_contradicts_it(shift_px: float) -> None:
    standing = replace(replace_depth(shift_px), box=BOX)
    pair = render(R, T, [GROUND, standing], noise=2.0)
    assert share_against(pair, BOX) > 0.7  # some look alike by chance
    assert share_against(pair, (20, 20, 60, 60)) == 0.0


def test_other_things_in_image_2_contradict_the_plane() -> None:
    here, there = render(R, T, [GROUND], seed=0), render(R, T, [GROUND], seed=1)
    assert share_against(replace(here, grey2=there.grey2), BOX) > 0.7


def test_bare_ground_contradicts_nothing() -> None:
    """Whatever stands there: one cannot see whether it is the same."""
    bare = replace(replace_depth(20.0), box=(110, 70, 100, 100), contrast=0.0)
    assert share_against(render(R, T, [GROUND, bare], noise=1.0), BOX) == 0.0


def test_ground_outside_image_2_contradicts_nothing() -> None:
    here, there = render(turn(0, 20, 0), T, [GROUND], seed=0), render(turn(0, 20, 0), T, [GROUND], seed=1)
    outside = lattice((0, 20, 320, 200))
    uv2 = here.transfer(outside)
    outside = outside[((uv2 < -10) | (uv2 > [330, 250])).any(1)]
    assert len(outside) > 50
    assert not contradicting_cells(outside, SIDE_PX, GROUND, scene_of(replace(here, grey2=there.grey2))).any()


def test_ground_behind_camera_2_contradicts_nothing() -> None:
    pair = render(R, T, [GROUND])
    assert not contradicting_cells(lattice(BOX), SIDE_PX, np.array([0.0, 0.0, 40.0]), scene_of(pair)).any()


def test_a_plane_that_ends_at_its_horizon_says_nothing_beyond_it() -> None:
    """There camera 1 would have it behind itself."""
    here, there = render(R, T, [GROUND], seed=0), render(R, T, [GROUND], seed=1)
    slanted = np.array([0.0, 0.6, 0.05])
    cells = lattice((0, 0, 320, 240))
    found = contradicting_cells(cells, SIDE_PX, slanted, scene_of(replace(here, grey2=there.grey2)))
    below = homogeneous(rays_from_pixels(here.camera1, cells)) @ slanted > 0
    assert found[below].any()
    assert not found[~below].any()


def test_a_lens_that_folds_leaves_out_what_it_has_no_picture_of() -> None:
    """Beyond some angle nothing comes of a polynomial that bends back; cells across that border are not compared."""
    lens = make_camera(model="brown", distortion=(-0.6,))
    here, there = (render(turn(0, 6, 0), T, [GROUND], camera1=lens, seed=seed) for seed in (0, 1))
    found = contradicting_cells(lattice((0, 0, 320, 240)), SIDE_PX, GROUND, scene_of(replace(here, grey2=there.grey2)))
    assert 0.3 < found.mean() < 1.0


# ---- cells that are borne out ----


def share_confirmed(pair: Pair) -> float:
    return float(confirmed_cells(lattice(BOX), SIDE_PX, GROUND, scene_of(pair)).mean())


def test_unmatched_ground_that_image_2_shows_on_the_plane_is_confirmed() -> None:
    assert share_confirmed(render(R, T, [GROUND], noise=2.0)) > 0.7


def test_what_stands_off_the_plane_is_not_confirmed() -> None:
    standing = replace(replace_depth(20.0), box=BOX)
    assert share_confirmed(render(R, T, [GROUND, standing], noise=2.0)) < 0.1
    here, there = render(R, T, [GROUND], seed=0), render(R, T, [GROUND], seed=1)
    assert share_confirmed(replace(here, grey2=there.grey2)) < 0.1


def test_bare_ground_is_not_confirmed() -> None:
    bare = replace(replace_depth(0.0), box=(110, 70, 100, 100), contrast=0.0)
    assert share_confirmed(render(R, T, [GROUND, bare], noise=1.0)) < 0.1
