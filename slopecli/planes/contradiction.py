"""Parts of a window that have texture and yet no match: whether they look in image 2 as its plane would have them."""

from __future__ import annotations

import numpy as np

from slopecli.geometry.epipolar import homogeneous
from slopecli.geometry.quantiles import median
from slopecli.planes.scene import Scene
from slopecli.types import BoolArray, FloatArray
from slopecli.vision.photometric import NOISE_GREY
from slopecli.vision.warp import FloatImage, covered, sample_layer

SAMPLES = 9  # a cell is compared on so many points a side
DRIFTS = (-2, -1, 0, 1, 2)  # spacings of the points by which ground of some relief may miss the plane
LEAST_CONTRAST = 2 * NOISE_GREY  # standard deviation of grey levels below which a cell cannot be compared
OUTSIDE_PX = -1e4
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
    asked = np.flatnonzero(covered(_imaged(uv1, normal, scene)[1], scene.shape2))
    if not len(asked):
        return found
    spacing = side_px / SAMPLES
    steps = (np.arange(SAMPLES) - 0.5 * (SAMPLES - 1)) * spacing
    points = uv1[asked, None] + np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    ours = sample_layer(scene.pyramid1.at(spacing), points.astype(np.float32))
    textured = ours.std(axis=1) > LEAST_CONTRAST
    asked, points, ours = asked[textured], points[textured], ours[textured]
    if len(asked):
        found[asked] = _differ(points, ours, normal, scene)
    return found


def _differ(points: FloatArray, ours: FloatImage, normal: FloatArray, scene: Scene) -> BoolArray:
    """(k,) cells whose points (k, n, 2) of grey values (k, n) image 2 shows, and shows otherwise."""
    far, near = (uv2.reshape(points.shape) for uv2 in _imaged(points.reshape(-1, 2), normal, scene))
    apart = median(np.linalg.norm(np.diff(near, axis=1)[:, : SAMPLES - 1], axis=2))
    along = near - far
    along *= apart / np.maximum(np.linalg.norm(along, axis=2, keepdims=True), 1e-9)
    layer = scene.pyramid2.at(apart)
    seen, best = np.ones(len(points), bool), np.full(len(points), -1.0)
    for drift in DRIFTS:
        mapping = (near + drift * along).astype(np.float32)
        seen &= covered(mapping, scene.shape2).all(1)
        best = np.maximum(best, _correlation(ours, sample_layer(layer, mapping)))
    return np.asarray(seen & (best < LEAST_AGREEMENT))


def _imaged(uv1: FloatArray, normal: FloatArray, scene: Scene) -> tuple[FloatArray, FloatArray]:
    """Pixels (n, 2) of image 2 of points of image 1 at infinity, and on a plane; far outside behind the camera."""
    rays = homogeneous(scene.rays1(uv1))
    turned = rays @ scene.R.T
    moved = turned - (rays @ normal)[:, None] * (scene.R @ scene.T)
    ahead = (moved[:, 2] > 0) & (turned[:, 2] > 0)
    far, near = (scene.pixels2(p[:, :2] / np.where(ahead, p[:, 2], 1.0)[:, None]) for p in (turned, moved))
    near[~ahead] = OUTSIDE_PX
    return far, near


def _correlation(ours: FloatImage, theirs: FloatImage) -> FloatArray:
    """(k,) normalised cross-correlation of rows (k, n)."""
    a, b = ours - ours.mean(axis=1, keepdims=True), theirs - theirs.mean(axis=1, keepdims=True)
    length = np.sqrt((a * a).sum(axis=1) * (b * b).sum(axis=1))
    return np.asarray((a * b).sum(axis=1) / np.maximum(length, 1e-9), float)
