"""Dense matches inside a window, guided by a first idea of its plane."""

from __future__ import annotations

import numpy as np

from slopecli.geometry.camera import rays_from_pixels
from slopecli.geometry.epipolar import homogeneous
from slopecli.geometry.motion import epipolar_residual, inverse_depth
from slopecli.planes.borrow import borrow
from slopecli.planes.evidence import Evidence
from slopecli.planes.polish import polish
from slopecli.planes.robust import robust_plane
from slopecli.planes.scene import FINE_PX, Scene, epipolar_axes, view_of
from slopecli.planes.window_match import WindowMatch, no_match, overdispersion
from slopecli.planes.windows import MIN_SIDE_PX, Window
from slopecli.types import FloatArray
from slopecli.vision.dense import Cells, dense_cells
from slopecli.vision.photometric import PlaneFit, align_plane, sweep_planes

COARSE_PX = 48  # planes are searched for at about this many pixels a side
EASY_SHARE = 0.25  # of the window covered by matches of the overview: then they give the first plane
PART_SHARE = 0.1  # of a window, when too little of it is in image 2 for its planes to be compared
GOOD_SCORE = 0.8  # photometric correlation at which no further plane is searched for
SWEEP_LIMIT = 60
INFORMED_DEG = 8.0  # 1-sigma of the normal from the pixels alone above which a window is too bare to answer by itself
PIXEL_CORRELATION = 3.0  # neighbouring pixels share noise and interpolation: standard errors grow by this
GREY_NOISE = 2.0  # grey levels; sensor noise of 8-bit images
FLOOR_PX = 0.03  # px of the grid: what interpolation and the flow's own quantisation leave
MAX_SIGMA_PX = 0.5  # px of the grid: cells matched worse than this are not used
# matched over less than this share, or agreeing less than this, a window may tilt otherwise than its matches say
SCARCE_SHARE, SCARCE_RAD = 0.3, np.radians(10.0)
FAINT_SCORE, FAINT_RAD = 0.8, np.radians(10.0)


def match_window(window: Window, scene: Scene) -> WindowMatch:
    """Dense matches of one window, or those of the plane around it, or none with the reason."""
    first = plane_from_overview(window, scene)
    if first is not None:
        match = _dense_match(window, scene, first)
        if match.origin == "own":
            return match
    for fit in search_plane(window, scene):
        match = _dense_match(window, scene, fit)
        if match.origin == "own":
            return match
    return _part(window, scene) or borrow(window, scene)


def _part(window: Window, scene: Scene) -> WindowMatch | None:
    """Matches of the part of the window that image 2 shows, where that is enough to speak for it."""
    normal = scene.evidence.plane_through(scene.evidence.near(window, 0.0))
    if normal is None:
        return None
    match = _dense_match(window, scene, normal)
    return match if match.share >= PART_SHARE else None


def plane_from_overview(window: Window, scene: Scene) -> FloatArray | None:
    """Scaled normal of the window's plane from the overview's matches in it, None where they cover too little."""
    inside = scene.evidence.near(window, 0.0)
    cell_area = 64.0 / float(np.prod(scene.pyramid1.overview_scale))
    if inside.sum() * cell_area < EASY_SHARE * window[2] * window[3]:
        return None
    return scene.evidence.plane_through(inside)


def search_plane(window: Window, scene: Scene) -> list[FloatArray]:
    """Planes worth a dense match, best first: those of the neighbourhood and the scene, else a sweep over depth."""
    view = view_of(window, scene, COARSE_PX, border=False)
    if min(view.grid.shape) < 8:
        return []
    candidates = [scene.evidence.plane_through(scene.evidence.near(window, grow)) for grow in (0.0, 0.5, 1.5)]
    fits = [align_plane(view, normal, 6) for normal in (*candidates, *scene.planes) if normal is not None]
    fits = [fit for fit in fits if np.isfinite(fit.score)]
    if max((fit.score for fit in fits), default=-1.0) < GOOD_SCORE and len(scene.evidence) >= 10:
        depths = _sweep_depths(scene.evidence, float(view.grid.scale.mean()))
        fits += [align_plane(view, fit.normal, 8) for fit in sweep_planes(view, depths)]
    fits.sort(key=lambda fit: -fit.score)
    best = [fit for fit in fits[:1] if fit.score > 0.3]
    if (
        not best and candidates[0] is not None
    ):  # too little of it is in image 2 to compare, but some of that was matched
        return [candidates[0]]
    return [fit.normal for fit in (_sharpen(window, scene, fit) for fit in best) if _informed(fit)]


