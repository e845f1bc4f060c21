"""Flat windows of faint texture, aligned on all their pixels at once."""

from __future__ import annotations

import numpy as np

from slopecli.geometry.camera import rays_from_pixels
from slopecli.geometry.epipolar import homogeneous
from slopecli.geometry.motion import inverse_depth
from slopecli.planes.scene import FINE_PX, Scene, epipolar_axes, view_of
from slopecli.planes.window_match import CHI2_MEDIAN, WindowMatch, overdispersion
from slopecli.planes.windows import Window
from slopecli.types import FloatArray
from slopecli.vision.photometric import PlaneFit, View, align_plane, cell_shifts
from slopecli.vision.warp import sample_map

CLEAR_SCORE, CLEAR_SHARE = 0.9, 0.6  # where flow sees this much this well, alignment adds nothing
PLANAR_RATIO = 5.0  # misfit to the plane over the predicted variance of the matches: beyond it there is relief
POLISH_FLOOR_PX = 0.02  # px of the grid
FAINTEST_PX = 1.0  # cells known worse than this add nothing
FAINT_SCORE, FAINT_PIXELS = 0.85, 100 * 100  # below both, other planes of the scene are tried as starts
SHIFT_VARIANCE = 4.0  # cells share noise with their neighbours through interpolation and normalisation


def polish(match: WindowMatch, window: Window, scene: Scene, cell: int) -> WindowMatch:
    """On a flat window, replace the flow's matches by steps of the pixels about the plane aligned on all of them.

    Flow looks no further than its patches and smooths over what it cannot see; the plane has three parameters, so
    alignment also uses texture too faint for any patch.
    """
    if match.origin != "own" or (match.score > CLEAR_SCORE and match.share > CLEAR_SHARE):
        return match
    view = view_of(window, scene, FINE_PX, border=False)
    scale = float(view.grid.scale.mean())
    w, leverage = inverse_depth(scene.R, scene.T, match.x1, match.x2)
    root = leverage / np.sqrt(match.variance_px[:, 0])
    rays = homogeneous(match.x1)
    normal = np.linalg.lstsq(rays * root[:, None], w * root, rcond=None)[0].astype(float)
    off = (w - rays @ normal) * leverage * scene.camera2.focal_px * scale
    if np.median(off**2 / (match.variance_px[:, 0] * scale**2)) > PLANAR_RATIO * CHI2_MEDIAN:
        return match
    fit = _align_best(view, normal, scene, match.score)
    if fit.score < max(0.5, match.score - 0.2):
        return match
    shifts = cell_shifts(view, fit.normal, cell)
    mapping = view.mapping(fit.normal)
    uv1 = view.grid.full(shifts.centre)
    uv2 = sample_map(mapping, shifts.centre + shifts.shift)
    along, across = epipolar_axes(uv1, scene)
    information = [np.einsum("ni,nij,nj->n", d, shifts.information, d) for d in (along, across)]
    variance = (POLISH_FLOOR_PX**2 + SHIFT_VARIANCE / np.maximum(np.column_stack(information), 1e-6)) / scale**2
    x1, x2 = rays_from_pixels(scene.camera1, uv1), rays_from_pixels(scene.camera2, uv2)
    good = np.isfinite(x1).all(1) & np.isfinite(x2).all(1) & (np.abs(shifts.shift).max(1) < 1.0)
    good &= variance[:, 0] * scale**2 < FAINTEST_PX**2
    if good.sum() < max(8, 0.3 * len(match.uv1)):
        return match
    w, leverage = inverse_depth(scene.R, scene.T, x1, x2)
    off = (w - homogeneous(x1) @ fit.normal) * leverage * scene.camera2.focal_px
    variance *= overdispersion(off[good] ** 2 / variance[good, 0])
    return WindowMatch(
        uv1[good], uv2[good], x1[good], x2[good], shifts.index[good], variance[good], "own", fit.score, match.share,
        doubt_rad=match.doubt_rad, left_out=match.left_out,
    )  # fmt: skip


def _align_best(view: View, normal: FloatArray, scene: Scene, score: float) -> PlaneFit:
    """Align from the flow's plane; where the window is small and faint, from the scene's planes as well."""
    fit = align_plane(view, normal, 10)
    if score > FAINT_SCORE or view.grid.grey.size > FAINT_PIXELS:
        return fit
    rivals = [align_plane(view, plane, 8) for plane in scene.planes]
    return max([fit, *rivals], key=lambda f: f.score)
