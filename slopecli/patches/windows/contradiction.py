"""Unmatched textured cells of a window compared with image 2 at the place where the window's plane puts them."""

from __future__ import annotations

import numpy as np

from slopecli.geometry.epipolar import homogeneous
from slopecli.geometry.statistics import median
from slopecli.look.noise import NOISE_GREY
from slopecli.look.scene import Scene
from slopecli.look.warp import FloatImage, covered, sample_layer
from slopecli.patches.windows.tunables import TUNE
from slopecli.types import BoolArray, FloatArray


def contradict(uv1: FloatArray, side_px: float, normal: FloatArray, scene: Scene) -> BoolArray:
    """(k,) cells of image 1 that are textured and in view of image 2, but do not correlate with it under a plane.

    Such a part stands off the plane, moves, or is hidden. A missing match alone does not show that: flow also fails
    on ground that is on the plane.

    Parameters
    ----------
    uv1 : (k, 2) px of image 1, centres of the cells.  side_px : of a cell.  normal : (3,) scaled.
    """
    found = np.zeros(len(uv1), bool)
    asked = np.flatnonzero(covered(_imaged(uv1, normal, scene), scene.shape2))
    if not len(asked):
        return found
    spacing = side_px / TUNE.samples
    steps = (np.arange(TUNE.samples) - 0.5 * (TUNE.samples - 1)) * spacing
    points = uv1[asked, None] + np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    ours = sample_layer(scene.pyramid1.at(spacing), points.astype(np.float32))
    near = _imaged(points.reshape(-1, 2), normal, scene).reshape(points.shape)
    kept = covered(near, scene.shape2).all(1) & (ours.std(axis=1) > 2 * NOISE_GREY)
    if kept.any():
        drifted = _imaged(points[kept].reshape(-1, 2), 0.99 * normal, scene).reshape(-1, *points.shape[1:])
        found[asked[kept]] = _differ(ours[kept], near[kept], drifted - near[kept], scene)
    return found


def _differ(ours: FloatImage, near: FloatArray, along: FloatArray, scene: Scene) -> BoolArray:
    """(k,) cells of grey values (k, n) without correlation in image 2, at px near (k, n, 2) and displaced `along`."""
    apart = median(np.linalg.norm(np.diff(near, axis=1)[:, : TUNE.samples - 1], axis=2))
    along = along * (apart / np.maximum(np.linalg.norm(along, axis=2, keepdims=True), 1e-9))
    layer = scene.pyramid2.at(apart)
    seen, best = np.ones(len(near), bool), np.full(len(near), -1.0)
    for drift in range(-2, 3):  # spacings of the points by which ground of some relief may miss the plane
        mapping = (near + drift * along).astype(np.float32)
        seen &= covered(mapping, scene.shape2).all(1)
        best = np.maximum(best, _correlation(ours, sample_layer(layer, mapping)))
    return np.asarray(seen & (best < TUNE.same_ground_score))


def _imaged(uv1: FloatArray, normal: FloatArray, scene: Scene) -> FloatArray:
    """Pixels (n, 2) of image 2 of points (n, 2) of image 1 on a plane; far outside the image where there are none."""
    rays = homogeneous(scene.rays1(uv1))
    w = rays @ normal
    moved = (rays - w[:, None] * scene.T) @ scene.R.T
    ahead = (w > 0) & (moved[:, 2] > 0)
    uv2 = scene.pixels2(moved[:, :2] / np.where(ahead, moved[:, 2], 1.0)[:, None])
    uv2[~(ahead & np.isfinite(uv2).all(1))] = -1e4
    return uv2


def _correlation(ours: FloatImage, theirs: FloatImage) -> FloatArray:
    """(k,) normalised cross-correlation of rows (k, n)."""
    a, b = ours - ours.mean(axis=1, keepdims=True), theirs - theirs.mean(axis=1, keepdims=True)
    length = np.sqrt((a * a).sum(axis=1) * (b * b).sum(axis=1))
    return np.asarray((a * b).sum(axis=1) / np.maximum(length, 1e-9), float)
