"""Photometric transfer error of planes at each pixel, and the plane of least error for given pixels.

The motion is held fixed. What does not depend on the plane is computed once, as hundreds of planes are compared.
"""

from __future__ import annotations

import cv2
import numpy as np

from slopecli.geometry.statistics import geman_mcclure
from slopecli.look.noise import DIFFERENCE_GREY
from slopecli.look.photometric import MAX_STEP_PX, MIN_SEEN, Bundle, View, detrend
from slopecli.look.warp import NODE_STEP, FloatImage, covered, image_gradient, map_nodes, node_shape, spread_table
from slopecli.types import FloatArray, IntArray

SHADING_PX = 8.0  # working px, sigma of the Gaussian that separates shading from texture
MISPLACED_PX = 0.45  # working px, 1-sigma by which a surface is off its plane: relief, lens, interpolation
TRUNCATED_COST = 9.0  # cost of a pixel that is off by three sigmas or more
OUTSIDE = 2 * TRUNCATED_COST  # cost of a pixel that the plane maps outside image 2

Points = tuple[IntArray, IntArray]  # rows and columns of working pixels
Box = tuple[slice, slice]  # rows and columns of a rectangle of them


class Comparison:
    """Compares the working grid of a view with image 2 through any plane.

    focal_px : of image 1 and of image 2; image 2 is compared at a resolution reduced by their ratio, so that both show
        things at about one size.
    """

    def __init__(self, view: View, focal_px: tuple[float, float]) -> None:
        grid = view.grid
        self.grid, self.shape, self._view, self._focal2_px = grid, grid.shape, view, focal_px[1]
        self._working_per_px2 = grid.mean_scale / (focal_px[1] / focal_px[0])
        self._nodes = view.bundle(map_nodes(grid))
        self._node_number = np.arange(len(self._nodes.rays)).reshape(node_shape(grid.shape))
        self.everywhere: Box = slice(0, self.shape[0]), slice(0, self.shape[1])
        grey1 = grid.grey.astype(np.float32)
        self._first = detrend(grey1, SHADING_PX)
        gx, gy = image_gradient(grey1)
        variance = DIFFERENCE_GREY**2 + MISPLACED_PX**2 * (gx * gx + gy * gy)
        self._certainty = (1 / variance).astype(np.float32)
        layer = view.pyramid2.at(1.0 / self._working_per_px2)
        self._scale2 = layer.scale
        shading_px = SHADING_PX * float(layer.scale.mean()) / self._working_per_px2
        self._second = detrend(layer.grey.astype(np.float32), shading_px)
        gx, gy = image_gradient(self._second)
        self._with_gradient = np.dstack([self._second, gx * layer.scale[0], gy * layer.scale[1]]).astype(np.float32)

    def cost(self, normal: FloatArray, step: int = 1, box: Box | None = None) -> FloatImage:
        """(h, w) squared photometric transfer error of a plane, in variances, truncated; of every `step`-th pixel.

        box : the pixels wanted, all if None; its first row and column are multiples of NODE_STEP and of `step`.
        """
        rows, columns = box or self.everywhere
        mapping = np.ascontiguousarray(self._mapping(normal, rows, columns)[::step, ::step])
        # outside image 2 a grey value that no image holds: faster than a mask of the mapping
        beyond = 1e6
        cost = cv2.remap(
            self._second, mapping, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=beyond
        )  # type: ignore[call-overload]
        outside = cost > 1e-3 * beyond  # also where interpolation mixed a little of it in
        cost -= self._first[rows, columns][::step, ::step]
        cost *= cost
        cost *= self._certainty[rows, columns][::step, ::step]
        np.minimum(cost, np.float32(TRUNCATED_COST), out=cost)
        cost[outside] = OUTSIDE
        return np.asarray(cost, np.float32)

    def _mapping(self, normal: FloatArray, rows: slice, columns: slice) -> FloatImage:
        """(h, w, 2) px of the layer of image 2 that a plane maps the pixels of a box to."""
        shape = (rows.stop - rows.start, columns.stop - columns.start)
        top, left = rows.start // NODE_STEP, columns.start // NODE_STEP
        high, wide = node_shape(shape)
        nodes = self._nodes.take(self._node_number[top : top + high, left : left + wide].ravel())
        return spread_table(self._local(self._view.transfer(nodes, normal)).reshape(high, wide, 2), shape)

    def _local(self, uv: FloatArray) -> FloatArray:
        """Full px of image 2 (n, 2) as px of the layer that is compared."""
        return (uv + 0.5) * self._scale2 - 0.5

    def cost_at(self, points: Points, normal: FloatArray) -> FloatArray:
        """(n,) the cost of single pixels."""
        uv = self._view.transfer(self._bundle(points), normal)
        error = self._sample(uv)[:, 0] - self._first[points]
        seen = covered(uv, self._view.shape2)
        return np.where(seen, np.minimum(error**2 * self._certainty[points], TRUNCATED_COST), OUTSIDE)

    def apart_px(self, points: Points, normal: FloatArray, others: FloatArray) -> FloatArray:
        """(k,) median distance, working px, between where a plane and each of k others (k, 3) map pixels; no lens."""
        bundle = self._bundle(points)

        def mapped(planes: FloatArray) -> FloatArray:
            moved = bundle.turned - (planes @ bundle.rays.T)[..., None] * (self._view.R @ self._view.T)
            depth = np.where(moved[..., 2:] > 1e-9, moved[..., 2:], np.nan)
            return np.asarray(moved[..., :2] / depth)

        offset = np.linalg.norm(mapped(others) - mapped(normal[None]), axis=2) * self._focal2_px * self._working_per_px2
        return np.asarray(np.median(np.nan_to_num(offset, nan=np.inf), axis=1))

    def fit(self, points: Points, normal: FloatArray, iterations: int = 8) -> FloatArray:
        """Scaled normal (3,) of least transfer error at the pixels, by robust Gauss-Newton from `normal`."""
        imaged = np.isfinite(self._bundle(points).rays[:, 0])  # a lens model has no ray for some pixels
        points = points[0][imaged], points[1][imaged]
        bundle, first, certainty = self._bundle(points), self._first[points], self._certainty[points]
        for _ in range(iterations):
            uv = self._view.transfer(bundle, normal)
            seen = covered(uv, self._view.shape2)
            if not seen.any() or seen.mean() < MIN_SEEN:
                break
            shift = self._shift(bundle, normal, uv)
            second, du, dv = self._sample(uv).T
            error = second - first
            jacobian = (du * shift[:, 0] + dv * shift[:, 1])[:, None] * bundle.rays
            weight = np.where(seen, certainty * geman_mcclure(error * np.sqrt(certainty), 2.0), 0.0)
            system = jacobian.T @ (jacobian * weight[:, None])
            damped = system + 1e-9 * max(float(np.trace(system)), 1e-30) * np.eye(3)
            step = -np.linalg.solve(damped, jacobian.T @ (weight * error))
            moved = np.abs(bundle.rays @ step) * np.hypot(*shift.T) * self._working_per_px2
            reach = float(np.quantile(moved[seen], 0.95))
            if not np.isfinite(reach):
                break
            normal = normal + step * min(1.0, MAX_STEP_PX / max(reach, 1e-12))
            if reach < 0.02:  # working px
                break
        return normal

    def _bundle(self, points: Points) -> Bundle:
        return self._view.pixels.take(points[0] * self.shape[1] + points[1])

    def _shift(self, bundle: Bundle, normal: FloatArray, uv: FloatArray) -> FloatArray:
        """(n, 2) displacement, px of image 2, per unit of inverse depth, of points mapped to uv."""
        step = 1e-3 * float(np.abs(bundle.rays @ normal).mean()) + 1e-12
        return (self._view.transfer(bundle, normal + np.array([0.0, 0.0, step])) - uv) / step

    def _sample(self, uv: FloatArray) -> FloatArray:
        """(n, 3) detrended grey values of image 2 and their gradient along u and v, per full px."""
        local = self._local(uv).astype(np.float32)[:, None]  # a column, as OpenCV allows at most 32767 points in a row
        found = cv2.remap(
            self._with_gradient, local[..., 0], local[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT
        )
        return np.asarray(found[:, 0], float)
