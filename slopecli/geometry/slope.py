"""Slope and aspect of planes, and the covariance of their tilt against up, larger where normals are poorly known."""

from __future__ import annotations

from dataclasses import replace
from functools import cache, reduce
from typing import NamedTuple

import numpy as np

from slopecli.errors import InputError, expect
from slopecli.geometry.epipolar import checked_direction, tangent_basis
from slopecli.types import FloatArray, Slopes, Solution

CAMERA_UP = np.array([0.0, 0.0, -1.0])  # up if the camera looks straight down
ASPECT_SIGMAS = 2.0  # sigmas of a slope below which its downhill direction is undefined


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
    north_sigma_rad: float = 0.0,
    growth: FloatArray | None = None,
) -> Slopes:
    """Slope and aspect of every plane.

    Parameters
    ----------
    up_cam1 : (3,) direction against gravity in camera-1 axes, any length.
    up_sigma_rad : 1-sigma of that direction about each horizontal axis.
    north : (3,) direction aspects are counted from, camera-1 axes; None takes the image's up direction (or the viewing
        direction when the camera looks at the horizon). Only its horizontal part counts.
    up_plane : index of the plane that is up, instead of `up_cam1`: its covariances are included, its slope is 0.
    north_sigma_rad : 1-sigma of the azimuth of north.  growth : (m,) `tilt_growth`, where it is at hand.

    Returns
    -------
    slopes : `Slopes`. sigma_rad is the root mean square error of the slope over the distribution of the tilt: the
        first-order sigma for a steep plane, finite and not zero for a level one, larger for poorly determined normals
        (`tilt_growth`). aspect_rad is clockwise seen from above, 0..2 pi, NaN where the slope is below twice its sigma;
        aspect_sigma_rad is its root mean square error (`aspect_sigmas`).

    Raises
    ------
    InputError : up or north is zero, not finite, or north is vertical; neither or both of the ups are given.
    """
    expect("solution", solution, Solution, "as solve_planes returns it")
    normals = surface_normals(solution)
    up = _up_direction(normals, up_cam1, up_plane)
    if not (np.isfinite(up_sigma_rad) and up_sigma_rad >= 0.0):
        raise InputError(f"the uncertainty of up is {up_sigma_rad}; it must be a number >= 0")
    along, across = tilt_axes(normals, up)
    slope = np.arctan2(np.linalg.norm(np.cross(up, normals), axis=1), normals @ up)
    growth = tilt_growth(solution.scaled_normals, solution.normal_covariance) if growth is None else growth
    covariance = _tilt_covariance(solution, normals, along, across, up, up_plane)
    covariance = _positive(covariance) * growth[:, None, None] ** 2
    if up_plane is not None:
        covariance[up_plane] = 0.0  # against itself it has no noise; `up_sigma_rad` says how level it is
    covariance = covariance + up_sigma_rad**2 * np.eye(2)
    sigma = slope_sigmas(slope, covariance)
    aspect = aspects(normals, up, north_direction(up, north))
    defined = (slope >= ASPECT_SIGMAS * sigma) & (np.sin(slope) > 0.0)
    slopes = Slopes(slope, sigma, np.where(defined, aspect, np.nan), np.full_like(slope, np.nan), covariance)
    return replace(slopes, aspect_sigma_rad=aspect_sigmas(slopes, normals, up, up_sigma_rad, north, north_sigma_rad))


def aspect_sigmas(
    slopes: Slopes,
    normals: FloatArray,
    up: FloatArray,
    up_sigma_rad: float,
    north: FloatArray | None,
    north_sigma_rad: float,
) -> FloatArray:
    """(m,) 1-sigma of aspects, NaN where there is none: the root mean square of their errors over the tilt's.

    Of a steep plane it is the 1-sigma of its tilt across the slope over the sine of the slope, and what is level within
    its errors may face anywhere. An error of up turns aspects by its part across the slope over the tangent of it, so
    that a wall keeps its strike.

    slopes : their covariance has `up_sigma_rad` in both directions.  normals : (m, 3) unit.  up : (3,) unit.
    """
    found = np.isfinite(slopes.aspect_rad)
    slope, covariance = slopes.slope_rad[found], slopes.tilt_covariance[found].copy()
    sine = np.sin(slope)
    if up_sigma_rad > 0.0:
        turned = _aspects_by_up(normals[found], up, north) * sine[:, None]
        covariance[:, 1, 1] += up_sigma_rad**2 * ((turned**2).sum(axis=1) - 1.0)
    z, weight = _hermite(16, 2)
    along, across = np.moveaxis(z @ _square_root(covariance).swapaxes(1, 2), 2, 0)
    angle = np.hypot(along, across)
    reach = np.sinc(angle / np.pi)  # of the error on the sphere
    error = np.arctan2(reach * across, np.cos(angle) * sine[:, None] + reach * along * np.cos(slope)[:, None])
    sigmas = np.full(len(slopes.slope_rad), np.nan)
    sigmas[found] = np.hypot(np.sqrt(error**2 @ weight), north_sigma_rad)
    return sigmas


