"""Dense depth of rendered pairs under their true motion: how exact it is, and where it says that it does not know.

Errors of inverse depth are counted as displacements in image 1, px. Margins are some 1.5 times the errors found.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from depth_scenes import error_px, pixels1, scene_of
from scenery import Pair, Surface, make_camera, render, tilted, turn, unit

from slopecli.look import DenseDepth, measure_depth
from slopecli.types import FloatArray

R, T, GROUND = turn(1, -2, 3), unit(0.8, 0.2, 0.4), tilted(0.2, -0.1)
BROWN = make_camera(model="brown", distortion=(-0.25, 0.08, 0.001, -0.001))
BLOCK = (100, 60, 120, 100)  # of image 1, px


def inside(depth: DenseDepth, pair: Pair) -> FloatArray:
    """(h, w) whether image 2 would show a pixel."""
    uv2 = pair.transfer(pixels1(depth).reshape(-1, 2)).reshape(*depth.w.shape, 2)
    size = np.array([pair.camera2.width, pair.camera2.height])
    return np.asarray(((uv2 > -0.5) & (uv2 < size - 0.5)).all(2))


def check(pair: Pair, median_px: float = 0.035, worst_px: float = 0.11, share: float = 0.97) -> DenseDepth:
    """The depth of a pair, of which most is known and little is wrong."""
    depth = measure_depth(scene_of(pair))
    seen, error = inside(depth, pair), np.abs(error_px(depth, pair)[depth.known])
    assert depth.known[seen].mean() > share
    assert not (depth.known & ~seen).any()
    assert np.median(error) < median_px
    assert np.quantile(error, 0.95) < worst_px
    assert abs(error_px(depth, pair)[depth.known].mean()) < 0.02
    return depth


@lru_cache(maxsize=1)
def plane() -> tuple[Pair, DenseDepth]:
    pair = render(R, T, [GROUND])
    return pair, measure_depth(scene_of(pair))


def test_a_plane_is_exact_to_hundredths_of_a_pixel_and_what_image_2_does_not_show_is_unknown() -> None:
    pair, depth = plane()
    check(pair)
    beyond = ~inside(depth, pair)
    assert 0.2 < beyond.mean() < 0.4
    assert not depth.known[beyond].any()


def test_places_in_image_2_and_rays_belong_to_the_depth() -> None:
    pair, depth = plane()
    uv2 = pair.transfer(pixels1(depth).reshape(-1, 2)).reshape(*depth.w.shape, 2)
    assert np.median(np.linalg.norm(depth.uv2 - uv2, axis=2)[depth.known]) < 0.04
    rays = (pixels1(depth) - [pair.camera1.cx, pair.camera1.cy]) / pair.camera1.fx
    assert np.abs(depth.rays - rays).max() < 1e-6
    assert depth.focal_px == pytest.approx(pair.camera1.fx, rel=1e-6)


def test_a_smaller_inverse_depth_moves_a_pixel_as_far_as_its_shift_says() -> None:
    pair, depth = plane()
    grid = pixels1(depth)[40:200:40, 40:280:40].reshape(-1, 2)
    nearer = render(R, T, [GROUND * 1.001])
    moved = (nearer.transfer(grid) - pair.transfer(grid)) / np.log(1.001)
    # what moves in image 2 is seen in image 1 as turned by the change from one to the other
    x, y = (pair.transfer(grid + half) - pair.transfer(grid - half) for half in 0.5 * np.eye(2))
    seen = np.linalg.solve(np.stack([x, y], -1), moved[..., None])[..., 0]
    shown = depth.shifts[40:200:40, 40:280:40].reshape(-1, 2)
    # the plane's own slope is no part of a shift at one and the same depth
    assert np.abs(np.linalg.norm(shown, axis=1) / np.linalg.norm(seen, axis=1) - 1).max() < 0.1


def test_what_remains_across_the_epipolar_lines_is_of_the_size_of_the_noise() -> None:
    quiet, noisy = plane()[1], measure_depth(scene_of(render(R, T, [GROUND], noise=3.0)))
    spread = [float(np.std(np.clip(depth.across_px[depth.known], -0.5, 0.5))) for depth in (quiet, noisy)]
    assert spread[0] < 0.03
    assert 1.3 * spread[0] < spread[1] < 0.1


def test_what_remains_along_the_lines_is_large_where_a_smaller_stone_was_smoothed() -> None:
    """A block of twelve pixels on level ground: its edges are smoothed, and a smaller window sees that they are."""
    block = Surface(tilted(0, 0, 6.0 / 1.04), (150, 110, 162, 122))
    pair = render(turn(), unit(0, 1, 0), [tilted(0, 0, 6.0), block])
    depth = measure_depth(scene_of(pair))
    off = np.abs(error_px(depth, pair)) > 0.2
    left = np.abs(depth.along_px)
    around = np.zeros_like(off)
    around[100:132, 140:172] = True
    assert (off & around).sum() > 20
    assert left[off & around].mean() > 5 * left[~off & ~around & depth.known].mean()


def test_distorting_lenses_are_followed() -> None:
    check(render(R, T, [GROUND], camera1=BROWN))
    check(render(R, T, [GROUND], camera1=make_camera(), camera2=BROWN))


def test_camera_2_may_be_another_camera() -> None:
    check(render(R, T, [GROUND], camera2=make_camera(400, 300, fx=260.0, fy=255.0)))


@pytest.mark.parametrize(("gain", "offset"), [(0.6, 30.0), (1.3, -40.0), (0.2, 4.0)])
def test_a_change_of_exposure_makes_no_difference(gain: float, offset: float) -> None:
    check(render(R, T, [GROUND], gain=gain, offset=offset))


@pytest.mark.parametrize("roll_deg", [90, 180])
def test_a_roll_of_the_camera_makes_no_difference(roll_deg: float) -> None:
    check(render(turn(0, 0, roll_deg) @ R, T, [GROUND]))


def test_a_camera_that_goes_back_by_a_fifth_of_the_distance_is_followed() -> None:
    check(render(R, unit(0.1, 0.1, -1), [tilted(0.2, -0.1, 5.0)]))


@pytest.mark.parametrize(("contrast", "unknown_px"), [(1.0, 0), (0.5, 2), (0.25, 8)])
def test_the_fainter_the_ground_the_more_is_unknown_around_the_point_that_the_camera_heads_for(
    contrast: float, unknown_px: float
) -> None:
    pair = render(turn(), unit(0, 0, 1), [Surface(tilted(0.1, 0.1, 5.0), contrast=contrast)], noise=1.0)
    depth = measure_depth(scene_of(pair))
    v, u = np.indices(depth.w.shape)
    away = np.hypot(u - pair.camera1.cx, v - pair.camera1.cy)
    assert depth.known[away < unknown_px].mean() < 0.05 if unknown_px else depth.known[away < 3].any()
    assert depth.known[(away > 30) & (away < 60)].mean() > 0.98
    # where it is known, it is known to a few percent, however little it moves pixels
    assert np.abs(error_px(depth, pair) / depth.shift_px)[depth.known & (away < 60)].max() < 0.04


def test_two_planes_keep_their_depths_up_to_the_edge_between_them() -> None:
    pair = render(R, T, [GROUND, Surface(tilted(0, 0, 5.0), BLOCK)])
    depth = measure_depth(scene_of(pair))
    error, seen = np.abs(error_px(depth, pair)), inside(depth, pair)
    assert np.median(error[depth.known]) < 0.04
    x, y, w, h = BLOCK
    on_top = np.zeros_like(depth.known)
    on_top[y + 6 : y + h - 6, x + 6 : x + w - 6] = True
    assert np.quantile(error[on_top & depth.known], 0.98) < 0.2
    assert depth.known[on_top & seen].mean() > 0.97
    # beside the edge it may be wrong, and says so: what it is sure of is right
    assert (error[depth.sure] > 1.0).mean() < 0.01
    assert depth.step.any()
    height, width = depth.w.shape
    near = np.ones((height, width), bool)
    near[y + 8 : y + h - 8, x + 8 : x + w - 8] = False
    near[: y - 8], near[y + h + 8 :] = False, False
    near[:, : x - 8], near[:, x + w + 8 :] = False, False
    assert near[depth.step & depth.known].mean() > 0.9


def test_what_a_nearer_surface_hides_in_image_2_is_unknown() -> None:
    pair = render(turn(), unit(1, 0, 0), [tilted(0, 0, 6.0), Surface(tilted(0, 0, 3.0), BLOCK)])
    depth = measure_depth(scene_of(pair))
    hidden = pair.hidden(pixels1(depth).reshape(-1, 2)).reshape(depth.w.shape) & inside(depth, pair)
    assert hidden.sum() > 2000
    assert depth.known[hidden].mean() < 0.15


def test_bare_ground_is_unknown_but_for_its_border() -> None:
    pair = render(R, T, [GROUND, Surface(GROUND, BLOCK, contrast=0.0)], noise=1.0)
    depth = measure_depth(scene_of(pair))
    x, y, w, h = BLOCK
    assert depth.known[y + 15 : y + h - 15, x + 15 : x + w - 15].mean() < 0.3


def test_a_large_image_is_measured_on_a_smaller_grid_at_the_same_places() -> None:
    pair = render(R, T, [GROUND], camera1=make_camera(640, 480), coarseness=2.0)
    depth = measure_depth(scene_of(pair), max_pixels=320 * 240)
    assert depth.w.shape == (240, 320)
    assert depth.focal_px == pytest.approx(pair.camera1.fx / 2, rel=1e-3)
    error = error_px(depth, pair)[depth.known]
    assert np.median(np.abs(error)) < 0.035
    assert abs(error.mean()) < 0.02


def test_ground_without_texture_is_bare_whatever_lies_beside_it() -> None:
    """A bright plate ends over a dark drop without texture: the plate's edge is no texture of the drop."""
    drop = Surface(tilted(0.0, 0.0, 9.0), (160, 0, 160, 240), contrast=0.0)
    depth = measure_depth(scene_of(render(R, T, [Surface(GROUND), drop])))
    assert depth.bare[20:220, 175:300].mean() > 0.95
    assert depth.bare[:, 30:150].mean() < 0.02
    assert not (depth.sure & depth.bare).any()


def test_textured_ground_is_not_bare() -> None:
    depth = measure_depth(scene_of(render(R, T, [Surface(GROUND)])))
    assert depth.bare.mean() < 0.005


def test_a_narrow_drop_without_texture_at_the_border_of_the_image_is_bare() -> None:
    """Ten pixels of it: the edge of the plate is within reach of the windows of half of them."""
    drop = Surface(tilted(0.0, 0.0, 9.0), (310, 0, 10, 240), contrast=0.0)
    depth = measure_depth(scene_of(render(R, T, [Surface(GROUND), drop], noise=1.0)))
    assert depth.bare[20:220, 315:].mean() > 0.6
    assert depth.bare[:, 30:290].mean() < 0.02
