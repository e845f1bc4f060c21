"""Planes under a known epipolar geometry, three parameters each: residuals, fits and proposals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slopecli.geometry.statistics import robust_least_squares
from slopecli.patches.labelling.student_t import t_weight
from slopecli.types import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class DepthPlanes:
    """The model of planes N (k, 3) with w = N . (x1, 1), w being inverse depth: see `search.PlaneModel`.

    rows (n, 3), target (n,) : target - rows @ N is the residual along the epipolar line of image 2.
    base (n,) : cost of the residual across that line, nats.  bounds : of the residuals' scale, in their unit.
    """

    rows: FloatArray
    target: FloatArray
    base: FloatArray
    bounds: tuple[float, float]
    dim = 1

    def squares(self, planes: FloatArray) -> FloatArray:
        """Return (n, k) squared residuals."""
        return np.asarray((self.target[:, None] - self.rows @ planes.T) ** 2)

    def take(self, part: IntArray) -> DepthPlanes:
        """Return the same model for some of the points."""
        return DepthPlanes(self.rows[part], self.target[part], self.base[part], self.bounds)

    def fit(self, plane: FloatArray, own: BoolArray, scale: float) -> FloatArray:
        """Return the plane (3,) refined on its own points by reweighted least squares; unchanged if under four."""
        if own.sum() < 4:
            return plane
        rows, target = self.rows[own], self.target[own]
        for _ in range(3):  # labels and scale change between the calls: no need to converge
            weighted = rows * t_weight((target - rows @ plane) ** 2, scale, self.dim)[:, None]
            plane = solve_regular(weighted.T @ rows, weighted.T @ target)
        return plane


def solve_regular(system: FloatArray, right: FloatArray) -> FloatArray:
    """Return solutions (..., 3) of normal equations (..., 3, 3), (..., 3); the smallest where they are singular."""
    size = np.trace(system, axis1=-2, axis2=-1)[..., None, None]
    return np.asarray(np.linalg.solve(system + (1e-10 * size + 1e-30) * np.eye(3), right[..., None])[..., 0])


def robust_planes(rows: FloatArray, target: FloatArray, bounds: tuple[float, float] = (1.0, 1.0)) -> FloatArray:
    """Return (..., 3) planes through groups of cells, rows (..., m, 3), target (..., m), by reweighted least squares.

    bounds : smallest and largest 1-sigma of a residual; 1 for residuals in sigmas.
    """
    columns = np.swapaxes(rows, -1, -2)
    start = solve_regular(columns @ rows, (columns @ target[..., None])[..., 0])
    return robust_least_squares(rows, target, start, bounds, 5)[0]
