"""Pixels to normalised rays and back: pinhole, Brown (radial-tangential, rational), fisheye and other lenses.

Everything is in OpenCV's convention: pixel centres at integer coordinates, `u = fx x_d + cx`, where x_d is the
distorted image of the normalised coordinate x = X/Z. Source of the models: OpenCV, "Camera Calibration and 3D
Reconstruction" (Brown 1966 with the rational radial factor) and "Fisheye camera model" (Kannala and Brandt 2006).
"polynomial" is Brown's with a radial term of order 8 in place of the rational ones, and skew: `u = fx (x_d + s y_d) +
cx`. "cahvor" is in `cahvor.py`.

A lens polynomial is invertible only up to its fold, the angle where the distorted radius stops growing with the true
one. Both directions return NaN beyond it, and for rays `INVERSION.largest_angle` or more off the axis.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from slopecli.errors import InputError
from slopecli.geometry import cahvor
from slopecli.geometry.epipolar import homogeneous
from slopecli.geometry.polynomials import INVERSION, smallest_positive_root
from slopecli.types import BoolArray, Camera, CameraModel, FloatArray

MAX_COEFFICIENTS = {"pinhole": 0, "brown": 8, "fisheye": 4, "polynomial": 7, "cahvor": 7, "division": 1}
OFF_MIDDLE = 0.25  # of the image, by which a principal point may be off its middle; lenses are centred to a few percent
OUTSIDE_PX = -1.0e4  # coordinate outside any image that cv2.remap still accepts (16 bit)


def rays_from_pixels(camera: Camera, uv: FloatArray) -> FloatArray:
    """Undistort pixels (n, 2), as stored, to normalised coordinates (X/Z, Y/Z) (n, 2), to rounding error.

    NaN where the model has no inverse: beyond the fold of the polynomial, or `INVERSION.largest_angle` off the axis.
    InputError if the camera has more distortion coefficients than its model.

    Newton's method on the forward model; OpenCV's five fixed-point iterations leave 0.5 px with k1 = -0.28.
    """
    distorted = (np.asarray(uv, dtype=np.float64) - (camera.cx, camera.cy)) / (camera.fx, camera.fy)
    k = padded_coefficients(camera)
    if camera.model == "pinhole":
        return distorted
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):  # only where there is no ray
        if camera.model == "fisheye":
            return _undistort_fisheye(distorted, k)
        if camera.model == "brown":
            return _undistort_brown(distorted, k)
        if camera.model == "division":
            return _undistort_division(distorted, k)
        distorted[:, 0] -= k[6] * distorted[:, 1]
        if camera.model == "cahvor":
            return cahvor.undistort(distorted, k)
        return _undistort_brown(distorted, _as_brown(k))


def pixels_from_rays(camera: Camera, x: FloatArray) -> FloatArray:
    """Project normalised coordinates (n, 2) to (distorted) pixels (n, 2).

    NaN for rays beyond the fold of the lens polynomial: the lens does not image them.
    InputError if the camera has more distortion coefficients than its model.
    """
    x = np.asarray(x, dtype=np.float64)
    return np.stack(_project(camera, x[:, 0], x[:, 1]), axis=1)


def points_on_plane(
    camera: Camera, uv: FloatArray, normal: FloatArray, distance: float | FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Intersect the rays of pixels (n, 2) with the plane `normal . P = -distance`, the unit normal towards the camera.

    normal, distance : of one plane, (3,) and a number, or of one for each pixel, (n, 3) and (n,).

    Returns
    -------
    points : (n, 3) camera axes, in the unit of the distance; undefined where not met.
    met : (n,) which rays meet the front of the plane at 0.6 deg or more. False where the lens has no ray.
    """
    rays = homogeneous(rays_from_pixels(camera, uv))
    incidence = -(rays * normal).sum(axis=1)
    with np.errstate(invalid="ignore"):  # a lens has no ray for some pixels: NaN compares false
        met = incidence > 0.01 * np.linalg.norm(rays, axis=1)
        return rays * (distance / np.where(met, incidence, 1.0))[:, None], met


def share_with_rays(camera: Camera) -> float:
    """Share of the pixels of a camera's image that have a ray, by a grid of 13 x 13."""
    u, v = (np.linspace(0.0, side - 1.0, 13) for side in (camera.width, camera.height))
    rays = rays_from_pixels(camera, np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2))
    return float(np.isfinite(rays).all(axis=1).mean())


