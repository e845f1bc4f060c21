"""Distribution of a slope: confidence intervals and the probability of a slope below a tolerance.

A slope is the length of a two-dimensional Gaussian tilt, so near zero it is not Gaussian: it cannot be negative, is
too large on average, and has no derivative at zero. Intervals and probabilities are therefore those of the tilt.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache, lru_cache
from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from slopecli.errors import InputError
from slopecli.types import BoolArray, FloatArray, Slopes

_gauss_legendre = cache(np.polynomial.legendre.leggauss)  # nodes and weights on [-1, 1]
REACH_SIGMAS = 9.0  # a Gaussian holds less than 1e-18 beyond


def slope_interval(slopes: Slopes, level: float = 0.95) -> FloatArray:
    """Two-sided confidence interval of every slope.

    A slope belongs to the interval if a tilt of that length is close enough to the estimated tilt, in sigmas. The
    allowed distance follows from the curvature of the circle of such tilts: that of two degrees of freedom for level
    ground (the circle is a point), of one for a steep plane (the circle is nearly straight). Intervals of small slopes
    start at 0 and cover the truth with the stated probability too; they are extended where necessary to hold that
    probability for a known tilt about which the truth varies, as for a plane that is taken as level.

    Parameters
    ----------
    slopes : from `measure_slopes`.  level : 0..1, exclusive.

    Returns
    -------
    interval : (m, 2) lower and upper limit, rad, within 0..pi.

    Raises
    ------
    InputError : level is not between 0 and 1.
    """
    if not 0.0 < level < 1.0:
        raise InputError(f"the confidence level is {level}; it must lie between 0 and 1")
    estimate, covariance = slopes.slope_rad, slopes.tilt_covariance
    reach = NormalDist().inv_cdf(0.5 + 0.5 * level) * np.sqrt(covariance[:, 0, 0])
    interval = np.column_stack([estimate - reach, estimate + reach])
    widest = np.sqrt(np.linalg.eigvalsh(covariance)[:, 1])
    # beyond 8 sigmas the tilt's length is Gaussian to a thousandth of a probability
    gentle = np.flatnonzero((estimate < 8.0 * widest) & (widest > 0.0))
    # so many at a time that the tilts compared fit into the cache of a processor: half of the time for thousands
    for some in np.array_split(gentle, 1 + len(gentle) // 512):
        interval[some] = _gentle_interval(estimate[some], covariance[some], widest[some], level)
    return np.clip(interval, 0.0, np.pi)


def _gentle_interval(estimate: FloatArray, covariance: FloatArray, widest: FloatArray, level: float) -> FloatArray:
    """(k, 2) lower and upper limit of slopes within 8 sigmas of level; widest (k,): the larger sigma of the tilt."""
    tilt, outside = _Tilt.of(estimate, covariance), estimate + REACH_SIGMAS * widest
    twice = _Tilt(*(np.tile(part, (2, 1)) for part in tilt))  # both ends at once
    ends = _farthest_agreeing(twice, np.tile(estimate, 2), np.concatenate([np.zeros_like(estimate), outside]), level)
    interval = ends.reshape(2, -1).T
    below = disc_probability(estimate, covariance, interval[:, 1])
    short = (interval[:, 0] <= 0.0) & (below < level)
    interval[short, 1] = _disc_holding(estimate[short], covariance[short], widest[short], level)
    return interval


class _Tilt(NamedTuple):
    """Estimated tilts (k, 2) and their sigmas (k, 2), both along the principal axes of the error."""

    place: FloatArray
    sigma: FloatArray

    @classmethod
    def of(cls, slope: FloatArray, covariance: FloatArray) -> _Tilt:
        values, axes = np.linalg.eigh(covariance)
        # the azimuths of `_agrees` do not resolve an ellipse narrower than 0.03
        return cls(slope[:, None] * axes[:, 0, :], np.sqrt(np.maximum(values, 0.03**2 * values[:, 1:])))


def _farthest_agreeing(tilt: _Tilt, inside: FloatArray, outside: FloatArray, level: float) -> FloatArray:
    """(k,) the slope nearest to `outside` that agrees with the tilt, by bisection from `inside`, which does."""
    beyond = outside
    for _ in range(30):
        middle = 0.5 * (inside + beyond)
        good = _agrees(tilt, middle, level)
        inside, beyond = np.where(good, middle, inside), np.where(good, beyond, middle)
    return np.where(_agrees(tilt, outside, level), outside, inside)


def _agrees(tilt: _Tilt, slope: FloatArray, level: float) -> BoolArray:
    """(k,) whether some tilt of this length is close enough to the estimate, by the distance in sigmas."""
    azimuth, step = np.linspace(0.0, 2.0 * np.pi, 128, endpoint=False, retstep=True)
    x, y = np.cos(azimuth), np.sin(azimuth)
    radius, place = (slope[:, None] / tilt.sigma)[:, :, None], (tilt.place / tilt.sigma)[:, :, None]
    squared = (radius[:, 0] * x - place[:, 0]) ** 2 + (radius[:, 1] * y - place[:, 1]) ** 2
    nearest = np.argmin(squared, axis=1)
    rows = np.arange(len(slope))
    here, left, right = (squared[rows, (nearest + k) % len(azimuth)] for k in (0, -1, 1))
    bend = np.maximum(left + right - 2.0 * here, np.finfo(float).tiny)
    shift = np.clip(0.5 * (left - right) / bend, -0.5, 0.5)  # vertex of the parabola through the three
    squared_distance = np.maximum(here - 0.125 * (left - right) ** 2 / bend, 0.0)
    phi = azimuth[nearest] + shift * step
    a, b = slope / tilt.sigma[:, 0], slope / tilt.sigma[:, 1]
    # radius of curvature of the circle of tilts, an ellipse in units of the error
    curvature_radius = ((a * np.sin(phi)) ** 2 + (b * np.cos(phi)) ** 2) ** 1.5 / np.maximum(a * b, 1e-300)
    radii, limits = _distance_limits(level)
    return np.asarray(np.sqrt(squared_distance) <= np.interp(curvature_radius, radii, limits))


def _disc_holding(estimate: FloatArray, covariance: FloatArray, widest: FloatArray, level: float) -> FloatArray:
    """(k,) radius of the disc of tilts about 0 that holds the probability `level`, at most the slope plus
    `REACH_SIGMAS` times the larger sigma of the tilt, `widest`."""

    def missing(radius: FloatArray) -> FloatArray:
        beyond = 1.0 - disc_probability(estimate, covariance, radius)
        return np.log1p(-level) - np.log(np.maximum(beyond, 1e-300))

    most = estimate + REACH_SIGMAS * widest
    return _zero_of(missing, estimate + widest, estimate + 2.0 * widest, np.zeros_like(estimate), most)


def _zero_of(
    missing: Callable[[FloatArray], FloatArray], before: FloatArray, now: FloatArray, low: FloatArray, high: FloatArray
) -> FloatArray:
    """(k,) zeros of a function between `low` and `high` by secant steps from two places; it must be nearly linear."""
    missed_before, missed = missing(before), missing(now)
    for _ in range(6):
        change = np.where(missed == missed_before, np.inf, missed - missed_before)
        then = np.clip(now - missed * (now - before) / change, low, high)
        before, missed_before, now, missed = now, missed, then, missing(then)
    return now


@lru_cache(maxsize=8)
def _distance_limits(level: float) -> tuple[FloatArray, FloatArray]:
    """Distance, in sigmas, within which a Gaussian point lies of a circle through its mean with the given probability.

    Returns radii (k,) of the circle and distances (k,), from the root of the 2-degree chi-square quantile at radius 0
    to the Gaussian quantile at a large radius.
    """
    radii = np.concatenate([np.linspace(0.0, 4.0, 21), [5.0, 7.0, 10.0, 20.0]])
    unit = np.broadcast_to(np.eye(2), (len(radii), 2, 2))

    def missing(distance: FloatArray) -> FloatArray:
        within = disc_probability(radii, unit, radii + distance)
        hole = disc_probability(radii, unit, np.maximum(radii - distance, 0.0))
        beyond = 1.0 - within + np.where(distance < radii, hole, 0.0)
        return np.log1p(-level) - np.log(np.maximum(beyond, 1e-300))

    # the logarithm is nearly linear between these
    low, high = 0.8 * NormalDist().inv_cdf(0.5 + 0.5 * level), float(np.sqrt(-2.0 * np.log1p(-level)))
    first, last = np.full_like(radii, low), np.full_like(radii, high)
    return radii, _zero_of(missing, first, last, first, last)


def probability_below(slopes: Slopes, tolerance_rad: float) -> FloatArray:
    """(m,) probability that each slope is below a tolerance, the tilt being Gaussian about its estimate.

    Integrates the tilt's two-dimensional density over the disc of tolerable tilts. It is at most the probability of the
    one-dimensional Gaussian with the same sigma, because errors across the slope only steepen it.
    """
    tolerance = np.full(len(slopes.slope_rad), float(tolerance_rad))
    return disc_probability(slopes.slope_rad, slopes.tilt_covariance, tolerance)


def disc_probability(distance: FloatArray, covariance: FloatArray, radius: FloatArray) -> FloatArray:
    """Probability (k,) that a two-dimensional Gaussian point falls into a disc of radius (k,) about the origin.

    Accurate to about 1e-9: Gauss-Legendre quadrature along the narrower principal axis, the integral along the wider
    one in closed form.

    distance : (k,) of the mean from the origin, along the first axis.  covariance : (k, 2, 2).
    """
    values, axes = np.linalg.eigh(covariance)
    # a point without noise is a very small Gaussian
    sigma = np.sqrt(np.maximum(values, (1e-12 * (1.0 + radius[:, None])) ** 2))
    mean = distance[:, None] * axes[:, 0, :]
    safe = np.maximum(radius, 1e-100)
    ends = np.clip((mean[:, :1] + REACH_SIGMAS * sigma[:, :1] * [-1.0, 1.0]) / safe[:, None], -1.0, 1.0)
    # x = radius sin(angle) keeps the integrand smooth where the disc ends
    first, last = np.arcsin(ends).T[:, :, None]
    nodes, weights = _gauss_legendre(48)
    angle = 0.5 * (last - first) * nodes + 0.5 * (last + first)
    x, half_chord = safe[:, None] * np.sin(angle), safe[:, None] * np.cos(angle)
    density = np.exp(-0.5 * ((x - mean[:, :1]) / sigma[:, :1]) ** 2) / (np.sqrt(2.0 * np.pi) * sigma[:, :1])
    upper, lower = (_normal_cdf((end - mean[:, 1:]) / sigma[:, 1:]) for end in (half_chord, -half_chord))
    integral = (density * (upper - lower) * half_chord * (0.5 * (last - first))) @ weights
    return np.clip(integral, 0.0, 1.0)


def _normal_cdf(x: FloatArray) -> FloatArray:
    return 0.5 + 0.5 * np.frompyfunc(math.erf, 1, 1)(x / np.sqrt(2.0)).astype(float)
