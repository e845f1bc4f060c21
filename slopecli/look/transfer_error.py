"""How well a plane transfers image 1 into image 2, pixel by pixel, and the plane that transfers given pixels best.

The motion is held. What does not depend on the plane is computed once, since hundreds of planes are compared.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from slopecli.geometry.epipolar import homogeneous
from slopecli.look.noise import DIFFERENCE_GREY
from slopecli.look.photometric import detrend, grid_rays
from slopecli.look.warp import (
    NODE_STEP,
    FloatImage,
    Grid,
    Pyramid,
    Transfer,
    covered,
    image_gradient,
    map_nodes,
    node_shape,
    spread_table,
)
from slopecli.types import FloatArray, IntArray

SHADING_PX = 8.0  # working px over which brightness is taken for exposure and shading, not texture
MISPLACED_PX = 0.45  # working px by which a surface may be off its plane (relief, lens, interpolation): 1-sigma
TRUNCATED = 9.0  # cost of a pixel that is off by three sigmas or by any more
OUTSIDE = 2 * TRUNCATED  # cost of a pixel the plane sends outside image 2
GATE = 4.0  # squared sigmas at which a pixel has lost three quarters of its weight in a fit
MIN_SEEN = 0.3  # share of the pixels image 2 must show for a plane to be fitted to them
MAX_STEP_PX, SETTLED_PX = 1.0, 0.02  # working px a step may move pixels by, and by which it ends the fit
SAME_SHIFT_PX = 0.3  # working px a step may move pixels by, and they still move alike with depth

NO_GREY, LEAST_OUTSIDE = 1e6, 1e-3  # grey value beyond image 2, and the share of it by which a pixel lies there
NOWHERE = -1e4  # px: far outside any image 2

Points = tuple[IntArray, IntArray]  # rows and columns of working pixels
Box = tuple[slice, slice]  # rows and columns of a rectangle of them


def transferred(turned: FloatArray, inverse_depth: FloatArray, epipole2: FloatArray, pixels2: Transfer) -> FloatArray:
    """Px of image 2 (n, 2) where points of image 1 are seen; NOWHERE for those behind a camera.

    turned : (n, 3) their homogeneous rays as rows times R.T.  inverse_depth : (n,) 1/baseline.  epipole2 : R T.
    """
    moved = turned - inverse_depth[:, None] * epipole2
    ahead = (moved[:, 2] > 1e-9) & (inverse_depth > 0)
    uv = pixels2(moved[:, :2] / np.where(ahead, moved[:, 2], 1.0)[:, None])
    return np.where(ahead[:, None] & np.isfinite(uv), uv, NOWHERE)


@dataclass(frozen=True, eq=False)
class _Bundle:
    """Homogeneous rays (n, 3) of image 1, as they are and turned into the axes of camera 2."""

    rays: FloatArray
    turned: FloatArray

    @classmethod
    def of(cls, rays: FloatArray, R: FloatArray) -> _Bundle:
        return cls(rays, rays @ R.T)

    def take(self, index: IntArray) -> _Bundle:
        return _Bundle(self.rays[index], self.turned[index])


class Comparison:
    """A working grid over image 1 and image 2 as every plane may send it there.

    Parameters
    ----------
    rays1 : (n, 2) px of image 1 -> normalised.  pixels2 : (n, 2) normalised -> px of image 2.
    R, T : (3, 3) and (3,) motion.  shape2 : (rows, columns) of image 2.  focal_px : of image 1 and of image 2; their
        ratio is by how much larger image 2 shows things, and to be compared it is shrunk by that.
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
        focal_px: tuple[float, float],
    ) -> None:
        self.grid, self.shape, self._shape2, self._focal2_px = grid, grid.shape, shape2, focal_px[1]
        self._working_per_px2 = grid.mean_scale / (focal_px[1] / focal_px[0])
        self._pixels2, self._epipole2 = pixels2, R @ T
        self._nodes = _Bundle.of(homogeneous(rays1(map_nodes(grid))), R)
        self._node_number = np.arange(len(self._nodes.rays)).reshape(node_shape(grid.shape))
        self.everywhere: Box = slice(0, self.shape[0]), slice(0, self.shape[1])
        ours = grid.grey.astype(np.float32)
        self._ours = detrend(ours, SHADING_PX)
        self._certainty = (1 / (DIFFERENCE_GREY**2 + MISPLACED_PX**2 * _squared_gradient(ours))).astype(np.float32)
        layer = pyramid2.at(1.0 / self._working_per_px2)
        self._scale2 = layer.scale
        shading_px = SHADING_PX * float(layer.scale.mean()) / self._working_per_px2
        self._theirs = detrend(layer.grey.astype(np.float32), shading_px)
        gx, gy = image_gradient(self._theirs)
        self._with_slopes = np.dstack([self._theirs, gx * layer.scale[0], gy * layer.scale[1]]).astype(np.float32)
        self._pixels = _Bundle.of(grid_rays(grid, rays1), R)

    def cost(self, normal: FloatArray, step: int = 1, box: Box | None = None) -> FloatImage:
        """(h, w) squared photometric transfer error of a plane, in variances, truncated; of every `step`-th pixel.

        box : the pixels wanted, all when None; its first row and column are multiples of NODE_STEP and of `step`.
        """
        rows, columns = box or self.everywhere
        mapping = np.ascontiguousarray(self._mapping(normal, rows, columns)[::step, ::step])
        # of all ways to treat the border this one is by far the fastest
        cost = cv2.remap(
            self._theirs, mapping, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=NO_GREY
        )  # type: ignore[call-overload]
        outside = cost > NO_GREY * LEAST_OUTSIDE
        cost -= self._ours[rows, columns][::step, ::step]
        cost *= cost
        cost *= self._certainty[rows, columns][::step, ::step]
        np.minimum(cost, np.float32(TRUNCATED), out=cost)
        cost[outside] = OUTSIDE
        return np.asarray(cost, np.float32)

    def _mapping(self, normal: FloatArray, rows: slice, columns: slice) -> FloatImage:
        """(h, w, 2) px of the layer of image 2 that a plane sends the pixels of a box to."""
        shape = (rows.stop - rows.start, columns.stop - columns.start)
        top, left = rows.start // NODE_STEP, columns.start // NODE_STEP
        high, wide = node_shape(shape)
        nodes = self._nodes.take(self._node_number[top : top + high, left : left + wide].ravel())
        return spread_table(self._local(self._sent(nodes, normal)).reshape(high, wide, 2), shape)

    def _local(self, uv: FloatArray) -> FloatArray:
        """Full px of image 2 (n, 2) as px of the layer that is compared."""
        return (uv + 0.5) * self._scale2 - 0.5

    def cost_at(self, points: Points, normal: FloatArray) -> FloatArray:
        """(n,) the same at single pixels."""
        uv = self._sent(self._bundle(points), normal)
        error = self._sample(uv)[:, 0] - self._ours[points]
        seen = covered(uv, self._shape2)
        return np.where(seen, np.minimum(error**2 * self._certainty[points], TRUNCATED), OUTSIDE)

    def apart_px(self, points: Points, normal: FloatArray, others: FloatArray) -> FloatArray:
        """(k,) median working px between where one plane and each of k others (k, 3) send pixels, the lens left out."""
        bundle = self._bundle(points)

        def sent(planes: FloatArray) -> FloatArray:
            moved = bundle.turned - (planes @ bundle.rays.T)[..., None] * self._epipole2
            depth = np.where(moved[..., 2:] > 1e-9, moved[..., 2:], np.nan)
            return np.asarray(moved[..., :2] / depth)

        offset = np.linalg.norm(sent(others) - sent(normal[None]), axis=2) * self._focal2_px * self._working_per_px2
        return np.asarray(np.median(np.nan_to_num(offset, nan=np.inf), axis=1))

    def fit(self, points: Points, normal: FloatArray, iterations: int = 8) -> FloatArray:
        """Scaled normal (3,) that transfers the pixels best, by robust Gauss-Newton from `normal`."""
        imaged = np.isfinite(self._bundle(points).rays[:, 0])  # a lens has no ray for some pixels
        points = points[0][imaged], points[1][imaged]
        bundle, ours, certainty = self._bundle(points), self._ours[points], self._certainty[points]
        rays, most = bundle.rays, np.inf
        for _ in range(iterations):
            uv = self._sent(bundle, normal)
            seen = covered(uv, self._shape2)
            if not seen.any() or seen.mean() < MIN_SEEN:
                break
            if most > SAME_SHIFT_PX:
                shift = self._shift(bundle, normal, uv)
            grey, du, dv = self._sample(uv).T
            error = grey - ours
            jacobian = (du * shift[:, 0] + dv * shift[:, 1])[:, None] * rays
            weight = np.where(seen, certainty / (1 + error**2 * certainty / GATE) ** 2, 0.0)
            system = jacobian.T @ (jacobian * weight[:, None])
            damped = system + 1e-9 * max(float(np.trace(system)), 1e-30) * np.eye(3)
            step = -np.linalg.solve(damped, jacobian.T @ (weight * error))
            moved = np.abs(rays @ step) * np.hypot(*shift.T) * self._working_per_px2
            most = _quantile(moved[seen], 0.95)
            if not np.isfinite(most):
                break
            normal = normal + step * min(1.0, MAX_STEP_PX / max(most, 1e-12))
            if most < SETTLED_PX:
                break
        return normal

    def _bundle(self, points: Points) -> _Bundle:
        return self._pixels.take(points[0] * self.shape[1] + points[1])

    def _sent(self, bundle: _Bundle, normal: FloatArray) -> FloatArray:
        return transferred(bundle.turned, bundle.rays @ normal, self._epipole2, self._pixels2)

    def _shift(self, bundle: _Bundle, normal: FloatArray, uv: FloatArray) -> FloatArray:
        """(n, 2) px of image 2 by which points seen at uv move per unit of inverse depth."""
        step = 1e-3 * float(np.abs(bundle.rays @ normal).mean()) + 1e-12
        return (self._sent(bundle, normal + np.array([0.0, 0.0, step])) - uv) / step

    def _sample(self, uv: FloatArray) -> FloatArray:
        """(n, 3) detrended grey of image 2 and its slope per full px along u and v."""
        local = self._local(uv).astype(np.float32)[:, None]  # a column: no limit on its length
        found = cv2.remap(
            self._with_slopes, local[..., 0], local[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT
        )
        return np.asarray(found[:, 0], float)


def _quantile(values: FloatArray, share: float) -> float:
    """The value that this share of values (n,) do not exceed; numpy's own takes longer than a step of a fit."""
    at = int(share * (len(values) - 1))
    return float(np.partition(values, at)[at])


def _squared_gradient(image: FloatImage) -> FloatImage:
    gx, gy = image_gradient(image)
    return np.asarray(gx * gx + gy * gy, np.float32)