def pinhole_of(camera: Camera) -> Camera:
    """Return the ideal camera with the same size and K and no distortion."""
    return replace(camera, model="pinhole", distortion=())


def radial_term(camera: Camera) -> float:
    """The coefficient of the third power of a lens: k1, or R1 of "cahvor"; 0 of a camera without distortion."""
    k = padded_coefficients(camera) or (0.0,)
    return k[1] if camera.model == "cahvor" else k[0]


def with_radial_term(camera: Camera, value: float) -> Camera:
    """Return the camera with another `radial_term`; a pinhole camera becomes a Brown one."""
    first, *others = camera.distortion or (0.0,)
    if camera.model == "cahvor":
        return replace(camera, distortion=(first, value, *others[1:]))
    model: CameraModel = "brown" if camera.model == "pinhole" else camera.model
    return replace(camera, model=model, distortion=(value, *others))


def scale_camera(camera: Camera, width: int, height: int) -> Camera:
    """Return the camera of the same view resized to width x height pixels.

    Pixel areas scale, not pixel centres (as `cv2.resize` does): c' = (c + 1/2) s - 1/2. Distortion stays as it is.
    """
    sx, sy = width / camera.width, height / camera.height
    cx, cy = (camera.cx + 0.5) * sx - 0.5, (camera.cy + 0.5) * sy - 0.5
    return replace(camera, width=width, height=height, fx=camera.fx * sx, fy=camera.fy * sy, cx=cx, cy=cy)


