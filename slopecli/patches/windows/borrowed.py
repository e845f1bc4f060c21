"""Matches borrowed from the plane around a window that has none of its own, or from one of known orientation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from slopecli.geometry.statistics import median
from slopecli.look.matches import MIN_ON_PLANE, ON_PLANE_PX, Matches, pair_rays, thin
from slopecli.look.noise import OVERVIEW_CELL_PX
from slopecli.look.scene import Scene, view_of
from slopecli.look.warp import covered
from slopecli.options import MOST_SIGMA_DEG
from slopecli.patches.patch import Patch, weight_of
from slopecli.patches.windows.tunables import TUNE
from slopecli.types import FloatArray, IntArray
from slopecli.windows import Window


def borrow(patch: Patch, scene: Scene) -> Patch:
    """The window with matches of the plane it most likely belongs to, or is parallel to.

    That is the plane that most matches around it lie on; else, amid clutter, the most common orientation of the
    scene. The tilt sigma is the disagreement between the candidate planes.
    """
    code, reason = _why_not(patch.window, scene, None)
    nothing = patch.unmatched(f"{reason}, and nothing around the window can be matched", code)
    return _from_around(patch, scene) or _from_scene(patch, scene) or nothing


def _from_around(patch: Patch, scene: Scene) -> Patch | None:
    """With matches of the plane that most matches around the window lie on; None if there is no such plane."""
    evidence, window = scene.evidence, patch.window
    for grow in TUNE.reaches:
        near = evidence.near(window, grow)
        if near.sum() < TUNE.least_near:
            continue
        vote = near * similarity(window, scene, grow)
        planes = [p for p in (evidence.plane_through(near), *scene.planes) if p is not None]
        share = shares(planes, scene, vote)
        best = int(np.argmax(share))
        chosen = np.flatnonzero(near & (evidence.misfit_px(planes[best]) < ON_PLANE_PX))
        if len(chosen) >= 2 * MIN_ON_PLANE and vote.sum() * share[best] >= 2 and share[best] >= 0.5:
            sigma = max(_disagreement(planes, share, best), np.radians(MOST_SIGMA_DEG) * (1 - share[best]))
            return _borrowed(chosen, patch, scene, planes[best], sigma, "this is the plane around it")
    return None


def _from_scene(patch: Patch, scene: Scene) -> Patch | None:
    """With matches of the plane of the scene's most common orientation, weighted towards the window; None if none."""
    if not scene.planes:
        return None
    window = patch.window
    near = scene.evidence.near(window, TUNE.reaches[-1])
    local = shares(scene.planes, scene, near * similarity(window, scene, TUNE.reaches[-1]))
    weight = local + shares(scene.planes, scene, np.ones(len(scene.evidence)))
    parallel = np.exp(-((angles(scene.planes) / np.radians(10.0)) ** 2))
    best = int(np.argmax(parallel @ weight))
    chosen = np.flatnonzero(scene.evidence.misfit_px(scene.planes[best]) < ON_PLANE_PX)
    if len(chosen) < 2 * MIN_ON_PLANE:
        return None
    sigma = _disagreement(scene.planes, weight, best)
    words = "this is the orientation most of the scene shares, its distance is not the window's"
    return _borrowed(chosen, patch, scene, scene.planes[best], sigma, words)


def shares(planes: Sequence[FloatArray] | FloatArray, scene: Scene, vote: FloatArray) -> FloatArray:
    """(k,) weighted share of all matches that lie on each plane; vote (n,): the weights."""
    on = np.array([scene.evidence.misfit_px(plane) < ON_PLANE_PX for plane in planes])
    return np.asarray(on @ vote / max(float(vote.sum()), 1e-9))


def angles(planes: Sequence[FloatArray] | FloatArray) -> FloatArray:
    """(k, k) angles between planes, 0..pi/2."""
    unit = np.asarray(planes) / np.linalg.norm(np.asarray(planes), axis=1, keepdims=True)
    return np.asarray(np.arccos(np.clip(np.abs(unit @ unit.T), 0.0, 1.0)))


