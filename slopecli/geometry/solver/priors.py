"""Prior on the motion: a measured rotation or direction as further residuals of the joint least squares."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slopecli.errors import InputError
from slopecli.geometry.epipolar import checked_direction, rotation_vector, skew
from slopecli.types import FloatArray, Solution


@dataclass(frozen=True, eq=False)
class MotionPrior:
    """A motion measured by another sensor; None for a part that was not measured.

    rotation : (3, 3) of P2 = R (P1 - T), with an error of `rotation_sigma` rad about each axis.
    direction : (3,) unit vector from camera 1 to camera 2 in camera-1 axes, `direction_sigma` rad off to each side.
    """

    rotation: FloatArray | None = None
    rotation_sigma: float = np.inf
    direction: FloatArray | None = None
    direction_sigma: float = np.inf

    @classmethod
    def checked(
        cls,
        rotation: FloatArray | None = None,
        rotation_sigma: float = np.inf,
        direction: FloatArray | None = None,
        direction_sigma: float = np.inf,
    ) -> MotionPrior:
        """The prior, its direction scaled to length 1. InputError if a part is none or its sigma is not positive."""
        if rotation is not None:
            rotation = np.asarray(rotation, float)
            if rotation.shape != (3, 3) or not np.abs(rotation @ rotation.T - np.eye(3)).max() < 1e-6:
                raise InputError("the rotation known beforehand must be a 3x3 rotation matrix")
            if np.linalg.det(rotation) < 0:
                raise InputError("the rotation known beforehand mirrors the scene; a rotation has determinant 1")
        if direction is not None:
            direction = checked_direction("the direction known beforehand", direction)
        for name, known, sigma in (("rotation", rotation, rotation_sigma), ("direction", direction, direction_sigma)):
            if known is not None and not sigma > 0:
                raise InputError(f"the sigma of the {name} known beforehand is {sigma}; it must be positive, in rad")
        # smaller sigmas would only lose digits
        return cls(rotation, max(rotation_sigma, 1e-7), direction, max(direction_sigma, 1e-7))

    def chi2(self, solution: Solution) -> float:
        """Squared distance, in sigmas of the prior, of a solution's motion from the prior."""
        return float(self.terms(solution.R[None], solution.T[None], 1.0)[0, 6, 6])

    def strain(self, alone: Solution) -> float:
        """Increase of the images' own chi-square that moves their motion to within 3 sigmas of the prior.

        alone : the solution without the prior, its root nearer to the prior.
        """
        off, sigmas, rows = np.empty(0), np.empty(0), list[int]()
        if self.rotation is not None:
            off, rows = rotation_vector(self.rotation @ alone.R.T), [0, 1, 2]
            sigmas = np.full(3, self.rotation_sigma)
        if self.direction is not None:
            off = np.append(off, alone.tangent.T @ (self.direction - alone.T))
            rows, sigmas = [*rows, 3, 4], np.append(sigmas, np.full(2, self.direction_sigma))
        beyond = max(0.0, 1.0 - 3.0 / max(float(np.linalg.norm(off / sigmas)), 3.0))
        return float(beyond**2 * off @ np.linalg.solve(alone.motion_covariance[np.ix_(rows, rows)], off))

    def terms(self, R: FloatArray, T: FloatArray, noise: float) -> FloatArray:
        """(s, 7, 7) information, gradient (row and column 6) and chi-square (corner) at motions R (s, 3, 3), T (s, 3).

        Perturbations as in `refinement.normal_equations`; in units of `noise`^2, as the residuals' are.
        """
        terms = np.zeros((len(R), 7, 7))
        if self.rotation is not None:
            off = np.array([rotation_vector(turned @ self.rotation.T) for turned in R])
            W = skew(off)
            slope = np.eye(3) - 0.5 * W + W @ W / 12  # of the logarithm, to second order
            _add(terms, slice(0, 3), slope, off, noise / self.rotation_sigma)
        if self.direction is not None:
            across = np.eye(3) - T[:, :, None] * T[:, None, :]  # the length of T is a gauge
            _add(terms, slice(3, 6), across, T - self.direction, noise / self.direction_sigma)
        return terms


def _add(terms: FloatArray, rows: slice, J: FloatArray, off: FloatArray, weight: float) -> None:
    """Add the square of weight * off (s, 3), whose derivative by these rows is weight * J (s, 3, 3)."""
    gradient = weight**2 * (J.swapaxes(1, 2) @ off[:, :, None])[:, :, 0]
    terms[:, rows, rows] += weight**2 * J.swapaxes(1, 2) @ J
    terms[:, rows, 6] += gradient
    terms[:, 6, rows] += gradient
    terms[:, 6, 6] += weight**2 * (off * off).sum(axis=1)