def undistortion_maps(camera: Camera, ideal: Camera | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates in the distorted image of every pixel of an ideal one, for `cv2.remap`.

    ideal : pinhole camera of the image wanted; `pinhole_of(camera)` when None. InputError if it has distortion.

    Returns
    -------
    map_u, map_v : (ideal.height, ideal.width) float32 arrays, px of the distorted image; `OUTSIDE_PX` where the
        lens does not image the ray.
    """
    ideal = pinhole_of(camera) if ideal is None else ideal
    if ideal.model != "pinhole":
        raise InputError(f"the camera to undistort to is a {ideal.model} camera, and must be a pinhole one")
    x: FloatArray = (np.arange(ideal.width, dtype=np.float64) - ideal.cx) / ideal.fx
    y: FloatArray = (np.arange(ideal.height, dtype=np.float64)[:, None] - ideal.cy) / ideal.fy
    maps = np.empty((2, ideal.height, ideal.width), dtype=np.float32)
    for top in range(0, ideal.height, 64):  # blocks of rows whose temporaries stay in cache
        rows = slice(top, top + 64)
        maps[0, rows], maps[1, rows] = _project(camera, x, y[rows])
    np.nan_to_num(maps, copy=False, nan=OUTSIDE_PX)
    return maps[0], maps[1]


def padded_coefficients(camera: Camera) -> tuple[float, ...]:
    """All coefficients of a camera's model in their order, zeros for the missing ones; InputError if it has more."""
    wanted = MAX_COEFFICIENTS[camera.model]
    if len(camera.distortion) > wanted:
        raise InputError(f"a {camera.model} camera takes {wanted} coefficients, found {len(camera.distortion)}")
    return tuple(map(float, camera.distortion)) + (0.0,) * (wanted - len(camera.distortion))


def _project(camera: Camera, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Pixels u, v of normalised coordinates x, y that broadcast against each other."""
    k = padded_coefficients(camera)
    if camera.model != "pinhole":
        with np.errstate(over="ignore", divide="ignore", invalid="ignore"):  # only where nothing is seen
            x, y = _distort(camera.model, x, y, k)
    u, v = np.broadcast_arrays(camera.fx * x + camera.cx, camera.fy * y + camera.cy)
    return u, v


def _distort(model: CameraModel, x: FloatArray, y: FloatArray, k: tuple[float, ...]) -> tuple[FloatArray, FloatArray]:
    """Distorted images of normalised coordinates by a lens, NaN where it has none."""
    if model == "cahvor":
        x, y = cahvor.distort(x, y, k)
        return x + k[6] * y, y
    if model == "polynomial":
        x, y = _distort("brown", x, y, _as_brown(k))
        return x + k[6] * y, y
    distort = _RADIAL.get(model, _distort_brown)
    r2 = x * x + y * y
    seen = r2 < np.tan(_valid_angle(model, k)) ** 2
    x, y = (np.where(seen, d, np.nan) for d in distort(x, y, r2, k))
    return x, y


def _as_brown(k: tuple[float, ...]) -> tuple[float, ...]:
    """Of a "polynomial" lens without its skew, coefficients of a Brown lens, the radial one of order 8 last."""
    return (*k[:5], 0.0, 0.0, 0.0, k[5])


# ---- Brown: x_d = x g(r^2) + tangential, g = (1 + k1 s + k2 s^2 + k3 s^3) / (1 + k4 s + k5 s^2 + k6 s^3) ----
# Coefficients are k1 k2 p1 p2 k3 k4 k5 k6, and after those, of a "polynomial" lens, one of s^4 in the numerator.


def _distort_brown(x: FloatArray, y: FloatArray, r2: FloatArray, k: tuple[float, ...]) -> tuple[FloatArray, FloatArray]:
    p1, p2 = k[2], k[3]
    g = _radial_factor(r2, k)
    xy = x * y
    return x * g + 2 * p1 * xy + p2 * (r2 + 2 * x * x), y * g + p1 * (r2 + 2 * y * y) + 2 * p2 * xy


def _radial_factor(r2: FloatArray, k: tuple[float, ...]) -> FloatArray:
    k1, k2, _, _, k3, k4, k5, k6, *order8 = k
    g = 1 + r2 * (k1 + r2 * (k2 + r2 * (k3 + r2 * order8[0] if order8 else k3)))
    return g / (1 + r2 * (k4 + r2 * (k5 + r2 * k6))) if any(k[5:8]) else g


def _radial_polynomials(k: tuple[float, ...]) -> tuple[FloatArray, FloatArray]:
    """Numerator and denominator of g in r^2, highest power first."""
    k1, k2, _, _, k3, k4, k5, k6, *order8 = k
    return np.array([*order8, k3, k2, k1, 1.0]), np.array([k6, k5, k4, 1.0])


def _undistort_brown(distorted: FloatArray, k: tuple[float, ...]) -> FloatArray:
    limit = _valid_angle("brown", k)
    x, y = (distorted * _radial_start(distorted, k, limit)[:, None]).T
    for _ in range(INVERSION.steps):
        step_x, step_y, determinant = _newton_step(x, y, distorted, k)
        x, y = x - step_x, y - step_y
        step = np.hypot(step_x, step_y) / (1 + np.abs(x) + np.abs(y))
        if not np.any(step > INVERSION.settled):
            break
    # a positive determinant alone would also admit the branch beyond a second fold
    good = (step <= INVERSION.settled) & (determinant > 0) & (np.hypot(x, y) < np.tan(limit))
    return np.where(good[:, None], np.stack([x, y], axis=1), np.nan)


def _radial_start(distorted: FloatArray, k: tuple[float, ...], limit: float) -> FloatArray:
    """r / r_d from a table of the radial part alone; at and beyond the fold, a point just inside it."""
    r = np.tan(np.linspace(0, limit, INVERSION.table_size))
    r_d = r * _radial_factor(r * r, k)
    radius = np.hypot(distorted[:, 0], distorted[:, 1])
    start = np.interp(radius, r_d[:-1], r[:-1])
    return np.divide(start, radius, out=np.ones_like(radius), where=radius > 0)


def _newton_step(
    x: FloatArray, y: FloatArray, target: FloatArray, k: tuple[float, ...]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Newton step of forward(x, y) = target, and the determinant of the (symmetric) Jacobian."""
    p1, p2 = k[2], k[3]
    r2 = x * x + y * y
    g, (n, d) = _radial_factor(r2, k), _radial_polynomials(k)
    slope = 2 * ((np.polyval(np.polyder(n), r2) - g * np.polyval(np.polyder(d), r2)) / np.polyval(d, r2))
    j_xx = g + slope * x * x + 2 * p1 * y + 6 * p2 * x
    j_yy = g + slope * y * y + 6 * p1 * y + 2 * p2 * x
    j_xy = slope * x * y + 2 * p1 * x + 2 * p2 * y
    x_d, y_d = _distort_brown(x, y, r2, k)
    e_x, e_y = x_d - target[:, 0], y_d - target[:, 1]
    determinant = j_xx * j_yy - j_xy * j_xy
    return (j_yy * e_x - j_xy * e_y) / determinant, (j_xx * e_y - j_xy * e_x) / determinant, determinant


# ---- fisheye: r_d = theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8), theta = atan r ----


def _distort_fisheye(
    x: FloatArray, y: FloatArray, r2: FloatArray, k: tuple[float, ...]
) -> tuple[FloatArray, FloatArray]:
    r = np.sqrt(r2)
    r_d = _fisheye_radius(np.arctan(r), k)
    ratio = np.divide(r_d, r, out=np.ones_like(r), where=r > 0)
    return x * ratio, y * ratio


def _fisheye_radius(theta: FloatArray, k: tuple[float, ...]) -> FloatArray:
    return theta * np.polyval([*k[::-1], 1.0], theta * theta)


def _undistort_fisheye(distorted: FloatArray, k: tuple[float, ...]) -> FloatArray:
    limit = _valid_angle("fisheye", k)
    r_d = np.hypot(distorted[:, 0], distorted[:, 1])
    grid = np.linspace(0, limit, INVERSION.table_size)
    theta = np.interp(r_d, _fisheye_radius(grid, k), grid)
    slope = np.array([9.0, 7.0, 5.0, 3.0, 1.0]) * [*k[::-1], 1.0]
    for _ in range(INVERSION.steps):
        step = (_fisheye_radius(theta, k) - r_d) / np.polyval(slope, theta * theta)
        theta = theta - step
        if not np.any(np.abs(step) > INVERSION.settled):
            break
    good = (np.abs(step) <= INVERSION.settled) & (theta < limit)
    ratio = np.divide(np.tan(theta), r_d, out=np.ones_like(r_d), where=r_d > 0)
    return np.where(good[:, None], distorted * ratio[:, None], np.nan)


# ---- division: x = x_d / (1 + k r_d^2); A. Fitzgibbon 2001 ----


def _distort_division(
    x: FloatArray, y: FloatArray, r2: FloatArray, k: tuple[float, ...]
) -> tuple[FloatArray, FloatArray]:
    ratio = 2.0 / (1.0 + np.sqrt(1.0 - 4.0 * k[0] * r2))
    return x * ratio, y * ratio


def _undistort_division(distorted: FloatArray, k: tuple[float, ...]) -> FloatArray:
    bend = k[0] * (distorted * distorted).sum(axis=1)
    x = distorted / (1.0 + bend)[:, None]
    good = (np.abs(bend) < 1.0) & (np.hypot(x[:, 0], x[:, 1]) < np.tan(_valid_angle("division", k)))
    return np.where(good[:, None], x, np.nan)


_RADIAL = {"fisheye": _distort_fisheye, "division": _distort_division}

# ---- where the polynomial ends ----


@lru_cache(maxsize=32)
def _valid_angle(model: CameraModel, k: tuple[float, ...]) -> float:
    """Angle off the axis, rad, below which the radial part of a lens grows: its fold, or `INVERSION.largest_angle`."""
    with np.errstate(over="ignore", invalid="ignore"):
        return _fold_angle(model, k)


def _fold_angle(model: CameraModel, k: tuple[float, ...]) -> float:
    """As `_valid_angle`; 0 where coefficients overflow."""
    if model == "division":  # its images turn back at r_d = 1 / sqrt(k)
        return min(float(np.arctan(0.5 / np.sqrt(k[0]))) if k[0] > 0 else np.inf, INVERSION.largest_angle)
    if model == "fisheye":
        fold = smallest_positive_root(np.array([9.0, 7.0, 5.0, 3.0, 1.0]) * [*k[::-1], 1.0])
        return min(float(np.sqrt(fold)), INVERSION.largest_angle)
    # d(r N/D)/dr = 0  <=>  (N + 2 s N') D - 2 s N D' = 0 with s = r^2; D = 0 is a pole and ends the model as well
    n, d = _radial_polynomials(k)
    two_s = np.array([2.0, 0.0])
    grown = np.polyadd(n, np.polymul(two_s, np.polyder(n)))
    rate: FloatArray = np.polysub(np.polymul(grown, d), np.polymul(np.polymul(two_s, n), np.polyder(d)))
    fold = min(smallest_positive_root(rate), smallest_positive_root(d))
    return min(float(np.arctan(np.sqrt(fold))), INVERSION.largest_angle)
