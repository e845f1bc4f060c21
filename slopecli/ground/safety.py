"""Slope of footprints against up, its 1-sigma, and the probability that a footprint is safe."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np

from slopecli.geometry.epipolar import tangent_basis
from slopecli.geometry.slope import ASPECT_SIGMAS, aspects
from slopecli.geometry.tilt_distribution import REACH_SIGMAS
from slopecli.types import FloatArray


class SafetyTunables(NamedTuple):
    """Tunables of slopes' sigmas and of probabilities."""

    flattened_gsd: float = 0.7  # ground px by which the matcher flattens what stands out, on average
    flattened_sigma_gsd: float = 2.0  # 1-sigma of that


SAFETY = SafetyTunables()


@dataclass(frozen=True, eq=False)
class Tilts:
    """Tilt of footprints against up (rows, columns): slope_rad, aspect_rad (NaN where level within its sigma), and the
    variances of the tilt along the slope and across it and their covariance, rad^2."""

    slope_rad: FloatArray
    aspect_rad: FloatArray
    along: FloatArray
    across: FloatArray
    both: FloatArray

    @property
    def sigma_rad(self) -> FloatArray:
        """Root mean square error of the slope over the distribution of the tilt."""
        return slope_sigma(self.slope_rad, self.along, self.across)

    def probability_below(self, tolerance_rad: float) -> FloatArray:
        """Probability that the slope is below a tolerance, that of a tilt in a disc, good to 1e-3.

        Gauss-Legendre quadrature along the narrower principal axis of the tilt, the integral along the wider one in
        closed form; as `disc_probability`, in a tenth of its time.
        """
        mean, half = 0.5 * (self.along + self.across), 0.5 * (self.along - self.across)
        radius, turn = np.hypot(half, self.both), 0.5 * np.arctan2(self.both, half)
        narrow, wide = (np.sqrt(np.maximum(mean + sign * radius, 1e-14)) for sign in (-1.0, 1.0))
        x0, y0 = self.slope_rad * np.sin(turn), self.slope_rad * np.cos(turn)
        # x = tolerance sin(angle) keeps the integrand smooth where the disc ends
        first, last = (
            np.arcsin(np.clip((x0 + sign * 0.5 * REACH_SIGMAS * narrow) / tolerance_rad, -1.0, 1.0))
            for sign in (-1.0, 1.0)
        )
        total = np.zeros_like(self.slope_rad)
        for node, weight in zip(*_legendre(), strict=True):
            angle = 0.5 * ((last - first) * node + last + first)
            x, chord = tolerance_rad * np.sin(angle), tolerance_rad * np.cos(angle)
            inside = normal_cdf((chord - y0) / wide) - normal_cdf((-chord - y0) / wide)
            total += weight * inside * chord * np.exp(-0.5 * ((x - x0) / narrow) ** 2)
        return np.clip(total * 0.5 * (last - first) / (np.sqrt(2.0 * np.pi) * narrow), 0.0, 1.0)


def tilts(normals: FloatArray, covariance: FloatArray, up: FloatArray, up_sigma_rad: float, north: FloatArray) -> Tilts:
    """Tilt of planes with scaled normals (..., 3) of a covariance (..., 3, 3) against up.

    north : (3,) horizontal unit vector that aspects are counted from.
    """
    length = np.linalg.norm(normals, axis=-1, keepdims=True)
    unit = -normals / length
    across = np.cross(up, unit)
    size = np.linalg.norm(across, axis=-1, keepdims=True)
    across = np.where(size > 1e-12, across / np.maximum(size, 1e-12), tangent_basis(up)[:, 0])
    along = np.cross(across, unit)
    slope = np.arctan2(size[..., 0], unit @ up)
    variances = [
        np.einsum("...i,...ij,...j->...", one, covariance, other) / length[..., 0] ** 2
        for one, other in ((along, along), (across, across), (along, across))
    ]
    variances[:2] = [variance + up_sigma_rad**2 for variance in variances[:2]]
    aspect = aspects(unit.reshape(-1, 3), up, north).reshape(slope.shape)
    level = slope < ASPECT_SIGMAS * slope_sigma(slope, *variances[:2])
    return Tilts(slope, np.where(level, np.nan, aspect), *variances)


def slope_sigma(slope: FloatArray, along: FloatArray, across: FloatArray) -> FloatArray:
    """RMS of |tilt + error| - |tilt| for errors of these variances along and across the slope, by quadrature.

    As `geometry.slope.slope_sigmas`, but to a few percent, and without the covariance of both: a map has many cells.
    """
    nodes, weights = _hermite()
    total = np.zeros_like(slope)
    for a, weight_a in zip(nodes, weights, strict=True):
        for b, weight_b in zip(nodes, weights, strict=True):
            changed = np.hypot(slope + a * np.sqrt(along), b * np.sqrt(across)) - slope
            total += weight_a * weight_b * changed**2
    return np.sqrt(total)


@cache
def _hermite() -> tuple[FloatArray, FloatArray]:
    """Nodes and weights along either axis by which a slope's sigma is good to a few percent."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(5)
    return nodes, weights / weights.sum()


@cache
def _legendre() -> tuple[FloatArray, FloatArray]:
    """Nodes and weights over -1..1 by which a probability is good to 1e-3."""
    return np.polynomial.legendre.leggauss(14)


def probability_low(height: FloatArray, limit: float, ground_px: FloatArray, scale_sigma: float) -> FloatArray:
    """Probability that nothing in a footprint is farther off its plane than a limit.

    height : largest distance off the plane that was seen.  ground_px : size of a pixel on the ground, as the limit.
    scale_sigma : relative 1-sigma of lengths.
    """
    variance = (SAFETY.flattened_sigma_gsd * ground_px) ** 2 + (scale_sigma * height) ** 2
    return normal_cdf((limit - height - SAFETY.flattened_gsd * ground_px) / np.sqrt(variance))


def least_limit(ground_px: float, confidence: float) -> float:
    """Smallest limit of heights that pixels of this size on the ground can promise with a confidence."""
    from statistics import NormalDist

    return ground_px * (SAFETY.flattened_gsd + SAFETY.flattened_sigma_gsd * NormalDist().inv_cdf(confidence))


def normal_cdf(x: FloatArray) -> FloatArray:
    """Cumulative standard normal distribution, to 1e-7 (Abramowitz and Stegun 26.2.17, of NaN it is NaN)."""
    size = np.abs(x)
    t = 1.0 / (1.0 + 0.2316419 * size)
    series = t * (0.319381530 + t * (-0.356563782 + t * (1.781477937 + t * (-1.821255978 + t * 1.330274429))))
    tail = np.exp(-0.5 * np.minimum(size, 38.0) ** 2) / np.sqrt(2.0 * np.pi) * series
    return np.where(x > 0, 1.0 - tail, np.where(np.isnan(x), np.nan, tail))
