"""Whether epipolar residuals grow from the image centre as a wrong lens distortion makes them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slopecli.geometry.epipolar import homogeneous, rotation_from_vector, skew, tangent_basis
from slopecli.geometry.motion import epipolar_residual
from slopecli.geometry.statistics import GATE_SIGMAS, geman_mcclure, median, robust_sigma
from slopecli.types import FloatArray

ROUNDS, SETTLED = 20, 1e-5  # of the fit, and the step, rad and normalised coordinates, that ends it
STEP_SIZES = (1.0, 0.3, 0.1)  # shares of a step that are tried, until one fits better
MOST_TERM = 1.0  # no step leaves this: a lens that bends rays more needs another model
MIN_MATCHES = 60  # fewer say nothing of a lens
EXPLAINED = 1.25  # factor by which the term must reduce the residuals
SIGMAS = 25.0  # and how far it must be from zero, as residuals are neither independent nor free of other errors
ALIKE = 0.5  # share of itself by which the term may differ on either side of the image: a lens is the same on both


class LensMisfit(NamedTuple):
    """A radial term that both images share: x (1 + term r^2) is the true ray of a normalised coordinate x.

    A lens whose k1 is larger than its camera file says by d shows a term of -d.

    term, sigma : the term and its 1-sigma, residuals taken as independent.  before, after : robust 1-sigma of the
    epipolar residual without and with it, normalised coordinates.
    """

    term: float
    sigma: float
    before: float
    after: float

    @property
    def clear(self) -> bool:
        """Whether it explains so much of the residuals that neither noise nor chance does."""
        return self.before > EXPLAINED * self.after and abs(self.term) > SIGMAS * self.sigma


def find_lens_misfit(R: FloatArray, T: FloatArray, x1: FloatArray, x2: FloatArray, floor: float) -> LensMisfit | None:
    """The radial term that the epipolar residuals ask for, where they do so clearly and all over the image, or None.

    Parameters
    ----------
    R, T : (3, 3) and (3,) unit, the motion that fits the matches best.
    x1, x2 : (n, 2) normalised coordinates as the cameras' own models undistort them; mismatches among them.
    floor : smallest robust sigma believed, normalised coordinates.
    """
    if len(x1) < MIN_MATCHES:
        return None
    whole, R, T = fit_lens_misfit(R, T, x1, x2, floor)
    if not whole.clear:
        return None
    left = x1[:, 0] < median(x1[:, 0])
    halves = [fit_lens_misfit(R, T, x1[half], x2[half], floor, whole.term)[0] for half in (left, ~left)]
    same = all(abs(half.term - whole.term) < ALIKE * abs(whole.term) for half in halves)
    return whole if same else None


def fit_lens_misfit(
    R: FloatArray, T: FloatArray, x1: FloatArray, x2: FloatArray, floor: float, term: float = 0.0
) -> tuple[LensMisfit, FloatArray, FloatArray]:
    """Fit a radial term together with the motion, which has taken up most of what the term does.

    Robust Gauss-Newton on the epipolar residual over six parameters, Geman-McClure weights; arguments as of
    `find_lens_misfit`.  term : to start from.

    Returns
    -------
    misfit : the term.  R, T : (3, 3) and (3,), the motion that goes with it.
    """
    before = robust_sigma(epipolar_residual(R, T, x1, x2), floor)
    scale, normal = before, np.eye(6)
    for _ in range(ROUNDS):
        residual, jacobian = _linearised(R, T, term, x1, x2)
        scale = robust_sigma(residual, floor)
        weighted = jacobian * geman_mcclure(residual, GATE_SIGMAS * scale)[:, None]
        normal = weighted.T @ jacobian
        normal += 1e-12 * np.trace(normal) * np.eye(6)
        step = np.asarray(-np.linalg.solve(normal, weighted.T @ residual), float)
        # half an image may leave the six so open that a full step leads astray
        for size in STEP_SIZES:
            moved = _moved(R, T, term, size * step)
            if _cost(_residual(*moved, x1, x2), scale) <= _cost(residual, scale):
                R, T, term = moved
                break
        else:
            break
        if np.abs(step).max() < SETTLED:
            break
    return LensMisfit(term, scale * float(np.sqrt(np.linalg.inv(normal)[5, 5])), before, scale), R, T


def _moved(R: FloatArray, T: FloatArray, term: float, step: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    direction = T + tangent_basis(T) @ step[3:5]
    term = float(np.clip(term + step[5], -MOST_TERM, MOST_TERM))
    return rotation_from_vector(step[:3]) @ R, direction / np.linalg.norm(direction), term


def _residual(R: FloatArray, T: FloatArray, term: float, x1: FloatArray, x2: FloatArray) -> FloatArray:
    """Epipolar residual (n,) of the rays that a term makes of the coordinates."""
    straight1, straight2 = (x * (1 + term * (x * x).sum(1, keepdims=True)) for x in (x1, x2))
    return epipolar_residual(R, T, straight1, straight2)


def _cost(residual: FloatArray, scale: float) -> float:
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
