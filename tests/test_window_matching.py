"""Windows: which are accepted, and what is matched in plain, faint, bare, crowded and unseen ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from scenery import Pair, Surface, make_camera, pixel_grid, render, tilted, turn, unit

from slopecli.errors import InputError
from slopecli.geometry import homogeneous, inverse_depth, normal_angle, rays_from_pixels
from slopecli.look import (
    Cells,
    Evidence,
    Layer,
    Matches,
    Pyramid,
    Scene,
    epipolar_axes,
    gather_evidence,
    overview_cells,
    sample_grey,
    scene_planes,
    shrink,
)
from slopecli.options import Options
from slopecli.patches import Patch, overdispersion, paint_labels, window_footprint
from slopecli.patches.windows import match_window, window_patch
from slopecli.types import FloatArray
from slopecli.windows import Window, check_windows, grid_windows, window_polygon

R, T, GROUND = turn(1, -2, 3), unit(0.8, 0.2, 0.4), tilted(0.2, -0.1)
OTHER = tilted(-0.3, 0.2, 5.0)
WINDOW: Window = (110, 70, 100, 100)
FAINTEST_CELL = 100.0  # grey^2/px^2: weaker cells of the overview move with the noise


def cells_of(pair: Pair, layer: Layer) -> Cells:
    """Dense matches of the whole image, led by sparse ones that are right, under the true motion."""
    rng = np.random.default_rng(0)
    size1, size2 = (np.array([c.width, c.height]) - 1.0 for c in (pair.camera1, pair.camera2))
    uv1 = rng.uniform([0, 0], size1, (600, 2))
    uv2 = pair.transfer(uv1)
    seen = ((uv2 > 2) & (uv2 < size2 - 2)).all(1) & ~pair.hidden(uv1)
    return overview_cells(layer, Pyramid(pair.grey2), pair.grey2.shape, uv1[seen], uv2[seen])


def evidence_of(pair: Pair, cells: Cells) -> Evidence:
    cells = cells.take(np.linalg.eigvalsh(cells.information)[:, 0] > FAINTEST_CELL)
    found = Matches.between(pair.camera1, pair.camera2, cells.uv1, cells.uv2)
    grey = sample_grey(pair.grey1, cells.uv1)
    return gather_evidence(found, grey, pair.R, pair.T, pair.camera2.focal_px)


def scene_of(pair: Pair, evidence: Evidence | None = None, planes: Sequence[FloatArray] | None = None) -> Scene:
    layer = Layer(*shrink(pair.grey1, 1e6))
    cells = cells_of(pair, layer)
    if evidence is None:
        evidence = evidence_of(pair, cells)
    found = list(planes) if planes is not None else scene_planes(evidence)
    pyramid1, pyramid2 = Pyramid(pair.grey1, layer.scale), Pyramid(pair.grey2)
    return Scene(pair.camera1, pair.camera2, pyramid1, pyramid2, pair.R, pair.T, evidence, lambda: found, cells)


def some(evidence: Evidence, keep: np.ndarray) -> Evidence:
    names = ("uv1", "uv2", "x1", "x2", "w", "leverage", "grey")
    return Evidence(*(getattr(evidence, name)[keep] for name in names), evidence.focal_px, evidence.n_given)


def plane_of(match: Patch, pair: Pair) -> FloatArray:
    """Scaled normal (3,) by weighted least squares: what the matches say of the plane when the motion is known."""
    w, leverage = inverse_depth(pair.R, pair.T, match.matches.x1, match.matches.x2)
    root = leverage * np.sqrt(match.weight)
    return np.linalg.lstsq(homogeneous(match.matches.x1) * root[:, None], w * root, rcond=None)[0]


def tilt_error_deg(match: Patch, pair: Pair, true: FloatArray = GROUND) -> float:
    return float(np.degrees(normal_angle(plane_of(match, pair), true)))


def inside(match: Patch, window: Window) -> np.ndarray:
    x, y, w, h = window
    low, high = np.array([x, y]) - 0.5, np.array([x + w, y + h]) - 0.5
    return np.asarray(((match.matches.uv1 >= low) & (match.matches.uv1 < high)).all(1))


def matched(surfaces: Sequence[Surface | FloatArray], window: Window = WINDOW, **changes: object) -> tuple:
    pair = render(R, T, surfaces, **{"noise": 1.0, **changes})  # type: ignore[arg-type]
    return match_window(window_patch(window), scene_of(pair)), pair


# ---- what else is in the window ----


def of_a_side(normal: FloatArray, share: float) -> Surface:
    """A surface in the right part of the window, and on to the right of it."""
    x, _, w, _ = WINDOW
    left = round(x + (1 - share) * w)
    return Surface(normal, box=(left, 0, 320 - left, 240))


@pytest.mark.parametrize("share", [0.12, 0.2, 0.3])
@pytest.mark.parametrize("distance", [8.0, 4.5])
def test_a_window_across_a_step_is_not_sure_of_the_part_it_sees(share: float, distance: float) -> None:
    """Ground and what lies beyond an edge, or stands before it: its plane is neither of them."""
    match, _ = matched([GROUND, of_a_side(tilted(0.2, -0.1, distance), share)])
    alone, _ = matched([GROUND])
    assert np.degrees(alone.tilt_sigma_rad) < 0.5
    assert np.degrees(match.tilt_sigma_rad) > 4.0


def test_a_window_with_something_that_has_moved_is_not_sure_of_the_part_it_sees() -> None:
    here = render(R, T, [GROUND], noise=1.0)
    moved = render(R, T, [GROUND], noise=1.0, seed=1)
    grey2 = here.grey2.copy()
    corner = here.transfer(np.array([[185.0, 75.0]]))[0].round().astype(int)
    part = np.s_[corner[1] : corner[1] + 90, corner[0] : corner[0] + 25]
    grey2[part] = moved.grey2[part]
    match = match_window(window_patch(WINDOW), scene_of(replace(here, grey2=grey2)))
    assert tilt_error_deg(match, here) < 1.0
    assert np.degrees(match.tilt_sigma_rad) > 4.0


# ---- windows ----


@pytest.mark.parametrize(("columns", "rows"), [(3, 3), (1, 1), (7, 5), (10, 2)])
def test_grid_windows_tile_the_image_exactly(columns: int, rows: int) -> None:
    windows = grid_windows(columns, rows, 331, 241)
    footprints = [window_footprint(window) for window in windows]
    labels = paint_labels(footprints, list(range(1, len(windows) + 1)), (241, 331))
    assert len(windows) == columns * rows
    assert sum(w * h for _, _, w, h in windows) == 331 * 241
    assert (labels > 0).all()
    widths, heights = {w for _, _, w, _ in windows}, {h for _, _, _, h in windows}
    assert max(widths) - min(widths) <= 1
    assert max(heights) - min(heights) <= 1


def test_grid_windows_run_row_by_row_from_the_top_left() -> None:
    windows = grid_windows(3, 2, 300, 200)
    assert [window[:2] for window in windows] == [(x, y) for y in (0, 100) for x in (0, 100, 200)]


def test_windows_inside_the_image_are_accepted() -> None:
    check_windows([*grid_windows(3, 3, 320, 240), (0, 0, 320, 240), (304, 224, 16, 16)], 320, 240)


@pytest.mark.parametrize(
    ("window", "words"),
    [
        ((10, 10, 15, 40), ["window 2", "15x40 px", "16x16", "larger"]),
        ((10, 10, 40, 0), ["window 2", "40x0 px"]),
        ((-1, 0, 40, 40), ["window 2", "(-1,0,40,40)", "320x240", "0 <= X"]),
        ((281, 0, 40, 40), ["window 2", "not inside image 1", "X+W <= 320"]),
        ((0, 201, 40, 40), ["window 2", "not inside image 1", "Y+H <= 240"]),
    ],
)
def test_a_bad_window_is_named_with_what_is_wrong_and_what_is_needed(window: Window, words: list[str]) -> None:
    with pytest.raises(InputError) as error:
        check_windows([(0, 0, 50, 50), window, (0, 0, 1, 1)], 320, 240)
    assert all(word in str(error.value) for word in words)
    assert "\n" not in str(error.value)


def test_the_outline_of_a_window_runs_along_pixel_edges() -> None:
    outline = window_polygon((10, 20, 30, 40))
    assert outline.tolist() == [[9.5, 19.5], [39.5, 19.5], [39.5, 59.5], [9.5, 59.5]]


# ---- matching ----


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"noise": 2.0},
        {"gain": 0.5, "offset": 20.0},
        {"camera1": make_camera(model="brown", distortion=(-0.25, 0.08, 0.001, -0.001))},
    ],
    ids=["clean", "noise", "darker", "lens"],
)
def test_a_textured_window_is_matched_all_over(changes: dict[str, object]) -> None:
    match, pair = matched([GROUND], **changes)
    assert match.origin == "own"
    assert inside(match, WINDOW).all()
    assert match.share > 0.95
    assert np.median(pair.error_px(match.matches.uv1, match.matches.uv2)) < 0.03
    assert tilt_error_deg(match, pair) < 0.1
    assert match.tilt_sigma_rad < np.radians(0.1)


def test_a_window_off_the_plane_around_it_gives_its_own() -> None:
    match, pair = matched([GROUND, Surface(OTHER, WINDOW)])
    assert match.origin == "own"
    assert tilt_error_deg(match, pair, OTHER) < 0.3


def test_a_window_the_overview_missed_is_searched_for() -> None:
    other = tilted(-0.5, 0.4)
    pair = render(R, T, [GROUND, Surface(other, WINDOW)], noise=1.0)
    evidence = scene_of(pair).evidence
    match = match_window(window_patch(WINDOW), scene_of(pair, some(evidence, ~evidence.near(WINDOW, 0.1)), [GROUND]))
    assert match.origin == "own"
    assert tilt_error_deg(match, pair, other) < 0.6


@pytest.mark.parametrize(("contrast", "margin_deg"), [(0.3, 0.6), (0.1, 1.8)])
def test_faint_texture_gives_the_plane_with_more_noise(contrast: float, margin_deg: float) -> None:
    match, pair = matched([GROUND, Surface(OTHER, WINDOW, contrast=contrast)])
    clear, _ = matched([GROUND, Surface(OTHER, WINDOW)])
    assert match.origin == "own"
    assert tilt_error_deg(match, pair, OTHER) < margin_deg
    assert np.median(clear.weight) > 2 * np.median(match.weight)


def test_claimed_noise_is_about_the_true_one() -> None:
    ratios = []
    for contrast in (1.0, 0.3, 0.1):
        match, pair = matched([GROUND, Surface(GROUND, WINDOW, contrast=contrast)])
        along, _ = epipolar_axes(match.matches.uv1, scene_of(pair))
        off = np.einsum("ni,ni->n", (match.matches.uv2 - pair.transfer(match.matches.uv1)) @ pair.R[:2, :2], along)
        ratios.append(np.sqrt(np.median(off**2) / 0.4549 * np.median(match.weight) / 0.05**2))
    assert max(ratios) < 1.5  # never much more certain than it may be
    assert min(ratios) > 0.25


@pytest.mark.parametrize("window", [(150, 100, 16, 16), (150, 100, 30, 20)])
def test_small_windows_are_matched(window: Window) -> None:
    match, pair = matched([GROUND], window)
    assert match.origin == "own"
    assert inside(match, window).all()
    assert tilt_error_deg(match, pair) < 2.0


def test_a_window_of_a_large_image_is_matched_on_shrunken_pixels_without_shift() -> None:
    match, pair = matched([GROUND], (200, 150, 500, 400), camera1=make_camera(1001, 777), coarseness=2.0)
    assert match.origin == "own"
    assert np.median(pair.error_px(match.matches.uv1, match.matches.uv2)) < 0.08
    assert np.abs((match.matches.uv2 - pair.transfer(match.matches.uv1)).mean(0)).max() < 0.03
    assert tilt_error_deg(match, pair) < 0.05


def test_rough_ground_is_matched_off_its_plane() -> None:
    rough = Surface(GROUND, bump=lambda uv: 0.002 * np.sin(uv[:, 0] / 9) * np.cos(uv[:, 1] / 8))
    match, pair = matched([rough])
    assert match.origin == "own"
    assert np.median(pair.error_px(match.matches.uv1, match.matches.uv2)) < 0.1
    assert tilt_error_deg(match, pair) < 0.5


@pytest.mark.parametrize("width", [15, 30])
def test_a_ledge_at_the_side_of_a_window_does_not_tilt_it_but_raises_doubt(width: int) -> None:
    match, pair = matched([GROUND, Surface(1.12 * GROUND, (110, 70, width, 100))])
    on_ledge = match.matches.uv1[:, 0] < 110 + width - 6
    assert match.origin == "own"
    assert on_ledge.mean() < 0.02
    assert tilt_error_deg(match, pair) < 0.4
    assert match.tilt_sigma_rad > np.radians(1.0)


def test_a_bare_window_borrows_the_plane_around_it_and_says_so() -> None:
    match, pair = matched([GROUND, Surface(GROUND, WINDOW, contrast=0.0)])
    assert match.origin == "borrowed"
    assert match.code == "low-texture"
    assert "texture" in match.reason
    assert inside(match, WINDOW).mean() < 0.1
    assert tilt_error_deg(match, pair) < 0.5


def test_a_bare_window_between_two_planes_is_in_doubt_of_both() -> None:
    left, right = tilted(0.4, 0, 5.5), tilted(-0.4, 0, 5.5)
    window = (130, 90, 60, 60)
    bare = Surface(tilted(0, 0, 5.5), window, contrast=0.0)
    match, pair = matched([right, Surface(left, (0, 0, 160, 240)), bare], window)
    assert match.origin == "borrowed"
    assert min(tilt_error_deg(match, pair, plane) for plane in (left, right)) < 5
    assert match.tilt_sigma_rad > np.radians(15)  # they are 43 degrees apart


def test_a_bare_window_amid_clutter_is_in_great_doubt() -> None:
    rng = np.random.default_rng(0)
    tiles = [(54 * i, 48 * j, 54, 48) for i in range(6) for j in range(5)]
    clutter = [Surface(tilted(*rng.uniform(-0.8, 0.8, 2), rng.uniform(5.5, 6.5)), tile) for tile in tiles]
    window = (130, 90, 60, 60)
    match, _ = matched([tilted(0, 0), *clutter, Surface(tilted(0, 0), window, contrast=0.0)], window)
    assert match.origin != "own"
    assert match.origin == "none" or np.degrees(match.tilt_sigma_rad) > Options().max_sigma_deg


@pytest.mark.parametrize("window", [(0, 0, 60, 60), (0, 90, 40, 60)])
def test_a_window_image_2_does_not_show_borrows_and_names_the_overlap(window: Window) -> None:
    match, pair = matched([GROUND], window)
    assert match.origin == "borrowed"
    assert match.code == "no-overlap"
    assert "image 2" in match.reason
    assert tilt_error_deg(match, pair) < 2.5


def test_with_nothing_to_go_by_there_is_no_match_but_a_reason() -> None:
    pair = render(R, T, [Surface(GROUND, contrast=0.0)], noise=1.0)
    empty = gather_evidence(Matches.none(), np.empty(0), R, T, 277.0)
    match = match_window(window_patch(WINDOW), scene_of(pair, empty))
    assert match.origin == "none"
    assert len(match.matches) == len(match.weight) == 0
    assert match.code == "low-texture"
    assert "texture" in match.reason


def test_a_handful_of_evidence_leads_to_a_textured_window() -> None:
    pair = render(R, T, [GROUND], noise=1.0)
    evidence = scene_of(pair).evidence
    match = match_window(window_patch(WINDOW), scene_of(pair, some(evidence, np.arange(len(evidence)) % 40 == 0)))
    assert match.origin == "own"
    assert tilt_error_deg(match, pair) < 0.2


@pytest.mark.parametrize("surfaces", [[GROUND], [GROUND, Surface(GROUND, WINDOW, contrast=0.0)]], ids=["own", "bare"])
def test_a_match_is_whole_and_the_same_again(surfaces: list) -> None:
    pair = render(R, T, surfaces, noise=1.0)
    scene = scene_of(pair)
    match, again = match_window(window_patch(WINDOW), scene), match_window(window_patch(WINDOW), scene)
    points = match.matches
    assert all(array.shape == (len(points), 2) for array in (*vars(points).values(), match.cell))
    assert all(np.isfinite(array).all() for array in (*vars(points).values(), match.weight))
    assert (match.weight > 0).all()
    assert np.array_equal(points.uv2, again.matches.uv2)
    np.testing.assert_allclose(rays_from_pixels(pair.camera1, points.uv1), points.x1, atol=1e-9)
    np.testing.assert_allclose(rays_from_pixels(pair.camera2, points.uv2), points.x2, atol=1e-9)


def test_epipolar_axes_are_where_a_change_of_depth_moves_things() -> None:
    scene = scene_of(render(R, T, [GROUND]))
    uv1 = pixel_grid(320, 240)[::40, ::40].reshape(-1, 2)
    along, across = epipolar_axes(uv1, scene)
    np.testing.assert_allclose(np.einsum("ni,ni->n", along, across), 0, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(along, axis=1), 1)
    # in image 1 as it would look after the rotation is undone
    rays = homogeneous(rays_from_pixels(scene.camera1, uv1))
    nearer, further = (rays - w * T for w in (0.21, 0.19))
    moved = nearer[:, :2] / nearer[:, 2:] - further[:, :2] / further[:, 2:]
    moved /= np.linalg.norm(moved, axis=1, keepdims=True)
    np.testing.assert_allclose(np.abs(np.einsum("ni,ni->n", moved, along)), 1, atol=1e-6)


def test_few_residuals_are_not_believed_to_be_small() -> None:
    assert overdispersion(np.full(20, 1e-6)) == 1.0
    assert overdispersion(np.full(200, 1e-6)) == 0.25
    chi2 = np.random.default_rng(0).chisquare(1, 4000)
    assert overdispersion(chi2) == pytest.approx(1.0, rel=0.1)
    assert overdispersion(9 * chi2) == pytest.approx(9.0, rel=0.1)


def test_an_unmatched_patch_carries_its_reason() -> None:
    match = window_patch(WINDOW).unmatched("too dark", "low-texture")
    assert (match.origin, match.reason, match.code) == ("none", "too dark", "low-texture")
    assert match.matches.uv1.shape == (0, 2)


@pytest.mark.parametrize("seed", [2, 3, 4])
def test_what_matches_by_chance_is_a_guess(seed: int) -> None:
    """Image 2 shows other ground there: some of it always agrees, and its slope must not be told."""
    pair, other = render(R, T, [GROUND]), render(R, T, [GROUND], seed=seed)
    x, y, w, h = WINDOW
    grey2 = pair.grey2.copy()
    around = np.s_[max(y - 60, 0) : y + h + 60, max(x - 60, 0) : x + w + 60]
    grey2[around] = other.grey2[around]
    match = match_window(window_patch(WINDOW), scene_of(replace(pair, grey2=grey2)))
    assert match.origin != "own" or np.degrees(match.tilt_sigma_rad) > Options().max_sigma_deg


def test_what_stands_off_the_plane_by_a_step_counts() -> None:
    """A block over a fifth of the window, which its matches leave out: the window as a whole is not as flat as they."""
    x, y, w, h = WINDOW
    flat, _ = matched([tilted(0, 0)], WINDOW)
    block = Surface(tilted(0, 0, 5.0), (x, y, w // 5, h))
    match, _ = matched([tilted(0, 0), block], WINDOW)
    assert np.degrees(flat.tilt_sigma_rad) < 1
    assert match.origin == "own"
    assert np.degrees(match.tilt_sigma_rad) > 5
