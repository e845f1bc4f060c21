"""Windows over rough ground: their planes through all pixels, in place of those through their matches.

Matches tell the plane of a flat window as well as it can be told. On rough ground the plane of a window is a mean over
its ground, for which all pixels count, and no match may be left out as an outlier.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from slopecli.geometry.statistics import CHI2
from slopecli.ground.footprint_planes import LEAST_SHARE
from slopecli.ground.tilt_uncertainty import Root, focal_shift, motion_gain, normals_under
from slopecli.ground.window_planes import FIT, WindowPlanes, fit_windows, steps_across
from slopecli.look.dense_depth import DenseDepth, measure_depth
from slopecli.look.scene import Scene
from slopecli.look.scene_from_images import FINE
from slopecli.look.threads import single_threaded
from slopecli.look.warp import covered
from slopecli.patches.join import Joined
from slopecli.patches.windows.raw_grey import KNOWN
from slopecli.patches.windows.unmatched_parts import imaged
from slopecli.types import BoolArray, Camera, FloatArray, IntArray, Plane, Solution
from slopecli.windows import Window


class DenseTunables(NamedTuple):
    """When the plane through all pixels takes the place of that through the matches."""

    rough_px: float = 0.5  # RMS relief of the matches, px on the ground, from which on a window is not flat
    # share of a window's pixels that must be matched without doubt; the rest is in the covariance
    least_sure: float = 0.6
    same_ground: float = 1.6  # times the relief of the matches: with more, the pixels show what the matches left out
    # times the variance of the plane through the matches, which lacks that of the ground they leave out: with more, the
    # pixels are too faint to take its place
    as_sure: float = 4.0


DENSE = DenseTunables()


def with_dense_planes(joined: Joined, solution: Solution, scene: Scene, focal_sigma: float) -> tuple[Joined, Solution]:
    """The same patches and solution, with planes through all pixels for the windows of which these tell more.

    focal_sigma : relative 1-sigma of the focal length that the covariances hold.
    """
    index = rough_windows(joined, solution, scene.camera1)
    if solution.solver != "mle" or solution.joint_normals is not None or not len(index):
        return joined, solution
    scene = replace(scene, R=solution.R, T=solution.T)
    shown = [_share_shown(joined.patches[k].footprint.bounds, solution.scaled_normals[k], scene) for k in index]
    # with less, the plane through all pixels is not told; by relief, up to 1 % more of a window can be matched
    index = index[np.array(shown) >= LEAST_SHARE - 0.01]
    if not len(index):
        return joined, solution
    with single_threaded():
        windows = [joined.patches[k].footprint.bounds for k in index]
        depth = measure_depth(scene, windows, _pixels_needed(windows))
    cameras = scene.camera1, scene.camera2
    return with_planes_of_depth(depth, joined, solution, cameras, focal_sigma, DENSE.as_sure, index)


def with_steps(joined: Joined, solution: Solution, scene: Scene, planes: Sequence[Plane]) -> Joined:
    """The patches, those poor of which a part lies across a step: windows called safe that left out matches.

    The plane of a window is that of the matches kept. A few left out are as often mismatches as a drop, but the depth
    of all pixels shows which. Planes that were found in the image are left as they are: they are made of their pixels,
    and the rectangle around these holds other surfaces.

    planes : as reported, with their verdicts.
    """
    called_safe = {plane.id for plane in planes if plane.verdict == "safe"}
    left_out = [patch.source == "window" and patch.left_out > 0.0 for patch in joined.patches]
    index = [k for k, patch in enumerate(joined.patches) if left_out[k] and patch.id in called_safe]
    if not index:
        return joined
    windows = [joined.patches[k].footprint.bounds for k in index]
    with single_threaded():
        depth = measure_depth(replace(scene, R=solution.R, T=solution.T), windows, _pixels_needed(windows))
        stepped = steps_across(depth, windows)
    if not stepped.any():
        return joined
    code, patches = "non-planar-patch", list(joined.patches)
    for k in np.array(index)[stepped].tolist():
        reason = f"{code}: a part of it lies across a step, and its slope is that of the rest"
        patches[k] = replace(patches[k], code=code, reason=reason)
    return replace(joined, patches=tuple(patches))


def _pixels_needed(windows: Sequence[Window]) -> float:
    """Pixels of a working grid around windows, px of image 1, that suffice for the planes of all of them."""
    x, y, w, h = np.array(windows, float).T
    around = float(np.ptp(np.r_[x, x + w]) * np.ptp(np.r_[y, y + h]))
    return min(FINE.max_pixels, around * (FIT.side_px / min(w.min(), h.min())) ** 2)


def _share_shown(window: Window, normal: FloatArray, scene: Scene) -> float:
    """Share of a window, px of image 1, that image 2 shows if its ground is on the plane of a scaled normal (3,)."""
    along = (np.arange(32) + 0.5) / 32  # 1024 places: the share of a straight border to 0.5 %
    places = np.stack(np.meshgrid(along, along), -1).reshape(-1, 2) * window[2:] + window[:2] - 0.5
    return float(covered(imaged(places, normal, scene), scene.shape2, 1.0).mean())


def rough_windows(joined: Joined, solution: Solution, camera: Camera) -> IntArray:
    """Index of the windows over rough ground that have matches of their own."""
    from_matches = np.array([p.source == "window" and p.origin == "own" for p in joined.patches])
    return np.flatnonzero(from_matches & (solution.relief * camera.focal_px > DENSE.rough_px))


def with_planes_of_depth(
    depth: DenseDepth,
    joined: Joined,
    solution: Solution,
    cameras: tuple[Camera, Camera],
    focal_sigma: float,
    as_sure: float,
    index: IntArray | None = None,
) -> tuple[Joined, Solution]:
    """As `with_dense_planes`, by a depth of image 1 that is known, in the baselines of the solution.

    as_sure : times the variance of the plane through the matches, the most that of the one through all pixels may be.
    index : of the windows whose depth it is; None for all `rough_windows`.
    """
    if index is None:
        index = rough_windows(joined, solution, cameras[0])
    if not len(index):
        return joined, solution
    root = Root.of(solution, focal_sigma, cameras)
    with single_threaded():
        dense = fit_windows(depth, [joined.patches[k].footprint.bounds for k in index], root)
    better = _better(dense, solution, joined, index, as_sure)
    if not better.any():
        return joined, solution
    index, patches = index[better], list(joined.patches)
    own = _tilt_variance(dense.normal[better], dense.covariance[better])
    for k, variance, (noise, relief, gaps) in zip(index, own, dense.shares[better].tolist(), strict=True):
        # ground without matches is in the covariance
        patches[k] = replace(
            patches[k],
            tilt_sigma_rad=0.0,
            unmatched_sigma_rad=float(np.sqrt(gaps * variance)),
            off_plane_sigma_rad=0.0,
            surer_cam1=np.zeros(3),
            dense_shares=(noise, relief, gaps),
        )
    return replace(joined, patches=tuple(patches)), _replaced(solution, index, dense, better, root)


def _better(dense: WindowPlanes, solution: Solution, joined: Joined, index: IntArray, as_sure: float) -> BoolArray:
    """(n,) whether a plane through all pixels is of the same ground as that of the matches, agrees, and is as sure."""
    normals = solution.scaled_normals[index]
    sparse, own = (
        _tilt_variance(normals, solution.normal_covariance[index]),
        _tilt_variance(dense.normal, dense.covariance),
    )
    sparse = sparse + np.array([joined.patches[k].tilt_sigma_rad ** 2 for k in index])
    units = [one / np.linalg.norm(one, axis=1, keepdims=True) for one in (normals, dense.normal)]
    apart = 2.0 * np.arcsin(np.minimum(np.linalg.norm(units[0] - units[1], axis=1) / 2.0, 1.0))
    # where the ground that the matches left out leaves the orientation unknown, theirs is not all of the relief
    unknown = (sparse > KNOWN.sure_rad**2) & (DENSE.as_sure**2 * own < sparse)
    most_relief = np.where(unknown, DENSE.same_ground**2, DENSE.same_ground) * solution.relief[index]
    same = dense.told & (dense.planes.sure[0] >= DENSE.least_sure) & (dense.relief < most_relief)
    return np.asarray(same & (own < as_sure * sparse) & (apart**2 < CHI2[2, 0.99] * (own + sparse)))


def _tilt_variance(normals: FloatArray, covariance: FloatArray) -> FloatArray:
    """(n,) mean variance of the tilt about two axes."""
    length2 = (normals**2).sum(axis=1)
    along = np.einsum("ni,nij,nj->n", normals, covariance, normals) / length2
    return np.asarray((np.trace(covariance, axis1=1, axis2=2) - along) / length2 / 2.0)


def _replaced(solution: Solution, index: IntArray, dense: WindowPlanes, better: BoolArray, root: Root) -> Solution:
    """The solution with these planes; in the second root they are those that the same pixels have there."""
    replaced = {
        "scaled_normals": dense.normal,
        "normal_covariance": dense.covariance,
        "normal_gain": motion_gain(dense.planes, root)[0],
        "relief": dense.relief,
    }
    arrays = {name: getattr(solution, name).copy() for name in replaced}
    for name, values in replaced.items():
        arrays[name][index] = values[better]
    if solution.focal_shift is not None:
        shift = arrays["focal_shift"] = solution.focal_shift.copy()
        shift[:-5].reshape(-1, 3)[index] = focal_shift(dense.planes, root)[0][better]
    ambiguity, other = solution.ambiguity, solution.ambiguity.alternative
    if other is not None:
        there, seen = other.scaled_normals.copy(), normals_under(dense.planes, root, other.R, other.T)[0]
        there[index] = seen[better]
        ambiguity = replace(ambiguity, alternative=replace(other, scaled_normals=there))
    return replace(solution, **arrays, ambiguity=ambiguity, joint_normals=None)
