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
LEAST_AGREEMENT = 0.5  # correlation of what is the same ground


def contradict(uv1: FloatArray, side_px: float, normal: FloatArray, scene: Scene) -> BoolArray:
    """(k,) cells of image 1 that image 2 should show, and shows otherwise than a plane has them.

    Such a part stands off the plane, moves, or is hidden by what stands off it. Flow alone does not tell: it also gives
    up where it has the right ground before it.

    Parameters
    ----------
    uv1 : (k, 2) px of image 1, centres of the cells.  side_px : of a cell.  normal : (3,) scaled.
    """
    spacing = side_px / SAMPLES
    steps = (np.arange(SAMPLES) - 0.5 * (SAMPLES - 1)) * spacing
    offset = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    points = uv1[:, None] + offset
    far, near = _imaged(points.reshape(-1, 2), normal, scene)
    shape = (len(uv1), SAMPLES**2, 2)
    far, near = far.reshape(shape), near.reshape(shape)
    ours = sample_layer(scene.pyramid1.at(spacing), points.astype(np.float32))
    seen = np.isfinite(near).all((1, 2)) & (ours.std(axis=1) > LEAST_CONTRAST)
    if not seen.any():
        return seen
    apart = median(np.linalg.norm(np.diff(near[seen], axis=1)[:, : SAMPLES - 1], axis=2))
    along = near - far
    along /= np.maximum(np.linalg.norm(along, axis=2, keepdims=True), 1e-9)
    layer = scene.pyramid2.at(apart)
    best = np.full(len(uv1), -1.0)
    for drift in DRIFTS:
        mapping = (near + drift * apart * along).astype(np.float32)
        seen[seen] = covered(mapping[seen], scene.shape2).all(1)
        theirs = sample_layer(layer, np.nan_to_num(mapping, nan=-1.0))
        best = np.maximum(best, _correlation(ours, theirs))
    return np.asarray(seen & (best < LEAST_AGREEMENT))


def _imaged(uv1: FloatArray, normal: FloatArray, scene: Scene) -> tuple[FloatArray, FloatArray]:
    """Pixels (n, 2) of image 2 of points of image 1 at infinity, and on a plane; NaN behind the camera."""
    rays = homogeneous(scene.rays1(uv1))
    turned = rays @ scene.R.T
    moved = turned - (rays @ normal)[:, None] * (scene.R @ scene.T)
    ahead = (moved[:, 2] > 0) & (turned[:, 2] > 0)
    nothing = np.where(ahead, 0.0, np.nan)[:, None]
    depths = (np.where(ahead, points[:, 2], 1.0)[:, None] for points in (turned, moved))
    far, near = (scene.pixels2(points[:, :2] / depth) for points, depth in zip((turned, moved), depths, strict=True))
    return far + nothing, near + nothing


def _correlation(ours: FloatImage, theirs: FloatImage) -> FloatArray:
    """(k,) normalised cross-correlation of rows (k, n)."""
    a, b = ours - ours.mean(axis=1, keepdims=True), theirs - theirs.mean(axis=1, keepdims=True)
    length = np.sqrt((a * a).sum(axis=1) * (b * b).sum(axis=1))
    return np.asarray((a * b).sum(axis=1) / np.maximum(length, 1e-9), float)
