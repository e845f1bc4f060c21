"""What planes say of points: a homography each, or three numbers each where all share one epipolar geometry."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slopecli.geometry.epipolar import homogeneous
from slopecli.patches.labelling.residual_cost import weight_of
from slopecli.types import BoolArray, FloatArray, IntArray

LEAST_DEPTH = 1e-3  # of the depth ratio at the points' centre: beyond lies the line that H sends to infinity
FAR = 1e6  # squared residual of what no plane explains
STEPS = 3  # of reweighted least squares: labels and scale change between the calls


@dataclass(frozen=True, eq=False)
class HomographyModel:
    """Planes as homographies (k, 9), row by row; x1, x2 (n, 2) centred, of about unit size. Residuals of image 2."""

    x1: FloatArray
    x2: FloatArray
    bounds: tuple[float, float]
    dim: int = 2

    @property
    def base(self) -> FloatArray:
        return np.zeros(len(self.x1))

    def squares(self, planes: FloatArray) -> FloatArray:
        H = planes.reshape(-1, 3, 3)
        x, y, depth = (homogeneous(self.x1) @ row.T for row in H.transpose(1, 0, 2))
        seen = depth > LEAST_DEPTH
        depth = np.where(seen, depth, 1.0)
        square = (x / depth - self.x2[:, :1]) ** 2 + (y / depth - self.x2[:, 1:]) ** 2
        return np.asarray(np.where(seen, np.minimum(square, FAR), FAR))

    def fit(self, plane: FloatArray, own: BoolArray, scale: float) -> FloatArray:
        """Gauss-Newton on the residuals in image 2; with fewer than five points the plane is left as it is."""
        if own.sum() < 5:
            return plane
        p, x2, H = homogeneous(self.x1[own]), self.x2[own], plane.reshape(3, 3)
        for _ in range(STEPS):
            depth = p @ H[2]
            if depth.min() < LEAST_DEPTH:
                break
            predicted = p @ H[:2].T / depth[:, None]
            root = np.sqrt(weight_of(((predicted - x2) ** 2).sum(axis=1), scale, self.dim))[:, None]
            H = _step(H, p / depth[:, None] * root, predicted, (predicted - x2) * root)
        return H.ravel() / H[2, 2] if H[2, 2] > 0 and homogeneous(self.x1[own]).dot(H[2]).min() > 0 else plane


def _step(H: FloatArray, q: FloatArray, predicted: FloatArray, error: FloatArray) -> FloatArray:
    """One Gauss-Newton step; q (n, 3) points over their depth ratio, times the root of their weights, as is error."""
    J = np.zeros((2, len(q), 9))
    J[0, :, :3] = J[1, :, 3:6] = q
    J[0, :, 6:], J[1, :, 6:] = -predicted[:, :1] * q, -predicted[:, 1:] * q
    rows, h = J.reshape(-1, 9), H.ravel()
    system = rows.T @ rows
    size = np.trace(system) / 9
    # h h^T leaves the scale of H alone; the small multiple of the identity, what too few points do not fix
    system += size * (np.outer(h, h) / (h @ h) + 1e-9 * np.eye(9))
    return np.asarray((h - np.linalg.solve(system, rows.T @ error.T.ravel())).reshape(3, 3))


@dataclass(frozen=True, eq=False)
class DepthModel:
    """Planes as scaled normals N (k, 3) with w = N . (x1, 1); target - rows @ N is the residual along the epipolar
    line of image 2, in the unit of `bounds`. base (n,): what the residual across it costs, nats."""

    rows: FloatArray
    target: FloatArray
    base: FloatArray
    bounds: tuple[float, float]
    dim: int = 1

    def squares(self, planes: FloatArray) -> FloatArray:
        return np.asarray((self.target[:, None] - self.rows @ planes.T) ** 2)

    def take(self, part: IntArray) -> DepthModel:
        """The same equation on some of the points."""
        return DepthModel(self.rows[part], self.target[part], self.base[part], self.bounds)

    def through(self, labels: IntArray, scale: float) -> FloatArray:
        """(k, 3) planes through the points labelled 1..k, by least squares and then robustly."""
        planes = []
        for k in range(1, labels.max(initial=0) + 1):
            own = labels == k
            rows = self.rows[own]
            planes.append(self.fit(solve_regular(rows.T @ rows, rows.T @ self.target[own]), own, scale))
        return np.array(planes).reshape(-1, 3)

    def fit(self, plane: FloatArray, own: BoolArray, scale: float) -> FloatArray:
        """Reweighted least squares; with fewer than four points the plane is left as it is."""
        if own.sum() < 4:
            return plane
        rows, target = self.rows[own], self.target[own]
        for _ in range(STEPS):
            weighted = rows * weight_of((target - rows @ plane) ** 2, scale, self.dim)[:, None]
            plane = solve_regular(weighted.T @ rows, weighted.T @ target)
        return plane


def solve_regular(system: FloatArray, right: FloatArray) -> FloatArray:
    """Solve normal equations (..., 3, 3), (..., 3), those of collinear points as well (by the least normal)."""
    size = np.trace(system, axis1=-2, axis2=-1)[..., None, None]
    return np.asarray(np.linalg.solve(system + (1e-10 * size + 1e-30) * np.eye(3), right[..., None])[..., 0])
