"""Windows that show nothing to match: the orientation, of those known elsewhere in the pair, that image 2 confirms.

Of a plane of known orientation only the depth is unknown. It is swept, and image 2, pulled through every plane, is
compared with the window on raw grey values, under one gain and offset for the pair: shading is the texture of a bare
wall, and a high pass would remove it. Orientations that nothing else shows are compared as well: they are never
chosen, but those that fit about as well are part of the spread, which is the sigma.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from slopecli.geometry.epipolar import homogeneous
from slopecli.geometry.motion import epipolar_residual, inverse_depth
from slopecli.look.dense import CLEAR_AGREEMENT
from slopecli.look.matches import MIN_ON_PLANE, ON_PLANE_PX, Matches
from slopecli.look.noise import MAX_GAIN, ROUNDING_GREY, SAME_GROUND
from slopecli.look.photometric import TILTS, View, align_plane
from slopecli.look.scene import FINE_PX, Scene, view_of
from slopecli.options import MANY_WINDOWS, MOST_SIGMA_DEG
from slopecli.patches.patch import IN_DOUBT_DEG, Patch
from slopecli.patches.regions.surest_planes import surest_planes
from slopecli.patches.windows.borrowed import angles, from_elsewhere, points_on, shares, similarity, with_matches
from slopecli.patches.windows.raw_grey import (
    KNOWN,
    Compared,
    Exposure,
    compared,
    exposure_of,
    misfit,
    open_orientations,
    swept_depths,
    tilted_aside,
)
from slopecli.patches.windows.tunables import TUNE
from slopecli.types import FloatArray

Rematch = Callable[[Patch, Scene, FloatArray], Patch]


class KnownPlane(NamedTuple):
    """A plane of known orientation: scaled normal (3,), 1-sigma of its tilt, the matches on it, and what it is.

    matches : None of an orientation that follows from others; its scaled normal is at no depth.
    """

    normal: FloatArray
    sigma_rad: float
    matches: Matches | None
    name: str


def with_known_orientations(patches: list[Patch], scene: Scene, rematch: Rematch, most_sigma_deg: float) -> list[Patch]:
    """The windows; those without matches, or with faint ones, have an orientation from elsewhere if that fits.

    rematch : matches a window anew, guided by a plane; used where texture aligns better from a known orientation.
    most_sigma_deg : of a slope that is reported; matches that leave more open tell no tilt.
    """
    if len(patches) >= MANY_WINDOWS:
        return patches
    faint = [_is_faint(patch) for patch in patches]
    unmatched = [_is_unmatched(patch, scene, most_sigma_deg) for patch in patches]
    if not any(faint + unmatched):
        return patches
    known = known_planes(patches, scene)
    if not known:
        return patches
    known += perpendicular_to_two(known)
    exposure, settled = exposure_of(scene), list(patches)
    normals = np.array([plane.normal for plane in known])
    for k in np.flatnonzero(np.logical_or(faint, unmatched)):
        view = view_of(patches[k].window, scene, TUNE.coarse_px // 2, border=False)
        if min(view.grid.shape) < 8:  # px: too narrow to compare
            continue
        found = compared(view, normals, swept_depths(view, scene), exposure, 1.0)
        again = _realigned(patches[k], found, scene, rematch)
        # matches of a window that had none must leave less open than is reported
        if faint[k] or again.tilt_sigma_rad < np.radians(most_sigma_deg):
            settled[k] = again
        if unmatched[k] and _is_unmatched(settled[k], scene, most_sigma_deg):
            found = found._replace(prior=_prior(known, settled[k], scene))
            settled[k] = _settled(settled[k], known, found, view, exposure, scene)
    return settled


def _is_unmatched(patch: Patch, scene: Scene, most_sigma_deg: float) -> bool:
    """Whether a window that image 2 shows has no matches of its own, or few that tell no tilt, or agree by chance.

    Textured ground without any match is not what image 2 shows there, and grey values that agree do so by chance.
    """
    if patch.origin != "own":
        return patch.code == "low-texture"
    by_chance = patch.score < KNOWN.faint_score and patch.tilt_sigma_rad > np.radians(IN_DOUBT_DEG)
    in_part = patch.share < TUNE.scarce_share and patch.tilt_sigma_rad > np.radians(most_sigma_deg)
    # without a clear agreement an orientation known elsewhere tells more already at three quarters of that: three of
    # 315 windows drawn in 28 pairs gain (errors of 4.4, 12.2, 7.1 degrees are 0.3, 0.5, 3.3), none loses; at a half as
    # many gain as lose
    told = most_sigma_deg * (1.0 if patch.score >= CLEAR_AGREEMENT else 0.75)
    return by_chance or in_part or _noise_rad(patch, scene) > np.radians(told)


def _noise_rad(patch: Patch, scene: Scene) -> float:
    """1-sigma of the tilt of a window by the residuals of its matches, if neighbours share as much as they ever do.

    Along the epipolar lines flow may have smoothed noise away; those across the lines show it then.
    """
    rows, target = _rows_of(patch, scene)
    normal = own_plane(patch, scene)
    across = epipolar_residual(scene.R, scene.T, patch.matches.x1, patch.matches.x2) * np.sqrt(patch.weight)
    along = float(np.linalg.norm(target - rows @ normal))
    larger = max(1.0, float(np.linalg.norm(across)) / max(along, 1e-12))
    return MAX_GAIN * larger * _tilt_sigma(rows, target, normal)


def _is_faint(patch: Patch) -> bool:
    """Whether a window has matches of its own that are better than chance, but may be led to the wrong plane."""
    by_matches = patch.tilt_sigma_rad - patch.unmatched_sigma_rad
    return (
        patch.origin == "own"
        and KNOWN.faint_score <= patch.score < CLEAR_AGREEMENT
        and by_matches > np.radians(IN_DOUBT_DEG)
    )


def _realigned(patch: Patch, found: Compared, scene: Scene, rematch: Rematch) -> Patch:
    """The window matched anew from the known orientation that its texture aligns best from, if clearly better so.

    found : the known orientations, compared with the window.
    """
    view = view_of(patch.window, scene, FINE_PX, border=False)
    starts = [k for k in np.argsort(found.misfit, kind="stable")[: KNOWN.starts] if np.isfinite(found.misfit[k])]
    fits = [align_plane(view, found.normals[k] * found.depth[k], 8) for k in starts]  # as for other starts
    score = SAME_GROUND
    if patch.origin == "own":
        score = max(score, align_plane(view, own_plane(patch, scene), 8).score + KNOWN.better)
    best = max(fits, key=lambda fit: fit.score, default=None)
    if best is None or best.score < score:
        return patch
    again = rematch(patch.unmatched(""), scene, best.normal)
    return again if again.origin == "own" and again.score > patch.score else patch


# ---- what is known ----


def known_planes(patches: Sequence[Patch], scene: Scene) -> list[KnownPlane]:
    """Planes of distinct orientation, the surest first: those of clearly matched windows, then those of the scene.

    Without such a window the scene's are all that is known, and those of its matches are not sure enough.
    """
    found = [plane for patch in patches if (plane := _plane_of(patch, scene)) is not None]
    found.sort(key=lambda plane: plane.sigma_rad)
    evidence = scene.evidence
    for normal in scene.planes if found else surest_planes(scene, KNOWN.sure_rad) or scene.planes:
        on = evidence.take(evidence.misfit_px(normal) < ON_PLANE_PX)
        if len(on) >= 2 * MIN_ON_PLANE:
            found.append(KnownPlane(normal, KNOWN.sure_rad, on, "a plane of the scene"))
    return _distinct(found, (), 0.5 * KNOWN.sure_rad)


def perpendicular_to_two(known: Sequence[KnownPlane]) -> list[KnownPlane]:
    """The orientations perpendicular to two known ones, as floors are to walls, that are not known themselves."""
    found = list[KnownPlane]()
    units = [plane.normal / np.linalg.norm(plane.normal) for plane in known]
    for k, one in enumerate(known):
        for j, other in enumerate(known[:k]):
            normal = np.cross(units[j], units[k])
            sine = float(np.linalg.norm(normal))
            if sine > 0.5:  # 30 degrees: less, and their errors count more than twice
                sigma = float(np.hypot(one.sigma_rad, other.sigma_rad)) / sine
                found.append(KnownPlane(normal, sigma, None, f"a plane perpendicular to {other.name} and {one.name}"))
    found.sort(key=lambda plane: plane.sigma_rad)
    return _distinct(found, known, 2.0 * KNOWN.parallel_rad)


def _distinct(found: Sequence[KnownPlane], known: Sequence[KnownPlane], least_rad: float) -> list[KnownPlane]:
    """The planes found, in their order, that are so far apart from those known and from one another, up to the most."""
    distinct = list[KnownPlane]()
    for plane in found:
        others = [*known, *distinct]
        apart = angles(np.array([plane.normal, *(other.normal for other in others)]))[0, 1:]
        if len(others) < KNOWN.most_known and (apart > least_rad).all():
            distinct.append(plane)
    return distinct


def _plane_of(patch: Patch, scene: Scene) -> KnownPlane | None:
    """The plane through the matches of a window; None if these are few, faint, or leave its orientation open."""
    if patch.origin != "own" or patch.score < TUNE.good_score or patch.share < TUNE.scarce_share:
        return None
    rows, target = _rows_of(patch, scene)
    if np.linalg.matrix_rank(rows) < 3:
        return None
    normal = own_plane(patch, scene)
    # what is not matched does not tilt the part that is
    noise, rest = _tilt_sigma(rows, target, normal), patch.tilt_sigma_rad - patch.unmatched_sigma_rad
    if np.hypot(rest, MAX_GAIN * noise) >= KNOWN.sure_rad:
        return None
    return KnownPlane(normal, float(np.hypot(rest, noise)), patch.matches, f"window {patch.id}")


def _tilt_sigma(rows: FloatArray, target: FloatArray, normal: FloatArray) -> float:
    """1-sigma, rad, of the tilt of a plane by the residuals of its rows (n, 3) @ normal = target (n,)."""
    residual, length = target - rows @ normal, float(np.linalg.norm(normal))
    across = np.eye(3) - np.outer(normal, normal) / length**2
    covariance = across @ np.linalg.pinv(rows.T @ rows) @ across
    return float(np.sqrt(0.5 * np.trace(covariance) * (residual @ residual) / max(len(target) - 3, 1))) / length


# ---- choice ----


def _settled(
    patch: Patch, known: list[KnownPlane], found: Compared, view: View, exposure: Exposure, scene: Scene
) -> Patch:
    """The window with the best of the known orientations; as it is if none fits, or its own matches fit better.

    found : the known orientations, compared with the window.  view : of it, for comparing others.
    """
    own = patch.origin == "own"
    if own and not np.isfinite(found.misfit).any():
        return _on_known(patch, known, scene)
    depths, n = swept_depths(view, scene), len(known)
    follows = np.array([plane.matches is None for plane in known])
    unseen = KNOWN.unknown - float(found.prior[follows].sum())
    found = found.joined(compared(view, open_orientations(view), depths, exposure, unseen))
    variance = float(view.grid.grey.var())
    # if no plane explains more than a uniform grey would, grey values tell nothing
    if not float(found.misfit.min()) < variance + ROUNDING_GREY**2:
        return patch
    if own:
        found = _beside_own(found, patch, view, exposure, scene)
    chance, apart = found.chance(variance), angles(found.normals)
    mass = (np.exp(-((apart / KNOWN.parallel_rad) ** 2)) @ chance)[:n]
    mass *= own | ~follows | (mass >= 0.5)  # what nothing shows must be likelier than all that something does
    group = np.flatnonzero(apart[int(np.argmax(mass)), :n] < KNOWN.parallel_rad)
    sigma = np.array([known[k].sigma_rad for k in group])
    best = int(group[np.argmax(chance[group] / sigma)])
    if own:
        as_well = bool(found.misfit[best] < (1.0 + KNOWN.alike) * found.misfit[-1])
        is_parallel = bool(apart[best, -1] < KNOWN.parallel_rad)
        enough = _tells_more(patch, known[best], is_parallel, float(mass.max()), as_well, scene)
        if not enough:
            return patch
    stays = not own and _is_around(patch, found.normals[best], scene)
    near = depths[np.abs(depths - found.depth[best]) < 6.0 * (depths[1] - depths[0])]
    found = found.joined(compared(view, tilted_aside(found.normals[best]), near, exposure, KNOWN.unknown))
    chance = found.chance(variance)
    spread = np.sqrt(chance @ angles(found.normals)[best] ** 2)
    # grey values leave more open than what is around, all of which may be another surface than a window without texture
    if stays or (patch.origin == "borrowed" and spread > patch.tilt_sigma_rad):
        spread = np.sqrt(chance @ angles(np.vstack([own_plane(patch, scene), found.normals]))[0, 1:] ** 2)
        return replace(patch, tilt_sigma_rad=max(patch.tilt_sigma_rad, float(spread)))
    matches, name = known[best].matches, known[best].name
    if matches is None:  # points have no errors, so that of the orientation is in none of them
        matches = points_on(patch.window, found.normals[best] * found.depth[best], scene)
        spread = np.hypot(spread, known[best].sigma_rad)
    return from_elsewhere(patch, scene, matches, float(spread), name)


def _tells_more(patch: Patch, plane: KnownPlane, is_parallel: bool, chance: float, as_well: bool, scene: Scene) -> bool:
    """Whether a known orientation tells more of a window than the window's own matches.

    is_parallel : whether it is about that of the matches; known no better than by these, it tells no more than they do.
    One that is not takes the place of clear matches only if these leave more open than is reported without asking.
    chance : probability of it and of those parallel to it.  as_well : whether it fits as well as the own plane.
    """
    noise = _noise_rad(patch, scene)
    clear = patch.share >= TUNE.scarce_share and patch.score >= KNOWN.faint_score
    stays = plane.sigma_rad >= noise if is_parallel else clear and noise < np.radians(MOST_SIGMA_DEG)
    return not stays and chance >= (0.25 if as_well else 0.5)


def _on_known(patch: Patch, known: Sequence[KnownPlane], scene: Scene) -> Patch:
    """The window of which image 2 shows too little to compare, with the known plane its few matches lie on, if any.

    That reaches farther than they do, so it tells their tilt better; what the rest of the window may be stays as open.
    """
    x1, x2 = patch.matches.x1, patch.matches.x2
    w, leverage = inverse_depth(scene.R, scene.T, x1, x2)
    to_px, best, least = leverage * scene.camera2.focal_px, None, ON_PLANE_PX
    for plane in known:
        off = float(np.sqrt(np.mean(((w - homogeneous(x1) @ plane.normal) * to_px) ** 2)))
        if plane.matches is not None and off < least:
            best, least = plane, off
    if best is None or best.matches is None:
        return patch
    reason = f"mostly not in image 2: this is the plane of what is, that of {best.name}"
    return with_matches(patch.unmatched(reason, "no-overlap"), best.matches, patch.tilt_sigma_rad)


def own_plane(patch: Patch, scene: Scene) -> FloatArray:
    """(3,) scaled normal of the plane through the matches of a window."""
    return np.asarray(np.linalg.lstsq(*_rows_of(patch, scene), rcond=None)[0])


def _rows_of(patch: Patch, scene: Scene) -> tuple[FloatArray, FloatArray]:
    """Rows (n, 3) @ normal = target (n,) of the matches of a window, weighted."""
    w, leverage = inverse_depth(scene.R, scene.T, patch.matches.x1, patch.matches.x2)
    root = leverage * np.sqrt(patch.weight)
    return homogeneous(patch.matches.x1) * root[:, None], w * root


def _is_around(patch: Patch, normal: FloatArray, scene: Scene) -> bool:
    """Whether the window has the plane of most matches around it already, and this normal (3,) agrees with it."""
    if patch.origin == "none":
        return False
    plane = own_plane(patch, scene)
    vote = scene.evidence.near(patch.window, TUNE.reaches[0]) * similarity(patch.window, scene, TUNE.reaches[0])
    agrees = angles(np.array([plane, normal]))[0, 1] < KNOWN.parallel_rad
    return bool(agrees and shares([plane], scene, vote)[0] >= 0.5)


def _beside_own(found: Compared, patch: Patch, view: View, exposure: Exposure, scene: Scene) -> Compared:
    """The orientations, less likely the farther they are from the plane of the window's own matches; and that, last."""
    normal = own_plane(patch, scene)[None]
    sigma = max(patch.tilt_sigma_rad, _noise_rad(patch, scene), KNOWN.sure_rad)
    apart = angles(np.vstack([found.normals, normal]))[-1, :-1]
    found = found._replace(prior=found.prior * np.exp(-0.5 * (apart / sigma) ** 2))
    return found.joined(Compared(normal, misfit(view, normal, exposure), np.zeros(1), np.array([KNOWN.unknown])))


def _prior(known: list[KnownPlane], patch: Patch, scene: Scene) -> FloatArray:
    """(k,) probability of each known orientation beforehand; as of one that nothing shows if it follows from others."""
    seen = [plane.matches is not None for plane in known]
    prior = np.full(len(known), KNOWN.unknown / (seen.count(False) + len(TILTS)))
    normals = np.array([plane.normal for plane in known])[seen]
    prior[seen] = (1.0 - KNOWN.unknown) * _support(normals, patch, scene)
    return prior


def _support(normals: FloatArray, patch: Patch, scene: Scene) -> FloatArray:
    """(k,) probability of each known orientation beforehand: by the matches on it, all and those around the window."""
    near = scene.evidence.near(patch.window, TUNE.reaches[0])
    around = shares(normals, scene, near * similarity(patch.window, scene, TUNE.reaches[0]))
    support = 0.02 + around + shares(normals, scene, np.ones(len(scene.evidence)))
    support /= np.exp(-((angles(normals) / KNOWN.parallel_rad) ** 2)).sum(axis=1)  # parallel ones share theirs
    return np.asarray(support / support.sum())
