"""The windows finder: rectangles of image 1, each matched by itself, guided by a first plane of it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from slopecli.geometry.epipolar import homogeneous
from slopecli.geometry.motion import epipolar_residual, inverse_depth
from slopecli.geometry.plane_fit import BEND_RAD, robust_plane
from slopecli.geometry.statistics import median
from slopecli.look.dense import CELL, FULL_SMOOTHINGS, Cells, dense_cells
from slopecli.look.foerstner import correlate_windows, foerstner_corners
from slopecli.look.matches import LEAST_MATCHES, ON_PLANE_PX, Matches, pair_rays
from slopecli.look.noise import LEAST_MATCH_PX, NOISE_GREY
from slopecli.look.photometric import PlaneFit, align_plane, sweep_planes
from slopecli.look.scene import FINE_PX, Scene, axis_variance, view_of
from slopecli.look.threads import single_threaded
from slopecli.look.warp import covered, resample, sample_map
from slopecli.options import MIN_SIDE_PX, Options
from slopecli.patches.join import Joined, join_patches
from slopecli.patches.patch import Found, Patch, overdispersion, weight_of, window_footprint
from slopecli.patches.windows.borrowed import borrow
from slopecli.patches.windows.direct_alignment import align_directly
from slopecli.patches.windows.known_orientations import with_known_orientations
from slopecli.patches.windows.tunables import TUNE
from slopecli.patches.windows.unmatched_parts import with_unmatched_parts
from slopecli.types import FloatArray
from slopecli.windows import Window, check_windows, grid_windows, inside_window


def find_in_windows(scene: Scene, options: Options) -> Found:
    """One patch per window, each matched by itself, guided by the scene; InputError as in `wanted_windows`."""
    windows = wanted_windows(options, scene.camera1.width, scene.camera1.height)
    match = WINDOW_MATCHERS[options.features]
    with single_threaded():
        patches = [match(window_patch(window, k), scene) for k, window in enumerate(windows, 1)]
        rematch = REMATCHERS[options.features]
        return Found(with_known_orientations(patches, scene, rematch, options.max_sigma_deg))


def join_widely(scene: Scene) -> Joined | None:
    """Windows all over image 1 that are matched by themselves, for what they tell of the cameras; None if none is.

    Their matches are three times as precise as those of the overview, which is all there is outside windows.
    """
    height, width = scene.shape1
    along = 5  # windows along each side; with 3, relief bends the planes of towns
    if min(width, height) < along * MIN_SIDE_PX:
        return None
    windows = grid_windows(along, along, width, height)
    with single_threaded():
        patches = [match_window(window_patch(window, k), scene) for k, window in enumerate(windows, 1)]
    own = [patch for patch in patches if patch.origin == "own"]
    return join_patches(Found(own), scene) if own else None


def wanted_windows(options: Options, width: int, height: int) -> list[Window]:
    """The windows given, or those of the grid; InputError if one is too small or not inside image 1 (px)."""
    windows = list(options.windows) or grid_windows(*options.grid, width, height)
    check_windows(windows, width, height)
    return windows


def window_patch(window: Window, number: int = 1) -> Patch:
    """The patch of a window, still without matches; `number`: its id."""
    return Patch(number, "window", window_footprint(window))


# ---- dense flow ----


def match_window(patch: Patch, scene: Scene) -> Patch:
    """The window with its dense matches, or with those of a plane borrowed, or with none and the reason."""
    tried: list[FloatArray] = []
    for normal in _starting_normals(patch.window, scene):
        matched = _densely_matched(patch, scene, normal)
        if matched.origin == "own":
            return matched
        tried.append(normal)
    inside = scene.evidence.plane_through(scene.evidence.near(patch.window, 0.0))
    if inside is not None and not any(np.array_equal(inside, earlier) for earlier in tried):
        matched = _densely_matched(patch, scene, inside)
        if matched.share >= TUNE.part_share:  # image 2 shows a part of the window
            return matched
    return borrow(patch, scene)


def _starting_normals(window: Window, scene: Scene) -> Iterator[FloatArray]:
    """Scaled normals to start a dense match from, the cheapest first; the search runs only if the first one fails."""
    first = _plane_from_overview(window, scene)
    if first is not None:
        yield first
    yield from _search_plane(window, scene)


def _plane_from_overview(window: Window, scene: Scene) -> FloatArray | None:
    """Scaled normal (3,) of the plane through the overview matches in the window; None if they cover too little."""
    inside = scene.evidence.near(window, 0.0)
    cell_area = CELL**2 / float(np.prod(scene.pyramid1.overview_scale))
    if inside.sum() * cell_area < TUNE.overview_share * window[2] * window[3]:
        return None
    return scene.evidence.plane_through(inside)


def _search_plane(window: Window, scene: Scene) -> list[FloatArray]:
    """The scaled normal (3,) under which the pixels of the window correlate best with image 2, in a list.

    Starts are the planes of overview matches in and around the window, the dominant planes of the scene and, if those
    correlate poorly, a sweep over depth and tilt. Empty if no plane correlates, or if the pixels do not determine the
    normal.
    """
    view = view_of(window, scene, TUNE.coarse_px, border=False)
    if min(view.grid.shape) < 8:  # px: too narrow to compare
        return []
    candidates = [scene.evidence.plane_through(scene.evidence.near(window, grow)) for grow in (0.0, 0.5, 1.5)]
    fits = [align_plane(view, normal, 6) for normal in (*candidates, *scene.planes) if normal is not None]
    fits = [fit for fit in fits if np.isfinite(fit.score)]
    if max((fit.score for fit in fits), default=-1.0) < TUNE.good_score and len(scene.evidence) >= LEAST_MATCHES:
        depths = scene.evidence.sweep_depths(view.grid.mean_scale, 8, 60)
        fits += [align_plane(view, fit.normal, 8) for fit in sweep_planes(view, depths)]
    best = max(fits, key=lambda fit: fit.score, default=None)
    if best is None or best.score <= TUNE.fair_score:
        # too little of the window is in image 2 to compare, but some of that may have overview matches
        return [candidates[0]] if candidates[0] is not None else []
    best = _align_finer(best, window, scene)
    return [best.normal] if _normal_is_determined(best) else []


def _align_finer(fit: PlaneFit, window: Window, scene: Scene) -> PlaneFit:
    """The plane aligned again at finer resolutions, up to that of the window."""
    for side in (TUNE.coarse_px * 2, FINE_PX):
        if max(window[2:]) > 0.6 * side:
            fit = align_plane(view_of(window, scene, side, border=False), fit.normal, 8)
    return fit


def _normal_is_determined(fit: PlaneFit) -> bool:
    """Whether the pixels determine the direction of the normal: to a 1-sigma below `informed_rad`."""
    if not np.isfinite(fit.covariance).all():
        return False
    length = max(float(np.linalg.norm(fit.normal)), 1e-12)
    unit = fit.normal / length
    project = (np.eye(3) - np.outer(unit, unit)) / length
    sigma = np.sqrt(max(np.linalg.eigvalsh(project @ fit.covariance @ project.T)[-1], 0.0))
    return bool(sigma < TUNE.informed_rad)


def _densely_matched(patch: Patch, scene: Scene, normal: FloatArray) -> Patch:
    """The window with matches by dense flow between it and image 2 resampled under the plane `normal` (3,)."""
    window = patch.window
    view = view_of(window, scene, FINE_PX, border=True)
    grid = view.grid
    if min(grid.shape) < MIN_SIDE_PX:
        return patch.unmatched("too few pixels")
    cell = int(np.clip(max(window[2:]) * grid.mean_scale / TUNE.cells_across, 4, 8))
    mapping = view.node_mapping(normal)
    possible = max(1.0, window[2] * window[3] * float(np.prod(grid.scale)) / cell**2)

    def flow_matched(smoothings: int) -> Patch:
        cells = dense_cells(grid, mapping, scene.pyramid2, scene.shape2, cell, finest=0, smoothings=smoothings)
        return with_cells(patch, cells.take(inside_window(cells.uv1, window)), scene, possible)

    matched = flow_matched(1)  # more rounds of smoothing would flatten relief
    if matched.score < TUNE.clear_score:
        smooth = flow_matched(FULL_SMOOTHINGS)  # faint texture needs them
        # smoothing extends the flow from textured ground into bare ground, where it is not a match
        matched = smooth if matched.origin == "own" or smooth.share >= TUNE.part_share else matched
    return with_unmatched_parts(align_directly(matched, scene, cell), matched, scene)


def with_cells(patch: Patch, cells: Cells, scene: Scene, possible: float) -> Patch:
    """The patch with those of the cells that are well matched and on its plane.

    possible : number of cells if all of the patch were matched.
    """
    x1, x2, seen = pair_rays(scene.camera1, scene.camera2, cells.uv1, cells.uv2)
    focal = scene.camera2.focal_px
    variance = axis_variance(cells.information, cells.uv1, scene, TUNE.flow_floor_px, NOISE_GREY) / cells.pixel_scale**2
    residual = np.abs(epipolar_residual(scene.R, scene.T, x1, x2)) * focal * cells.pixel_scale
    good = seen & (residual < ON_PLANE_PX)
    good &= (variance[:, 0] * cells.pixel_scale**2 < TUNE.max_sigma_px**2) & (cells.agreement > TUNE.fair_score)
    good[good] &= inverse_depth(scene.R, scene.T, x1[good], x2[good])[0] > 0
    share = float(good.sum() / possible)
    if good.sum() < LEAST_MATCHES or share < TUNE.least_share:
        return patch.unmatched("too few matches")
    w, leverage = inverse_depth(scene.R, scene.T, x1[good], x2[good])
    plane = robust_plane(x1[good], w, leverage, TUNE.flow_floor_px / focal / cells.pixel_scale)
    score = median(cells.agreement[good])
    sigma = _poor_match_rad(share, score)
    sigma += plane.tilt_sigma_rad(homogeneous(x1[good]) * leverage[:, None], w * leverage)
    keep = np.flatnonzero(good)[plane.inlier]
    matches = Matches(cells.uv1, cells.uv2, x1, x2).take(keep)
    across = epipolar_residual(scene.R, scene.T, matches.x1, matches.x2) * focal
    return replace(
        patch,
        matches=matches,
        weight=weight_of(variance[keep, 0] * overdispersion(across**2 / variance[keep, 1])),
        cell=cells.index[keep],
        origin="own",
        score=score,
        share=share,
        tilt_sigma_rad=sigma,
        left_out=1 - float(plane.inlier.mean()),
    )


def _poor_match_rad(share: float, score: float) -> float:
    """1-sigma of the tilt due to a small matched share or a low score, much larger where both occur."""
    scarce, faint = max(0.0, 1 - share / TUNE.scarce_share), max(0.0, 1 - score / TUNE.good_score)
    # few matches of a low score are what other ground gives: those that agree do so by chance
    unclear = min(max(0.0, (TUNE.clear_score - score) / (TUNE.clear_score - TUNE.good_score)), 1.0)
    chance = min(2 * scarce, 1.0) * unclear
    return float(np.hypot(BEND_RAD * (scarce + faint), TUNE.most_rad * chance))


# ---- the paper's matcher (section IV, experiment 1): Förstner corners, correlation, outlier removal ----


def match_window_corners(patch: Patch, scene: Scene) -> Patch:
    """The window with its corners matched by correlation, or with the matches of a plane borrowed, or with none."""
    first = _plane_from_overview(patch.window, scene)
    for normal in [first] if first is not None else _search_plane(patch.window, scene):
        matched = _correlated(patch, scene, normal)
        if matched.origin == "own":
            return matched
    return borrow(patch, scene)


def _correlated(patch: Patch, scene: Scene, normal: FloatArray) -> Patch:
    """The window with corners correlated with image 2 resampled under the plane `normal` (3,), or with a reason."""
    view = view_of(patch.window, scene, FINE_PX, border=True)
    mapping = view.mapping(normal)
    pulled = resample(scene.pyramid2, mapping, view.grid)
    pulled[~covered(mapping, scene.shape2)] = np.nan
    corners = foerstner_corners(view.grid.grey, 60, TUNE.corner_distance_px)  # 60 as in the paper
    if len(corners) < LEAST_MATCHES:
        return patch.unmatched("too few corners")
    displacement, correlation, ok = correlate_windows(view.grid.grey, pulled, corners)
    scale = view.grid.mean_scale
    uv1, uv2 = view.grid.full(corners), sample_map(mapping, corners + displacement)
    x1, x2, seen = pair_rays(scene.camera1, scene.camera2, uv1, uv2)
    ok &= seen & inside_window(uv1, patch.window)
    grid_focal = scene.camera2.focal_px * scale
    ok[ok] &= np.abs(epipolar_residual(scene.R, scene.T, x1[ok], x2[ok])) * grid_focal < ON_PLANE_PX
    if ok.sum() < LEAST_MATCHES:
        return patch.unmatched("too few corners matched")
    w, leverage = inverse_depth(scene.R, scene.T, x1[ok], x2[ok])
    kept = np.flatnonzero(ok)[robust_plane(x1[ok], w, leverage, LEAST_MATCH_PX / grid_focal).inlier]
    matched = replace(
        patch,
        matches=Matches(uv1, uv2, x1, x2).take(kept),
        weight=weight_of(np.full(len(kept), (LEAST_MATCH_PX / scale) ** 2)),
        cell=np.round(corners[kept, ::-1] / TUNE.corner_distance_px).astype(np.int64),
        origin="own",
        score=median(correlation[kept]),
        share=len(kept) / len(corners),
    )
    return with_unmatched_parts(matched, matched, scene)


# what `--features` names: the matcher of a window
WINDOW_MATCHERS: dict[str, Callable[[Patch, Scene], Patch]] = {"sift": match_window, "foerstner": match_window_corners}
# and how a window is matched under a plane
REMATCHERS: dict[str, Callable[[Patch, Scene, FloatArray], Patch]] = {
    "sift": _densely_matched,
    "foerstner": _correlated,
}