def _aspects_by_up(normals: FloatArray, up: FloatArray, north: FloatArray | None) -> FloatArray:
    """(m, 2) derivatives of aspects by the direction of up, along two horizontal directions."""
    step, columns = 1e-5, []
    for direction in tangent_basis(up).T:
        one, other = (
            aspects(normals, turned, north_direction(turned, north))
            for turned in (np.cos(step) * up + np.sin(angle) * direction for angle in (step, -step))
        )
        columns.append(np.angle(np.exp(1j * (one - other))) / (2.0 * step))
    return np.column_stack(columns)


def _up_direction(normals: FloatArray, up_cam1: FloatArray | None, up_plane: int | None) -> FloatArray:
    if up_cam1 is not None and up_plane is None:
        return checked_direction("up", up_cam1)
    if up_cam1 is not None or up_plane is None:
        raise InputError("give either the up direction or the plane whose normal is up, not both or neither")
    if not 0 <= up_plane < len(normals):
        raise InputError(f"up_plane is {up_plane}, the solution has planes 0..{len(normals) - 1}")
    return np.asarray(normals[up_plane])


def tilt_axes(normals: FloatArray, up: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Unit tangents (m, 3) at each normal: away from up (steeper), and level; arbitrary where the normal is up."""
    across = np.cross(up, normals)
    length = np.linalg.norm(across, axis=1)
    level = length < 1e-12
    across[level], length[level] = tangent_basis(up)[:, 0], 1.0
    across /= length[:, None]
    return np.cross(across, normals), across


def _tilt_covariance(
    solution: Solution, normals: FloatArray, along: FloatArray, across: FloatArray, up: FloatArray, up_plane: int | None
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


class TiltParts(NamedTuple):
    """Parts of the covariance of the tilt between each normal and up, (m, 2, 2) along the slope and across it.

    axes (m, 2, 3): derivatives of the tilt by the plane's own scaled normal.  motion: due to the motion, which all
    planes share.  camera: due to the focal length.  reference: due to the own noise of the plane whose normal is up.
    total: of all; the rest of it is due to the own noise of each plane.
    """

    axes: FloatArray
    motion: FloatArray
    camera: FloatArray
    reference: FloatArray
    total: FloatArray


def tilt_parts(solution: Solution, up_cam1: FloatArray | None = None, up_plane: int | None = None) -> TiltParts:
    """Divide the first-order covariance of the tilt by its causes; arguments as of `measure_slopes`."""
    normals = surface_normals(solution)
    up = _up_direction(normals, up_cam1, up_plane)
    along, across = tilt_axes(normals, up)
    axes, m = -np.stack([along, across], axis=1) / _lengths(solution), len(normals)
    shift = np.zeros(3 * m + 5) if solution.focal_shift is None else solution.focal_shift
    C = solution.motion_covariance - np.outer(shift[-5:], shift[-5:])
    by_motion = axes @ solution.normal_gain
    by_focal = axes @ shift[:-5].reshape(m, 3, 1)
    reference = np.zeros((m, 2, 2))
    if up_plane is not None:
        far = np.stack([np.cross(across, up), across], axis=1) / _lengths(solution)[up_plane]
        gain, moved = solution.normal_gain[up_plane], shift[3 * up_plane : 3 * up_plane + 3]
        own = solution.normal_covariance[up_plane] - gain @ C @ gain.T - np.outer(moved, moved)
        by_motion, by_focal = by_motion + far @ gain, by_focal + (far @ moved)[:, :, None]
        reference = _positive(far @ own @ far.swapaxes(1, 2))
    motion, camera = by_motion @ C @ by_motion.swapaxes(1, 2), by_focal @ by_focal.swapaxes(1, 2)
    total = _positive(_tilt_covariance(solution, normals, along, across, up, up_plane))
    return TiltParts(axes, motion, camera, reference, total)


def _lengths(solution: Solution) -> FloatArray:
    """(m, 1, 1) lengths of the scaled normals."""
    return np.asarray(np.linalg.norm(solution.scaled_normals, axis=1)[:, None, None])


def _positive(covariance: FloatArray) -> FloatArray:
    """(m, 2, 2) covariance without negative eigenvalues, which rounding gives poorly determined planes."""
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.swapaxes(1, 2)))
    if (values >= 0.0).all():
        return covariance
    return np.asarray((vectors * np.maximum(values, 0.0)[:, None, :]) @ vectors.swapaxes(1, 2))


def slope_sigmas(slope: FloatArray, covariance: FloatArray) -> FloatArray:
    """(m,) RMS of |tilt + error| - |tilt| over the error, by Gauss-Hermite quadrature in two dimensions.

    slope : (m,) rad.  covariance : (m, 2, 2) of the tilt along the slope and across, rad^2.
    """
    factor = _square_root(covariance)
    z, weight = _hermite(16, 2)
    error = z @ factor.swapaxes(1, 2)
    # |t + e| - |t| without cancellation
    change = error[:, :, 0] * (2.0 * slope[:, None] + error[:, :, 0]) + error[:, :, 1] ** 2
    length = np.hypot(slope[:, None] + error[:, :, 0], error[:, :, 1])
    change = change / np.maximum(length + slope[:, None], np.finfo(float).tiny)
    return np.sqrt(change**2 @ weight)


@cache
def _hermite(n: int, k: int) -> tuple[FloatArray, FloatArray]:
    """Gauss-Hermite nodes (n^k, k) and weights (n^k,) in k dimensions; 9 a dimension reach 4.5 sigma."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(n)
    grid = np.stack(np.meshgrid(*[nodes] * k), axis=-1).reshape(-1, k)
    return grid, reduce(np.multiply.outer, [weights] * k).ravel() / (2.0 * np.pi) ** (0.5 * k)


def _square_root(covariance: FloatArray) -> FloatArray:
    """Factors F (m, k, k) with F F^T = covariance."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :])


def north_direction(up: FloatArray, north: FloatArray | None) -> FloatArray:
    """Horizontal unit vector (3,) that aspects are counted from: the horizontal part of `north`, camera-1 axes.

    None stands for the image's up direction, or the viewing direction where that is vertical.
    """
    given = checked_direction("north", north) if north is not None else np.array([0.0, -1.0, 0.0])
    level = given - (given @ up) * up
    if np.linalg.norm(level) < 1e-6:
        if north is not None:
            raise InputError("north is vertical, so it gives no horizontal direction; give another north")
        level = np.array([0.0, 0.0, 1.0]) - up[2] * up  # the viewing direction
    return np.asarray(level / np.linalg.norm(level))


def aspects(normals: FloatArray, up: FloatArray, north: FloatArray) -> FloatArray:
    """(m,) azimuth of the downhill direction, the horizontal part of the outward normal; 0..2 pi."""
    east = np.cross(north, up)
    return np.asarray(np.arctan2(normals @ east, normals @ north) % (2.0 * np.pi))


def normal_covariances(solution: Solution, growth: FloatArray | None = None) -> FloatArray:
    """(m, 3, 3) covariances of the unit normals, rad^2, each 0 along its normal; larger where normals are poorly known
    (`tilt_growth`, which is (m,) growth where it is at hand)."""
    normals = surface_normals(solution)
    turn = (np.eye(3) - normals[:, :, None] * normals[:, None]) / _lengths(solution)
    growth = tilt_growth(solution.scaled_normals, solution.normal_covariance) if growth is None else growth
    return np.asarray(turn @ solution.normal_covariance @ turn * growth[:, None, None] ** 2)


def tilt_growth(normals: FloatArray, covariance: FloatArray) -> FloatArray:
    """Ratio (m,) of the RMS tilt error of each plane to its first-order value; exactly 1 where that is good to 5 %.

    The error of a scaled normal is Gaussian, the tilt depends on its direction alone. With nearly collinear points the
    normal's sigma in one direction exceeds its length, and linear error propagation fails. The RMS tilt is therefore
    integrated over the Gaussian error.

    normals : (m, 3) scaled.  covariance : (m, 3, 3) of them.
    """
    factor = _square_root(covariance)
    growth = np.ones(len(normals))
    # below a relative sigma of 0.05 the growth is far below 5 %
    vague = np.linalg.norm(factor[:, :, 2], axis=1) > 0.05 * np.linalg.norm(normals, axis=1)
    # 256 at a time: the errors integrated over then fit into the cache of a processor
    for some in np.array_split(np.flatnonzero(vague), 1 + vague.sum() // 256):
        growth[some] = _mean_growth(normals[some], factor[some])
    return np.where(growth > 1.05, growth, 1.0)


def _mean_growth(normals: FloatArray, factor: FloatArray) -> FloatArray:
    """(m,) RMS tilt over its first-order value; factor @ factor^T (m, 3, 3) is the covariance of the normals (m, 3)."""
    z, weight = _hermite(9, 3)
    length = np.linalg.norm(normals, axis=1)[:, None]
    unit = normals / length
    possible = (normals[:, None] + z @ factor.swapaxes(1, 2)) / length[:, None]
    ahead = (possible * unit[:, None]).sum(axis=2)
    aside = np.linalg.norm(possible - ahead[:, :, None] * unit[:, None], axis=2)
    turned = np.arctan2(aside, ahead) ** 2 @ weight
    across = factor - unit[:, :, None] * (unit[:, None] @ factor)
    linear = (across**2).sum(axis=(1, 2)) / length[:, 0] ** 2
    return np.asarray(np.sqrt(turned / np.maximum(linear, np.finfo(float).tiny)))
