"""Lenses of JPL's CAHVOR and CAHVORE models: radial distortion about an optical axis O that is tilted against A.

Camera axes: z along A, so that `x_d = x'/z'` of the distorted direction P'. Of a direction P at the angle theta off O:

    chi  = tan(L theta) / L, theta for L = 0, sin(L theta) / L for L < 0   (L: linearity; 1 is perspective, 0 fisheye)
    chi' = (1 + R0) chi + R1 chi^3 + R2 chi^5,   P' = O + chi' l           (l: unit vector from O towards P)

With L = 1 this is CAHVOR: P' = P + (R0 + R1 tau + R2 tau^2) lambda, tau = tan^2 theta. Source: Gennery, "Generalized
camera calibration including fish-eye lenses", 2006. The entrance pupil is taken to be at C: E has no part in this.

Coefficients are R0 R1 R2, the tilt of O (Ox/Oz, Oy/Oz), L, and the skew, which has no part in this either.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from slopecli.geometry.polynomials import INVERSION, smallest_positive_root
from slopecli.types import BoolArray, FloatArray

Coefficients = tuple[float, ...]


def distort(x: FloatArray, y: FloatArray, k: Coefficients) -> tuple[FloatArray, FloatArray]:
    """Distorted images of normalised coordinates x, y that broadcast against each other.

    NaN beyond the fold of the polynomial, and for directions `INVERSION.largest_angle` or more off A.
    """
    x, y = np.broadcast_arrays(x, y)
    ray = np.stack([x, y, np.ones_like(x)], axis=-1)
    axis = optical_axis(k)
    along, across, towards = _split(ray, axis)
    theta = np.arctan2(across, along)
    chi = _chi_of(theta, k[5])
    image = axis + (chi * _growth(chi, k))[..., None] * towards
    seen = (theta < _largest_theta(k)) & (x * x + y * y < np.tan(INVERSION.largest_angle) ** 2) & (image[..., 2] > 0)
    distorted = np.where(seen[..., None], image[..., :2] / image[..., 2:], np.nan)
    return distorted[..., 0], distorted[..., 1]


def undistort(distorted: FloatArray, k: Coefficients) -> FloatArray:
    """Normalised coordinates (n, 2) of distorted ones (n, 2), the inverse of `distort`."""
    axis = optical_axis(k)
    along, across, towards = _split(np.column_stack([distorted, np.ones(len(distorted))]), axis)
    chi, settled = _chi_from_image(across / along, k)
    theta = _theta_of(chi, k[5])
    ray = np.cos(theta)[:, None] * axis + np.sin(theta)[:, None] * towards
    x = ray[:, :2] / ray[:, 2:]
    seen = (theta >= 0) & (theta < _largest_theta(k))  # Newton may end on the branch beyond the fold, or across O
    good = settled & seen & (along > 0) & (ray[:, 2] > 0) & (np.hypot(*x.T) < np.tan(INVERSION.largest_angle))
    return np.where(good[:, None], x, np.nan)


def optical_axis(k: Coefficients) -> FloatArray:
    """The unit vector O (3,) in camera axes."""
    axis = np.array([k[3], k[4], 1.0])
    return np.asarray(axis / np.linalg.norm(axis))


def angles_off_axis(x: FloatArray, k: Coefficients) -> FloatArray:
    """Angles (n,), rad, between O and the rays of normalised coordinates (n, 2)."""
    along, across, _ = _split(np.column_stack([x, np.ones(len(x))]), optical_axis(k))
    return np.asarray(np.arctan2(across, along))


def _split(direction: FloatArray, axis: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The parts of directions (..., 3) along and across an axis, and the unit vectors of the latter (0 on the axis)."""
    along = direction @ axis
    offset = direction - along[..., None] * axis
    across = np.linalg.norm(offset, axis=-1)
    return along, across, offset / np.where(across > 0, across, 1.0)[..., None]


def _growth(chi: FloatArray, k: Coefficients) -> FloatArray:
    """chi' / chi."""
    square = chi * chi
    return 1 + k[0] + square * (k[1] + square * k[2])


def _chi_of(theta: FloatArray, linearity: float) -> FloatArray:
    if linearity == 0:
        return theta
    return np.asarray((np.tan if linearity > 0 else np.sin)(linearity * theta) / linearity)


def _theta_of(chi: FloatArray, linearity: float) -> FloatArray:
    if linearity == 0:
        return chi
    return np.asarray((np.arctan if linearity > 0 else np.arcsin)(linearity * chi) / linearity)


def _chi_from_image(image: FloatArray, k: Coefficients) -> tuple[FloatArray, BoolArray]:
    """chi (n,) of chi' (n,) by Newton's method from a table, and where it settled."""
    theta = np.linspace(0.0, _largest_theta(k), INVERSION.table_size)[:-1]
    table = _chi_of(theta, k[5])
    chi = np.interp(image, table * _growth(table, k), table)
    for _ in range(INVERSION.steps):
        square = chi * chi
        rate = 1 + k[0] + square * (3 * k[1] + 5 * k[2] * square)
        step = (chi * _growth(chi, k) - image) / rate
        chi = chi - step
        settled = np.abs(step) <= INVERSION.settled * (1 + np.abs(chi))
        if settled.all():
            break
    return chi, settled


@lru_cache(maxsize=32)
def _largest_theta(k: Coefficients) -> float:
    """Angle off O, rad, below which chi' grows with it; 0 where it does so nowhere."""
    linearity = k[5]
    if not 1 + k[0] > 0 or not np.isfinite(k).all():
        return 0.0
    quarter = 0.5 * np.pi / abs(linearity) if linearity else np.pi
    fold = np.sqrt(smallest_positive_root(np.array([5 * k[2], 3 * k[1], 1 + k[0]])))
    if not np.isfinite(fold) or (linearity < 0 and -linearity * fold >= 1):
        return float(min(quarter, np.pi))
    return min(float(quarter), float(np.pi), float(_theta_of(np.asarray(fold), linearity)))
