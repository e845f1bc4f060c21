"""The paper's own window matches (section IV, experiment 1): Förstner corners, correlation, outliers removed."""

from __future__ import annotations

import numpy as np

from slopecli.geometry.motion import epipolar_residual, inverse_depth
from slopecli.geometry.plane_fit import robust_plane
from slopecli.geometry.statistics import median
from slopecli.look.foerstner import correlate_windows, foerstner_corners
from slopecli.look.scene import FINE_PX, Scene, view_of
from slopecli.look.sparse import pair_rays
from slopecli.look.warp import covered, resample, sample_map
from slopecli.patches.match import WindowMatch, no_match
from slopecli.patches.windows.borrowed import borrow
from slopecli.patches.windows.matching import plane_from_overview, search_plane
from slopecli.patches.windows.unmatched_parts import with_doubt_of_gaps
from slopecli.types import FloatArray
from slopecli.windows import Window, inside_window

N_CORNERS = 60  # per window, as in the paper
CORNER_DISTANCE_PX = 5.0  # between corners, px of the working grid
MIN_CORNERS = 8  # through fewer a plane is chance
SIGMA_PX = 0.05  # of a correlated corner, px of the working grid
EPIPOLAR_PX = 1.0  # px of the working grid a corner may miss its epipolar line by


def match_window_corners(window: Window, scene: Scene) -> WindowMatch:
    """Corners of the window correlated with image 2 pulled onto it, or the matches of the plane around it."""
    first = plane_from_overview(window, scene)
    for normal in [first] if first is not None else search_plane(window, scene):
        match = _correlate(window, scene, normal)
        if match.origin == "own":
            return match
    return borrow(window, scene)


def _correlate(window: Window, scene: Scene, normal: FloatArray) -> WindowMatch:
    view = view_of(window, scene, FINE_PX, border=True)
    mapping = view.mapping(normal)
    pulled = resample(scene.pyramid2, mapping, view.grid)
    pulled[~covered(mapping, scene.shape2)] = np.nan
    corners = foerstner_corners(view.grid.grey, N_CORNERS, CORNER_DISTANCE_PX)
    if len(corners) < MIN_CORNERS:
        return no_match("too few corners")
    displacement, correlation, ok = correlate_windows(view.grid.grey, pulled, corners)
    scale = view.grid.mean_scale
    uv1, uv2 = view.grid.full(corners), sample_map(mapping, corners + displacement)
    x1, x2, seen = pair_rays(scene.camera1, scene.camera2, uv1, uv2)
    ok &= seen & inside_window(uv1, window)
    ok[ok] &= np.abs(epipolar_residual(scene.R, scene.T, x1[ok], x2[ok])) * scene.camera2.focal_px * scale < EPIPOLAR_PX
    if ok.sum() < MIN_CORNERS:
        return no_match("too few corners matched")
    w, leverage = inverse_depth(scene.R, scene.T, x1[ok], x2[ok])
    kept = np.flatnonzero(ok)[robust_plane(x1[ok], w, leverage, SIGMA_PX / scale / scene.camera2.focal_px).inlier]
    match = WindowMatch(
        uv1=uv1[kept],
        uv2=uv2[kept],
        x1=x1[kept],
        x2=x2[kept],
        index=np.round(corners[kept, ::-1] / CORNER_DISTANCE_PX).astype(np.int64),
        variance_px=np.full((len(kept), 2), (SIGMA_PX / scale) ** 2),
        origin="own",
        score=median(correlation[kept]),
        share=len(kept) / len(corners),
    )
    return with_doubt_of_gaps(match, match, window, scene)
