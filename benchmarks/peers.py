"""What others make of the same correspondences: one motion and a plane in every patch, with each library's own tools.

Every peer gets pixels, the camera and the patch labels. PoseLib and pycolmap find the motion from all correspondences,
robustly, and refine it; planes are then fitted, patch by patch and robustly, to inverse depths of the points on their
rays: linear in the plane's parameters, and better behaved than a fit to triangulated points. OpenCV fits and
decomposes the homography of every patch by itself; its two or more answers are told apart by the truth, which no user
has.
"""

from __future__ import annotations

import importlib
import time
from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType

import cv2
import numpy as np

from slopecli.geometry import homogeneous, rotation_angle, solve_planes
from slopecli.study import Scene
from slopecli.types import FloatArray

THRESHOLD_PX = 1.0  # beyond which every peer takes a correspondence for a mismatch


@dataclass(frozen=True, eq=False)
class Answer:
    """R (3, 3), T (3,) and normals (m, 3) of any length, in the frames of `types.Solution`; a second one if told.

    planes_s : processor time spent by this script, not the peer, on planes under the peer's pose.
    """

    R: FloatArray
    T: FloatArray
    normals: FloatArray
    second: Answer | None = None
    planes_s: float = 0.0


@dataclass(frozen=True)
class Peer:
    """One way to answer a scene, called by what it is."""

    name: str
    answer: Callable[[Scene], Answer]


def find_peers() -> tuple[list[Peer], list[str]]:
    """Every peer that is installed, slopemap's solvers first, and a line for each that is not."""
    peers = [Peer(f"slopemap {solver}", lambda scene, s=solver: _ours(scene, s)) for solver in ("mle", "ha", "lh")]
    peers.append(Peer("OpenCV, patch by patch", _opencv))
    absent = []
    for module, title, answer in (
        ("poselib", "PoseLib pose, then planes", _poselib),
        ("pycolmap", "pycolmap two-view, then planes", _pycolmap),
    ):
        try:
            library = importlib.import_module(module)
        except ImportError:
            absent.append(f"{title}: skipped, {module} is not installed (pip install '.[peers]')")
        else:
            peers.append(Peer(title, lambda scene, a=answer, lib=library: a(scene, lib)))
    return peers, absent


def _ours(scene: Scene, solver: str) -> Answer:
    solution = solve_planes(scene.x1, scene.x2, scene.patch, solver)  # type: ignore[arg-type]
    other = solution.ambiguity.alternative if solution.ambiguity.status == "unresolved" else None
    second = None if other is None else Answer(other.R, other.T, other.scaled_normals)
    return Answer(solution.R, solution.T, solution.scaled_normals, second)


def _opencv(scene: Scene) -> Answer:
    """Homographies one by one; of each decomposition what is nearest the truth. The motion is the mean of theirs."""
    found = [_nearest_reading(scene, patch) for patch in range(len(scene.normals))]
    u, _, vt = np.linalg.svd(np.sum([answer.R for answer in found], axis=0))
    T = np.sum([answer.T / np.linalg.norm(answer.T) for answer in found], axis=0)
    return Answer(u @ vt, T, np.concatenate([answer.normals for answer in found]))


def _nearest_reading(scene: Scene, patch: int) -> Answer:
    """The reading of one patch's homography whose rotation and normal are nearest the truth."""
    own = scene.patch == patch
    H, _ = cv2.findHomography(scene.x1[own], scene.x2[own], cv2.RANSAC, THRESHOLD_PX / scene.camera.focal_px)
    _, rotations, translations, normals = cv2.decomposeHomographyMat(H, np.eye(3))
    readings = []
    for R, t, n in zip(rotations, translations, normals, strict=True):
        # OpenCV: P2 = R P1 + t with t = -R T, and H = R + t n'; a reading and its negative are the same plane
        sign = 1.0 if n.ravel() @ scene.normals[patch] > 0 else -1.0
        readings.append(Answer(R, -sign * R.T @ t.ravel(), sign * n.reshape(1, 3)))
    return min(readings, key=lambda reading: _off(reading, scene, patch))


def _off(reading: Answer, scene: Scene, patch: int) -> float:
    true = scene.normals[patch] / np.linalg.norm(scene.normals[patch])
    return float(rotation_angle(reading.R, scene.R) + np.linalg.norm(reading.normals[0] - true))


def _poselib(scene: Scene, poselib: ModuleType) -> Answer:
    camera = scene.camera
    numbers = {
        "model": "PINHOLE",
        "width": camera.width,
        "height": camera.height,
        "params": [camera.fx, camera.fy, camera.cx + 0.5, camera.cy + 0.5],  # its pixels' centres are at halves
    }
    pose, details = poselib.estimate_relative_pose(
        scene.uv1 + 0.5, scene.uv2 + 0.5, numbers, numbers, {"max_epipolar_error": THRESHOLD_PX}, {}
    )
    return _with_planes(scene, np.asarray(pose.R), np.asarray(pose.t), np.asarray(details["inliers"], bool))


def _pycolmap(scene: Scene, pycolmap: ModuleType) -> Answer:
    camera = scene.camera
    theirs = pycolmap.Camera(
        model="PINHOLE",
        width=camera.width,
        height=camera.height,
        params=[camera.fx, camera.fy, camera.cx + 0.5, camera.cy + 0.5],
    )
    options = pycolmap.TwoViewGeometryOptions()
    options.max_H_inlier_ratio = 1.0  # else a nearly flat scene is called planar, and its motion is much worse
    options.compute_relative_pose = True
    options.ransac.max_error = THRESHOLD_PX
    options.ransac.random_seed = 0
    uv1, uv2 = scene.uv1 + 0.5, scene.uv2 + 0.5
    every = np.arange(len(uv1), dtype=np.uint32)
    found = pycolmap.estimate_calibrated_two_view_geometry(
        theirs, uv1, theirs, uv2, np.column_stack([every, every]), options
    )
    pose = found.cam2_from_cam1.matrix()
    inlier = np.zeros(len(uv1), bool)
    inlier[np.asarray(found.inlier_matches)[:, 0]] = True
    return _with_planes(scene, pose[:, :3], pose[:, 3], inlier)


def _with_planes(scene: Scene, R: FloatArray, t: FloatArray, inlier: np.ndarray) -> Answer:
    """The plane of every patch under a motion P2 = R P1 + t: inverse depths w = n . (x1, 1) by least squares."""
    x1 = homogeneous(scene.x1)
    start = time.process_time()
    # image 2: x2 ~ R x1 + w t; across either axis that is one equation in w, both are kept
    y, x2 = x1 @ R.T, scene.x2
    coefficient = t[:2] - x2 * t[2]
    value = x2 * y[:, 2:] - y[:, :2]
    normals = []
    for patch in range(len(scene.normals)):
        own = inlier & (scene.patch == patch)
        normals.append(_plane(coefficient[own][:, :, None] * x1[own][:, None, :], value[own]))
    return Answer(R, -R.T @ t, np.array(normals), planes_s=time.process_time() - start)


def _plane(design: FloatArray, value: FloatArray) -> FloatArray:
    """Least squares (k, 2, 3) n = (k, 2), again without what is off by more than three times the usual."""
    kept = np.ones(len(value), bool)
    for _ in range(4):
        normal = np.linalg.lstsq(design[kept].reshape(-1, 3), value[kept].ravel(), rcond=None)[0]
        off = np.linalg.norm(design @ normal - value, axis=1)
        kept = off <= 3.0 * np.median(off) / 1.18  # the median length of two unit normal deviates
    return np.asarray(normal)
