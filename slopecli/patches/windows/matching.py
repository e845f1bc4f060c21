"""Dense matches inside a window, guided by a first idea of its plane."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from slopecli.geometry.epipolar import homogeneous
from slopecli.geometry.motion import epipolar_residual, inverse_depth
from slopecli.geometry.plane_fit import robust_plane
from slopecli.geometry.statistics import median
from slopecli.look.dense import Cells, dense_cells
from slopecli.look.evidence import Evidence
from slopecli.look.matches import Matches, pair_rays
from slopecli.look.noise import NOISE_GREY
from slopecli.look.overview import CELL
from slopecli.look.photometric import PlaneFit, align_plane, plane_map, sweep_planes
from slopecli.look.scene import FINE_PX, Scene, axis_variance, view_of, window_grid
from slopecli.patches.patch import Patch, overdispersion, weight_of
from slopecli.patches.windows.borrowed import borrow
from slopecli.patches.windows.direct_alignment import polish
from slopecli.patches.windows.unmatched_parts import with_unmatched_parts
from slopecli.types import FloatArray
from slopecli.windows import MIN_SIDE_PX, Window, inside_window

# rounds of smoothing of the flow in a window, all but still when pulled through its plane: more would flatten its
# relief, but what is faint needs them
SMOOTHINGS, FAINT_SMOOTHINGS = 1, 5
COARSE_PX = 48  # planes are searched for at about this many pixels a side
EASY_SHARE = 0.25  # of the window covered by matches of the overview: then they give the first plane
PART_SHARE = 0.1  # of a window, when too little of it is in image 2 for its planes to be compared
GOOD_SCORE = 0.8  # photometric correlation at which no further plane is searched for
FAIR_SCORE = 0.3  # photometric correlation below which what is compared is not the same ground
REACHES = (0.0, 0.5, 1.5)  # sides of the window around it whose matches give planes to try
MIN_EVIDENCE = 10  # matches that tell the range of depths to sweep
SWEEP_LIMIT = 60  # depths: at a px apart, the costliest search
INFORMED_DEG = 8.0  # 1-sigma of the normal from the pixels alone above which a window is too bare to answer by itself
PIXEL_CORRELATION = 3.0  # neighbouring pixels share noise and interpolation: standard errors grow by this
FLOOR_PX = 0.03  # px of the grid: what interpolation and the flow's own quantisation leave
MAX_SIGMA_PX = 0.5  # px of the grid: cells matched worse than this are not used
EPIPOLAR_PX = 1.0  # px of the grid a cell may miss its epipolar line by
MIN_CELLS, MIN_SHARE = 8, 0.04  # of the window, without which its plane is chance
# matched over less than this share, or agreeing less than this, a window may tilt otherwise than its matches say
SCARCE_SHARE, SCARCE_RAD = 0.3, np.radians(10.0)
FAINT_SCORE, FAINT_RAD = 0.8, np.radians(10.0)
# both at once is how ground that is not the same matches: what little agrees has been picked, and its plane is a guess
CHANCE_SCORE, CLEAR_SCORE, GUESS_RAD = 0.8, 0.95, np.radians(30.0)


def match_window(patch: Patch, scene: Scene) -> Patch:
    """The window with its dense matches, or with those of the plane around it, or with none and the reason."""
    tried: list[FloatArray] = []
    for normal in _first_ideas(patch.window, scene):
        matched = _densely_matched(patch, scene, normal)
        if matched.origin == "own":
            return matched
        tried.append(normal)
    return _part(patch, scene, tried) or borrow(patch, scene)


def _first_ideas(window: Window, scene: Scene) -> Iterator[FloatArray]:
    """Scaled normals worth a dense match, the cheapest first; the search is made only if that one is not enough."""
    first = plane_from_overview(window, scene)
    if first is not None:
        yield first
    yield from search_plane(window, scene)


def _part(patch: Patch, scene: Scene, tried: list[FloatArray]) -> Patch | None:
    """Matches of the part of the window that image 2 shows, where that is enough to speak for it, else None."""
    normal = scene.evidence.plane_through(scene.evidence.near(patch.window, 0.0))
    if normal is None or any(np.array_equal(normal, earlier) for earlier in tried):
        return None
    matched = _densely_matched(patch, scene, normal)
    return matched if matched.share >= PART_SHARE else None


def plane_from_overview(window: Window, scene: Scene) -> FloatArray | None:
    """Scaled normal of the window's plane from the overview's matches in it, None where they cover too little."""
    inside = scene.evidence.near(window, 0.0)
    cell_area = CELL**2 / float(np.prod(scene.pyramid1.overview_scale))
    if inside.sum() * cell_area < EASY_SHARE * window[2] * window[3]:
        return None
    return scene.evidence.plane_through(inside)


def search_plane(window: Window, scene: Scene) -> list[FloatArray]:
    """The plane the window's pixels fit best, of those of the neighbourhood and the scene, else of a sweep over depth.

    Empty where no plane fits, or where the pixels leave the plane open.
    """
    view = view_of(window, scene, COARSE_PX, border=False)
    if min(view.grid.shape) < 8:
        return []
    candidates = [scene.evidence.plane_through(scene.evidence.near(window, grow)) for grow in REACHES]
    fits = [align_plane(view, normal, 6) for normal in (*candidates, *scene.planes) if normal is not None]
    fits = [fit for fit in fits if np.isfinite(fit.score)]
    if max((fit.score for fit in fits), default=-1.0) < GOOD_SCORE and len(scene.evidence) >= MIN_EVIDENCE:
        depths = _sweep_depths(scene.evidence, view.grid.mean_scale)
        fits += [align_plane(view, fit.normal, 8) for fit in sweep_planes(view, depths)]
    best = max(fits, key=lambda fit: fit.score, default=None)
    if best is None or best.score <= FAIR_SCORE:
        # too little of it is in image 2 to compare, but some of that may have been matched
        return [candidates[0]] if candidates[0] is not None else []
    best = _sharpen(window, scene, best)
    return [best.normal] if _informed(best) else []


def _sweep_depths(evidence: Evidence, scale: float) -> FloatArray:
    """Inverse depths (n,) over and somewhat beyond those of the scene, about a px of the grid apart."""
    low, high = np.percentile(evidence.w, [1, 99])
    spread = high - low
    low, high = max(low - 0.3 * spread, 1e-4 * high), high + 0.3 * spread
    pixels = (high - low) * median(evidence.leverage) * evidence.focal_px * scale
    return np.linspace(low, high, int(np.clip(pixels, 8, SWEEP_LIMIT)))


def _sharpen(window: Window, scene: Scene, fit: PlaneFit) -> PlaneFit:
    """The plane aligned at finer and finer resolution, as far as the window has it."""
    for side in (COARSE_PX * 2, FINE_PX):
        if max(window[2:]) > 0.6 * side:
            fit = align_plane(view_of(window, scene, side, border=False), fit.normal, 8)
    return fit


def _informed(fit: PlaneFit) -> bool:
    """Whether the pixels decide where the plane faces."""
    if not np.isfinite(fit.covariance).all():
        return False
    length = float(np.linalg.norm(fit.normal))
    unit = fit.normal / max(length, 1e-12)
    project = (np.eye(3) - np.outer(unit, unit)) / max(length, 1e-12)
    sigma = np.sqrt(max(np.linalg.eigvalsh(project @ fit.covariance @ project.T)[-1], 0.0))
    return bool(np.degrees(sigma) * PIXEL_CORRELATION < INFORMED_DEG)


def _densely_matched(patch: Patch, scene: Scene, normal: FloatArray) -> Patch:
    """The window with the matches of dense flow between it and image 2 pulled onto it by a plane."""
    window = patch.window
    grid = window_grid(window, scene, FINE_PX, border=True)
    if min(grid.shape) < MIN_SIDE_PX:
        return patch.unmatched("too few pixels")
    side = max(window[2:]) * grid.mean_scale
    cell = int(np.clip(side / 16, 4, 8))
    mapping = plane_map(grid, scene.rays1, scene.pixels2, scene.R, scene.T, normal)
    possible = max(1.0, window[2] * window[3] * float(np.prod(grid.scale)) / cell**2)

    def flow_matched(smoothings: int) -> Patch:
        cells = dense_cells(grid, mapping, scene.pyramid2, scene.shape2, cell, finest=0, smoothings=smoothings)
        return with_cells(patch, cells.take(inside_window(cells.uv1, window)), scene, possible)

    matched = flow_matched(SMOOTHINGS)
    if matched.score < CLEAR_SCORE:
        smooth = flow_matched(FAINT_SMOOTHINGS)
        # a smooth flow reaches from the border of bare ground into it, where it is no match
        matched = smooth if matched.origin == "own" or smooth.share >= PART_SHARE else matched
    return with_unmatched_parts(polish(matched, scene, cell), matched, scene)


def with_cells(patch: Patch, cells: Cells, scene: Scene, possible: float) -> Patch:
    """The patch with those of the cells that are well matched and on its plane; `possible`: how many it could hold."""
    x1, x2, seen = pair_rays(scene.camera1, scene.camera2, cells.uv1, cells.uv2)
    focal = scene.camera2.focal_px
    variance = axis_variance(cells.information, cells.uv1, scene, FLOOR_PX, NOISE_GREY) / cells.pixel_scale**2
    residual = np.abs(epipolar_residual(scene.R, scene.T, x1, x2)) * focal * cells.pixel_scale
    good = seen & (residual < EPIPOLAR_PX)
    good &= (variance[:, 0] * cells.pixel_scale**2 < MAX_SIGMA_PX**2) & (cells.agreement > FAIR_SCORE)
    good[good] &= inverse_depth(scene.R, scene.T, x1[good], x2[good])[0] > 0
    share = float(good.sum() / possible)
    if good.sum() < MIN_CELLS or share < MIN_SHARE:
        return patch.unmatched("too few matches")
    w, leverage = inverse_depth(scene.R, scene.T, x1[good], x2[good])
    plane = robust_plane(x1[good], w, leverage, FLOOR_PX / focal / cells.pixel_scale)
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
    """1-sigma of the tilt of a patch of which little is matched, or matched poorly, or, far worse, both."""
    scarce, faint = max(0.0, 1 - share / SCARCE_SHARE), max(0.0, 1 - score / FAINT_SCORE)
    guess = min(2 * scarce, 1.0) * min(max(0.0, (CLEAR_SCORE - score) / (CLEAR_SCORE - CHANCE_SCORE)), 1.0)
    return float(np.hypot(SCARCE_RAD * scarce + FAINT_RAD * faint, GUESS_RAD * guess))
