"""Slopes, aspects and what can honestly be said about them.

A slope is the length of a two-dimensional tilt, so near zero it is not Gaussian: its estimate cannot be negative, is
too large on average, and has no derivative at zero. Everything here works on the tilt and its 2x2 covariance instead.
"""

from __future__ import annotations

import math
from functools import lru_cache
from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from slopecli.errors import InputError
from slopecli.geometry.epipolar import tangent_basis, unit_vector
from slopecli.geometry.tilt_interval import tilt_growth
from slopecli.types import BoolArray, FloatArray, Slopes, Solution

CAMERA_UP = np.array([0.0, 0.0, -1.0])  # up where the camera looks straight down
IMAGE_UP = np.array([0.0, -1.0, 0.0])
VIEWING_DIRECTION = np.array([0.0, 0.0, 1.0])

# standard deviations of a slope below which its downhill direction means nothing
_ASPECT_NEEDS = 2.0
# slope over its largest tilt sigma beyond which the tilt's length is Gaussian to a thousandth of a probability
_GAUSSIAN_BEYOND = 8.0
# beyond this many standard deviations a Gaussian holds less than 1e-18
_REACH = 9.0
_NODES, _NODE_WEIGHTS = np.polynomial.legendre.leggauss(48)
_HERMITE, _HERMITE_WEIGHTS = np.polynomial.hermite_e.hermegauss(16)
_BISECTIONS, _HALVINGS = 30, 24
_NARROWEST = 0.03  # of the wider sigma of a tilt is the narrower at least: the azimuths tell no thinner ellipse
_AZIMUTHS = np.linspace(0.0, 2.0 * np.pi, 128, endpoint=False)
_erf = np.frompyfunc(math.erf, 1, 1)


def surface_normals(solution: Solution) -> FloatArray:
    """(m, 3) unit normals that point out of the surface, towards camera 1: -N / |N|."""
    N = solution.scaled_normals
    return -N / np.linalg.norm(N, axis=1, keepdims=True)


def measure_slopes(
    solution: Solution,
    up_cam1: FloatArray | None = None,
    up_sigma_rad: float = 0.0,
    north: FloatArray | None = None,
    *,
    up_plane: int | None = None,
) -> Slopes:
    """Slope and aspect of every plane.

    Parameters
    ----------
    up_cam1 : (3,) direction against gravity in camera-1 axes, any length.
    up_sigma_rad : 1-sigma of that direction about each horizontal axis.
    north : (3,) direction aspects are counted from, camera-1 axes; None takes the image's up direction (or the viewing
        direction when the camera looks at the horizon). Only its horizontal part counts.
    up_plane : take the normal of this plane of the solution as up instead of `up_cam1`; what its own noise shares with
        the other planes is accounted for, and its own slope is 0 exactly.

    Returns
    -------
    slopes : `Slopes`. sigma_rad is the root mean square error of the slope as the tilt varies: the first-order sigma
        on a steep plane, finite and not zero on a level one, larger where the normal is so open that no derivative
        tells its tilt (`openness.tilt_growth`). aspect_rad is clockwise seen from above, 0..2 pi, NaN
        where the slope is below twice its sigma.

    Raises
    ------
    InputError : up or north is zero, not finite, or north is vertical; neither or both of the ups are given.
    """
    normals = surface_normals(solution)
    up = _up_direction(normals, up_cam1, up_plane)
    if not (np.isfinite(up_sigma_rad) and up_sigma_rad >= 0.0):
        raise InputError(f"the uncertainty of up is {up_sigma_rad}; it must be a number >= 0")
    along, across = _tilt_axes(normals, up)
    slope = np.arctan2(np.linalg.norm(np.cross(up, normals), axis=1), normals @ up)
    covariance = _tilt_covariance(solution, normals, along, across, up, up_plane)
    growth = tilt_growth(solution.scaled_normals, solution.normal_covariance)
    covariance = _positive(covariance) * growth[:, None, None] ** 2
    if up_plane is not None:
        covariance[up_plane] = 0.0  # against itself it has no noise; how level it is in truth is up's uncertainty
    covariance = covariance + up_sigma_rad**2 * np.eye(2)
    sigma = _root_mean_square_error(slope, covariance)
    aspect = _aspects(normals, up, _north_direction(up, north))
    meaningful = (slope >= _ASPECT_NEEDS * sigma) & (np.sin(slope) > 0.0)
    spread = np.sqrt(covariance[:, 1, 1]) / np.where(meaningful, np.sin(slope), 1.0)
    nothing = np.where(meaningful, 0.0, np.nan)
    return Slopes(slope, sigma, aspect + nothing, spread + nothing, covariance)


