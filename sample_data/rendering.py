"""What both sample scenes share: views, periodic noise, the pixel's area filter, the sensor, planes through points.

Frames are those of docs/conventions.md: camera x right, y down, z forward, pixel centres at integers; the world is
z up, in metres. Nothing here comes from slopecli, so that the truth stays independent of what it is compared with.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class View:
    """A camera in the world: `X_c = rotation (X_w - centre)`, radial distortion (k1, k2) of the OpenCV model."""

    width: int
    height: int
    focal: float
    rotation: FloatArray
    centre: FloatArray
    distortion: tuple[float, float] = (0.0, 0.0)

    @property
    def principal_point(self) -> tuple[float, float]:
        return (self.width - 1) / 2, (self.height - 1) / 2

    def rays(self, u: FloatArray, v: FloatArray) -> FloatArray:
        """World directions (..., 3) of pixels u, v (...), scaled so that the ray parameter is the depth along z."""
        cx, cy = self.principal_point
        x, y = undistort((u - cx) / self.focal, (v - cy) / self.focal, self.distortion)
        return np.stack([x, y, np.ones_like(x)], axis=-1) @ self.rotation

    def project(self, points: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Pixel coordinates u, v and depth (...) of world points (..., 3)."""
        x, y, depth = np.moveaxis((points - self.centre) @ self.rotation.T, -1, 0)
        x, y = distort(x / depth, y / depth, self.distortion)
        cx, cy = self.principal_point
        return self.focal * x + cx, self.focal * y + cy, depth

    def contains(self, u: FloatArray, v: FloatArray) -> NDArray[np.bool_]:
        """Whether pixel coordinates lie between the outermost pixel centres."""
        return (u >= 0) & (u <= self.width - 1) & (v >= 0) & (v <= self.height - 1)

    def to_camera(self, points: FloatArray) -> FloatArray:
        return (points - self.centre) @ self.rotation.T

    def camera_file(self) -> dict[str, Any]:
        """The native camera file: focal lengths and principal point in px, OpenCV order of the distortion."""
        cx, cy = self.principal_point
        k1, k2 = self.distortion
        return {
            "width": self.width,
            "height": self.height,
            "fx": self.focal,
            "fy": self.focal,
            "cx": cx,
            "cy": cy,
            "distortion": [k1, k2, 0.0, 0.0, 0.0],
        }


def distort(x: FloatArray, y: FloatArray, k: tuple[float, float]) -> tuple[FloatArray, FloatArray]:
    """Radial distortion of normalised coordinates, 1 + k1 r^2 + k2 r^4."""
    r2 = x * x + y * y
    gain = 1 + r2 * (k[0] + r2 * k[1])
    return x * gain, y * gain


def undistort(x: FloatArray, y: FloatArray, k: tuple[float, float]) -> tuple[FloatArray, FloatArray]:
    """Inverse of `distort` by Newton's method on the radius; exact to rounding for |k1| of a few tenths."""
    if not any(k):
        return x, y
    distorted = np.hypot(x, y)
    radius = distorted.copy()
    for _ in range(5):
        r2 = radius * radius
        error = radius * (1 + r2 * (k[0] + r2 * k[1])) - distorted
        radius -= error / (1 + r2 * (3 * k[0] + 5 * r2 * k[1]))
    gain = np.divide(radius, distorted, out=np.ones_like(radius), where=distorted > 0)
    return x * gain, y * gain


def relative_motion(first: View, second: View) -> tuple[FloatArray, FloatArray]:
    """R (3, 3) and T (3,) in metres of `P2 = R (P1 - T)`."""
    return second.rotation @ first.rotation.T, first.rotation @ (second.centre - first.centre)


def motion_truth(first: View, second: View) -> dict[str, Any]:
    """The part of truth.json that both scenes have: R, T in metres, and up in camera-1 axes."""
    rotation, baseline = relative_motion(first, second)
    return {
        "convention": "P2 = R (P1 - T), P1 in metres in camera-1 axes; x right, y down, z forward",
        "R": rotation.round(12).tolist(),
        "T": baseline.round(12).tolist(),
        "up_cam1": (first.rotation[:, 2] + 0.0).round(12).tolist(),
    }


