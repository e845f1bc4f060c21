"""Flat windows of faint texture, aligned on all their pixels at once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from slopecli.geometry.epipolar import homogeneous
from slopecli.geometry.motion import inverse_depth
from slopecli.geometry.statistics import CHI2_MEDIAN, median
from slopecli.look.matches import Matches, pair_rays
from slopecli.look.noise import SYSTEMATIC_PX
from slopecli.look.photometric import PlaneFit, View, align_plane, cell_shifts
from slopecli.look.scene import FINE_PX, Scene, axis_variance, view_of
from slopecli.look.warp import sample_map
from slopecli.patches.patch import REFERENCE_PX, Patch, overdispersion, weight_of
from slopecli.types import FloatArray

CLEAR_SCORE, CLEAR_SHARE = 0.9, 0.85  # where flow sees this much this well, alignment adds nothing
PLANAR_RATIO = 5.0  # misfit to the plane over the predicted variance of the matches: beyond it there is relief
MIN_SCORE, MAX_LOSS = 0.5, 0.2  # correlation an alignment must reach, and may lose against the flow's
MIN_CELLS, MIN_KEPT = 8, 0.3  # polished cells that can stand for the flow's matches, and their number over those
MAX_SHIFT_PX = 1.0  # px of the grid: a cell that wants to move further was not aligned
FAINTEST_PX = 1.0  # cells known worse than this add nothing
FAINT_SCORE, FAINT_PIXELS = 0.85, 100 * 100  # below both, other planes of the scene are tried as starts
SHIFT_SIGMAS = 2.0  # cells share noise with their neighbours through interpolation and normalisation


def polish(patch: Patch, scene: Scene, cell: int) -> Patch:
    """On a flat window, replace the flow's matches by steps of the pixels about the plane aligned on all of them.

    Flow looks no further than its patches and smooths over what it cannot see; the plane has three parameters, so
    alignment also uses texture too faint for any patch.
    """
    if patch.origin != "own" or (patch.score > CLEAR_SCORE and patch.share > CLEAR_SHARE):
        return patch
    normal = _plane_of(patch, scene)
    off = _misfit_px(normal, patch.matches.x1, patch.matches.x2, scene)
    if median(off**2 * patch.weight) / REFERENCE_PX**2 > PLANAR_RATIO * CHI2_MEDIAN:
        return patch
    view = view_of(patch.window, scene, FINE_PX, border=False)
    fit = _align_best(view, normal, scene, patch.score)
    if fit.score < max(MIN_SCORE, patch.score - MAX_LOSS):
        return patch
    return _shifted_cells(patch, view, fit, scene, cell) or patch


def _plane_of(patch: Patch, scene: Scene) -> FloatArray:
    """Scaled normal (3,) of the plane through the matches, each by its variance."""
    w, leverage = inverse_depth(scene.R, scene.T, patch.matches.x1, patch.matches.x2)
    root = leverage * np.sqrt(patch.weight)
    return np.asarray(np.linalg.lstsq(homogeneous(patch.matches.x1) * root[:, None], w * root, rcond=None)[0])


def _misfit_px(normal: FloatArray, x1: FloatArray, x2: FloatArray, scene: Scene) -> FloatArray:
    """(n,) signed distance in image 2 of matches from where the plane puts them, full px."""
    w, leverage = inverse_depth(scene.R, scene.T, x1, x2)
    return (w - homogeneous(x1) @ normal) * leverage * scene.camera2.focal_px


def _shifted_cells(patch: Patch, view: View, fit: PlaneFit, scene: Scene, cell: int) -> Patch | None:
    """The aligned plane's cells, each where its own pixels want it; None where too few of them know."""
    shifts = cell_shifts(view, fit.normal, cell)
    uv1 = view.grid.full(shifts.centre)
    uv2 = sample_map(view.mapping(fit.normal), shifts.centre + shifts.shift)
    variance = axis_variance(shifts.information, uv1, scene, SYSTEMATIC_PX, SHIFT_SIGMAS)
    x1, x2, seen = pair_rays(scene.camera1, scene.camera2, uv1, uv2)
    good = seen & (np.abs(shifts.shift).max(1) < MAX_SHIFT_PX) & (variance[:, 0] < FAINTEST_PX**2)
    if good.sum() < max(MIN_CELLS, MIN_KEPT * len(patch.matches)):
        return None
    matches, variance = Matches(uv1, uv2, x1, x2).take(good), variance[good, 0] / view.grid.mean_scale**2
    variance *= overdispersion(_misfit_px(fit.normal, matches.x1, matches.x2, scene) ** 2 / variance)
    return replace(patch, matches=matches, weight=weight_of(variance), cell=shifts.index[good], score=fit.score)


def _align_best(view: View, normal: FloatArray, scene: Scene, score: float) -> PlaneFit:
    """Align from the flow's plane; where the window is small and faint, from the scene's planes as well."""
    fit = align_plane(view, normal, 10)
    if score > FAINT_SCORE or view.grid.grey.size > FAINT_PIXELS:
        return fit
    rivals = [align_plane(view, plane, 8) for plane in scene.planes]
    return max([fit, *rivals], key=lambda f: f.score)
