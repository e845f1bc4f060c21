"""The plane around a window inside which nothing can be matched."""

from __future__ import annotations

import numpy as np

from slopecli.geometry.camera import pixels_from_rays
from slopecli.geometry.metrics import normal_angle
from slopecli.planes.scene import Scene, view_of
from slopecli.planes.window_match import WindowMatch, no_match
from slopecli.planes.windows import Window
from slopecli.types import FloatArray, IntArray
from slopecli.vision.sampling import thin
from slopecli.vision.warp import covered

REACHES = (0.75, 1.5, 3.0)  # how far to look, sides of the window
MIN_NEAR, MIN_CHOSEN, MIN_SUPPORT = 20, 12, 2.0  # matches, matches on the plane, votes
MOST = 300  # matches to borrow: more are no more certain of what they do not see
ON_PLANE_PX = 1.0
SAME_GREY = 30.0  # grey levels
SIGMA_PX = 0.3  # of matches of the overview, generously
SKETCH_PX, SEEN_SHARE = 24, 0.3
LONELY_RAD = np.radians(60.0)  # doubt about a borrowed plane that nothing around the window supports


def borrow(window: Window, scene: Scene) -> WindowMatch:
    """Matches around the window that lie on the plane it most likely belongs to: near it and of its brightness."""
    evidence = scene.evidence
    for grow in REACHES:
        near = evidence.near(window, grow)
        if near.sum() < MIN_NEAR:
            continue
        vote = near * _kinship(window, scene, grow)
        planes = [p for p in (evidence.plane_through(near), *scene.planes) if p is not None]
        support = [float((vote * (evidence.misfit_px(p) < ON_PLANE_PX)).sum()) for p in planes]
        best = int(np.argmax(support))
        chosen = np.flatnonzero(near & (evidence.misfit_px(planes[best]) < ON_PLANE_PX))
        if len(chosen) < MIN_CHOSEN or support[best] < MIN_SUPPORT:
            continue
        doubt = max(_disagreement(planes, support, best), LONELY_RAD * (1 - support[best] / float(vote.sum())))
        return _as_match(thin(evidence.uv1, chosen, MOST), window, scene, planes[best], doubt)
    code, reason = _why_not(window, scene, None)
    return no_match(f"{reason}, and nothing around the window can be matched", code)


def _kinship(window: Window, scene: Scene, grow: float) -> FloatArray:
    """(n,) how likely each match around belongs with the window: close to it and as bright."""
    x, y, w, h = window
    grey = scene.pyramid1.at(1.0).grey[y : y + h, x : x + w]
    reach = max(w, h) * (0.5 + grow)
    offset = np.linalg.norm(scene.evidence.uv1 - np.array([x + w / 2, y + h / 2]), axis=1) / reach
    contrast = (scene.evidence.grey - float(np.median(grey))) / SAME_GREY
    return np.asarray(np.exp(-(offset**2)) * np.exp(-(contrast**2)))


def _as_match(chosen: IntArray, window: Window, scene: Scene, plane: FloatArray, doubt: float) -> WindowMatch:
    evidence = scene.evidence
    spacing = max(max(window[2:]) / 16, 1.0)
    index = np.round(evidence.uv1[chosen, ::-1] / spacing).astype(np.int64)
    x2 = evidence.x2[chosen]
    variance = np.full((len(chosen), 2), SIGMA_PX**2)
    code, reason = _why_not(window, scene, plane)
    return WindowMatch(
        uv1=evidence.uv1[chosen],
        uv2=pixels_from_rays(scene.camera2, x2),
        x1=evidence.x1[chosen],
        x2=x2,
        index=index,
        variance_px=variance,
        origin="borrowed",
        score=0.0,
        share=0.0,
        reason=f"{reason}: this is the plane around it",
        code=code,
        doubt_rad=doubt,
    )


def _why_not(window: Window, scene: Scene, plane: FloatArray | None) -> tuple[str, str]:
    """Diagnostic code and words for why the window itself has no matches."""
    if plane is not None:
        mapping = view_of(window, scene, SKETCH_PX, border=False).mapping(plane)
        if covered(mapping, scene.shape2).mean() < SEEN_SHARE:
            return "no-overlap", "not in image 2"
    return "low-texture", "too little texture inside"


def _disagreement(planes: list[FloatArray], support: list[float], best: int) -> float:
    """RMS angle between the chosen plane and the others, each weighted by the support it has."""
    share = np.array(support) / max(sum(support), 1e-9)
    angles = np.array([float(normal_angle(plane, planes[best])) for plane in planes])
    return float(np.sqrt(share @ np.minimum(angles, np.pi - angles) ** 2))