def similarity(window: Window, scene: Scene, grow: float) -> FloatArray:
    """(n,) weight of each match around the window, 0..1: high if it is close and of similar brightness."""
    x, y, w, h = window
    grey = scene.pyramid1.at(1.0).grey[y : y + h, x : x + w]
    reach = max(w, h) * (0.5 + grow)
    offset = np.linalg.norm(scene.evidence.uv1 - np.array([x + w / 2, y + h / 2]), axis=1) / reach
    contrast = (scene.evidence.grey - median(grey)) / TUNE.same_grey
    return np.asarray(np.exp(-(offset**2)) * np.exp(-(contrast**2)))


def from_elsewhere(patch: Patch, scene: Scene, matches: Matches, sigma: float, name: str) -> Patch:
    """The window with the orientation of a plane elsewhere, by the matches on that.

    sigma : of its tilt, rad.  name : what that plane is.
    """
    code, why = ("low-texture", "only faint matches inside")
    if patch.origin != "own":
        code, why = _why_not(patch.window, scene, None)
    reason = f"{why}: orientation from elsewhere, that of {name}, its distance is not the window's"
    return with_matches(patch.unmatched(reason, code), matches, sigma)


def points_on(window: Window, plane: FloatArray, scene: Scene) -> Matches:
    """Points of a plane (3,) in and around a window, in place of matches: few, as they tell nothing of the motion.

    They cover nine times the window, so that the sigma of a match hardly tilts the plane.
    """
    x, y, w, h = window
    u, v = np.meshgrid(np.linspace(x - w, x + 2 * w, 10), np.linspace(y - h, y + 2 * h, 10))
    uv1 = np.stack([u, v], -1).reshape(-1, 2)
    view = view_of(window, scene, TUNE.coarse_px, border=False)
    uv2 = view.transfer(view.bundle(uv1), plane)
    x1, x2, seen = pair_rays(scene.camera1, scene.camera2, uv1, uv2)
    return Matches(uv1, uv2, x1, x2).take(seen & covered(uv1, scene.shape1) & covered(uv2, scene.shape2))


def with_matches(patch: Patch, matches: Matches, sigma: float) -> Patch:
    """The window with some of the matches of another plane; sigma: of its tilt, rad."""
    matches = matches.take(thin(matches.uv1, np.arange(len(matches)), 300))  # more would not be surer of the window
    spacing = max(max(patch.window[2:]) / TUNE.cells_across, 1.0)
    return replace(
        patch,
        matches=matches,
        weight=weight_of(np.full(len(matches), (3 * OVERVIEW_CELL_PX) ** 2)),
        cell=np.round(matches.uv1[:, ::-1] / spacing).astype(np.int64),
        origin="borrowed",
        tilt_sigma_rad=sigma,
    )


def _borrowed(chosen: IntArray, patch: Patch, scene: Scene, plane: FloatArray, sigma: float, words: str) -> Patch:
    """The window with the chosen matches (indices) of a plane; sigma: of its tilt, rad."""
    code, reason = _why_not(patch.window, scene, plane)
    if code == "poor-fit":  # on this plane it would have been matched
        sigma = max(sigma, TUNE.unexplained_rad)
    return with_matches(patch.unmatched(f"{reason}: {words}", code), scene.evidence.take(chosen), sigma)


def _why_not(window: Window, scene: Scene, plane: FloatArray | None) -> tuple[str, str]:
    """Diagnostic code and reason why the window itself has no matches; plane (3,): of its surroundings, if known."""
    shown = 1.0
    if plane is not None:
        mapping = view_of(window, scene, TUNE.coarse_px // 2, border=False).mapping(plane)
        shown = float(covered(mapping, scene.shape2).mean())
    x, y, w, h = window
    return why_unmatched(shown, float(scene.pyramid1.at(1.0).grey[y : y + h, x : x + w].std()))


def why_unmatched(shown: float, contrast: float) -> tuple[str, str]:
    """Diagnostic code and reason why a window has no matches.

    shown : share of it that image 2 shows.  contrast : standard deviation of its grey levels.
    """
    if shown < TUNE.scarce_share:
        return "no-overlap", "not in image 2"
    if contrast > TUNE.textured_grey:
        return "poor-fit", "textured, but no match found inside"
    return "low-texture", "too little texture inside"


def _disagreement(planes: list[FloatArray], share: FloatArray, best: int) -> float:
    """RMS angle, rad, between the chosen plane and the others, each weighted by its share."""
    return float(np.sqrt(share @ angles(planes)[best] ** 2 / max(float(share.sum()), 1e-9)))