def _direction(name: str, vector: FloatArray) -> FloatArray:
    vector = np.asarray(vector, dtype=float)
    unit = unit_vector(vector) if vector.shape == (3,) else np.zeros(3)
    if not unit.any():
        raise InputError(f"{name} is {vector.tolist()}; it must be three finite numbers, not all zero")
    return unit


def _up_direction(normals: FloatArray, up_cam1: FloatArray | None, up_plane: int | None) -> FloatArray:
    if (up_cam1 is None) == (up_plane is None):
        raise InputError("give either the up direction or the plane whose normal is up, not both or neither")
    if up_plane is None:
        return _direction("up", up_cam1)  # type: ignore[arg-type]
    if not 0 <= up_plane < len(normals):
        raise InputError(f"up_plane is {up_plane}, the solution has planes 0..{len(normals) - 1}")
    return np.asarray(normals[up_plane])


def _tilt_axes(normals: FloatArray, up: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Unit tangents (m, 3) at each normal: away from up (steeper), and level; any pair where the normal is up."""
    across = np.cross(up, normals)
    length = np.linalg.norm(across, axis=1)
    level = length < 1e-12
    across[level], length[level] = tangent_basis(up)[:, 0], 1.0
    across /= length[:, None]
    return np.cross(across, normals), across


def _tilt_covariance(
    solution: Solution,
    normals: FloatArray,
    along: FloatArray,
    across: FloatArray,
    up: FloatArray,
    up_plane: int | None,
) -> FloatArray:
    """(m, 2, 2) covariance of the tilt between each normal and up, first order in the scaled normals."""
    # d n = -(I - n n^T) dN / |N|, and the axes are perpendicular to n already
    axes = -np.stack([along, across], axis=1) / np.linalg.norm(solution.scaled_normals, axis=1)[:, None, None]
    covariance = axes @ solution.normal_covariance @ axes.swapaxes(1, 2)
    if up_plane is None:
        return covariance
    # the same tilt seen from the up plane: its normal moves the other way
    far = np.stack([np.cross(across, up), across], axis=1)
    reference = far / np.linalg.norm(solution.scaled_normals[up_plane])
    shared = np.array([solution.cross_covariance(i, up_plane) for i in range(len(normals))])
    mixed = axes @ shared @ reference.swapaxes(1, 2)
    own = reference @ solution.normal_covariance[up_plane] @ reference.swapaxes(1, 2)
    return covariance + own + mixed + mixed.swapaxes(1, 2)


def _positive(covariance: FloatArray) -> FloatArray:
    """(m, 2, 2) without the negative variances that rounding gives planes whose tilt is hardly known."""
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.swapaxes(1, 2)))
    if (values >= 0.0).all():
        return covariance
    return np.asarray((vectors * np.maximum(values, 0.0)[:, None, :]) @ vectors.swapaxes(1, 2))


def _root_mean_square_error(slope: FloatArray, covariance: FloatArray) -> FloatArray:
    """(m,) RMS of |tilt + error| - |tilt| over the error, by Gauss-Hermite quadrature in two dimensions."""
    factor = _square_root(covariance)
    z = np.stack(np.meshgrid(_HERMITE, _HERMITE), axis=-1).reshape(-1, 2)
    weight = np.outer(_HERMITE_WEIGHTS, _HERMITE_WEIGHTS).ravel() / (2.0 * np.pi)
    error = z @ factor.swapaxes(1, 2)
    # |t + e| - |t| without cancellation
    change = error[:, :, 0] * (2.0 * slope[:, None] + error[:, :, 0]) + error[:, :, 1] ** 2
    length = np.hypot(slope[:, None] + error[:, :, 0], error[:, :, 1])
    change = change / np.maximum(length + slope[:, None], np.finfo(float).tiny)
    return np.sqrt(change**2 @ weight)


def _square_root(covariance: FloatArray) -> FloatArray:
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :])


def _north_direction(up: FloatArray, north: FloatArray | None) -> FloatArray:
    """Horizontal unit vector (3,) that aspects are counted from."""
    given = _direction("north", north) if north is not None else IMAGE_UP
    level = given - (given @ up) * up
    if np.linalg.norm(level) < 1e-6:
        if north is not None:
            raise InputError("north is vertical, so it gives no horizontal direction; give another north")
        level = VIEWING_DIRECTION - (VIEWING_DIRECTION @ up) * up
    return np.asarray(level / np.linalg.norm(level))


def _aspects(normals: FloatArray, up: FloatArray, north: FloatArray) -> FloatArray:
    """(m,) azimuth of the downhill direction, the horizontal part of the outward normal; 0..2 pi."""
    east = np.cross(north, up)
    return np.asarray(np.arctan2(normals @ east, normals @ north) % (2.0 * np.pi))


def slope_interval(slopes: Slopes, level: float = 0.95) -> FloatArray:
    """Two-sided confidence interval of every slope.

    A slope belongs to the interval when some tilt of that length agrees with the tilt found. How far the two may be
    apart depends on how strongly the circle of such tilts is curved against the error: two degrees of freedom for
    level ground, whose circle is a point, one on a steep plane, whose circle is straight. The interval so covers the
    truth with the stated probability at small slopes too, where it starts at 0. There it does so as well where the
    tilt is laid down and the truth varies about it, as with a plane that is taken as level.

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
    gentle = np.flatnonzero((estimate < _GAUSSIAN_BEYOND * widest) & (widest > 0.0))
    if len(gentle):
        s, tilt = estimate[gentle], _Tilt.of(estimate[gentle], covariance[gentle])
        # both ends at once
        twice, outside = _Tilt(*(np.tile(part, (2, 1)) for part in tilt)), s + _REACH * widest[gentle]
        ends = _farthest_agreeing(twice, np.tile(s, 2), np.concatenate([np.zeros_like(s), outside]), level)
        interval[gentle] = ends.reshape(2, -1).T
        below = disc_probability(s, covariance[gentle], interval[gentle, 1])
        short = gentle[(interval[gentle, 0] <= 0.0) & (below < level)]
        interval[short, 1] = _disc_holding(estimate[short], covariance[short], _REACH * widest[short], level)
    return np.clip(interval, 0.0, np.pi)


class _Tilt(NamedTuple):
    """Tilts found: place (k, 2) and sigma (k, 2), both along the principal axes of the error."""

    place: FloatArray
    sigma: FloatArray

    @classmethod
    def of(cls, slope: FloatArray, covariance: FloatArray) -> _Tilt:
        values, axes = np.linalg.eigh(covariance)
        return cls(slope[:, None] * axes[:, 0, :], np.sqrt(np.maximum(values, _NARROWEST**2 * values[:, 1:])))


def _farthest_agreeing(tilt: _Tilt, inside: FloatArray, outside: FloatArray, level: float) -> FloatArray:
    """(k,) the slope nearest to `outside` that agrees with the tilt, searched from `inside`, which does."""
    agrees = _agrees(tilt, outside, level)
    for _ in range(_BISECTIONS):
        middle = 0.5 * (inside + outside)
        good = _agrees(tilt, middle, level)
        inside, outside = np.where(good, middle, inside), np.where(good | agrees, outside, middle)
    return np.where(agrees, outside, inside)


def _agrees(tilt: _Tilt, slope: FloatArray, level: float) -> BoolArray:
    """(k,) whether some tilt of this length is close enough to the one found, distances in sigmas of the error."""
    azimuth, step = _AZIMUTHS, _AZIMUTHS[1]
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
    # radius of curvature of the ellipse that the circle of tilts is in units of the error
    curvature_radius = ((a * np.sin(phi)) ** 2 + (b * np.cos(phi)) ** 2) ** 1.5 / np.maximum(a * b, 1e-300)
    radii, limits = _distance_limits(level)
    return np.asarray(np.sqrt(squared_distance) <= np.interp(curvature_radius, radii, limits))


def _disc_holding(estimate: FloatArray, covariance: FloatArray, reach: FloatArray, level: float) -> FloatArray:
    """(k,) radius, at most the slope and `reach`, of the disc of tilts about 0 that holds what is found at `level`."""
    inside, outside = np.zeros_like(estimate), estimate + reach
    for _ in range(_HALVINGS):
        middle = 0.5 * (inside + outside)
        small = disc_probability(estimate, covariance, middle) < level
        inside, outside = np.where(small, middle, inside), np.where(small, outside, middle)
    return outside


@lru_cache(maxsize=8)
def _distance_limits(level: float) -> tuple[FloatArray, FloatArray]:
    """How far, in sigmas, a Gaussian point strays from a circle through its mean with the given probability.

    Returns radii (k,) of the circle and the distances (k,): from the root of the 2-degree chi-square quantile at
    radius 0 to the Gaussian quantile at a large radius.
    """
    radii = np.concatenate([np.linspace(0.0, 4.0, 21), [5.0, 7.0, 10.0, 20.0]])
    unit = np.broadcast_to(np.eye(2), (len(radii), 2, 2))

    def missing(distance: FloatArray) -> FloatArray:
        within = disc_probability(radii, unit, radii + distance)
        hole = disc_probability(radii, unit, np.maximum(radii - distance, 0.0))
        beyond = 1.0 - within + np.where(distance < radii, hole, 0.0)
        return np.log1p(-level) - np.log(np.maximum(beyond, 1e-300))

    # between these the logarithm is nearly linear, and the secant finds its zero in a few steps
    low, high = 0.8 * NormalDist().inv_cdf(0.5 + 0.5 * level), float(np.sqrt(-2.0 * np.log1p(-level)))
    before, now = np.full_like(radii, low), np.full_like(radii, high)
    missed_before, missed = missing(before), missing(now)
    for _ in range(6):
        change = np.where(missed == missed_before, np.inf, missed - missed_before)
        then = np.clip(now - missed * (now - before) / change, low, high)
        before, missed_before, now, missed = now, missed, then, missing(then)
    return radii, now


def probability_below(slopes: Slopes, tolerance_rad: float) -> FloatArray:
    """(m,) probability that each slope is below a tolerance, the tilt being Gaussian about its estimate.

    Integrates the tilt's two-dimensional density over the disc of tolerable tilts. That is at most what the
    one-dimensional Gaussian with the same sigma says, because errors across the slope only ever steepen it.
    """
    tolerance = np.full(len(slopes.slope_rad), float(tolerance_rad))
    return disc_probability(slopes.slope_rad, slopes.tilt_covariance, tolerance)


def disc_probability(distance: FloatArray, covariance: FloatArray, radius: FloatArray) -> FloatArray:
    """Probability that a two-dimensional Gaussian point falls into a disc about the origin.

    Parameters
    ----------
    distance : (k,) distance of the mean from the origin; the mean lies on the first axis.
    covariance : (k, 2, 2); radius : (k,).

    Returns
    -------
    probability : (k,), accurate to about 1e-9: Gauss-Legendre quadrature along the narrower principal axis, the
    integral along the wider one in closed form.
    """
    values, axes = np.linalg.eigh(covariance)
    # a point without noise is a very small Gaussian
    sigma = np.sqrt(np.maximum(values, (1e-12 * (1.0 + radius[:, None])) ** 2))
    mean = distance[:, None] * axes[:, 0, :]
    safe = np.maximum(radius, 1e-100)
    ends = np.clip((mean[:, :1] + _REACH * sigma[:, :1] * [-1.0, 1.0]) / safe[:, None], -1.0, 1.0)
    # x = radius sin(angle) keeps the integrand smooth where the disc ends
    first, last = np.arcsin(ends).T[:, :, None]
    angle = 0.5 * (last - first) * _NODES + 0.5 * (last + first)
    x, half_chord = safe[:, None] * np.sin(angle), safe[:, None] * np.cos(angle)
    density = np.exp(-0.5 * ((x - mean[:, :1]) / sigma[:, :1]) ** 2) / (np.sqrt(2.0 * np.pi) * sigma[:, :1])
    chord = _normal_cdf((half_chord - mean[:, 1:]) / sigma[:, 1:]) - _normal_cdf(
        (-half_chord - mean[:, 1:]) / sigma[:, 1:]
    )
    integral = (density * chord * half_chord * (0.5 * (last - first))) @ _NODE_WEIGHTS
    return np.clip(integral, 0.0, 1.0)


def _normal_cdf(x: FloatArray) -> FloatArray:
    return 0.5 + 0.5 * _erf(x / np.sqrt(2.0)).astype(float)
