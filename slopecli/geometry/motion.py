"""Relative motion from correspondences without planes: epipolar residual, robust refinement, inverse depth.

Also the test for wrong lens distortion: a radial term fitted to the epipolar residuals together with the motion.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from slopecli.geometry.epipolar import homogeneous, rotation_from_vector, skew, tangent_basis
from slopecli.geometry.statistics import GATE_SIGMAS, geman_mcclure, median, robust_sigma
from slopecli.types import FloatArray

MOST_TERM = 1.0  # of a lens misfit: one that reaches it was not measured


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
    """Residual (n,), epipolar lines (n, 3) in images 2 and 1, and the factor (n,) from p2 . line2 to the residual."""
    E = R @ skew(T)
    line2, line1 = p1 @ E.T, p2 @ E
    square = line2[:, 0] ** 2 + line2[:, 1] ** 2 + line1[:, 0] ** 2 + line1[:, 1] ** 2
    factor = np.sqrt(2.0 / np.maximum(square, 1e-20))
    return np.einsum("ij,ij->i", p2, line2) * factor, line2, line1, factor


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Cross products of rows (n, 3), several times as fast as np.cross for a few hundred."""
    product = np.empty(a.shape)
    (a0, a1, a2), (b0, b1, b2) = a.T, b.T
    product[:, 0], product[:, 1], product[:, 2] = a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0
    return product


def refine_motion(
    R: FloatArray, T: FloatArray, x1: FloatArray, x2: FloatArray, bounds: tuple[float, float], iterations: int = 15
) -> MotionEstimate:
    """Robust Gauss-Newton on the epipolar residual over the five parameters of the motion, from R and T.

    Geman-McClure weights, whose scale follows the residuals.

    x1, x2 : (n, 2) normalised coordinates; some may be mismatches.  bounds : of the robust sigma, in
        normalised coordinates. The upper bound guards against a majority of mismatches.
    """
    p1, p2 = homogeneous(x1), homogeneous(x2)
    scale = bounds[0]
    for _ in range(iterations):
        residual, line2, _, factor = _residual_parts(R, T, p1, p2)
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
    """Inverse depths w (n,) of matches x1, x2 (n, 2), by least squares in image 2, and their leverage (n,).

    w has x2 ~ R (x1 - w T), in 1/baseline; it is negative behind the camera, and by noise far away. The leverage is
    |d x2 / d w|, near 0 at the focus of expansion, where w is undetermined.
    """
    a, b = homogeneous(x1) @ R.T, R @ T
    along = b[:2] - x2 * b[2]
    offset = a[:, :2] - x2 * a[:, 2:]
    square = np.einsum("ij,ij->i", along, along)
    w = np.einsum("ij,ij->i", along, offset) / np.maximum(square, 1e-18)
    z2 = a[:, 2] - w * b[2]
    return w, np.sqrt(square) / np.maximum(np.abs(z2), 1e-12)


class LensMisfit(NamedTuple):
    """A radial term shared by both images: x (1 + term r^2) is the true ray of a normalised coordinate x.

    If the true k1 exceeds that of the camera file by d, the term is -d.

    term, sigma : the term and its 1-sigma for independent residuals.  before, after : robust 1-sigma of the epipolar
    residual without and with it, normalised coordinates.  reach : 19 of 20 matches lie nearer to the axis.
    """

    term: float
    sigma: float
    before: float
    after: float
    reach: float = float("inf")

    @property
    def clear(self) -> bool:
        """Whether the term is significant: it reduces the residuals by a fifth and is 25 sigmas from zero.

        So many sigmas, because residuals are correlated and hold other systematic errors.
        """
        return self.before > 1.25 * self.after and abs(self.term) > 25.0 * self.sigma


