"""Matches of windows as in the paper (section IV, experiment 1): Förstner corners, correlation, outlier removal."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from slopecli.geometry.motion import epipolar_residual, inverse_depth
from slopecli.geometry.plane_fit import robust_plane
from slopecli.geometry.statistics import median
from slopecli.look.foerstner import correlate_windows, foerstner_corners
from slopecli.look.matches import Matches, pair_rays
from slopecli.look.noise import LEAST_MATCH_PX
from slopecli.look.scene import FINE_PX, Scene, view_of
from slopecli.look.warp import covered, resample, sample_map
from slopecli.patches.patch import Patch, weight_of
from slopecli.patches.windows.borrowed import borrow
from slopecli.patches.windows.matching import plane_from_overview, search_plane
from slopecli.patches.windows.tunables import TUNE
from slopecli.patches.windows.unmatched_parts import with_unmatched_parts
from slopecli.types import FloatArray
from slopecli.windows import inside_window


def match_window_corners(patch: Patch, scene: Scene) -> Patch:
    """Corners of the window correlated with image 2 pulled onto it, or the matches of the plane around it."""
    first = plane_from_overview(patch.window, scene)
    for normal in [first] if first is not None else search_plane(patch.window, scene):
        matched = _correlated(patch, scene, normal)
        if matched.origin == "own":
            return matched
    return borrow(patch, scene)


def _correlated(patch: Patch, scene: Scene, normal: FloatArray) -> Patch:
    window = patch.window
    view = view_of(window, scene, FINE_PX, border=True)
    mapping = view.mapping(normal)
    pulled = resample(scene.pyramid2, mapping, view.grid)
    pulled[~covered(mapping, scene.shape2)] = np.nan
    corners = foerstner_corners(view.grid.grey, 60, TUNE.corner_distance_px)  # 60 as in the paper
    if len(corners) < TUNE.least_matches:
        return patch.unmatched("too few corners")
    displacement, correlation, ok = correlate_windows(view.grid.grey, pulled, corners)
    scale = view.grid.mean_scale
    uv1, uv2 = view.grid.full(corners), sample_map(mapping, corners + displacement)
    x1, x2, seen = pair_rays(scene.camera1, scene.camera2, uv1, uv2)
    ok &= seen & inside_window(uv1, window)
    ok[ok] &= (
        np.abs(epipolar_residual(scene.R, scene.T, x1[ok], x2[ok])) * scene.camera2.focal_px * scale < TUNE.mismatch_px
    )
    if ok.sum() < TUNE.least_matches:
        return patch.unmatched("too few corners matched")
    w, leverage = inverse_depth(scene.R, scene.T, x1[ok], x2[ok])
    kept = np.flatnonzero(ok)[robust_plane(x1[ok], w, leverage, LEAST_MATCH_PX / scale / scene.camera2.focal_px).inlier]
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
