"""Where the points of the reference are in a frame: the frame is pulled onto the reference, the rest is small.

Under a motion and the inverse depth of every pixel, the frame is resampled to look like the reference; Lucas-Kanade
between the two finds displacements of a few pixels, to a twentieth of one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from slopecli.geometry.camera import pixels_from_rays, rays_from_pixels
from slopecli.geometry.epipolar import homogeneous
from slopecli.geometry.solver.views import predict_views
from slopecli.look.features import Grey
from slopecli.look.warp import NODE_STEP
from slopecli.sequence.frame_detail import detail_shown
from slopecli.sequence.tracking_tunables import TRACKING
from slopecli.sequence.tracks import Tracks
from slopecli.types import BoolArray, Camera, FloatArray, IntArray
from slopecli.windows import Window

Motion = tuple[FloatArray, FloatArray]  # R (3, 3) and T (3,)


class Found(NamedTuple):
    """Where a frame shows the points: uv (n, 2) px, x (2, n) rays, seen (n,).

    zoom : px of the frame to one of the reference, so that errors there are as many times those of the alignment.
    likeness : correlation of the frame, pulled onto the reference, with it.  detail : (4,) of `detail_shown`.
    """

    uv: FloatArray
    x: FloatArray
    seen: BoolArray
    zoom: float
    likeness: float
    detail: FloatArray


@dataclass(frozen=True, eq=False)
class Nodes:
    """A coarse grid over the reference: rays (3, rows * columns) of its nodes, and the window each is nearest to."""

    shape: tuple[int, int]
    rays: FloatArray
    window: IntArray

    @classmethod
    def of(cls, windows: list[Window], camera: Camera) -> Nodes:
        """Nodes every `NODE_STEP` px, placed as `cv2.resize` enlarges them."""
        step = NODE_STEP
        rows, columns = -(-camera.height // step), -(-camera.width // step)
        v = (np.arange(rows) + 0.5) * camera.height / rows - 0.5
        u = (np.arange(columns) + 0.5) * camera.width / columns - 0.5
        uv = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
        rays = homogeneous(np.nan_to_num(rays_from_pixels(camera, uv))).T
        distance = np.full(len(uv), np.inf)
        nearest = np.zeros(len(uv), np.int64)
        for i, (x, y, w, h) in enumerate(windows):
            off = np.maximum(np.maximum(np.array([x, y]) - uv, uv - np.array([x + w, y + h])), 0.0)
            away = (off**2).sum(axis=1)
            nearest[away < distance], distance = i, np.minimum(away, distance)
        return cls((rows, columns), rays, nearest)


class Aligner:
    """Pulls frames onto a reference and finds its points in them."""

    def __init__(self, grey: Grey, camera: Camera, windows: list[Window], tracks: Tracks) -> None:
        self.grey, self.camera, self.tracks = grey, camera, tracks
        self._nodes = Nodes.of(windows, camera)
        rows, columns = self._nodes.shape
        cell = (tracks.uv + 0.5) * [columns / camera.width, rows / camera.height]
        at = np.clip(cell.astype(np.int64), 0, [columns - 1, rows - 1])
        self._node_of_track = at[:, 1] * columns + at[:, 0]

    def find(
        self, frame: Grey, motion: Motion, normals: FloatArray, u: FloatArray, known: BoolArray, levels: int = 0
    ) -> Found:
        """The points of the reference in a frame taken near a motion.

        normals : (m, 3) scaled; u : (n,) inverse depths of the points; those `known` (n,) are looked for.
        levels : of the pyramid, beyond the first, for displacements of several pixels.
        """
        places = self._places(motion, normals, u, known)
        zoom, moved = self._zoom(places), self.tracks.uv.copy()
        near, likeness, detail = np.zeros(len(self.tracks), bool), 0.0, np.ones(4)
        asked = np.flatnonzero(known & _inside(_sampled(places, moved), self.camera, TRACKING.border_px))
        if len(asked):
            part = self._part(moved[asked])
            reference = np.ascontiguousarray(_blurred(self.grey, 1.0 / zoom)[part])
            pulled = _pulled(_blurred(frame, zoom), places[:, part[0], part[1]])
            gain, offset, likeness = _brightness(reference, pulled, places[:, part[0], part[1]], self.camera)
            pulled = _brightened(pulled, gain, offset)
            corner = np.array([part[1].start, part[0].start])
            start = moved[asked] - corner
            found, well = _tracked(reference, pulled, start, levels)
            detail = detail_shown(reference, pulled, places[:, part[0], part[1]], start[well], found[well])
            near[asked] = well
            moved[asked] = found + corner
        uv = _sampled(places, moved)
        inside = _inside(uv, self.camera, TRACKING.border_px)
        x = rays_from_pixels(self.camera, np.where(inside[:, None], uv, 0.0))
        seen = near & inside & np.isfinite(x).all(axis=1)
        return Found(uv, np.where(seen[:, None], x, 0.0).T, seen, zoom, likeness, detail)

    def _part(self, uv: FloatArray) -> tuple[slice, slice]:
        """Rows and columns of the reference around points (k, 2), with room for windows and displacements."""
        low = np.maximum(uv.min(axis=0).astype(int) - 2 * TRACKING.lk_px, 0)
        high = uv.max(axis=0).astype(int) + 2 * TRACKING.lk_px
        return slice(int(low[1]), int(high[1])), slice(int(low[0]), int(high[0]))

    def _places(self, motion: Motion, normals: FloatArray, u: FloatArray, known: BoolArray) -> NDArray[np.float32]:
        """(2, h, w) px of the frame that every pixel of the reference is expected at."""
        nodes = self._nodes
        rows, columns = nodes.shape
        depth = self._node_depth(normals, u, known)
        x, ahead = predict_views(nodes.rays, motion[0][None], motion[1][None], depth)
        x[0][:, ahead[0] <= 0.0] = 1e3
        uv = pixels_from_rays(self.camera, x[0].T)
        grid = np.nan_to_num(uv, nan=-1e4).T.reshape(2, rows, columns).astype(np.float32)
        size = (self.camera.width, self.camera.height)
        return np.stack([cv2.resize(part, size, interpolation=cv2.INTER_LINEAR) for part in grid])

    def _node_depth(self, normals: FloatArray, u: FloatArray, known: BoolArray) -> FloatArray:
        """(nodes,) inverse depth: that of the nearest window's plane, and what the points around are off it."""
        nodes, tracks = self._nodes, self.tracks
        plane = (normals[nodes.window] * nodes.rays.T).sum(axis=1)
        at = self._node_of_track
        off = np.where(known, u - (normals[nodes.window[at]] * tracks.p.T).sum(axis=1), 0.0)
        total = np.bincount(at, off * known, len(plane)).reshape(nodes.shape)
        count = np.bincount(at, known.astype(float), len(plane)).reshape(nodes.shape)
        both = cv2.GaussianBlur(np.dstack([total, count]), (0, 0), 1.5)
        smooth = both[..., 0] / (both[..., 1] + 0.02)  # a fiftieth of a point: far from all of them the plane holds
        blurred = cv2.blur(plane.reshape(nodes.shape), (3, 3))
        return np.maximum((blurred + smooth).ravel(), 1e-3 * float(np.median(plane)))

    @staticmethod
    def _zoom(places: NDArray[np.float32]) -> float:
        """Pixels of the frame a pixel of the reference, in the middle."""
        h, w = places.shape[1:]
        a, b = places[:, h // 2, w // 4], places[:, h // 2, 3 * w // 4]
        return float(np.hypot(*(b - a)) / max(3 * w // 4 - w // 4, 1))


def _tracked(reference: Grey, pulled: Grey, uv: FloatArray, levels: int) -> tuple[FloatArray, BoolArray]:
    """Where points (k, 2) of the reference are in the frame pulled onto it, and (k,) whether they were found near."""
    start = np.ascontiguousarray(uv, np.float32)
    moved, status, _ = cv2.calcOpticalFlowPyrLK(
        reference,
        pulled,
        start,
        start.copy(),
        winSize=(TRACKING.lk_px, TRACKING.lk_px),
        maxLevel=levels,
        criteria=(cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 12, 0.01),
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    end = np.asarray(moved, float)
    return end, (status.ravel() > 0) & (np.hypot(*(end - uv).T) < TRACKING.lk_px * (1 + levels))


def _brightened(grey: Grey, gain: float, offset: float) -> Grey:
    """gain * grey + offset, within 0..255."""
    table = np.clip(gain * np.arange(256.0) + offset, 0.0, 255.0).round().astype(np.uint8)
    return np.asarray(cv2.LUT(grey, table), np.uint8)


def _pulled(frame: Grey, places: NDArray[np.float32]) -> Grey:
    """The frame resampled at places (2, h, w), px."""
    return np.asarray(
        cv2.remap(frame, places[0], places[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), np.uint8
    )


def _blurred(grey: Grey, zoom: float) -> Grey:
    """The image without detail that shrinking it by `zoom` would alias; unchanged where it is not shrunk."""
    sigma = 0.5 * np.sqrt(max(zoom * zoom - 1.0, 0.0))
    return grey if sigma < 0.2 else np.asarray(cv2.GaussianBlur(grey, (0, 0), sigma), np.uint8)


def _brightness(
    reference: Grey, pulled: Grey, places: NDArray[np.float32], camera: Camera
) -> tuple[float, float, float]:
    """Gain and offset of the grey values of a pulled frame that give those of the reference, and their correlation."""
    part = (slice(None, None, 8), slice(None, None, 8))
    u, v = places[:, ::8, ::8]
    valid = (u > 0) & (u < camera.width - 1) & (v > 0) & (v < camera.height - 1)
    if np.count_nonzero(valid) < 100:
        return 1.0, 0.0, 0.0
    a, b = reference[part][valid].astype(float), pulled[part][valid].astype(float)
    spread = max(float(a.std()), 1e-3), max(float(b.std()), 1e-3)
    gain = float(np.clip(spread[0] / spread[1], 0.5, 2.0))
    likeness = float(((a - a.mean()) * (b - b.mean())).mean()) / (spread[0] * spread[1])
    return gain, float(a.mean() - gain * b.mean()), likeness


def _sampled(places: NDArray[np.float32], uv: FloatArray) -> FloatArray:
    """Bilinear values (n, 2) of a map (2, h, w) at pixels (n, 2)."""
    h, w = places.shape[1:]
    at = np.clip(uv, 0.0, [w - 1.001, h - 1.001])
    corner = at.astype(np.int64)
    fx, fy = (at - corner).T
    index = corner[:, 1] * w + corner[:, 0]
    flat = places.reshape(2, -1)
    upper = flat[:, index] * (1.0 - fx) + flat[:, index + 1] * fx
    lower = flat[:, index + w] * (1.0 - fx) + flat[:, index + w + 1] * fx
    return np.asarray((upper * (1.0 - fy) + lower * fy).T, float)


def _inside(uv: FloatArray, camera: Camera, margin: float) -> BoolArray:
    """(n,) pixels (n, 2) at least `margin` px inside the image."""
    u, v = uv.T
    return np.asarray((u >= margin) & (u < camera.width - margin) & (v >= margin) & (v < camera.height - margin))
