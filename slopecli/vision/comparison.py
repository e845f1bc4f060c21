"""How well a plane transfers image 1 into image 2, pixel by pixel, and the plane that transfers given pixels best.

The motion is held. What does not depend on the plane is computed once, since hundreds of planes are compared.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import cv2
import numpy as np

from slopecli.geometry.epipolar import homogeneous
from slopecli.types import BoolArray, FloatArray, IntArray
from slopecli.vision.photometric import detrend, grid_rays
from slopecli.vision.warp import FloatImage, Grid, Pyramid, Transfer, covered, image_gradient, map_nodes, spread_nodes

SHADING_PX = 8.0  # working px over which brightness is taken for exposure and shading, not texture
NOISE_GREY = 2.5  # 1-sigma of the difference of two images of one surface, grey levels
MISPLACED_PX = 0.45  # working px by which a surface may be off its plane (relief, lens, interpolation): 1-sigma
TRUNCATED = 9.0  # cost of a pixel that is off by three sigmas or by any more
OUTSIDE = 2 * TRUNCATED  # cost of a pixel the plane sends outside image 2
GATE = 4.0  # squared sigmas at which a pixel has lost three quarters of its weight in a fit
MIN_SEEN = 0.3  # share of the pixels image 2 must show for a plane to be fitted to them
MAX_STEP_PX, SETTLED_PX = 1.0, 0.02  # working px a step may move pixels by, and by which it ends the fit

NOWHERE = -1e4  # px: far outside any image 2

Points = tuple[IntArray, IntArray]  # rows and columns of working pixels


def transferred(
    rays: FloatArray, inverse_depth: FloatArray, R: FloatArray, epipole2: FloatArray, pixels2: Transfer
) -> FloatArray:
    """Px of image 2 (n, 2) where points of image 1 are seen; NOWHERE for those behind a camera.

    rays : (n, 3) homogeneous.  inverse_depth : (n,) 1/baseline.  epipole2 : R T.
    """
    moved = rays @ R.T - inverse_depth[:, None] * epipole2
    ahead = (moved[:, 2] > 1e-9) & (inverse_depth > 0)
    uv = pixels2(moved[:, :2] / np.where(ahead, moved[:, 2], 1.0)[:, None])
    return np.where(ahead[:, None] & np.isfinite(uv), uv, NOWHERE)


@contextmanager
def single_threaded() -> Iterator[None]:
    """OpenCV on one thread: hundreds of small comparisons cost more to hand to threads than they take."""
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(threads)


class Comparison:
    """A working grid over image 1 and image 2 as every plane may send it there.

    Parameters
    ----------
    rays1 : (n, 2) px of image 1 -> normalised.  pixels2 : (n, 2) normalised -> px of image 2.
    R, T : (3, 3) and (3,) motion.  shape2 : (rows, columns) and focal2_px : focal length of image 2.
    """

    def __init__(
        self,
        grid: Grid,
        rays1: Transfer,
        pixels2: Transfer,
        R: FloatArray,
        T: FloatArray,
        pyramid2: Pyramid,
        shape2: tuple[int, int],
        focal2_px: float,
    ) -> None:
        self.grid, self.shape, self._shape2, self._focal2_px = grid, grid.shape, shape2, focal2_px
        self._pixels2, self._R, self._epipole2 = pixels2, R, R @ T
        self._nodes = homogeneous(rays1(map_nodes(grid)))
        ours = grid.grey.astype(np.float32)
        self._ours = detrend(ours, SHADING_PX)
        self._certainty = (1 / (NOISE_GREY**2 + MISPLACED_PX**2 * _squared_gradient(ours))).astype(np.float32)
        layer = pyramid2.at(1.0 / grid.mean_scale)
        self._scale2 = layer.scale
        self._theirs = detrend(layer.grey.astype(np.float32), SHADING_PX * float(layer.scale.mean()) / grid.mean_scale)
        gx, gy = image_gradient(self._theirs)
        self._with_slopes = np.dstack([self._theirs, gx * layer.scale[0], gy * layer.scale[1]]).astype(np.float32)
        self.rays = grid_rays(grid, rays1).reshape(*self.shape, 3)

    def cost(self, normal: FloatArray, step: int = 1) -> FloatImage:
        """(h, w) squared photometric transfer error of a plane, in variances, truncated; of every `step`-th pixel."""
        mapping = spread_nodes(self.grid, self._project(self._nodes, normal))[::step, ::step]
        outside = ~covered(mapping, self._shape2)
        if (self._scale2 != 1).any():
            mapping = (mapping + 0.5) * self._scale2.astype(np.float32) - 0.5
        cost = cv2.remap(
            self._theirs, np.ascontiguousarray(mapping), None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )  # type: ignore[call-overload]
        cost -= self._ours[::step, ::step]
        cost *= cost
        cost *= self._certainty[::step, ::step]
        np.minimum(cost, np.float32(TRUNCATED), out=cost)
        cost[outside] = OUTSIDE
        return np.asarray(cost, np.float32)

    def cost_at(self, points: Points, normal: FloatArray) -> FloatArray:
        """(n,) the same at single pixels."""
        uv, seen = self._sent(points, normal)
        error = self._sample(uv)[:, 0] - self._ours[points]
        return np.where(seen, np.minimum(error**2 * self._certainty[points], TRUNCATED), OUTSIDE)

    def apart_px(self, points: Points, normal: FloatArray, others: FloatArray) -> FloatArray:
        """(k,) median working px between where one plane and each of k others (k, 3) send pixels, the lens left out."""
        rays = self.rays[points]
        turned = rays @ self._R.T

        def sent(planes: FloatArray) -> FloatArray:
            moved = turned - (planes @ rays.T)[..., None] * self._epipole2
            depth = np.where(moved[..., 2:] > 1e-9, moved[..., 2:], np.nan)
            return np.asarray(moved[..., :2] / depth)

        offset = np.linalg.norm(sent(others) - sent(normal[None]), axis=2) * self._focal2_px * self.grid.mean_scale
        return np.asarray(np.median(np.nan_to_num(offset, nan=np.inf), axis=1))

    def fit(self, points: Points, normal: FloatArray, iterations: int = 8) -> FloatArray:
        """Scaled normal (3,) that transfers the pixels best, by robust Gauss-Newton from `normal`."""
        rays, ours, certainty = self.rays[points], self._ours[points], self._certainty[points]
        for _ in range(iterations):
            uv, seen = self._sent(points, normal)
            if seen.mean() < MIN_SEEN:
                break
            depth_step = 1e-3 * float(np.abs(rays @ normal).mean()) + 1e-12
            deeper = normal + np.array([0.0, 0.0, depth_step])
            shift = (self._sent(points, deeper)[0] - uv) / depth_step
            grey, du, dv = self._sample(uv).T
            error = grey - ours
            jacobian = (du * shift[:, 0] + dv * shift[:, 1])[:, None] * rays
            weight = np.where(seen, certainty / (1 + error**2 * certainty / GATE) ** 2, 0.0)
            system = jacobian.T @ (jacobian * weight[:, None])
            damped = system + 1e-9 * max(float(np.trace(system)), 1e-30) * np.eye(3)
            step = -np.linalg.solve(damped, jacobian.T @ (weight * error))
            moved = np.abs(rays @ step) * np.linalg.norm(shift, axis=1) * self.grid.mean_scale
            most = float(np.quantile(moved[seen], 0.95))
            if not np.isfinite(most):
                break
            normal = normal + step * min(1.0, MAX_STEP_PX / max(most, 1e-12))
            if most < SETTLED_PX:
                break
        return normal

    def _project(self, rays: FloatArray, normal: FloatArray) -> FloatArray:
        return transferred(rays, rays @ normal, self._R, self._epipole2, self._pixels2)

    def _sent(self, points: Points, normal: FloatArray) -> tuple[FloatArray, BoolArray]:
        uv = self._project(self.rays[points], normal)
        return uv, covered(uv, self._shape2)

    def _sample(self, uv: FloatArray) -> FloatArray:
        """(n, 3) detrended grey of image 2 and its slope per full px along u and v."""
        local = ((uv + 0.5) * self._scale2 - 0.5).astype(np.float32)[:, None]  # a column: no limit on its length
        found = cv2.remap(
            self._with_slopes, local[..., 0], local[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        return np.asarray(found[:, 0], float)


def _squared_gradient(image: FloatImage) -> FloatImage:
    gx, gy = image_gradient(image)
    return np.asarray(gx * gx + gy * gy, np.float32)
