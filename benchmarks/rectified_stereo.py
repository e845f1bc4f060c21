"""What the usual way makes of a pair: images rectified by OpenCV, its semi-global matcher, depths on image 1's rays.

It is given the motion that slopemap found, and the range of depths that slopemap measured. The rotations are those of
`cv2.stereoRectify`; the part of the rectified plane that is looked at is the one that shows the ground, at the scale of
the images, as OpenCV's own choice leaves out much of it where the camera moves towards the ground. Where it moves along
its line of sight the rows of rectified images meet in one point, and there is little that can be matched along them.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from true_ground import FloatArray, camera_rays

from slopecli.types import Camera, Image

BLOCK_PX = 5  # side of the blocks that are matched
PENALTIES = 8 * BLOCK_PX**2, 32 * BLOCK_PX**2  # as OpenCV's documentation gives them
SPARE_PX = 4, 0.1  # disparities beyond those of the ground: px, and share of their range
LEAST_COSINE = 0.2  # of the angle between the axis of a rectified image and what is looked at: 78 degrees
MOST_PX = 1600  # side of a rectified image; beyond, it is shrunk


@dataclass(frozen=True, eq=False)
class Rectified:
    """Rows of both rectified images are along the baseline.

    turns : (3, 3) rotations from the cameras to the rectified axes, with the baseline along x.
    focal_px, first (2,) : px of a direction (x, y, 1) are focal_px (x, y) - first.  size : width and height, px.
    """

    turns: tuple[FloatArray, FloatArray]
    focal_px: float
    first: FloatArray
    size: tuple[int, int]

    def map_of(self, camera: Camera, number: int) -> NDArray[np.float32]:
        """(h, w, 2) px of an image that the pixels of its rectified image show; far outside where there is none."""
        u, v = np.meshgrid(*(np.arange(n) for n in self.size))
        seen = np.dstack([(u + self.first[0]) / self.focal_px, (v + self.first[1]) / self.focal_px, np.ones(u.shape)])
        rays = (seen @ self.turns[number]).reshape(-1, 3)
        ends = camera_rays(camera)[..., :2].reshape(-1, 2)
        flat = rays[:, :2] / np.where(rays[:, 2:] > 1e-6, rays[:, 2:], np.nan)
        inside = ((flat > ends.min(0) - 0.01) & (flat < ends.max(0) + 0.01)).all(1)
        px = np.full((len(rays), 2), -1e4)
        lens = np.array(camera.distortion or (0.0,) * 4)
        zero = np.zeros(3)
        if inside.any():
            px[inside] = cv2.projectPoints(rays[inside], zero, zero, camera.K, lens)[0].reshape(-1, 2)
        return px.reshape(*u.shape, 2).astype(np.float32)


def stereo_points(
    images: tuple[Image, Image], camera: Camera, R: FloatArray, T: FloatArray, ground: FloatArray
) -> FloatArray:
    """(h, w, 3) points of the pixels of image 1, camera-1 axes, in the unit of T; NaN where nothing was matched.

    R, T : motion, P2 = R (P1 - T).  ground : (n, 3) points of the ground, which tell where to look and how far it is.
    """
    turns = rotations(camera, R, T)
    x = ground @ turns[0].T
    x = x[x[:, 2] > LEAST_COSINE * np.linalg.norm(x, axis=1)]
    if len(x) < 0.01 * len(ground):
        return np.full((camera.height, camera.width, 3), np.nan)
    baseline = float((turns[0] @ T)[0])
    pair = window_of(turns, camera.focal_px, x)
    disparity = pair.focal_px * baseline / x[:, 2]
    least, most = np.quantile(disparity, [0.005, 0.995])
    spare = SPARE_PX[0] + SPARE_PX[1] * (most - least)
    count = 16 * int(np.ceil((most - least + 2 * spare) / 16))
    found = _matched(images, camera, pair, int(np.floor(least - spare)), count)
    return on_rays(camera, pair, found, baseline)


def rotations(camera: Camera, R: FloatArray, T: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Those of both cameras to rectified axes, the longest part of the baseline along x, whichever OpenCV chose."""
    lens, size = np.array(camera.distortion or (0.0,) * 4), (camera.width, camera.height)
    first, second, *_ = cv2.stereoRectify(camera.K, lens, camera.K, lens, size, R, -R @ T[:, None], alpha=-1)
    along = first @ T
    if abs(along[1]) > abs(along[0]):  # columns are along the baseline
        quarter = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
        return quarter @ first, quarter @ second
    return first, second


