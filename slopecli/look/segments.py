"""Straight edges of an image, by their rays: what tells vanishing points."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from slopecli.geometry.camera import rays_from_pixels
from slopecli.geometry.epipolar import homogeneous
from slopecli.look.features import Grey, shrink, to_full
from slopecli.types import BoolArray, Camera, FloatArray

MAX_PIXELS = 0.06e6  # an image is shrunk to this: 5 ms, and only edges that people would call lines are left
SHORTEST = 0.03  # of the diagonal: shorter segments have no direction


class Segments(NamedTuple):
    """Straight edges: unit normals (n, 3) of the planes through the camera and each edge, and lengths (n,) px.

    An edge in space of direction d has d . normal = 0: it is one of those that converge to the vanishing point of d.
    """

    normals: FloatArray
    length: FloatArray

    def length_towards(self, directions: FloatArray, within_deg: float) -> FloatArray:
        """(k,) length of the edges that converge to the vanishing points of unit directions (k, 3)."""
        return np.asarray((np.abs(directions @ self.normals.T) < np.sin(np.radians(within_deg))) @ self.length)


def find_segments(grey: Grey, camera: Camera) -> Segments:
    """Line segments of an image (von Gioi et al., LSD), lens distortion taken out at their ends.

    Edges of what was filled with black, as around an undistorted image, are none of the scene's.
    """
    small, scale = shrink(grey, MAX_PIXELS)
    found = cv2.createLineSegmentDetector(cv2.LSD_REFINE_NONE).detect(small)[0]
    ends = np.empty((0, 2, 2)) if found is None else np.asarray(found, float).reshape(-1, 2, 2)
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    ends = ends[(length >= SHORTEST * np.hypot(*small.shape)) & ~_along_black(small, ends)]
    first, second = (homogeneous(rays_from_pixels(camera, to_full(ends[:, k], scale))) for k in (0, 1))
    normals = np.cross(first, second)
    size = np.linalg.norm(normals, axis=1)
    kept = size > 0.0  # NaN beyond the reach of a lens model compares false
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    return Segments(normals[kept] / size[kept, None], length[kept])


def _along_black(grey: Grey, ends: FloatArray) -> BoolArray:
    """(n,) whether a segment (n, 2, 2) runs along black that reaches the border of the image."""
    dark = (grey <= 2).astype(np.uint8)  # JPEG leaves black at 0 to 2
    pieces = cv2.connectedComponents(dark)[1]
    border = np.concatenate([pieces[0], pieces[-1], pieces[:, 0], pieces[:, -1]])
    filled = np.isin(pieces, border[border > 0]).astype(np.uint8)
    near = cv2.dilate(filled, np.ones((5, 5), np.uint8))  # the edge is found up to 2 px beside it
    share = np.linspace(0.0, 1.0, 9)
    along = ends[:, :1] + share[None, :, None] * (ends[:, 1:] - ends[:, :1])
    column, row = (np.clip(along[..., k].round().astype(int), 0, grey.shape[1 - k] - 1) for k in (0, 1))
    return np.asarray(near[row, column].mean(axis=1) > 0.5)
