"""The plane around a window inside which nothing can be matched."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from slopecli.geometry.statistics import median
from slopecli.look.matches import thin
from slopecli.look.scene import Scene, view_of
from slopecli.look.warp import covered
from slopecli.patches.patch import Patch, weight_of
from slopecli.types import FloatArray, IntArray
from slopecli.windows import Window

REACHES = (0.75, 1.5, 3.0)  # how far to look, sides of the window
MIN_NEAR, MIN_CHOSEN, MIN_SUPPORT = 20, 12, 2.0  # matches, matches on the plane, votes
MOST = 300  # matches to borrow: more are no more certain of what they do not see
ON_PLANE_PX = 1.0  # distance in image 2 from where the plane puts them, of matches that are on it
AGREED_SHARE = 0.5  # of the votes around a window that one plane must have
PARALLEL_RAD = np.radians(10.0)  # planes this alike count as one orientation
SAME_GREY = 30.0  # grey levels by which one material differs from place to place
SIGMA_PX = 0.3  # of matches of the overview, generously
SKETCH_PX, SEEN_SHARE = 24, 0.3  # px a side on which is counted how much of a window image 2 shows; too little
CELLS_ACROSS = 16  # cells of a window: borrowed matches closer than that share errors
TEXTURED_GREY = 12.0  # standard deviation of a window that ought to have been matched
UNEXPLAINED_RAD = np.radians(20.0)  # doubt about the plane around a window that was not found on it
LONELY_RAD = np.radians(60.0)  # doubt about a borrowed plane that nothing around the window supports


def borrow(patch: Patch, scene: Scene) -> Patch:
    """The window with the matches of the plane it most likely belongs to, or is parallel to, if none are found inside.

    That is the plane around it where most of what lies around agrees on one; else, amid clutter, the orientation
    that most of the scene shares. The doubt says how far the candidates disagree.
    """
    return _from_around(patch, scene) or _from_scene(patch, scene) or _nothing(patch, scene)


def _from_around(patch: Patch, scene: Scene) -> Patch | None:
    """Matches of the plane most of what lies around agrees on; None where it agrees on none, however far one looks."""
    evidence, window = scene.evidence, patch.window
    for grow in REACHES:
        near = evidence.near(window, grow)
        if near.sum() < MIN_NEAR:
            continue
        vote = near * _kinship(window, scene, grow)
        planes = [p for p in (evidence.plane_through(near), *scene.planes) if p is not None]
        share = _shares(planes, scene, vote)
        best = int(np.argmax(share))
        chosen = np.flatnonzero(near & (evidence.misfit_px(planes[best]) < ON_PLANE_PX))
        if len(chosen) >= MIN_CHOSEN and vote.sum() * share[best] >= MIN_SUPPORT and share[best] >= AGREED_SHARE:
            doubt = max(_disagreement(planes, share, best), LONELY_RAD * (1 - share[best]))
            return _borrowed(chosen, patch, scene, planes[best], doubt, "this is the plane around it")
    return None


def _from_scene(patch: Patch, scene: Scene) -> Patch | None:
    """Matches of the scene's plane of the most common orientation, near the window above all; None without one."""
    if not scene.planes:
        return None
    window = patch.window
    near = scene.evidence.near(window, REACHES[-1])
    local = _shares(scene.planes, scene, near * _kinship(window, scene, REACHES[-1]))
    weight = local + _shares(scene.planes, scene, np.ones(len(scene.evidence)))
    best = int(np.argmax(np.exp(-((_angles(scene.planes) / PARALLEL_RAD) ** 2)) @ weight))
    chosen = np.flatnonzero(scene.evidence.misfit_px(scene.planes[best]) < ON_PLANE_PX)
    if len(chosen) < MIN_CHOSEN:
        return None
    doubt = _disagreement(scene.planes, weight, best)
    words = "this is the orientation most of the scene shares, its distance is not the window's"
    return _borrowed(chosen, patch, scene, scene.planes[best], doubt, words)


def _nothing(patch: Patch, scene: Scene) -> Patch:
    code, reason = _why_not(patch.window, scene, None)
    return patch.unmatched(f"{reason}, and nothing around the window can be matched", code)


def _shares(planes: list[FloatArray], scene: Scene, vote: FloatArray) -> FloatArray:
    """(k,) of the votes of all matches, the share of those on each plane."""
    on = np.array([scene.evidence.misfit_px(plane) < ON_PLANE_PX for plane in planes])
    return np.asarray(on @ vote / max(float(vote.sum()), 1e-9))


def _angles(planes: list[FloatArray]) -> FloatArray:
    """(k, k) angles between planes, 0..pi/2."""
    unit = np.array(planes) / np.linalg.norm(planes, axis=1, keepdims=True)
    return np.asarray(np.arccos(np.clip(np.abs(unit @ unit.T), 0.0, 1.0)))


def _kinship(window: Window, scene: Scene, grow: float) -> FloatArray:
    """(n,) how likely each match around belongs with the window: close to it and as bright."""
    x, y, w, h = window
    grey = scene.pyramid1.at(1.0).grey[y : y + h, x : x + w]
    reach = max(w, h) * (0.5 + grow)
    offset = np.linalg.norm(scene.evidence.uv1 - np.array([x + w / 2, y + h / 2]), axis=1) / reach
    contrast = (scene.evidence.grey - median(grey)) / SAME_GREY
    return np.asarray(np.exp(-(offset**2)) * np.exp(-(contrast**2)))


def _borrowed(chosen: IntArray, patch: Patch, scene: Scene, plane: FloatArray, doubt: float, words: str) -> Patch:
    evidence, window = scene.evidence, patch.window
    chosen = thin(evidence.uv1, chosen, MOST)
    spacing = max(max(window[2:]) / CELLS_ACROSS, 1.0)
    cell = np.round(evidence.uv1[chosen, ::-1] / spacing).astype(np.int64)
    code, reason = _why_not(window, scene, plane)
    if code == "poor-fit":  # had it been on this plane, it would have matched there
        doubt = max(doubt, UNEXPLAINED_RAD)
    return replace(
        patch,
        matches=evidence.take(chosen),
        weight=weight_of(np.full(len(chosen), SIGMA_PX**2)),
        cell=cell,
        origin="borrowed",
        reason=f"{reason}: {words}",
        code=code,
        tilt_sigma_rad=doubt,
    )


def _why_not(window: Window, scene: Scene, plane: FloatArray | None) -> tuple[str, str]:
    """Diagnostic code and words for why the window itself has no matches."""
    if plane is not None:
        mapping = view_of(window, scene, SKETCH_PX, border=False).mapping(plane)
        if covered(mapping, scene.shape2).mean() < SEEN_SHARE:
            return "no-overlap", "not in image 2"
    x, y, w, h = window
    contrast = float(scene.pyramid1.at(1.0).grey[y : y + h, x : x + w].std())
    if contrast > TEXTURED_GREY:
        return "poor-fit", "textured, but no match found inside"
    return "low-texture", "too little texture inside"


def _disagreement(planes: list[FloatArray], share: FloatArray, best: int) -> float:
    """RMS angle between the chosen plane and the others, each weighted by the support it has."""
    return float(np.sqrt(share @ _angles(planes)[best] ** 2 / max(float(share.sum()), 1e-9)))