def window_of(turns: tuple[FloatArray, FloatArray], focal_px: float, x: FloatArray) -> Rectified:
    """The part of the rectified plane in which points x (n, 3), rectified axes, lie."""
    flat = x[:, :2] / x[:, 2:]
    low, high = np.quantile(flat, [0.002, 0.998], axis=0)
    focal_px = min(focal_px, MOST_PX / float((high - low).max()))
    first = np.floor(focal_px * low) - BLOCK_PX
    width, height = (int(n) for n in np.ceil(focal_px * high) + BLOCK_PX - first)
    return Rectified(turns, focal_px, first, (width, height))


def _matched(images: tuple[Image, Image], camera: Camera, pair: Rectified, least: int, count: int) -> FloatArray:
    """(h, w) disparities, column of image 1 less that of image 2; NaN where none is told."""
    maps = [pair.map_of(camera, number) for number in (0, 1)]
    shown = [(m > 0).all(2) & (m[..., 0] < camera.width - 1) & (m[..., 1] < camera.height - 1) for m in maps]
    grey = [cv2.remap(one.grey, m, None, cv2.INTER_CUBIC) for one, m in zip(images, maps, strict=True)]
    beside = max(0, least + count, -least)  # columns that would otherwise have no partner within the image
    wide = [cv2.copyMakeBorder(one, 0, 0, beside, beside, cv2.BORDER_CONSTANT) for one in grey]
    matcher = cv2.StereoSGBM_create(
        minDisparity=least,
        numDisparities=count,
        blockSize=BLOCK_PX,
        P1=PENALTIES[0],
        P2=PENALTIES[1],
        disp12MaxDiff=1,
        uniquenessRatio=10,
        speckleWindowSize=100,
        speckleRange=2,
        mode=cv2.STEREO_SGBM_MODE_SGBM,
    )
    sixteenths = matcher.compute(*wide)[:, beside : beside + pair.size[0]]
    found = np.where(sixteenths >= 16 * least, sixteenths / 16.0, np.nan)
    partner = np.arange(pair.size[0]) - np.nan_to_num(found)
    rows = np.broadcast_to(np.arange(pair.size[1])[:, None], partner.shape)
    there = cv2.remap(
        shown[1].astype(np.float32), partner.astype(np.float32), rows.astype(np.float32), cv2.INTER_LINEAR
    )
    return np.where(shown[0] & (there > 0.99), found, np.nan)


def on_rays(camera: Camera, pair: Rectified, disparity: FloatArray, baseline: float) -> FloatArray:
    """(h, w, 3) points on the rays of image 1 at the disparities that its rectified image has there."""
    rays = camera_rays(camera)
    x = rays @ pair.turns[0].T
    ahead = np.where(x[..., 2] > LEAST_COSINE, x[..., 2], np.nan)
    px = (pair.focal_px * x[..., :2] / ahead[..., None] - pair.first).astype(np.float32)
    px[~np.isfinite(px)] = -1e4
    nothing = {"borderMode": cv2.BORDER_CONSTANT, "borderValue": (np.nan,)}
    there = cv2.remap(disparity.astype(np.float32), px, None, cv2.INTER_LINEAR, **nothing).astype(float)
    depth = pair.focal_px * baseline / np.where(there * baseline > 0, there, np.nan)
    return rays * (depth / ahead)[..., None]
