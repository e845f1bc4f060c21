"""Test for wrong lens distortion: a radial term fitted together with the motion to the epipolar residuals."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slopecli.geometry.epipolar import homogeneous, rotation_from_vector, skew, tangent_basis
from slopecli.geometry.motion import epipolar_residual
from slopecli.geometry.statistics import GATE_SIGMAS, geman_mcclure, median, robust_sigma
from slopecli.types import FloatArray


class LensMisfit(NamedTuple):
    """A radial term shared by both images: x (1 + term r^2) is the true ray of a normalised coordinate x.

    If the true k1 exceeds that of the camera file by d, the term is -d.

    term, sigma : the term and its 1-sigma for independent residuals.  before, after : robust 1-sigma of the epipolar
    residual without and with it, normalised coordinates.
    """

    term: float
    sigma: float
    before: float
    after: float

    @property
    def clear(self) -> bool:
        """Whether the term is significant: it reduces the residuals by a fifth and is 25 sigmas from zero.

        So many sigmas, because residuals are correlated and hold other systematic errors.
        """
        return self.before > 1.25 * self.after and abs(self.term) > 25.0 * self.sigma


def find_lens_misfit(R: FloatArray, T: FloatArray, x1: FloatArray, x2: FloatArray, floor: float) -> LensMisfit | None:
    """The radial term that explains the epipolar residuals; None unless it is significant and alike in both halves.

    Parameters
    ----------
    R, T : (3, 3) and (3,) unit, the motion that fits the matches best.
    x1, x2 : (n, 2) normalised coordinates, undistorted by the cameras' own models; some may be mismatches.
    floor : smallest robust sigma believed, normalised coordinates.
    """
    if len(x1) < 60:  # too few to tell a lens error from noise
        return None
    whole, R, T = fit_lens_misfit(R, T, x1, x2, floor)
    if not whole.clear:
        return None
    left = x1[:, 0] < median(x1[:, 0])
    halves = [fit_lens_misfit(R, T, x1[half], x2[half], floor, whole.term)[0] for half in (left, ~left)]
    same = all(abs(half.term - whole.term) < 0.5 * abs(whole.term) for half in halves)
    return whole if same else None


def fit_lens_misfit(
    R: FloatArray, T: FloatArray, x1: FloatArray, x2: FloatArray, floor: float, term: float = 0.0
) -> tuple[LensMisfit, FloatArray, FloatArray]:
    """Fit a radial term jointly with the motion: a motion alone absorbs most of a lens error.

    Robust Gauss-Newton on the epipolar residual over six parameters, Geman-McClure weights. Arguments as of
    `find_lens_misfit`; term : to start from.

    Returns
    -------
    misfit : the term.  R, T : (3, 3) and (3,), the motion that goes with it.
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
    return LensMisfit(term, scale * float(np.sqrt(np.linalg.inv(normal)[5, 5])), before, scale), R, T


def _moved(R: FloatArray, T: FloatArray, term: float, step: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    direction = T + tangent_basis(T) @ step[3:5]
    term = float(np.clip(term + step[5], -1.0, 1.0))  # a stronger distortion needs another lens model
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
    E = R @ skew(T)
    line2, line1 = p1 @ E.T, p2 @ E
    square = (line2[:, :2] ** 2).sum(1) + (line1[:, :2] ** 2).sum(1)
    factor = np.sqrt(2.0 / np.maximum(square, 1e-20))
    by_term = (line2[:, :2] * bent2).sum(1) + (line1[:, :2] * bent1).sum(1)
    jacobian = np.column_stack([np.cross(line2, p2), np.cross(p1, p2 @ R) @ tangent_basis(T), by_term])
    return np.einsum("ij,ij->i", p2, line2) * factor, jacobian * factor[:, None]