def find_lens_misfit(R: FloatArray, T: FloatArray, x1: FloatArray, x2: FloatArray, floor: float) -> LensMisfit | None:
    """The radial term that explains the epipolar residuals; None unless it is significant and alike in both halves.

    R, T : the motion that fits the matches best.  x1, x2 : (n, 2) normalised coordinates, undistorted by the cameras'
    own models; some may be mismatches.  floor : lower bound of the robust sigma, normalised coordinates.
    """
    if len(x1) < 60:  # too few to tell a lens error from noise
        return None
    whole, R, T = fit_lens_misfit(R, T, x1, x2, floor)
    if not whole.clear:
        return None
    left = x1[:, 0] < median(x1[:, 0])
    halves = [fit_lens_misfit(R, T, x1[half], x2[half], floor, whole.term)[0] for half in (left, ~left)]
    same = all(abs(half.term - whole.term) < 0.5 * abs(whole.term) for half in halves)
    # what the halves disagree by is an error that the residuals, which are correlated, do not show
    sigma = max(whole.sigma, 0.5 * abs(halves[0].term - halves[1].term))
    return whole._replace(sigma=sigma) if same else None


def fit_lens_misfit(
    R: FloatArray, T: FloatArray, x1: FloatArray, x2: FloatArray, floor: float, term: float = 0.0
) -> tuple[LensMisfit, FloatArray, FloatArray]:
    """Fit a radial term jointly with the motion, and return both: a motion alone absorbs most of a lens error.

    Robust Gauss-Newton on the epipolar residual over six parameters, Geman-McClure weights. Arguments as of
    `find_lens_misfit`; term : to start from.
    """
    before = robust_sigma(epipolar_residual(R, T, x1, x2), floor)
    scale, normal = before, np.eye(6)
    for _ in range(20):
        residual, jacobian = _linearised(R, T, term, x1, x2)
        scale = robust_sigma(residual, floor)
        weighted = jacobian * geman_mcclure(residual, GATE_SIGMAS * scale)[:, None]
        normal = weighted.T @ jacobian
        normal += 1e-12 * np.trace(normal) * np.eye(6)
        step = np.asarray(-np.linalg.solve(normal, weighted.T @ residual), float)
        # half an image may determine the six so poorly that a full step diverges
        for size in (1.0, 0.3, 0.1):
            moved = _moved(R, T, term, size * step)
            if _cost(_residual(*moved, x1, x2), scale) <= _cost(residual, scale):
                R, T, term = moved
                break
        else:
            break
        if np.abs(step).max() < 1e-5:  # rad
            break
    reach = float(np.quantile(np.linalg.norm(np.concatenate([x1, x2]), axis=1), 0.95))
    return LensMisfit(term, scale * float(np.sqrt(np.linalg.inv(normal)[5, 5])), before, scale, reach), R, T


def _moved(R: FloatArray, T: FloatArray, term: float, step: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    direction = T + tangent_basis(T) @ step[3:5]
    term = float(np.clip(term + step[5], -MOST_TERM, MOST_TERM))  # a stronger distortion needs another lens model
    return rotation_from_vector(step[:3]) @ R, direction / np.linalg.norm(direction), term


def _residual(R: FloatArray, T: FloatArray, term: float, x1: FloatArray, x2: FloatArray) -> FloatArray:
    """Epipolar residual (n,) of the coordinates corrected by a term."""
    straight1, straight2 = (x * (1 + term * (x * x).sum(1, keepdims=True)) for x in (x1, x2))
    return epipolar_residual(R, T, straight1, straight2)


def _cost(residual: FloatArray, scale: float) -> float:
    """Geman-McClure cost, summed."""
    square = (residual / (GATE_SIGMAS * scale)) ** 2
    return float((square / (1 + square)).sum())


def _linearised(
    R: FloatArray, T: FloatArray, term: float, x1: FloatArray, x2: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Epipolar residual (n,), normalised coordinates, and its derivatives (n, 6) by rotation, direction and term."""
    bent1, bent2 = (x * (x * x).sum(1, keepdims=True) for x in (x1, x2))
    p1, p2 = homogeneous(x1 + term * bent1), homogeneous(x2 + term * bent2)
    residual, line2, line1, factor = _residual_parts(R, T, p1, p2)
    by_term = (line2[:, :2] * bent2).sum(1) + (line1[:, :2] * bent1).sum(1)
    jacobian = np.column_stack([_cross(line2, p2), _cross(p1, p2 @ R) @ tangent_basis(T), by_term])
    return residual, jacobian * factor[:, None]
