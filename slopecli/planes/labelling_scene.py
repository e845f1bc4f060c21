"""The planes of a scene whose motion is known: dense cells with inverse depths, labelled by plane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slopecli.geometry.epipolar import homogeneous
from slopecli.planes.labelling import Prices, label_points
from slopecli.planes.labelling_graph import mutual_graph, nearest
from slopecli.types import FloatArray, IntArray

NEIGHBOURS = 6  # of every cell
SMOOTH = 1.0  # nats for two neighbours on different planes
PLANE_CELLS = 8.0  # cells a plane must explain, that nothing else does, to be stated
FLOOR_PX = 0.2  # 1-sigma in image 2 within which no surface is flatter: lens, matching, relief
AROUND, TRIPLES = 24, 8  # cells around a seed through which planes are proposed, and triples tried
SEEDS = 1200
SAMPLE = 2500  # cells on which the proposals compete
LEAST = 8  # cells: fewer show no plane


@dataclass(frozen=True, eq=False)
class _ScenePlanes:
    """Planes as scaled normals (k, 3): rows (n, 3) and target (n,) are px of image 2, so that
    target - rows @ normal is the residual, px; sigma_px its 1-sigma."""

    rows: FloatArray
    target: FloatArray
    sigma_px: float

    def cost(self, planes: FloatArray) -> FloatArray:
        residual = self.target[:, None] - self.rows @ planes.T
        return np.asarray(0.5 * (residual / self.sigma_px) ** 2)

    def refit(self, planes: FloatArray, labels: IntArray) -> FloatArray:
        fitted = planes.copy()
        for k in range(len(planes)):
            own = labels == k + 1
            if own.sum() >= LEAST:
                fitted[k] = np.linalg.lstsq(self.rows[own], self.target[own], rcond=None)[0]
        return fitted


def label_scene_planes(
    x1: FloatArray,
    w: FloatArray,
    leverage: FloatArray,
    uv1: FloatArray,
    focal_px: float,
    seed: int = 0,
    sigma_px: float | None = None,
) -> tuple[IntArray, FloatArray]:
    """Say which plane each cell is on, the motion being known: an unknown number of planes, and cells on none.

    Parameters
    ----------
    x1 : (n, 2) normalised points of image 1.  w : (n,) inverse depths, 1/baseline.
    leverage : (n,) image-2 motion per unit of inverse depth, normalised.  uv1 : (n, 2) px of image 1.
    focal_px : px of image 2 per unit of normalised coordinate.  seed : of the random draws.
    sigma_px : 1-sigma of a cell's distance in image 2 from its plane; None estimates it.

    Returns
    -------
    labels : (n,) int, 0..k-1, the plane with most cells first, -1 for none.
    scaled_normals : (k, 3), N . (x1, 1) = w.
    """
    if len(uv1) < LEAST:
        return np.full(len(uv1), -1), np.empty((0, 3))
    px = leverage * focal_px
    rows, target = homogeneous(x1) * px[:, None], w * px
    rng = np.random.default_rng(seed)
    near = nearest(uv1, AROUND)
    candidates, local = _propose(rows, target, near, rng)
    sigma = sigma_px if sigma_px is not None else max(local, FLOOR_PX)
    spread = float(np.ptp(np.quantile(target, [0.02, 0.98]))) + 4 * sigma
    none = float(np.log(spread / (sigma * np.sqrt(2 * np.pi))))
    none = min(max(none, 2.0), 4.5)
    sample = rng.permutation(len(uv1))[:SAMPLE]
    graph = mutual_graph(near[:, :NEIGHBOURS], SMOOTH)
    model = _ScenePlanes(rows, target, sigma)
    return label_points(model, candidates, graph, Prices(none, PLANE_CELLS * none), sample)


def _propose(
    rows: FloatArray, target: FloatArray, near: IntArray, rng: np.random.Generator
) -> tuple[FloatArray, float]:
    """(c, 3) planes through cells around seeds, and the noise that the cells around them show, px."""
    n = len(rows)
    seeds = rng.permutation(n)[:SEEDS]
    around = np.column_stack([seeds, near[seeds]])
    A, b = rows[around], target[around]
    pick = rng.random((len(seeds), TRIPLES, around.shape[1])).argpartition(3, axis=2)[:, :, :3]
    at = np.arange(len(seeds))[:, None, None]
    matrix = A[at, pick]
    area = np.abs(np.linalg.det(matrix))
    ok = area > 1e-9 * np.abs(matrix).max(axis=(2, 3)) ** 3
    matrix[~ok] = np.eye(3)
    normal = np.linalg.solve(matrix, b[at, pick][..., None])[..., 0]
    residual = np.abs(np.einsum("sij,stj->sti", A, normal) - b[:, None])
    half = np.median(residual, axis=2)
    half[~ok] = np.inf
    best = half.argmin(axis=1)
    normal, half = normal[np.arange(len(seeds)), best], half.min(axis=1)
    ok = np.isfinite(half)
    A, b, normal, half = A[ok], b[ok], normal[ok], half[ok]
    for _ in range(3):
        r = np.einsum("sij,sj->si", A, normal) - b
        scale = np.maximum(np.median(np.abs(r), axis=1) / 0.6745, 0.05)
        weight = 1 / (1 + (r / (2 * scale[:, None])) ** 2) ** 2
        M = np.einsum("sij,si,sik->sjk", A, weight, A)
        trace = np.trace(M, axis1=1, axis2=2)[:, None, None]
        normal = np.linalg.solve(M + 1e-12 * trace * np.eye(3), np.einsum("sij,si,si->sj", A, weight, b)[..., None])
        normal = normal[..., 0]
    r = np.abs(np.einsum("sij,sj->si", A, normal) - b)
    return np.asarray(normal), float(np.median(np.median(r, axis=1)) / 0.6745)
