"""Flat windows of faint texture, aligned on all their pixels at once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from slopecli.geometry.epipolar import homogeneous
from slopecli.geometry.motion import inverse_depth
from slopecli.geometry.statistics import median
from slopecli.look.noise import SYSTEMATIC_PX
from slopecli.look.photometric import PlaneFit, View, align_plane, cell_shifts
from slopecli.look.scene import FINE_PX, Scene, axis_variance, view_of
from slopecli.look.sparse import pair_rays
from slopecli.look.warp import sample_map
from slopecli.patches.match import CHI2_MEDIAN, WindowMatch, overdispersion
from slopecli.types import FloatArray
from slopecli.windows import Window

CLEAR_SCORE, CLEAR_SHARE = 0.9, 0.85  # where flow sees this much this well, alignment adds nothing
PLANAR_RATIO = 5.0  # misfit to the plane over the predicted variance of the matches: beyond it there is relief
MIN_SCORE, MAX_LOSS = 0.5, 0.2  # correlation an alignment must reach, and may lose against the flow's
MIN_CELLS, MIN_KEPT = 8, 0.3  # polished cells that can stand for the flow's matches, and their number over those
MAX_SHIFT_PX = 1.0  # px of the grid: a cell that wants to move further was not aligned
FAINTEST_PX = 1.0  # cells known worse than this add nothing
FAINT_SCORE, FAINT_PIXELS = 0.85, 100 * 100  # below both, other planes of the scene are tried as starts
SHIFT_SIGMAS = 2.0  # cells share noise with their neighbours through interpolation and normalisation


def polish(match: WindowMatch, window: Window, scene: Scene, cell: int) -> WindowMatch:
    """On a flat window, replace the flow's matches by steps of the pixels about the plane aligned on all of them.

    Flow looks no further than its patches and smooths over what it cannot see; the plane has three parameters, so
    alignment also uses texture too faint for any patch.
    """
    if match.origin != "own" or (match.score > CLEAR_SCORE and match.share > CLEAR_SHARE):
        return match
    normal = _plane_of(match, scene)
    off = _misfit_px(normal, match.x1, match.x2, scene)
    if median(off**2 / match.variance_px[:, 0]) > PLANAR_RATIO * CHI2_MEDIAN:
        return match
    view = view_of(window, scene, FINE_PX, border=False)
    fit = _align_best(view, normal, scene, match.score)
    if fit.score < max(MIN_SCORE, match.score - MAX_LOSS):
        return match
    return _shifted_cells(match, view, fit, scene, cell) or match


def _plane_of(match: WindowMatch, scene: Scene) -> FloatArray:
    """Scaled normal (3,) of the plane through the matches, each by its variance."""
    w, leverage = inverse_depth(scene.R, scene.T, match.x1, match.x2)
    root = leverage / np.sqrt(match.variance_px[:, 0])
    return np.asarray(np.linalg.lstsq(homogeneous(match.x1) * root[:, None], w * root, rcond=None)[0])


def _misfit_px(normal: FloatArray, x1: FloatArray, x2: FloatArray, scene: Scene) -> FloatArray:
    """(n,) signed distance in image 2 of matches from where the plane puts them, full px."""
    w, leverage = inverse_depth(scene.R, scene.T, x1, x2)
    return (w - homogeneous(x1) @ normal) * leverage * scene.camera2.focal_px


def _shifted_cells(match: WindowMatch, view: View, fit: PlaneFit, scene: Scene, cell: int) -> WindowMatch | None:
    """The aligned plane's cells, each where its own pixels want it; None where too few of them know."""
    shifts = cell_shifts(view, fit.normal, cell)
    uv1 = view.grid.full(shifts.centre)
    uv2 = sample_map(view.mapping(fit.normal), shifts.centre + shifts.shift)
    variance = axis_variance(shifts.information, uv1, scene, SYSTEMATIC_PX, SHIFT_SIGMAS)
    x1, x2, seen = pair_rays(scene.camera1, scene.camera2, uv1, uv2)
    good = seen & (np.abs(shifts.shift).max(1) < MAX_SHIFT_PX) & (variance[:, 0] < FAINTEST_PX**2)
    if good.sum() < max(MIN_CELLS, MIN_KEPT * len(match.uv1)):
        return None
    uv1, uv2, x1, x2, variance = uv1[good], uv2[good], x1[good], x2[good], variance[good] / view.grid.mean_scale**2
    variance *= overdispersion(_misfit_px(fit.normal, x1, x2, scene) ** 2 / variance[:, 0])
    return replace(
        match, uv1=uv1, uv2=uv2, x1=x1, x2=x2, index=shifts.index[good], variance_px=variance, score=fit.score
    )


def _align_best(view: View, normal: FloatArray, scene: Scene, score: float) -> PlaneFit:
    """Align from the flow's plane; where the window is small and faint, from the scene's planes as well."""
    fit = align_plane(view, normal, 10)
    if score > FAINT_SCORE or view.grid.grey.size > FAINT_PIXELS:
        return fit
    rivals = [align_plane(view, plane, 8) for plane in scene.planes]
    return max([fit, *rivals], key=lambda f: f.score)
