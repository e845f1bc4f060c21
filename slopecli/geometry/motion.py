"""Relative motion from correspondences without planes: epipolar residual, robust refinement, inverse depth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slopecli.geometry.epipolar import homogeneous, rotation_from_vector, skew, tangent_basis
from slopecli.geometry.statistics import GATE_SIGMAS, geman_mcclure, median, robust_sigma
from slopecli.types import FloatArray


@dataclass(frozen=True, eq=False)
class MotionEstimate:
    """A motion P2 = R (P1 - T) with R (3, 3), T (3,) unit, and its fit to the matches it was scored on.

    scale : robust 1-sigma of the epipolar residual, normalised coordinates.  cost : truncated mean square of the
    residual.  front : share of the matches near their epipolar lines that lie in front of the camera.
    """

    R: FloatArray
    T: FloatArray
    scale: float
    cost: float
    front: float


def epipolar_residual(R: FloatArray, T: FloatArray, x1: FloatArray, x2: FloatArray) -> FloatArray:
    """Signed first-order epipolar distance (n,), normalised coordinates, as if all error were in image 2.

    Source: Sampson's distance (Hartley and Zisserman, eq. (11.9)) times sqrt 2.
    """
    return _residual_parts(R, T, homogeneous(x1), homogeneous(x2))[0]


def _residual_parts(R: FloatArray, T: FloatArray, p1: FloatArray, p2: FloatArray) -> tuple[FloatArray, ...]:
    """Residual (n,), epipolar lines in image 2 (n, 3), and the factor (n,) that makes p2 . line the residual."""
    E = R @ skew(T)
    line2, line1 = p1 @ E.T, p2 @ E
    square = line2[:, 0] ** 2 + line2[:, 1] ** 2 + line1[:, 0] ** 2 + line1[:, 1] ** 2
    factor = np.sqrt(2.0 / np.maximum(square, 1e-20))
    return np.einsum("ij,ij->i", p2, line2) * factor, line2, factor


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Cross products of rows (n, 3), several times as fast as np.cross for a few hundred."""
    product = np.empty(a.shape)
    (a0, a1, a2), (b0, b1, b2) = a.T, b.T
    product[:, 0], product[:, 1], product[:, 2] = a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0
    return product


def refine_motion(
    R: FloatArray, T: FloatArray, x1: FloatArray, x2: FloatArray, bounds: tuple[float, float], iterations: int = 15
) -> MotionEstimate:
    """Robust Gauss-Newton on the epipolar residual over the five parameters of the motion.

    Geman-McClure weights, whose scale follows the residuals.

    Parameters
    ----------
    R, T : (3, 3) and (3,) motion to start from.
    x1, x2 : (n, 2) normalised coordinates; some may be mismatches.
    bounds : smallest and largest sigma believed, normalised coordinates. The upper bound guards against a majority of
        mismatches.
    """
    p1, p2 = homogeneous(x1), homogeneous(x2)
    scale = bounds[0]
    for _ in range(iterations):
        residual, line2, factor = _residual_parts(R, T, p1, p2)
        scale = robust_sigma(residual, *bounds)
        weight = geman_mcclure(residual, GATE_SIGMAS * scale)
        basis = tangent_basis(T)
        jacobian = np.empty((len(p1), 5))
        jacobian[:, :3] = _cross(line2, p2)
        jacobian[:, 3:] = _cross(p1, p2 @ R) @ basis
        jacobian *= factor[:, None]
        weighted = jacobian * weight[:, None]
        normal = weighted.T @ jacobian
        step = -np.linalg.solve(normal + 1e-12 * np.trace(normal) * np.eye(5), weighted.T @ residual)
        R = rotation_from_vector(step[:3]) @ R
        T = T + basis @ step[3:]
        T = T / np.linalg.norm(T)
        if np.abs(step).max() < 1e-6:  # rad, about a thousandth of a pixel
            break
    return assess_motion(R, T, x1, x2, scale)


def assess_motion(R: FloatArray, T: FloatArray, x1: FloatArray, x2: FloatArray, scale: float) -> MotionEstimate:
    """Score a motion, with the sign of T that puts more of the scene in front of the camera.

    scale : 1-sigma of the residual, normalised coordinates. Residuals are truncated at four of them; costs can be
        compared only under the same scale.
    """
    limit = 4.0 * scale
    w, leverage = inverse_depth(R, T, x1, x2)
    residual = np.abs(epipolar_residual(R, T, x1, x2))
    near = residual < limit
    if near.any() and median(w[near] * leverage[near]) < 0:
        return assess_motion(R, -T, x1, x2, scale)
    # noise alone may make a far point's inverse depth slightly negative
    behind = w * leverage < -limit
    cost = float(np.mean(np.where(behind, limit**2, np.minimum(residual, limit) ** 2)))
    front = float(np.mean(~behind[near])) if near.any() else 0.0
    return MotionEstimate(R, T, scale, cost, front)


def inverse_depth(R: FloatArray, T: FloatArray, x1: FloatArray, x2: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Inverse depth of each match, by least squares in image 2.

    Parameters
    ----------
    x1, x2 : (n, 2) normalised coordinates.

    Returns
    -------
    w : (n,) with x2 ~ R (x1 - w T), 1/baseline; negative behind the camera, and by noise far away.
    leverage : (n,) |d x2 / d w|; near 0 at the focus of expansion, where w is undetermined.
    """
    a, b = homogeneous(x1) @ R.T, R @ T
    along = b[:2] - x2 * b[2]
    offset = a[:, :2] - x2 * a[:, 2:]
    square = np.einsum("ij,ij->i", along, along)
    w = np.einsum("ij,ij->i", along, offset) / np.maximum(square, 1e-18)
    z2 = a[:, 2] - w * b[2]
    return w, np.sqrt(square) / np.maximum(np.abs(z2), 1e-12)
