"""Depth of every pixel of the reference from the frames of a sequence that tell most of it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from slopecli.geometry.camera import pixels_from_rays
from slopecli.geometry.solver.views import predict_views
from slopecli.look.dense import Cells
from slopecli.look.dense_depth import DEPTH, DenseDepth, measure_depth
from slopecli.look.features import Grey
from slopecli.look.fused_depth import fuse_depths, start_for_farther
from slopecli.look.matches import LEAST_MATCHES, Evidence
from slopecli.look.scene import Scene
from slopecli.look.standing_still import Still
from slopecli.look.warp import FloatImage, Pyramid
from slopecli.sequence.tracking_tunables import TRACKING
from slopecli.sequence.tracks import Tracks
from slopecli.types import BoolArray, Camera, FloatArray


@dataclass(frozen=True, eq=False)
class KeptFrame:
    """A frame with its motion."""

    grey: Grey
    R: FloatArray
    T: FloatArray

    @property
    def baseline(self) -> float:
        return float(np.linalg.norm(self.T))


class DepthFrames:
    """Keeps the few frames that tell most of the depth: the memory of a sequence does not grow.

    They are spread over short and long baselines: a long one is precise, but its images are much unlike, and only
    with the depth that shorter ones tell is each pixel found again.

    most : frames kept besides the last one used.
    """

    def __init__(self, most: int = 5) -> None:
        self._most = most
        self._kept: list[KeptFrame] = []  # of rising baseline
        self._last: KeptFrame | None = None

    def add(self, grey: Grey, R: FloatArray, T: FloatArray) -> None:
        """Take in a frame."""
        last = self._last
        if last is not None and (not self._kept or last.baseline > TRACKING.next_depth * self._kept[-1].baseline):
            self._kept = [*self._kept, last][-self._most :]
        self._last = KeptFrame(grey, R, T)

    @property
    def baselines(self) -> list[float]:
        """Lengths of the baselines of the frames kept, and of the last one used."""
        return [frame.baseline for frame in (*self._kept, self._last) if frame is not None]

    def kept(self) -> DepthFrames:
        """These frames, whatever is added from now on."""
        held = DepthFrames(self._most)
        held._kept, held._last = list(self._kept), self._last
        return held

    def fused(
        self,
        reference: Grey,
        camera: Camera,
        tracks: Tracks,
        u: FloatArray,
        known: BoolArray,
        max_pixels: float,
        still: Still | None = None,
    ) -> FusedScene:
        """Depth of the reference from all frames kept, in baselines of the last one.

        Frames are taken in by rising baseline, each beginning with the depth that those before it tell.

        u : (n,) inverse depths of the points where `known` (n,), in the unit of the frames' positions.
        max_pixels : that are measured.  still : what is no ground.
        """
        frames = [frame for frame in (self._last, *self._kept) if frame is not None]
        scenes = [replace(scene_of(reference, frame, camera, tracks, u, known), still=still) for frame in frames]
        length = [frame.baseline for frame in frames]
        depths: dict[int, DenseDepth] = {}
        start: FloatImage | None = None  # in the unit of the positions
        for k in sorted(range(len(frames)), key=lambda k: length[k]):
            begin = None if start is None else start * np.float32(length[k])
            own = measure_depth(scenes[k], max_pixels=max_pixels, start=begin)
            depths[k] = _in_unit_of_points(own, scenes[k].evidence)
            longest = sorted(depths, key=lambda j: -length[j])
            start = start_for_farther([depths[j] for j in longest], [length[j] for j in longest])
        every = range(len(frames))
        return FusedScene(scenes[0], fuse_depths([depths[k] for k in every], [length[k] for k in every]))


@dataclass(frozen=True, eq=False)
class FusedScene:
    """The pair of the reference and the last frame, and the depth of the reference from all."""

    scene: Scene
    depth: DenseDepth


def _in_unit_of_points(depth: DenseDepth, points: Evidence) -> DenseDepth:
    """The depth scaled to agree with the points: the length of a frame's own baseline is known less well than they."""
    rows, columns = depth.w.shape
    at = np.clip(np.rint(depth.grid.inside(points.uv1)).astype(np.int64), 0, [columns - 1, rows - 1])
    row, column = at[:, 1], at[:, 0]
    known = depth.known[row, column]
    if np.count_nonzero(known) < LEAST_MATCHES:
        return depth
    off = float(np.median(np.log(depth.w[row, column][known] / points.w[known])))
    return replace(depth, w=depth.w * np.float32(np.exp(-off)))


def scene_of(
    reference: Grey, frame: KeptFrame, camera: Camera, tracks: Tracks, u: FloatArray, known: BoolArray
) -> Scene:
    """The pair of the reference and a frame as a scene; the points are its evidence, where the frame shows them."""
    length = frame.baseline
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