def _sweep_depths(evidence: Evidence, scale: float) -> FloatArray:
    low, high = np.percentile(evidence.w, [1, 99])
    spread = high - low
    low, high = max(low - 0.3 * spread, 1e-4 * high), high + 0.3 * spread
    pixels = (high - low) * float(np.median(evidence.leverage)) * evidence.focal_px * scale
    return np.linspace(low, high, int(np.clip(pixels, 8, SWEEP_LIMIT)))


def _sharpen(window: Window, scene: Scene, fit: PlaneFit) -> PlaneFit:
    for side in (COARSE_PX * 2, FINE_PX):
        if max(window[2:]) > 0.6 * side:
            fit = align_plane(view_of(window, scene, side, border=False), fit.normal, 8)
    return fit


def _informed(fit: PlaneFit) -> bool:
    if not np.isfinite(fit.covariance).all():
        return False
    length = float(np.linalg.norm(fit.normal))
    unit = fit.normal / max(length, 1e-12)
    project = (np.eye(3) - np.outer(unit, unit)) / max(length, 1e-12)
    sigma = np.sqrt(max(np.linalg.eigvalsh(project @ fit.covariance @ project.T)[-1], 0.0))
    return bool(np.degrees(sigma) * PIXEL_CORRELATION < INFORMED_DEG)


def _dense_match(window: Window, scene: Scene, normal: FloatArray) -> WindowMatch:
    view = view_of(window, scene, FINE_PX, border=True)
    if min(view.grid.shape) < MIN_SIDE_PX:
        return no_match("too few pixels")
    side = max(window[2:]) * float(view.grid.scale.mean())
    cell = int(np.clip(side / 16, 4, 8))
    cells = dense_cells(view.grid, view.mapping(normal), scene.pyramid2, scene.shape2, cell, finest=0)
    x, y, w, h = window
    u, v = cells.uv1.T
    cells = cells.take((u >= x - 0.5) & (u < x + w - 0.5) & (v >= y - 0.5) & (v < y + h - 0.5))
    possible = max(1.0, w * h * float(np.prod(view.grid.scale)) / cell**2)
    return polish(_usable(cells, scene, possible), window, scene, cell)


def _usable(cells: Cells, scene: Scene, possible: float) -> WindowMatch:
    x1, x2 = rays_from_pixels(scene.camera1, cells.uv1), rays_from_pixels(scene.camera2, cells.uv2)
    focal = scene.camera2.focal_px
    variance = _variance_px(cells, scene)
    residual = np.abs(epipolar_residual(scene.R, scene.T, x1, x2)) * focal * cells.pixel_scale
    good = np.isfinite(x2).all(1) & np.isfinite(x1).all(1) & (residual < 1.0)
    good &= (variance[:, 0] * cells.pixel_scale**2 < MAX_SIGMA_PX**2) & (cells.agreement > 0.3)
    good[good] &= inverse_depth(scene.R, scene.T, x1[good], x2[good])[0] > 0
    share = float(good.sum() / possible)
    if good.sum() < 8 or share < 0.04:
        return no_match("too few matches")
    w, leverage = inverse_depth(scene.R, scene.T, x1[good], x2[good])
    plane = robust_plane(x1[good], w, leverage, 0.03 / focal / cells.pixel_scale)
    score = float(np.median(cells.agreement[good]))
    doubt = SCARCE_RAD * max(0.0, 1 - share / SCARCE_SHARE) + FAINT_RAD * max(0.0, 1 - score / FAINT_SCORE)
    doubt += plane.doubt_rad(homogeneous(x1[good]) * leverage[:, None], w * leverage)
    keep = np.flatnonzero(good)[plane.inlier]
    across = epipolar_residual(scene.R, scene.T, x1[keep], x2[keep]) * focal
    variance = variance[keep] * overdispersion(across**2 / variance[keep, 1])
    return WindowMatch(
        cells.uv1[keep], cells.uv2[keep], x1[keep], x2[keep], cells.index[keep], variance, "own", score, share,
        doubt_rad=doubt, left_out=1 - float(plane.inlier.mean()),
    )  # fmt: skip


def _variance_px(cells: Cells, scene: Scene) -> FloatArray:
    """(n, 2) noise variance along and across the epipolar line in full px^2, from each cell's structure tensor."""
    information = [np.einsum("ni,nij,nj->n", d, cells.information, d) for d in epipolar_axes(cells.uv1, scene)]
    grid = FLOOR_PX**2 + GREY_NOISE**2 / np.maximum(np.column_stack(information), 1e-6)
    return grid / cells.pixel_scale**2
