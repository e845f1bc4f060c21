"""Photometric transfer error of planes at each pixel, the motion held fixed.

What does not depend on the plane is computed once, as many planes are compared.
"""

from __future__ import annotations

import cv2
import numpy as np

from slopecli.geometry.statistics import CERTAIN_SIGMAS
from slopecli.look.noise import DIFFERENCE_GREY
from slopecli.look.photometric import View, detrend
from slopecli.look.warp import NODE_STEP, Box, FloatImage, image_gradient, map_nodes, node_shape, spread_table
from slopecli.types import FloatArray

SHADING_PX = 8.0  # working px, sigma of the Gaussian that separates shading from texture
MISPLACED_PX = 0.45  # working px, 1-sigma by which a surface is off its plane: relief, lens, interpolation
TRUNCATED_COST = CERTAIN_SIGMAS * CERTAIN_SIGMAS  # cost of a pixel that is off by three sigmas or more
OUTSIDE = 2 * TRUNCATED_COST  # cost of a pixel that the plane maps outside image 2


class Comparison:
    """Compares the working grid of a view with image 2 through any plane.

    focal_px : of image 1 and of image 2; image 2 is compared at a resolution reduced by their ratio, so that both show
        things at about one size.
    """

    def __init__(self, view: View, focal_px: tuple[float, float]) -> None:
        grid = view.grid
        self.grid, self.shape, self._view = grid, grid.shape, view
        working_per_px2 = grid.mean_scale / (focal_px[1] / focal_px[0])
        self._nodes = view.bundle(map_nodes(grid))
        self._node_number = np.arange(len(self._nodes.rays)).reshape(node_shape(grid.shape))
        grey1 = grid.grey.astype(np.float32)
        self._first = detrend(grey1, SHADING_PX)
        gx, gy = image_gradient(grey1)
        variance = DIFFERENCE_GREY**2 + MISPLACED_PX**2 * (gx * gx + gy * gy)
        self._certainty = (1 / variance).astype(np.float32)
        self.contrast = (gx * gx + gy * gy) * self._certainty
        layer = view.pyramid2.at(1.0 / working_per_px2)
        self._scale2 = layer.scale
        shading_px = SHADING_PX * float(layer.scale.mean()) / working_per_px2
        self._second = detrend(layer.grey.astype(np.float32), shading_px)

    def cost(self, normal: FloatArray, box: Box | None = None) -> FloatImage:
        """(h, w) squared photometric transfer error of a plane, in variances, truncated.

        box : the pixels wanted, all if None; its first row and column are multiples of NODE_STEP.
        """
        rows, columns = box or (slice(0, self.shape[0]), slice(0, self.shape[1]))
        mapping = self._mapping(normal, rows, columns)
        # outside image 2 a grey value that no image holds: faster than a mask of the mapping
        beyond = 1e6
        cost = cv2.remap(
            self._second, mapping, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=beyond
        )  # type: ignore[call-overload]
        outside = cost > 1e-3 * beyond  # also where interpolation mixed a little of it in
        cost -= self._first[rows, columns]
        cost *= cost
        cost *= self._certainty[rows, columns]
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