def rotation_about(axis: str, degrees: float) -> FloatArray:
    """Right-handed rotation (3, 3) about a coordinate axis."""
    angle = np.deg2rad(degrees)
    c, s = np.cos(angle), np.sin(angle)
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    rotation = np.eye(3)
    rotation[i, i] = rotation[j, j] = c
    rotation[i, j], rotation[j, i] = -s, s
    return rotation


def spectral_noise(
    rng: np.random.Generator, size: int, longest: float, shortest: float, slope: float = 1.0
) -> FloatArray:
    """Periodic Gaussian noise (size, size), zero mean and unit variance, band-limited.

    Wavelengths between `longest` and `shortest` (cells) have amplitude proportional to wavelength**slope; the band's
    ends roll off as Gaussians so that the noise does not ring.
    """
    spectrum = np.fft.rfft2(rng.standard_normal((size, size)))
    frequency = np.hypot(np.fft.fftfreq(size)[:, None], np.fft.rfftfreq(size)[None, :])
    frequency[0, 0] = np.inf
    low_cut = -np.expm1(-((frequency * longest) ** 2))
    spectrum *= frequency**-slope * low_cut * np.exp(-((frequency * shortest) ** 2) / 2)
    noise = np.fft.irfft2(spectrum, s=(size, size))
    return noise / noise.std()


def bilinear(grid: NDArray[Any], column: FloatArray, row: FloatArray) -> NDArray[Any]:
    """Values (n,) or (n, channels) of a grid at fractional indices (n,); the edge is repeated beyond the border."""
    width = grid.shape[1]
    column, row = np.clip(column, 0, width - 1), np.clip(row, 0, grid.shape[0] - 1)
    j = np.minimum(column.astype(np.int64), width - 2)
    i = np.minimum(row.astype(np.int64), grid.shape[0] - 2)
    s, t = column - j, row - i
    if grid.ndim == 3:
        s, t = s[:, None], t[:, None]
    flat, k = grid.reshape(grid.shape[0] * width, *grid.shape[2:]), i * width + j
    top = flat[k] + s * (flat[k + 1] - flat[k])
    bottom = flat[k + width] + s * (flat[k + width + 1] - flat[k + width])
    return top + t * (bottom - top)


def subpixel_offsets(factor: int) -> FloatArray:
    """Centres (factor,) of a pixel's sub-samples along one axis, px."""
    return (np.arange(factor) + 0.5) / factor - 0.5


def area_filter(samples: FloatArray, factor: int, blur_px: float = 0.5) -> FloatArray:
    """Pixels (h, w, ...) from sub-samples (h factor, w factor, ...): lens blur, then the mean over each pixel."""
    from scipy.ndimage import gaussian_filter1d

    for axis in (0, 1):
        samples = gaussian_filter1d(samples, blur_px * factor, axis=axis, mode="nearest")
    h, w = samples.shape[0] // factor, samples.shape[1] // factor
    return samples.reshape(h, factor, w, factor, *samples.shape[2:]).mean(axis=(1, 3))


def develop(radiance: FloatArray, exposure: float, rng: np.random.Generator) -> NDArray[np.uint8]:
    """8-bit image of linear radiance: exposure, photon and read-out noise, gamma 2.2."""
    signal = np.clip(radiance * exposure, 0, None)
    signal = signal + rng.standard_normal(signal.shape) * np.sqrt(5e-5 * signal + 2e-6)
    grey = 255 * np.clip(signal, 0, 1) ** (1 / 2.2)
    return np.rint(grey).astype(np.uint8)


def total_least_squares_plane(points: FloatArray) -> tuple[FloatArray, float, float]:
    """Plane through points (n, 3) of camera 1: unit normal towards the camera, distance and rms height in metres."""
    mean = points.mean(axis=0)
    scatter = (points - mean).T @ (points - mean) / len(points)
    variances, axes = np.linalg.eigh(scatter)
    normal = axes[:, 0] * -np.sign(axes[:, 0] @ mean)
    return normal, float(-normal @ mean), float(np.sqrt(max(variances[0], 0.0)))


def angle_deg(a: FloatArray, b: FloatArray) -> float:
    """Angle between two unit vectors, degrees; accurate near 0 and 180."""
    return float(np.rad2deg(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)))
