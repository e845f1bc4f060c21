"""Parts of a window that have texture and yet no match: whether they look in image 2 as its plane would have them."""

from __future__ import annotations

import numpy as np

from slopecli.geometry.epipolar import homogeneous
from slopecli.geometry.statistics import median
from slopecli.look.noise import NOISE_GREY
from slopecli.look.scene import Scene
from slopecli.look.warp import FloatImage, covered, sample_layer
from slopecli.types import BoolArray, FloatArray

SAMPLES = 9  # a cell is compared on so many points a side
DRIFTS = (-2, -1, 0, 1, 2)  # spacings of the points by which ground of some relief may miss the plane
LEAST_CONTRAST = 2 * NOISE_GREY  # standard deviation of grey levels below which a cell cannot be compared
OUTSIDE_PX = -1e4
DRIFTED = 0.99  # inverse depth that tells which way ground off the plane is displaced in image 2
LEAST_AGREEMENT = 0.5  # correlation of what is the same ground


def contradict(uv1: FloatArray, side_px: float, normal: FloatArray, scene: Scene) -> BoolArray:
    """(k,) cells of image 1 that image 2 should show, and shows otherwise than a plane has them.

    Such a part stands off the plane, moves, or is hidden by what stands off it. Flow alone does not tell: it also gives
    up where it has the right ground before it.

    Parameters
    ----------
    uv1 : (k, 2) px of image 1, centres of the cells.  side_px : of a cell.  normal : (3,) scaled.
    """
    found = np.zeros(len(uv1), bool)
    asked = np.flatnonzero(covered(_imaged(uv1, normal, scene), scene.shape2))
    if not len(asked):
        return found
    spacing = side_px / SAMPLES
    steps = (np.arange(SAMPLES) - 0.5 * (SAMPLES - 1)) * spacing
    points = uv1[asked, None] + np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    ours = sample_layer(scene.pyramid1.at(spacing), points.astype(np.float32))
    near = _imaged(points.reshape(-1, 2), normal, scene).reshape(points.shape)
    kept = covered(near, scene.shape2).all(1) & (ours.std(axis=1) > LEAST_CONTRAST)
    if kept.any():
        drifted = _imaged(points[kept].reshape(-1, 2), DRIFTED * normal, scene).reshape(-1, *points.shape[1:])
        found[asked[kept]] = _differ(ours[kept], near[kept], drifted - near[kept], scene)
    return found


def _differ(ours: FloatImage, near: FloatArray, along: FloatArray, scene: Scene) -> BoolArray:
    """(k,) cells of grey values (k, n) that image 2 shows otherwise at px (k, n, 2), and near them along (k, n, 2)."""
    apart = median(np.linalg.norm(np.diff(near, axis=1)[:, : SAMPLES - 1], axis=2))
    along = along * (apart / np.maximum(np.linalg.norm(along, axis=2, keepdims=True), 1e-9))
    layer = scene.pyramid2.at(apart)
    seen, best = np.ones(len(near), bool), np.full(len(near), -1.0)
    for drift in DRIFTS:
        mapping = (near + drift * along).astype(np.float32)
        seen &= covered(mapping, scene.shape2).all(1)
        best = np.maximum(best, _correlation(ours, sample_layer(layer, mapping)))
    return np.asarray(seen & (best < LEAST_AGREEMENT))


def _imaged(uv1: FloatArray, normal: FloatArray, scene: Scene) -> FloatArray:
    """Pixels (n, 2) of image 2 of points of image 1 on a plane; far outside where one of the cameras has it behind it,
    or no picture of it."""
    rays = homogeneous(scene.rays1(uv1))
    w = rays @ normal
    moved = (rays - w[:, None] * scene.T) @ scene.R.T
    ahead = (w > 0) & (moved[:, 2] > 0)
    uv2 = scene.pixels2(moved[:, :2] / np.where(ahead, moved[:, 2], 1.0)[:, None])
    uv2[~(ahead & np.isfinite(uv2).all(1))] = OUTSIDE_PX
    return uv2


def _correlation(ours: FloatImage, theirs: FloatImage) -> FloatArray:
    """(k,) normalised cross-correlation of rows (k, n)."""
    a, b = ours - ours.mean(axis=1, keepdims=True), theirs - theirs.mean(axis=1, keepdims=True)
    length = np.sqrt((a * a).sum(axis=1) * (b * b).sum(axis=1))
    return np.asarray((a * b).sum(axis=1) / np.maximum(length, 1e-9), float)
