"""What the whole image says before any window is looked at: matches, their inverse depths, the planes they form."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slopecli.geometry.epipolar import homogeneous
from slopecli.geometry.motion import epipolar_residual, inverse_depth
from slopecli.planes.robust import robust_plane
from slopecli.types import BoolArray, FloatArray

TOLERANCE_PX = 1.5  # epipolar residual of matches that count
MAX_PLANES = 8
PLANE_TOLERANCE_PX = 1.0
TRIES = 400


@dataclass(frozen=True, eq=False)
class Evidence:
    """Matches consistent with the motion: uv1 (n, 2) px, x1, x2 (n, 2) normalised, w (n,) inverse depth, leverage (n,),
    grey (n,) brightness of image 1 there; n_given: matches there were, those that contradict the motion included."""

    uv1: FloatArray
    x1: FloatArray
    x2: FloatArray
    w: FloatArray
    leverage: FloatArray
    grey: FloatArray
    focal_px: float
    n_given: int

    def __len__(self) -> int:
        return len(self.uv1)

    def near(self, window: tuple[int, int, int, int], grow: float) -> BoolArray:
        """(n,) within the window (x, y, w, h) grown on every side by `grow` times its longer side."""
        x, y, width, height = window
        d = grow * max(width, height)
        u, v = self.uv1.T
        return np.asarray((u >= x - d) & (u < x + width + d) & (v >= y - d) & (v < y + height + d))

    def plane_through(self, which: BoolArray) -> FloatArray | None:
        """Scaled normal (3,) of the robust plane through the chosen matches; None when fewer than six."""
        if which.sum() < 6:
            return None
        floor = 0.05 / self.focal_px
        return robust_plane(self.x1[which], self.w[which], self.leverage[which], floor).normal

    def misfit_px(self, normal: FloatArray) -> FloatArray:
        """(n,) distance in image 2 between each match and the plane's prediction, px."""
        return np.abs(self.w - homogeneous(self.x1) @ normal) * self.leverage * self.focal_px


def gather_evidence(
    uv1: FloatArray, x1: FloatArray, x2: FloatArray, grey: FloatArray, R: FloatArray, T: FloatArray, focal_px: float
) -> Evidence:
    """Keep matches that obey the epipolar geometry in front of the camera, and give each its inverse depth."""
    w, leverage = inverse_depth(R, T, x1, x2)
    keep = np.abs(epipolar_residual(R, T, x1, x2)) * focal_px < TOLERANCE_PX
    keep &= (w > 0) & (leverage > 0)
    return Evidence(uv1[keep], x1[keep], x2[keep], w[keep], leverage[keep], grey[keep], focal_px, len(keep))


def scene_planes(evidence: Evidence) -> list[FloatArray]:
    """Dominant planes of the scene, largest first: sequential RANSAC over triples of neighbours, fixed seed."""
    rng = np.random.default_rng(0)
    left = np.arange(len(evidence))
    rays = homogeneous(evidence.x1)
    planes: list[FloatArray] = []
    while len(left) >= 40 and len(planes) < MAX_PLANES:
        found = _largest_plane(evidence, rays, left, rng)
        if found is None or found[1].sum() < max(30, 0.02 * len(evidence)):
            break
        planes.append(found[0])
        left = left[~found[1]]
    return planes


def _largest_plane(
    evidence: Evidence, rays: FloatArray, left: np.ndarray, rng: np.random.Generator
) -> tuple[FloatArray, BoolArray] | None:
    seeds = left[rng.integers(0, len(left), TRIES)]
    span = np.ptp(evidence.uv1, axis=0).max() / 6
    partners = left[rng.integers(0, len(left), (TRIES, 24))]
    distance = np.linalg.norm(evidence.uv1[partners] - evidence.uv1[seeds][:, None], axis=2)
    two = np.argsort(np.abs(distance - span / 2), axis=1)[:, :2]
    triple = np.column_stack([seeds, np.take_along_axis(partners, two, 1)])
    matrix = rays[triple]
    area = np.abs(np.linalg.det(matrix))
    wide = area > np.median(area) * 0.5
    if not wide.any() or not (area[wide] > 0).all():
        return None
    normals = np.linalg.solve(matrix[wide], evidence.w[triple[wide]][..., None])[..., 0]
    scale = evidence.leverage[left] * evidence.focal_px
    misfit = np.abs(evidence.w[left] - normals @ rays[left].T) * scale
    best = normals[(misfit < PLANE_TOLERANCE_PX).sum(1).argmax()]
    inlier = np.zeros(len(left), bool)
    for _ in range(3):
        inlier = np.abs(evidence.w[left] - rays[left] @ best) * scale < PLANE_TOLERANCE_PX
        if inlier.sum() < 6:
            return None
        rows = rays[left][inlier] * scale[inlier, None]
        best = np.linalg.lstsq(rows, evidence.w[left][inlier] * scale[inlier], rcond=None)[0]
    return best, inlier
