"""Depth of every pixel of the reference from the frames of a sequence that tell most of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slopecli.geometry.camera import pixels_from_rays
from slopecli.geometry.solver.views import predict_views
from slopecli.look.dense import Cells
from slopecli.look.dense_depth import DEPTH, DenseDepth, measure_depth
from slopecli.look.features import Grey
from slopecli.look.fused_depth import fuse_depths
from slopecli.look.matches import Evidence
from slopecli.look.scene import Scene
from slopecli.look.warp import Pyramid
from slopecli.sequence.tracks import Tracks
from slopecli.types import BoolArray, Camera, FloatArray


@dataclass(frozen=True, eq=False)
class KeptFrame:
    """A frame with its motion, and what it is worth: its baseline, less what it does not show of the reference."""

    grey: Grey
    R: FloatArray
    T: FloatArray
    worth: float


class DepthFrames:
    """Keeps the few frames that tell most of the depth: the memory of a sequence does not grow.

    most : frames kept besides the last one used.
    """

    def __init__(self, most: int = 4) -> None:
        self._most = most
        self._kept: list[KeptFrame] = []
        self._last: KeptFrame | None = None

    def add(self, grey: Grey, R: FloatArray, T: FloatArray, shown: float) -> None:
        """Take in a frame; shown: share of the points of the reference that it shows."""
        if self._last is not None:
            self._kept = sorted([*self._kept, self._last], key=lambda frame: -frame.worth)[: self._most]
        self._last = KeptFrame(grey, R, T, float(np.linalg.norm(T)) * shown**2)

    def fused(self, reference: Grey, camera: Camera, tracks: Tracks, u: FloatArray, known: BoolArray) -> FusedScene:
        """Depth of the reference from all frames kept, the last one first.

        u : (n,) inverse depths of the points where `known` (n,), in the unit of the frames' positions.
        """
        frames = [frame for frame in (self._last, *self._kept) if frame is not None]
        scenes = [scene_of(reference, frame, camera, tracks, u, known) for frame in frames]
        depths = [measure_depth(scene) for scene in scenes]
        depth = fuse_depths(depths, [float(np.linalg.norm(frame.T)) for frame in frames])
        return FusedScene(scenes[0], depth)


@dataclass(frozen=True, eq=False)
class FusedScene:
    """The pair of the reference and the last frame, and the depth of the reference from all."""

    scene: Scene
    depth: DenseDepth


def scene_of(
    reference: Grey, frame: KeptFrame, camera: Camera, tracks: Tracks, u: FloatArray, known: BoolArray
) -> Scene:
    """The pair of the reference and a frame as a scene; the points are its evidence, where the frame shows them."""
    length = float(np.linalg.norm(frame.T))
    x2, ahead = predict_views(tracks.p, frame.R[None], frame.T[None], u)
    uv2 = pixels_from_rays(camera, x2[0].T)
    K = frame.R @ frame.T / length
    leverage = np.hypot(*(x2[0] * K[2] - K[:2, None])) / np.abs(ahead[0])
    used = known & (ahead[0] > 0.0) & (u > 0.0) & (leverage > 0.0) & np.isfinite(uv2).all(axis=1)
    evidence = Evidence(
        uv1=tracks.uv[used],
        uv2=uv2[used],
        x1=tracks.p[:2, used].T,
        x2=x2[0][:, used].T,
        w=u[used] * length,
        leverage=leverage[used],
        grey=np.zeros(int(used.sum())),
        focal_px=camera.focal_px,
        n_given=int(used.sum()),
    )
    none = np.empty((0, 2))
    cells = Cells(none, none, np.empty((0, 2, 2)), np.empty((0, 2), np.int64), np.empty(0), np.empty(0), 1.0)
    scale = np.ones(2) * min(1.0, DEPTH.most_pixels / reference.size) ** 0.5
    pyramids = Pyramid(reference, scale), Pyramid(frame.grey)
    return Scene(camera, camera, *pyramids, frame.R, frame.T / length, evidence, list, cells)
