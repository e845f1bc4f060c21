"""Windows that show nothing to match: the orientation, of those known elsewhere in the pair, that image 2 confirms.

Of a plane of known orientation only the depth is unknown. It is swept, and image 2, pulled through every plane, is
compared with the window on raw grey values, under one gain and offset for the pair: shading is the texture of a bare
wall, and a high pass would remove it. Orientations that nothing else shows are compared as well: they are never
chosen, but those that fit about as well are part of the spread, which is the sigma.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from slopecli.geometry.epipolar import homogeneous, tangent_basis
from slopecli.geometry.motion import inverse_depth
from slopecli.geometry.statistics import robust_sigma
from slopecli.look.dense import CLEAR_AGREEMENT
from slopecli.look.matches import LEAST_MATCHES, MIN_ON_PLANE, ON_PLANE_PX, Matches
from slopecli.look.noise import MAX_GAIN, ROUNDING_GREY
from slopecli.look.photometric import TILTS, View, align_plane
from slopecli.look.scene import FINE_PX, Scene, view_of
from slopecli.look.warp import covered, map_nodes, node_shape, sample_grey, sample_layer, spread_table
from slopecli.options import MANY_WINDOWS, Options
from slopecli.patches.patch import IN_DOUBT_DEG, Patch
from slopecli.patches.windows.borrowed import angles, from_elsewhere, shares, similarity
from slopecli.patches.windows.tunables import TUNE
from slopecli.types import FloatArray


class OrientationTunables(NamedTuple):
    """When an orientation is known, which windows are compared with it, and how well they must fit."""

    faint_score: float = 0.55  # own matches that agree less, and are in doubt, are chance as often as not
    starts: int = 3  # known orientations that a faint window is aligned from, those of the least misfit
    better: float = 0.05  # growth of the correlation by which another start is no chance
    most_known: int = 12  # orientations compared: rooms and streets have fewer
    # 1-sigma of the tilt of a plane whose orientation counts as known; those nearer than half of it are the same
    sure_rad: float = float(np.radians(3.0))
    parallel_rad: float = float(np.radians(10.0))  # orientations that shading does not tell from each other
    least_seen: float = 0.75  # share of a window that image 2 must show: planes are compared on nearly the same pixels
    alike: float = 0.02  # relative growth of the squared difference by which an orientation gets e times less likely
    unknown: float = 0.3  # probability beforehand of an orientation that is not among the known


KNOWN = OrientationTunables()


Rematch = Callable[[Patch, Scene, FloatArray], Patch]


class KnownPlane(NamedTuple):
    """A plane of known orientation: scaled normal (3,), 1-sigma of its tilt, the matches on it, and what it is."""

    normal: FloatArray
    sigma_rad: float
    matches: Matches
    name: str


class Exposure(NamedTuple):
    """Grey values of image 1 are gain times those of image 2 plus offset, to a 1-sigma of noise."""

    gain: float
    offset: float
    noise: float


def with_known_orientations(patches: list[Patch], scene: Scene, rematch: Rematch) -> list[Patch]:
    """The windows; those without matches, or with faint ones, have an orientation from elsewhere if that fits.

    rematch : matches a window anew, guided by a plane; used where texture aligns better from a known orientation.
    """
    if len(patches) >= MANY_WINDOWS:
        return patches
    faint, unmatched = [_is_faint(patch) for patch in patches], [_is_unmatched(patch, scene) for patch in patches]
    if not any(faint + unmatched):
        return patches
    known = known_planes(patches, scene)
    if not known:
        return patches
    exposure, settled = exposure_of(scene), list(patches)
    for k in range(len(patches)):
        if faint[k]:
            settled[k] = _realigned(settled[k], known, exposure, scene, rematch)
        if unmatched[k] and _is_unmatched(settled[k], scene):
            settled[k] = _settled(settled[k], known, exposure, scene)
    return settled


def _is_unmatched(patch: Patch, scene: Scene) -> bool:
    """Whether a window that image 2 shows has no matches of its own, or such as agree by chance or tell no tilt.

    Textured ground without any match is not what image 2 shows there, and grey values that agree do so by chance.
    """
    if patch.origin != "own":
        return patch.code == "low-texture"
    by_chance = patch.score < KNOWN.faint_score and patch.tilt_sigma_rad > np.radians(IN_DOUBT_DEG)
    return by_chance or _noise_rad(patch, scene) > np.radians(Options().max_sigma_deg)


def _noise_rad(patch: Patch, scene: Scene) -> float:
    """1-sigma of the tilt of a window by the residuals of its matches, if neighbours share as much as they ever do."""
    rows, target = _rows_of(patch, scene)
    return MAX_GAIN * _tilt_sigma(rows, target, own_plane(patch, scene))


def _is_faint(patch: Patch) -> bool:
    """Whether a window has matches of its own that are better than chance, but may be led to the wrong plane."""
    by_matches = patch.tilt_sigma_rad - patch.unmatched_sigma_rad
    return (
        patch.origin == "own"
        and KNOWN.faint_score <= patch.score < CLEAR_AGREEMENT
        and by_matches > np.radians(IN_DOUBT_DEG)
    )


def _realigned(patch: Patch, known: list[KnownPlane], exposure: Exposure, scene: Scene, rematch: Rematch) -> Patch:
    """The window matched anew from the known orientation that its texture aligns best from, if clearly better so."""
    small, view = (view_of(patch.window, scene, side, border=False) for side in (TUNE.coarse_px // 2, FINE_PX))
    if min(small.grid.shape) < 8:  # px: too narrow to compare
        return patch
    found = _compared(small, np.array([plane.normal for plane in known]), _swept(small, scene), exposure, 1.0)
    starts = [k for k in np.argsort(found.misfit, kind="stable")[: KNOWN.starts] if np.isfinite(found.misfit[k])]
    fits = [align_plane(view, found.normals[k] * found.depth[k], 8) for k in starts]  # as for other starts
    own = align_plane(view, own_plane(patch, scene), 8)
    best = max(fits, key=lambda fit: fit.score, default=own)
    if best.score < own.score + KNOWN.better:
        return patch
    again = rematch(patch.unmatched(""), scene, best.normal)
    return again if again.origin == "own" and again.score > patch.score else patch


# ---- what is known ----


def known_planes(patches: Sequence[Patch], scene: Scene) -> list[KnownPlane]:
    """Planes of distinct orientation, the surest first: those of clearly matched windows, then those of the scene."""
    found = [plane for patch in patches if (plane := _plane_of(patch, scene)) is not None]
    found.sort(key=lambda plane: plane.sigma_rad)
    evidence = scene.evidence
    for normal in scene.planes:
        on = evidence.take(evidence.misfit_px(normal) < ON_PLANE_PX)
        if len(on) >= 2 * MIN_ON_PLANE:
            found.append(KnownPlane(normal, KNOWN.sure_rad, on, "a plane of the scene"))
    distinct = list[KnownPlane]()
    for plane in found:
        apart = angles(np.array([plane.normal, *(other.normal for other in distinct)]))[0, 1:]
        if len(distinct) < KNOWN.most_known and (apart > 0.5 * KNOWN.sure_rad).all():
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
    sigma = float(np.hypot(patch.tilt_sigma_rad - patch.unmatched_sigma_rad, _tilt_sigma(rows, target, normal)))
    return KnownPlane(normal, sigma, patch.matches, f"window {patch.id}") if sigma < KNOWN.sure_rad else None


def _tilt_sigma(rows: FloatArray, target: FloatArray, normal: FloatArray) -> float:
    """1-sigma, rad, of the tilt of a plane by the residuals of its rows (n, 3) @ normal = target (n,)."""
    residual, length = target - rows @ normal, float(np.linalg.norm(normal))
    across = np.eye(3) - np.outer(normal, normal) / length**2
    covariance = across @ np.linalg.pinv(rows.T @ rows) @ across
    return float(np.sqrt(0.5 * np.trace(covariance) * (residual @ residual) / max(len(target) - 3, 1))) / length


def exposure_of(scene: Scene) -> Exposure:
    """Gain and offset between the images, from the grey values of their matches, mismatches left out."""
    first, second = scene.evidence.grey, sample_grey(scene.pyramid2.at(1.0).grey, scene.evidence.uv2)
    gain, offset, kept = 1.0, 0.0, np.ones(len(first), bool)
    for _ in range(4):  # settles in three
        if kept.sum() < LEAST_MATCHES or np.ptp(second[kept]) < 1.0:
            break
        gain, offset = np.polyfit(second[kept], first[kept], 1)
        residual = first - gain * second - offset
        kept = np.abs(residual) <= 3.0 * robust_sigma(residual)
    return Exposure(float(gain), float(offset), robust_sigma(first - gain * second - offset))


# ---- comparison ----


class Compared(NamedTuple):
    """Orientations (k, 3), scaled normals, with the least misfit (k,) over the depths, its depth, and a prior (k,)."""

    normals: FloatArray
    misfit: FloatArray
    depth: FloatArray
    prior: FloatArray

    def joined(self, other: Compared) -> Compared:
        """Both, one after the other."""
        return Compared(*(np.concatenate(pair) for pair in zip(self, other, strict=True)))

    def chance(self, variance: float) -> FloatArray:
        """(k,) probability of each, one of them being right.

        variance : of the window's grey values; differences tell less where not even the best explains it.
        """
        least, rounding = float(self.misfit.min()), ROUNDING_GREY**2
        unit = KNOWN.alike * max(least, rounding) * (1.0 + least / max(variance, rounding))
        likely = self.prior * np.exp(-(self.misfit - least) / unit)
        return np.asarray(likely / max(float(likely.sum()), 1e-300))


def _settled(patch: Patch, known: list[KnownPlane], exposure: Exposure, scene: Scene) -> Patch:
    """The window with the best of the known orientations; as it is if none fits, or its own matches fit better."""
    view = view_of(patch.window, scene, TUNE.coarse_px // 2, border=False)
    if min(view.grid.shape) < 8:  # px: too narrow to compare
        return patch
    depths, n = _swept(view, scene), len(known)
    normals = np.array([plane.normal for plane in known])
    found = _compared(view, normals, depths, exposure, (1.0 - KNOWN.unknown) * _support(normals, patch, scene))
    found = found.joined(_compared(view, _open_orientations(view), depths, exposure, KNOWN.unknown))
    variance = float(view.grid.grey.var())
    # if no plane explains more than a uniform grey would, grey values tell nothing
    if not float(found.misfit.min()) < variance + exposure.noise**2:
        return patch
    if patch.origin == "own":
        found = _beside_own(found, patch, view, exposure, scene)
    chance, apart = found.chance(variance), angles(found.normals)
    mass = (np.exp(-((apart / KNOWN.parallel_rad) ** 2)) @ chance)[:n]
    group = np.flatnonzero(apart[int(np.argmax(mass)), :n] < KNOWN.parallel_rad)
    sigma = np.array([known[k].sigma_rad for k in group])
    best = int(group[np.argmax(chance[group] / sigma)])
    if patch.origin == "own":
        as_well = found.misfit[best] < (1.0 + KNOWN.alike) * found.misfit[-1]
        if mass.max() < (0.25 if as_well else 0.5):
            return patch
    elif _is_around(patch, found.normals[best], scene):
        return patch
    near = depths[np.abs(depths - found.depth[best]) < 6.0 * (depths[1] - depths[0])]
    found = found.joined(_compared(view, tilted_aside(found.normals[best]), near, exposure, KNOWN.unknown))
    spread = np.sqrt(found.chance(variance) @ angles(found.normals)[best] ** 2)
    return from_elsewhere(patch, scene, known[best].matches, float(spread), known[best].name)


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
    misfit = _misfit(view, normal, exposure)
    sigma = max(patch.tilt_sigma_rad, _noise_rad(patch, scene), KNOWN.sure_rad)
    apart = angles(np.vstack([found.normals, normal]))[-1, :-1]
    found = found._replace(prior=found.prior * np.exp(-0.5 * (apart / sigma) ** 2))
    return found.joined(Compared(normal, misfit, np.zeros(1), np.array([KNOWN.unknown])))


def _support(normals: FloatArray, patch: Patch, scene: Scene) -> FloatArray:
    """(k,) probability of each known orientation beforehand: by the matches on it, all and those around the window."""
    near = scene.evidence.near(patch.window, TUNE.reaches[0])
    around = shares(normals, scene, near * similarity(patch.window, scene, TUNE.reaches[0]))
    support = 0.02 + around + shares(normals, scene, np.ones(len(scene.evidence)))
    support /= np.exp(-((angles(normals) / KNOWN.parallel_rad) ** 2)).sum(axis=1)  # parallel ones share theirs
    return np.asarray(support / support.sum())


def _open_orientations(view: View) -> FloatArray:
    """(k, 3) scaled normals of every tilt that a search for planes knows."""
    centre = view.pixels.rays.mean(0)
    return np.array([[x, y, 1.0 - x * centre[0] - y * centre[1]] for x, y in TILTS])


def _swept(view: View, scene: Scene) -> FloatArray:
    """(n,) inverse depths, 1/baseline, two thirds of a px of the grid apart."""
    return scene.evidence.sweep_depths(1.5 * view.grid.mean_scale, 12, 100)


def tilted_aside(normal: FloatArray) -> FloatArray:
    """(8, 3) normals tilted from this one by what shading may not tell, and by twice as much, to four sides."""
    unit = normal / np.linalg.norm(normal)
    sides = tangent_basis(unit).T
    angle = KNOWN.parallel_rad * np.array([1.0, -1.0, 2.0, -2.0])
    return np.concatenate([np.cos(angle)[:, None] * unit + np.sin(angle)[:, None] * side for side in sides])


def _compared(
    view: View, normals: FloatArray, depths: FloatArray, exposure: Exposure, prior: FloatArray | float
) -> Compared:
    """Planes parallel to the normals (k, 3), each at the best of the inverse depths (n,) in the middle of the window.

    prior : (k,) of each, or one number that all share.
    """
    facing = normals / (normals @ view.pixels.rays.mean(0))[:, None]
    every = np.array([_misfit(view, depths[:, None] * one, exposure) for one in facing])
    each = prior if isinstance(prior, np.ndarray) else np.full(len(normals), prior / len(normals))
    return Compared(facing, every.min(axis=1), depths[every.argmin(axis=1)], each)


def _misfit(view: View, planes: FloatArray, exposure: Exposure) -> FloatArray:
    """(n,) mean squared difference, grey levels, of the window and image 2 through planes (n, 3); inf where unseen."""
    nodes = view.bundle(map_nodes(view.grid))
    layer, ours = view.pyramid2.at(1.0 / view.grid.mean_scale), view.grid.grey.astype(np.float32)
    found = np.full(len(planes), np.inf)
    for i, plane in enumerate(planes):
        table = view.transfer(nodes, plane).reshape(*node_shape(view.grid.shape), 2)
        mapping = spread_table(table, view.grid.shape)
        seen = covered(mapping, view.shape2)
        if seen.mean() < KNOWN.least_seen:
            continue
        off = exposure.gain * sample_layer(layer, mapping) + exposure.offset - ours
        found[i] = np.minimum(off[seen] ** 2, TUNE.same_grey**2).mean()
    return found
