"""Planes aligned on all pixels of a window: how exactly, under which exposure, past what hides them, how surely."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from scenery import Pair, Surface, make_camera, render, tilted, turn, unit

from slopecli.geometry import homogeneous, normal_angle, pixels_from_rays, rays_from_pixels
from slopecli.look import (
    NOISE_GREY,
    Layer,
    PlaneFit,
    Pyramid,
    View,
    align_plane,
    cell_shifts,
    correlation,
    cut,
    detrend,
    gain_between,
    normalise,
    sample_map,
    shrink,
    sweep_planes,
)
from slopecli.types import FloatArray

R, T, GROUND = turn(1, -2, 3), unit(0.8, 0.2, 0.4), tilted(0.2, -0.1)
WINDOW = (60, 50, 120, 100)
BROWN = make_camera(model="brown", distortion=(-0.25, 0.08, 0.001, -0.001))


def view_of(pair: Pair, window: tuple[int, int, int, int] = WINDOW, max_pixels: float = 1e7) -> View:
    return View(
        cut(Layer(*shrink(pair.grey1, max_pixels)), *window),
        lambda uv: rays_from_pixels(pair.camera1, uv),
        lambda x: pixels_from_rays(pair.camera2, x),
        pair.R,
        pair.T,
        Pyramid(pair.grey2),
        pair.grey2.shape,
    )


def worst_px(pair: Pair, view: View, normal: FloatArray) -> float:
    """The most by which a plane misses the truth anywhere in the window, px of image 2."""
    y, x = np.mgrid[: view.grid.shape[0], : view.grid.shape[1]]
    uv1 = view.grid.full(np.stack([x, y], -1).reshape(-1, 2).astype(float))
    return float(pair.error_px(uv1, view.mapping(normal).reshape(-1, 2)).max())


@pytest.mark.parametrize(
    ("changes", "margin_px"),
    [
        ({}, 0.01),
        ({"gain": 0.5, "offset": 20.0}, 0.02),
        ({"gain": 0.25, "offset": 10.0}, 0.03),
        ({"gain": 1.5, "offset": -60.0}, 0.02),
        ({"noise": 4.0}, 0.03),
        ({"camera1": BROWN}, 0.01),
    ],
    ids=["clean", "darker", "four times darker", "brighter", "noise", "lens"],
)
@pytest.mark.parametrize("off", [(0.0, 0.0, 0.0), (0.003, -0.002, 0.0), (0.006, -0.01, 0.008)])
def test_a_plane_is_aligned_to_hundredths_of_a_pixel(
    changes: dict[str, object], margin_px: float, off: tuple[float, float, float]
) -> None:
    pair = render(R, T, [GROUND], **changes)  # type: ignore[arg-type]
    view = view_of(pair)
    fit = align_plane(view, GROUND + off, 15)
    assert worst_px(pair, view, fit.normal) < margin_px
    assert fit.score > 0.98
    assert np.degrees(normal_angle(fit.normal, GROUND)) < 0.06


def test_the_starts_of_these_tests_are_pixels_away() -> None:
    pair = render(R, T, [GROUND])
    off = worst_px(pair, view_of(pair), GROUND + np.array([0.006, -0.01, 0.008]))
    assert 2.5 < off < 5


@pytest.mark.parametrize("share", [0.1, 0.2, 0.3])
def test_something_nearer_in_the_window_hardly_tilts_its_plane(share: float) -> None:
    x, y, w, h = WINDOW
    nearer = Surface(tilted(0, 0, 4.2), (x, y, w, round(share * h)))
    pair, bare = render(R, T, [GROUND, nearer]), render(R, T, [GROUND])
    fit = align_plane(view_of(pair), 1.02 * GROUND, 15)
    assert worst_px(bare, view_of(bare), fit.normal) < 0.05


def test_faint_texture_no_patch_could_show_decides_the_plane() -> None:
    pair = render(R, T, [Surface(GROUND, contrast=0.1)], noise=1.5)
    view = view_of(pair)
    fit = align_plane(view, 1.02 * GROUND, 15)
    assert worst_px(pair, view, fit.normal) < 0.15
    assert fit.score > 0.6


def test_bare_ground_scores_nothing() -> None:
    pair = render(R, T, [Surface(GROUND, contrast=0.0)], noise=1.5)
    assert abs(align_plane(view_of(pair), GROUND).score) < 0.1


def test_a_window_out_of_view_is_not_aligned() -> None:
    pair = render(R, T, [GROUND])
    fit = align_plane(view_of(pair), tilted(0, 0, 0.2))
    assert fit.score == -1.0
    assert np.isinf(fit.covariance).all()


def test_a_shrunken_window_is_aligned_as_well() -> None:
    pair = render(R, T, [GROUND], camera1=make_camera(1001, 777), coarseness=2.0)
    view = view_of(pair, (200, 150, 400, 350), 2e5)
    assert view.grid.scale.max() < 0.6
    assert worst_px(pair, view, align_plane(view, 1.01 * GROUND).normal) < 0.05


@pytest.mark.slow
@pytest.mark.parametrize(("gain", "offset"), [(1.0, 0.0), (0.5, 20.0)])
def test_covariance_is_that_of_repeated_fits(gain: float, offset: float) -> None:
    fits: list[PlaneFit] = []
    for texture in range(3):
        for noise in range(12):
            pair = render(R, T, [GROUND], noise=3.0, seed=texture, noise_seed=noise, gain=gain, offset=offset)
            fits.append(align_plane(view_of(pair), GROUND))
    error = np.sqrt(np.mean([(fit.normal - GROUND) ** 2 for fit in fits], axis=0))
    claimed = np.sqrt(np.mean([np.diag(fit.covariance) for fit in fits], axis=0))
    assert ((error / claimed > 0.7) & (error / claimed < 1.35)).all()  # 36 fits tell a spread to 12 %


@pytest.mark.parametrize("off", [1.0, 1.006, 0.99])
@pytest.mark.parametrize("noise", [0.0, 2.0])
def test_cells_want_to_move_to_where_the_truth_is(off: float, noise: float) -> None:
    pair = render(R, T, [GROUND], noise=noise)
    view = view_of(pair)
    cells = cell_shifts(view, off * GROUND, 10)
    uv1, mapping = view.grid.full(cells.centre), view.mapping(off * GROUND)
    before, after = (pair.error_px(uv1, sample_map(mapping, at)) for at in (cells.centre, cells.centre + cells.shift))
    assert len(cells.shift) == 120
    assert np.median(after) < (0.05 if noise == 0 else 0.06)
    assert np.percentile(after, 95) < 0.15
    if off != 1.0:
        assert np.median(before) > 0.3


def test_cells_know_how_well_they_know() -> None:
    pair = render(R, T, [GROUND], noise=3.0)
    view = view_of(pair)
    cells = cell_shifts(view, GROUND, 10)
    # the plane is the truth, so all that is left of a shift is its error
    off = cells.shift
    chi2 = np.einsum("ni,nij,nj->n", off, cells.information, off)
    assert 0.3 < chi2.mean() / 2 < 1.5


def test_shifts_along_epipolar_lines_alone_leave_the_plane_where_it_was_aligned() -> None:
    """Shifts in two directions trade off, so their part along the line pulls the plane of a small window away."""
    pulled = []
    for seed in range(6):
        pair = render(R, T, [GROUND], noise=4.0, noise_seed=seed)
        view = view_of(pair, (100, 60, 48, 48))
        cells = cell_shifts(view, align_plane(view, GROUND).normal, 4)
        rays = homogeneous(rays_from_pixels(pair.camera1, view.grid.full(cells.centre)))
        axis = rays[:, :2] * T[2] - T[:2]
        axis /= np.linalg.norm(axis, axis=1, keepdims=True)
        root = np.sqrt(np.einsum("ni,nij,nj->n", axis, cells.information, axis))
        shifts = np.array([cells.along(axis), (cells.shift * axis).sum(axis=1)]).T
        planes = np.linalg.lstsq(rays * root[:, None], shifts * root[:, None], rcond=None)[0]
        pulled.append(np.abs(rays @ planes).max(axis=0))
    alone, of_two = np.sqrt(np.mean(np.square(pulled), axis=0))
    assert alone < 0.02  # px
    assert alone < 0.7 * of_two


def test_cells_out_of_view_are_left_out() -> None:
    pair = render(R, T, [GROUND])
    view = view_of(pair, (0, 0, 120, 100))
    cells = cell_shifts(view, GROUND, 10)
    seen = pair.transfer(view.grid.full(cells.centre))
    assert 0 < len(cells.shift) < 120
    assert (seen > -5).all()
    np.testing.assert_allclose(cells.centre, cells.index[:, ::-1] * 10 + 4.5)


@pytest.mark.parametrize(
    "true",
    [
        (0.2, -0.1, 6.0),
        pytest.param((0.0, 0.0, 5.0), marks=pytest.mark.slow),
        (1.2, 0.0, 6.0),
        pytest.param((0.0, -0.8, 7.0), marks=pytest.mark.slow),
    ],
)
def test_a_sweep_comes_near_enough_to_be_aligned(true: tuple[float, float, float]) -> None:
    pair = render(R, T, [tilted(*true)])
    view = view_of(pair)
    found = sweep_planes(view, np.linspace(1 / 9, 1 / 4, 40))
    assert len(found) == 4
    assert [fit.score for fit in found] == sorted((fit.score for fit in found), reverse=True)
    fit = align_plane(view, found[0].normal, 20)
    assert worst_px(pair, view, fit.normal) < 0.02


def test_a_sweep_of_depths_out_of_view_finds_nothing() -> None:
    pair = render(R, T, [GROUND])
    assert sweep_planes(view_of(pair), np.array([5.0, 8.0])) == []


def test_a_plane_behind_the_camera_maps_nowhere() -> None:
    pair = render(turn(), unit(0, 0, 1), [GROUND])
    behind = view_of(pair).mapping(tilted(0, 0, 0.5))
    assert (behind == -1e4).all()


def test_the_mapping_of_a_view_is_exact_with_any_lens() -> None:
    pair = render(R, T, [GROUND], camera1=BROWN)
    assert worst_px(pair, view_of(pair), GROUND) < 1e-4


@pytest.fixture(scope="module")
def grey() -> np.ndarray:
    return render(R, T, [GROUND]).grey1.astype(np.float32)


def test_exposure_and_slow_shading_are_taken_out(grey: np.ndarray) -> None:
    y, x = np.mgrid[:240, :320]
    shaded = (0.7 * grey + 20 + 0.1 * x - 0.15 * y).astype(np.float32)
    inner = (slice(40, -40), slice(40, -40))
    assert np.corrcoef(normalise(grey, 15)[inner].ravel(), normalise(shaded, 15)[inner].ravel())[0, 1] > 0.998
    assert np.abs(detrend(shaded, 15) - 0.7 * detrend(grey, 15))[inner].max() < 1.0


def test_the_local_mean_that_is_taken_out_is_that_of_all_pixels_up_to_the_border(grey: np.ndarray) -> None:
    window = np.ascontiguousarray(grey[50:150, 60:180])
    mean = cv2.GaussianBlur(window, (0, 0), 16.0, borderType=cv2.BORDER_REFLECT)
    assert np.abs(window - detrend(window, 16.0) - mean).max() < 0.2 * mean.std()


def test_contrast_below_the_noise_is_not_blown_up() -> None:
    noise = np.random.default_rng(0).standard_normal((100, 100)).astype(np.float32)
    assert normalise(128 + 0.5 * NOISE_GREY * noise, 12).std() < 0.55


def test_gain_is_the_ratio_of_contrasts_within_limits(grey: np.ndarray) -> None:
    ours, everywhere = detrend(grey, 15), np.ones(grey.shape, bool)
    assert gain_between(ours, np.float32(0.8) * ours, everywhere) == pytest.approx(1.25, rel=1e-3)
    assert gain_between(ours, np.float32(0.25) * ours, everywhere) == pytest.approx(4.0, rel=1e-3)
    assert gain_between(ours, np.float32(0.01) * ours, everywhere) == 10.0
    assert gain_between(ours, 0 * ours, everywhere) == 10.0
    assert gain_between(ours, ours, ~everywhere) == 1.0


def test_correlation_is_one_for_alike_and_minus_one_where_hardly_anything_is_seen(grey: np.ndarray) -> None:
    everywhere = np.ones(grey.shape, bool)
    sliver = everywhere & (np.arange(320) < 90)
    assert correlation(grey, 0.5 * grey + 9, everywhere) == pytest.approx(1.0, abs=1e-3)
    assert correlation(grey, -grey, everywhere) == pytest.approx(-1.0, abs=1e-3)
    assert abs(correlation(grey, cv2.flip(grey, 1), everywhere)) < 0.1
    assert correlation(grey, grey, sliver) == -1.0


def test_views_do_not_change_what_they_are_made_of() -> None:
    view = view_of(render(R, T, [GROUND]))
    rays, pixels = view.pixels.rays.copy(), view.grid.grey.copy()
    align_plane(view, 1.01 * GROUND)
    cell_shifts(view, GROUND, 10)
    assert np.array_equal(view.pixels.rays, rays)
    assert np.array_equal(view.grid.grey, pixels)
