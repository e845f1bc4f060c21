"""Where image 2 shows the pixels of a working grid, given the inverse depth of each of them, with the motion known."""

from __future__ import annotations

import cv2
import numpy as np

from slopecli.geometry.camera import OUTSIDE_PX, rays_from_pixels
from slopecli.geometry.epipolar import homogeneous
from slopecli.look.scene import Scene
from slopecli.look.warp import NODE_STEP, FloatImage, Grid, map_nodes, node_shape, spread_table
from slopecli.types import FloatArray, IntArray

SMALL_STEP = 1e-3  # relative change of depth, and change of a normalised coordinate, of numerical derivatives


class DepthTransfer:
    """Maps pixels with an inverse depth each into image 2. `rays` (h, w, 2): normalised coordinates of the grid."""

    def __init__(self, scene: Scene, grid: Grid) -> None:
        self.grid, self._scene = grid, scene
        self._node_rays = scene.rays1(map_nodes(grid))
        self.rays = spread_table(self._node_rays.reshape(*node_shape(grid.shape), 2), grid.shape)
        self._lens = None if scene.camera2.model == "pinhole" else _Lens(scene)
        self._turn, self._epipole = scene.camera2.K @ scene.R, scene.camera2.K @ scene.R @ scene.T
        x, y = self.rays[..., 0], self.rays[..., 1]
        self._turned = [a * x + b * y + c for a, b, c in self._turn.astype(np.float32)]

    def pixels2(self, w: FloatImage, at: IntArray | None = None) -> FloatImage:
        """(h, w, 2) full px of image 2 of the pixels at inverse depths w (h, w); OUTSIDE_PX behind a camera.

        at (h, w) : flat indices of the pixels; None for all of the grid.
        """
        turned = self._turned if at is None else [row.ravel()[at] for row in self._turned]
        x, y, z = (row - w * e for row, e in zip(turned, self._epipole.astype(np.float32), strict=True))
        hidden = (z < 1e-6) | ~(w > 0)
        z[hidden] = 1.0
        uv = np.empty((*w.shape, 2), np.float32)
        np.divide(x, z, out=uv[..., 0])
        np.divide(y, z, out=uv[..., 1])
        uv[hidden] = OUTSIDE_PX
        return uv if self._lens is None else self._lens.stored(uv)

    def shifts(self, w: FloatArray) -> FloatImage:
        """(h, w, 2) displacement within the grid, px, that a change of the logarithm of inverse depth by 1 looks like.

        w : (rows, columns) inverse depths of the nodes of a map, see `warp.node_shape`.
        """
        p, w = homogeneous(self._node_rays), np.maximum(w.reshape(-1), 1e-12)

        def moved(rays: FloatArray, inverse: FloatArray) -> FloatArray:
            X = rays @ self._turn.T - inverse[:, None] * self._epipole
            return np.asarray(X[:, :2] / np.where(X[:, 2:] > 1e-9, X[:, 2:], np.nan))

        here, aside, below = moved(p, w), p + np.array([SMALL_STEP, 0, 0]), p + np.array([0, SMALL_STEP, 0])
        by_depth = moved(p, w * (1.0 + SMALL_STEP)) - here
        by_place = np.stack([moved(aside, w) - here, moved(below, w) - here], axis=2)
        regular = np.isfinite(by_place).all((1, 2)) & np.isfinite(by_depth).all(1)
        by_place[~regular], by_depth[~regular] = np.eye(2), 0.0
        turned = np.linalg.solve(by_place, by_depth[..., None])[..., 0]
        camera = self._scene.camera1
        px = turned * [camera.fx, camera.fy] * self.grid.scale
        return spread_table(px.reshape(*node_shape(self.grid.shape), 2), self.grid.shape)


class _Lens:
    """Pixels of image 2 as stored from those without distortion, by a table."""

    def __init__(self, scene: Scene) -> None:
        camera, (height, width) = scene.camera2, scene.shape2
        focal, centre = np.array([camera.fx, camera.fy]), np.array([camera.cx, camera.cy])
        u, v = np.arange(-8.0, width + 8.0, 8.0), np.arange(-8.0, height + 8.0, 8.0)
        rows = [np.column_stack([u, np.full_like(u, y)]) for y in (v[0], v[-1])]
        columns = [np.column_stack([np.full_like(v, x), v]) for x in (u[0], u[-1])]
        border = rays_from_pixels(camera, np.vstack(rows + columns)) * focal + centre
        border = np.clip(border[np.isfinite(border).all(1)], -2.0 * max(scene.shape2), 3.0 * max(scene.shape2))
        corners = np.vstack([border, [[0.0, 0.0], [width, height]]])
        self._first = np.floor(corners.min(0))
        count = np.ceil((corners.max(0) - self._first) / NODE_STEP).astype(int) + 2
        x, y = np.meshgrid(*(self._first[k] + NODE_STEP * np.arange(count[k]) for k in (0, 1)))
        ideal = np.stack([x, y], -1).reshape(-1, 2)
        stored = scene.pixels2((ideal - centre) / focal)
        offset = np.where(np.isfinite(stored).all(1, keepdims=True), stored - ideal, OUTSIDE_PX)
        self._offset = offset.reshape(*x.shape, 2).astype(np.float32)

    def stored(self, ideal: FloatImage) -> FloatImage:
        """(h, w, 2) px as stored of px (h, w, 2) without distortion; far outside the image where there are none."""
        at = (ideal - self._first.astype(np.float32)) * np.float32(1 / NODE_STEP)
        beyond = {"borderMode": cv2.BORDER_CONSTANT, "borderValue": (OUTSIDE_PX, OUTSIDE_PX)}
        return np.asarray(ideal + cv2.remap(self._offset, at, None, cv2.INTER_LINEAR, **beyond))  # type: ignore[call-overload]
