"""Planar windows of faint texture, aligned with image 2 on all their pixels at once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from slopecli.geometry.epipolar import homogeneous
from slopecli.geometry.motion import inverse_depth
from slopecli.geometry.statistics import CHI2, median
from slopecli.look.matches import LEAST_MATCHES, ON_PLANE_PX, Matches, pair_rays
from slopecli.look.noise import LEAST_MATCH_PX, SYSTEMATIC_PX
from slopecli.look.photometric import PlaneFit, View, align_plane, cell_shifts
from slopecli.look.scene import FINE_PX, Scene, axis_variance, epipolar_axes, view_of
from slopecli.look.warp import sample_map
from slopecli.patches.patch import Patch, overdispersion, weight_of
from slopecli.patches.windows.tunables import TUNE
from slopecli.types import FloatArray


def align_directly(patch: Patch, scene: Scene, cell: int) -> Patch:
    """Replace the matches of a planar window by those of cells measured around a plane aligned on all pixels.

    Flow matches small patches and smooths between them; the plane has only three parameters, so its alignment also
    uses texture that is too faint for a patch. Windows matched clearly and nearly all over, by which alignment adds
    nothing, and those with relief stay as they are.

    cell : side of a cell, px of the window's working grid.
    """
    if patch.origin != "own" or (patch.score > 0.9 and patch.share > 0.85):
        return patch
    x1, x2 = patch.matches.x1, patch.matches.x2
    w, leverage = inverse_depth(scene.R, scene.T, x1, x2)
    root = leverage * np.sqrt(patch.weight)
    normal = np.asarray(np.linalg.lstsq(homogeneous(x1) * root[:, None], w * root, rcond=None)[0])
    off = _misfit_px(normal, x1, x2, scene)
    if median(off**2 * patch.weight) / LEAST_MATCH_PX**2 > 5 * CHI2[1, 0.5]:  # 5 times the variance of noise: relief
        return patch
    view = view_of(patch.window, scene, FINE_PX, border=False)
    fit = _align_best(view, normal, scene, patch.score)
    # all pixels correlate less than the matched ones alone; by more than 0.2, some are not on the plane
    if fit.score < max(TUNE.same_ground_score, patch.score - 0.2):
        return patch
    return _shifted_cells(patch, view, fit, scene, cell) or patch


def _misfit_px(normal: FloatArray, x1: FloatArray, x2: FloatArray, scene: Scene) -> FloatArray:
    """(n,) signed distance in image 2 of matches from where the plane puts them, full px."""
    w, leverage = inverse_depth(scene.R, scene.T, x1, x2)
    return (w - homogeneous(x1) @ normal) * leverage * scene.camera2.focal_px


def _align_best(view: View, normal: FloatArray, scene: Scene, score: float) -> PlaneFit:
    """The plane aligned from that of the flow; for a small and faint window also from the scene's planes, the best."""
    fit = align_plane(view, normal, 10)  # steps of Gauss-Newton, of which a good start needs fewer
    # clear flow is a good start; in more than 100 x 100 px, even faint texture is enough for one
    if score > 0.85 or view.grid.grey.size > 100 * 100:
        return fit
    return max([fit, *(align_plane(view, plane, 8) for plane in scene.planes)], key=lambda f: f.score)


def _shifted_cells(patch: Patch, view: View, fit: PlaneFit, scene: Scene, cell: int) -> Patch | None:
    """The window with the aligned plane's cells, each shifted as its pixels require; None if too few are certain."""
    shifts = cell_shifts(view, fit.normal, cell)
    uv1 = view.grid.full(shifts.centre)
    # depth moves a cell along its epipolar line only
    axes = np.array(epipolar_axes(uv1, scene))
    shift = np.array([shifts.along(axis) for axis in axes])
    uv2 = sample_map(view.mapping(fit.normal), shifts.centre + (shift[:, :, None] * axes).sum(axis=0))
    # twice the noise of grey values, as interpolation gives neighbouring cells some of it in common
    variance = axis_variance(shifts.information, uv1, scene, SYSTEMATIC_PX, 2.0)
    x1, x2, seen = pair_rays(scene.camera1, scene.camera2, uv1, uv2)
    good = seen & (np.abs(shift).max(0) < ON_PLANE_PX) & (variance[:, 0] < ON_PLANE_PX**2)
    if good.sum() < max(LEAST_MATCHES, 0.3 * len(patch.matches)):  # fewer than 30 % of those of flow: it is better
        return None
    matches, variance = Matches(uv1, uv2, x1, x2).take(good), variance[good, 0] / view.grid.mean_scale**2
    variance *= overdispersion(_misfit_px(fit.normal, matches.x1, matches.x2, scene) ** 2 / variance)
    return replace(patch, matches=matches, weight=weight_of(variance), cell=shifts.index[good], score=fit.score)
