"""Many windows at once: the motion comes from a few large windows, their planes from one pass over all pixels.

A fine grid matched window by window costs some 10 ms each, and small windows have few matches. A dense depth serves all
of them. Windows without depth of their own have the plane that is known around them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import starmap
from typing import NamedTuple

import numpy as np

from slopecli.errors import NoAnswer
from slopecli.geometry.epipolar import normal_angle
from slopecli.geometry.statistics import robust_sigma
from slopecli.ground.footprint_planes import FootprintPlanes
from slopecli.ground.tilt_uncertainty import Root, focal_shift, motion_gain, normal_covariance, normals_under
from slopecli.ground.window_planes import WindowPlanes, across_steps, box_sums, fit_windows, onto_bare, parts_of
from slopecli.look.dense_depth import DEPTH, DenseDepth, measure_depth
from slopecli.look.matches import Matches, pair_rays, thin
from slopecli.look.noise import LEAST_MATCH_PX
from slopecli.look.scene import Scene
from slopecli.look.threads import single_threaded
from slopecli.look.warp import covered
from slopecli.options import MANY_WINDOWS, Options
from slopecli.patches.join import OUTSIDE_POINTS, Joined, outside_weight
from slopecli.patches.neighbours import nearest_of
from slopecli.patches.patch import LEAST_MATCHED, Patch, weight_of
from slopecli.patches.windows.borrowed import why_unmatched
from slopecli.patches.windows.tunables import TUNE
from slopecli.patches.windows.window_finder import wanted_windows, window_patch
from slopecli.types import FloatArray, IntArray, Solution
from slopecli.windows import Window


class ManyWindowsTunables(NamedTuple):
    """Which of many windows have an answer of the dense depth, and what the others have."""

    neighbours: int = 8  # answered windows whose orientation one without an answer has
    pairs: int = 4096  # of windows that tell how much orientations differ, in so many groups by distance:
    groups: int = 16
    every_px: int = 4  # grid px between the pixels that stand for its matches; nearer ones share their errors


MANY = ManyWindowsTunables()


def many_windows(options: Options, width: int, height: int) -> list[Window]:
    """The windows wanted of an image of this size, px, if they are to be answered together; else none."""
    if options.planes != "windows" or options.solver != "mle" or options.features != "sift" or options.merge_coplanar:
        return []
    windows = wanted_windows(options, width, height)
    return windows if len(windows) >= MANY_WINDOWS else []


def answer_together(
    windows: Sequence[Window], joined: Joined, solution: Solution, scene: Scene, focal_sigma: float
) -> tuple[Joined, Solution]:
    """Patches of all windows, and the solution with their planes.

    Parameters
    ----------
    joined, solution : of a few large windows, whose motion is kept.  focal_sigma : that the covariances hold.

    Raises
    ------
    NoAnswer : no window has a plane.
    """
    scene = replace(scene, R=solution.R, T=solution.T)
    root = Root.of(solution, focal_sigma, (scene.camera1, scene.camera2))
    with single_threaded():
        depth = measure_depth(scene, windows, DEPTH.most_pixels)
        dense = fit_windows(depth, windows, root)
        own = _with_unseen(_own_patches(windows, depth, dense, scene), depth, dense.planes, scene)
        patches, planes = _borrowed(own, depth, dense.planes, scene)
    chosen = [k for k, patch in enumerate(patches) if patch.origin != "none"]
    if not chosen:
        raise NoAnswer(
            "low-texture",
            f"none of the {len(patches)} windows can be matched: {patches[0].reason}",
            "choose windows with texture that both images show",
        )
    every = normal_covariance(planes, root, np.zeros((*planes.cells.shape, 2, 2)))[0]
    lent = np.array([patch.origin == "borrowed" for patch in patches])
    covariance = np.where(lent[:, None, None], every, dense.covariance)
    answered = WindowPlanes(planes.some(np.array(chosen)), covariance[chosen], dense.shares[chosen])
    outside = scene.evidence.take(thin(scene.evidence.uv1, np.arange(len(scene.evidence)), OUTSIDE_POINTS))
    together = Joined.of(patches, outside, outside_weight(scene, len(outside)))
    return together, _solution_of(solution, answered, len(together.matches), root)


def _own_patches(windows: Sequence[Window], depth: DenseDepth, dense: WindowPlanes, scene: Scene) -> list[Patch]:
    """A patch a window, with pixels of the depth as its matches where it has enough, else without any."""
    share, sure = dense.planes.share[0], dense.planes.sure[0]
    own = np.isfinite(dense.covariance).all((1, 2)) & (share >= LEAST_MATCHED) & (sure >= TUNE.scarce_share)
    doubts = _doubts(depth, windows, dense.planes)
    matches, lattice = _matches(depth, scene)
    sigma_px = max(robust_sigma(depth.across_px[depth.known].astype(float)), LEAST_MATCH_PX) / depth.grid.mean_scale
    patches = list(starmap(window_patch, zip(windows, range(1, len(windows) + 1), strict=True)))
    parts = -(-parts_of(depth, windows) // MANY.every_px)
    for k in np.flatnonzero(own):
        noise, relief, gaps = dense.shares[k].tolist()
        inside = lattice[slice(*parts[k, 0].tolist()), slice(*parts[k, 1].tolist())]
        kept = inside >= 0
        index = inside[kept]
        if len(index):
            patches[k] = replace(
                patches[k],
                matches=matches.take(index),
                weight=weight_of(np.full(len(index), sigma_px**2)),
                cell=np.column_stack(kept.nonzero()),
                origin="own",
                score=1.0,
                share=float(share[k]),
                dense_shares=(noise, relief, gaps),
                code=doubts[k][0],
                reason=doubts[k][1],
            )
    return patches


def _doubts(depth: DenseDepth, windows: Sequence[Window], planes: FootprintPlanes) -> list[tuple[str, str]]:
    """Diagnostic code and reason in words why the plane of a window is poor, for each; empty where it is not."""
    stepped, bare = across_steps(depth, windows, planes), onto_bare(depth, windows)
    step = "non-planar-patch", "across a step: no surface has this slope"
    drop = "low-texture", "part of it has no texture of its own, and may be a drop"
    return [step if a else drop if b else ("", "") for a, b in zip(stepped.tolist(), bare.tolist(), strict=True)]


def _with_unseen(patches: list[Patch], depth: DenseDepth, planes: FootprintPlanes, scene: Scene) -> list[Patch]:
    """The patches, with a tilt sigma for the part that image 2 does not show.

    It is the RMS angle between windows of the pair that are far apart, times the share of that part.
    """
    windows = [patch.window for patch in patches]
    parts = parts_of(depth, windows)
    hidden = 1.0 - box_sums(covered(depth.uv2, scene.shape2), parts) / np.diff(parts, axis=-1)[..., 0].prod(1)
    partly = [k for k, patch in enumerate(patches) if patch.origin == "own" and hidden[k] > 0.0]
    index = _without_doubt(patches)
    if not partly or len(index) < MANY.neighbours:
        return patches
    anywhere = np.full(len(partly), np.inf)
    sigma = hidden[partly] * _angle_between(_middles(windows)[index], planes.normal[0, index], anywhere)
    patches = list(patches)
    for k, sigma_rad in zip(partly, sigma.tolist(), strict=True):
        patches[k] = replace(patches[k], tilt_sigma_rad=sigma_rad, unmatched_sigma_rad=sigma_rad)
    return patches


def _without_doubt(patches: Sequence[Patch]) -> IntArray:
    """Indices of the windows whose own plane is not poor."""
    return np.flatnonzero([patch.origin == "own" and not patch.reason for patch in patches])


def _middles(windows: Sequence[Window]) -> FloatArray:
    """(n, 2) px."""
    return np.array([(x + w / 2, y + h / 2) for x, y, w, h in windows])


def _matches(depth: DenseDepth, scene: Scene) -> tuple[Matches, IntArray]:
    """Pixels of the depth, `MANY.every_px` apart, as matches, and (rows, columns) the index of each, -1 for none."""
    rows, columns = (np.arange(0, n, MANY.every_px) for n in depth.w.shape)
    known, uv2 = (values[:: MANY.every_px, :: MANY.every_px] for values in (depth.known, depth.uv2))
    uv1 = depth.grid.full(np.stack(np.meshgrid(columns, rows), -1)[known].astype(float))
    x1, x2, seen = pair_rays(scene.camera1, scene.camera2, uv1, uv2[known].astype(float))
    lattice = np.full(known.shape, -1)
    lattice[known] = np.where(seen, np.arange(len(uv1)), -1)
    return Matches(uv1, uv2[known].astype(float), x1, x2), lattice


def _borrowed(
    patches: list[Patch], depth: DenseDepth, planes: FootprintPlanes, scene: Scene
) -> tuple[list[Patch], FootprintPlanes]:
    """The patches and planes, with the mean orientation of the nearest answered windows for those without one.

    The 1-sigma of their tilt is the RMS angle between answered windows as far apart as these are.
    """
    known = np.array([patch.origin == "own" for patch in patches])
    rest = np.flatnonzero(~known)
    if not len(rest):
        return patches, planes
    windows = [patch.window for patch in patches]
    reasons = _reasons(depth, windows, scene)
    index = _without_doubt(patches)
    if len(index) < MANY.neighbours:
        nothing = "and too few windows around it can be matched"
        return [
            patch if patch.origin == "own" else patch.unmatched(f"{why}, {nothing}", code)
            for patch, (code, why) in zip(patches, reasons, strict=True)
        ], planes
    middle = _middles(windows)
    away, nearest = nearest_of(middle[index], middle[rest], MANY.neighbours)
    units = planes.normal[0, index]
    mean = units[nearest].mean(axis=1)
    sigma = _angle_between(middle[index], units, away[:, -1])
    normal, middles, relief = planes.normal.copy(), planes.middle.copy(), planes.relief.copy()
    normal[0, rest] = mean / np.linalg.norm(mean, axis=1, keepdims=True)
    middles[0, rest], relief[0, rest] = middles[0, index[nearest[:, 0]]], 0.0
    patches = list(patches)
    for k, from_k, sigma_rad in zip(rest.tolist(), index[nearest[:, 0]].tolist(), sigma.tolist(), strict=True):
        code, why = reasons[k]
        lent = patches[from_k]
        patches[k] = replace(
            patches[k],
            matches=lent.matches,
            weight=lent.weight,
            cell=lent.cell,
            origin="borrowed",
            reason=f"{why}: this is the orientation of the windows nearest to it, its distance is theirs",
            code=code,
            tilt_sigma_rad=max(sigma_rad, TUNE.unexplained_rad if code == "poor-fit" else 0.0),
        )
    return patches, replace(planes, normal=normal, middle=middles, relief=relief)


def _angle_between(places: FloatArray, units: FloatArray, away: FloatArray) -> FloatArray:
    """(k,) RMS angle, rad, between planes at distances `away` (k,) px from each other.

    It is measured on pairs of planes with middles (n, 2) px and unit normals (n, 3), and does not fall with distance.
    """
    rng = np.random.default_rng(0)
    i, j = rng.integers(0, len(places), (2, MANY.pairs))
    i, j = i[i != j], j[i != j]
    apart = np.linalg.norm(places[i] - places[j], axis=1)
    angle2 = normal_angle(units[i], units[j]) ** 2
    order = np.argsort(apart)
    groups = np.array_split(order, max(1, min(len(order) // MANY.neighbours, MANY.groups)))
    distance = np.array([apart[group].mean() for group in groups])
    return np.interp(away, distance, np.maximum.accumulate([np.sqrt(angle2[group].mean()) for group in groups]))


def _reasons(depth: DenseDepth, windows: Sequence[Window], scene: Scene) -> list[tuple[str, str]]:
    """Diagnostic code and reason in words why a window has no depth of its own, for each."""
    parts, grey = parts_of(depth, windows), depth.grid.grey.astype(np.float32)
    area = np.diff(parts, axis=-1)[..., 0].prod(1)
    layers = covered(depth.uv2, scene.shape2), grey, grey * grey
    shown, mean, square = (box_sums(layer, parts) / area for layer in layers)
    contrast = np.sqrt(np.maximum(square - mean**2, 0.0))
    return [why_unmatched(*one) for one in zip(shown.tolist(), contrast.tolist(), strict=True)]


def _solution_of(solution: Solution, dense: WindowPlanes, n_matches: int, root: Root) -> Solution:
    """The solution with these planes in place of its own, in its second root too."""
    planes, every = dense.planes, np.ones(n_matches, bool)
    shift = None
    if solution.focal_shift is not None:
        shift = np.concatenate([focal_shift(planes, root)[0].ravel(), solution.focal_shift[-5:]])

    def with_planes(one: Solution, normals: FloatArray) -> Solution:
        """One root with the planes that the same pixels have there."""
        return replace(
            one,
            scaled_normals=normals,
            normal_covariance=dense.covariance,
            normal_gain=motion_gain(planes, root)[0],
            relief=dense.relief,
            inlier=every,
            joint_normals=None,
            focal_shift=shift,
        )

    ambiguity, other = solution.ambiguity, solution.ambiguity.alternative
    if other is not None:
        second = with_planes(other, normals_under(planes, root, other.R, other.T)[0])
        ambiguity = replace(ambiguity, alternative=second)
    return replace(with_planes(solution, dense.normal), ambiguity=ambiguity)
