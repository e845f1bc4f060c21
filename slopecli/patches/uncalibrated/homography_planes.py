"""Planes as independent homographies: residuals and fits; and planes proposed from a few neighbouring points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slopecli.geometry.epipolar import homogeneous
from slopecli.geometry.homography import four_point_homographies, homography_rows
from slopecli.patches.labelling.labelling_tunables import LABELLING
from slopecli.patches.labelling.student_t import t_weight
from slopecli.types import BoolArray, FloatArray, IntArray

LEAST_DEPTH = 1e-3  # of the depth ratio at the points' centre: a point nearer to the horizon of H is not seen


@dataclass(frozen=True, eq=False)
class HomographyPlanes:
    """The model of planes as homographies (k, 9), row by row: see `search.PlaneModel`.

    x1, x2 (n, 2) : points, centred and of about unit size.  Residuals are those in image 2.
    """

    x1: FloatArray
    x2: FloatArray
    bounds: tuple[float, float]
    dim = 2

    @property
    def base(self) -> FloatArray:
        """Return zeros (n,): all of a residual is in `squares`."""
        return np.zeros(len(self.x1))

    def squares(self, planes: FloatArray) -> FloatArray:
        """Return (n, k) squared residuals, at most 1e6: that of points H sends to infinity or behind a camera."""
        H = planes.reshape(-1, 3, 3)
        x, y, depth = (homogeneous(self.x1) @ row.T for row in H.transpose(1, 0, 2))
        seen = depth > LEAST_DEPTH
        depth = np.where(seen, depth, 1.0)
        square = (x / depth - self.x2[:, :1]) ** 2 + (y / depth - self.x2[:, 1:]) ** 2
        return np.asarray(np.where(seen, np.minimum(square, 1e6), 1e6))

    def fit(self, plane: FloatArray, own: BoolArray, scale: float) -> FloatArray:
        """Return the plane (9,) refined on its own points by robust Gauss-Newton; unchanged if under five."""
        if own.sum() < 5:
            return plane
        p, x2, H = homogeneous(self.x1[own]), self.x2[own], plane.reshape(3, 3)
        for _ in range(3):  # labels and scale change between the calls: no need to converge
            depth = p @ H[2]
            if depth.min() < LEAST_DEPTH:
                break
            predicted = p @ H[:2].T / depth[:, None]
            root = np.sqrt(t_weight(((predicted - x2) ** 2).sum(axis=1), scale, self.dim))[:, None]
            H = _step(H, p / depth[:, None] * root, predicted, (predicted - x2) * root)
        return H.ravel() / H[2, 2] if H[2, 2] > 0 and (p @ H[2]).min() > 0 else plane


def _step(H: FloatArray, q: FloatArray, predicted: FloatArray, error: FloatArray) -> FloatArray:
    """Return H after one Gauss-Newton step.

    q : (n, 3) points over their depth ratio, times the root of their weights, as is error (n, 2).
    """
    rows, h = homography_rows(q, predicted), H.ravel()
    system = rows.T @ rows
    # h h^T fixes the scale of H; the small multiple of the identity, what too few points do not fix
    system += np.trace(system) / 9 * (np.outer(h, h) / (h @ h) + 1e-9 * np.eye(9))
    return np.asarray((h - np.linalg.solve(system, rows.T @ error.T.ravel())).reshape(3, 3))


def propose_homographies(
    x1: FloatArray, x2: FloatArray, near: IntArray, rng: np.random.Generator
) -> tuple[FloatArray, IntArray]:
    """Return (c, 9) homographies, last entry 1, through a point and three near it, and (c,) which point that is.

    x1, x2 : (n, 2) centred, of about unit size.  near : (n, m) nearest other points.
    """
    seeds = np.repeat(rng.permutation(len(x1))[: LABELLING.seeds], LABELLING.samples)
    pick = rng.random((len(seeds), near.shape[1])).argpartition(2, axis=1)[:, :3]
    sample = np.column_stack([seeds, near[seeds[:, None], pick]])
    H = four_point_homographies(x1[sample], x2[sample])
    depth = homogeneous(x1[sample]) @ H[:, 2, :, None]
    # the four points are seen from one side of the plane, and none lies near the horizon of H
    good = (depth > 0.05).all(axis=(1, 2)) & np.isfinite(H).all(axis=(1, 2))
    return H[good].reshape(-1, 9), seeds[good]
