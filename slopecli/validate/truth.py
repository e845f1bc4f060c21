"""Known ground: points in camera-1 axes with the pixels of image 1 that show them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slopecli.errors import InputError
from slopecli.geometry.camera import pixels_from_rays, rays_from_pixels, scale_camera
from slopecli.types import BoolArray, Camera, FloatArray, IntArray


class TruthTunables(NamedTuple):
    """Tunables of what image 1 shows of the truth."""

    block_px: float = 4.0  # side of the blocks of image 1 in which points behind others are hidden
    behind: float = 1.05  # times the distance of the nearest point of a block, from which on a point is hidden
    like: float = 0.02  # relative difference of the shapes of image 1 and of its depth that rounding makes


SHOWN = TruthTunables()


@dataclass(frozen=True, eq=False)
class Truth:
    """Points of known ground that image 1 shows.

    points : (n, 3) camera-1 axes.  uv : (n, 2) px of image 1.
    in_disparity : whether their noise is that of a disparity, so that planes are fitted to inverse depths.
    """

    points: FloatArray
    uv: FloatArray
    in_disparity: bool = False

    def some(self, which: BoolArray | IntArray) -> Truth:
        """Those of these indices, or of a mask (n,)."""
        return Truth(self.points[which], self.uv[which], self.in_disparity)


def from_depth(depth: NDArray[np.floating], camera: Camera, *, in_disparity: bool = False) -> Truth:
    """The ground of depths along the axis of camera 1, one a pixel of image 1, which may be larger or smaller.

    InputError : the shape is not that of image 1, or no depth is a positive number.
    """
    rows, columns = depth.shape
    if not depth.size or abs(np.log(columns / camera.width / (rows / camera.height))) > SHOWN.like:
        raise InputError(
            f"the truth is {columns}x{rows} px, and image 1 {camera.width}x{camera.height}; needed one value for every "
            "pixel of image 1, or of image 1 enlarged or reduced"
        )
    seen = np.isfinite(depth) & (depth > 0)
    if not seen.any():
        raise InputError("the truth has no positive number; needed depths along the axis of camera 1")
    v, u = np.nonzero(seen)
    places = np.column_stack([u, v]).astype(float)
    rays = rays_from_pixels(scale_camera(camera, columns, rows), places)
    z = depth[seen].astype(float)
    known = np.isfinite(rays).all(axis=1)
    points = np.column_stack([rays * z[:, None], z])[known]
    uv = (places + 0.5) * np.array([camera.width / columns, camera.height / rows]) - 0.5
    return Truth(points, uv[known], in_disparity)


def from_disparity(
    disparity: NDArray[np.floating], cameras: tuple[Camera, Camera], baseline: float, offset_px: float | None
) -> Truth:
    """The ground of disparities, px, of a rectified pair whose left image is image 1: z = fx baseline / (d + offset).

    offset_px : difference of the principal points, cx of the right image less that of the left one, in px of the file;
        None takes that of the cameras of the answer, which is right if image 2 is the right image.

    Raises
    ------
    InputError : as `from_depth`, or image 1 has lens distortion, so that it is not rectified.
    """
    camera = cameras[0]
    if any(camera.distortion):
        raise InputError("a disparity is of rectified images, and camera 1 has lens distortion; give --depth instead")
    scale = disparity.shape[1] / camera.width
    offset = (cameras[1].cx - camera.cx) * scale if offset_px is None else offset_px
    with np.errstate(divide="ignore", invalid="ignore"):
        valid = np.isfinite(disparity) & (disparity > 0)
        depth = np.where(valid, camera.fx * scale * baseline / (disparity + offset), np.nan)
    return from_depth(depth, camera, in_disparity=True)


def from_points(points: FloatArray, camera: Camera) -> Truth:
    """The points (n, 3), camera-1 axes, that image 1 shows: in front of the camera, inside, and not behind others.

    InputError : there is none.
    """
    points = points[np.isfinite(points).all(axis=1) & (points[:, 2] > 0)]
    uv = pixels_from_rays(camera, points[:, :2] / points[:, 2:]) if len(points) else np.empty((0, 2))
    size = np.array([camera.width, camera.height])
    inside = np.isfinite(uv).all(axis=1) & (uv > -0.5).all(axis=1) & (uv < size - 0.5).all(axis=1)
    if not inside.any():
        raise InputError(
            f"image 1 shows none of the {len(points)} points; needed points in camera-1 axes (x right, y down, z "
            "forward), or their --pose: the attitude and the place of camera 1 among them"
        )
    truth = Truth(points[inside], uv[inside])
    block = np.floor(truth.uv / SHOWN.block_px).astype(np.int64)
    _, number = np.unique(block[:, 1] * (camera.width + 1) + block[:, 0], return_inverse=True)
    nearest = np.full(number.max() + 1, np.inf)
    np.minimum.at(nearest, number, truth.points[:, 2])
    return truth.some(truth.points[:, 2] <= SHOWN.behind * nearest[number])
