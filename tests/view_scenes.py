"""Simulated points of a reference image in several views of known motions and planes, as in the paper's section 4.1."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slopecli.geometry import homogeneous, rotation_from_vector
from slopecli.types import FloatArray, IntArray

FOCAL_PX = 886.8  # the paper's camera: 1024 px that see 60 degrees


@dataclass(frozen=True, eq=False)
class Views:
    """x1 (n, 2), x (k, n, 2) with noise, patch (n,), and the truth: R (k, 3, 3), T (k, 3) with |T[0]| = 1, normals."""

    x1: FloatArray
    x: FloatArray
    patch: IntArray
    R: FloatArray
    T: FloatArray
    normals: FloatArray
    noise: float


def views(
    seed: int,
    number: int,
    trajectory_deg: float,
    *,
    noise_px: float = 0.3,
    path: float = 0.2,
    bend_deg: float = 0.0,
    steepest_deg: float = 40.0,
    one_plane: bool = False,
    roughness_deg: float = 0.0,
    relief: float = 0.0,
    points: int = 30,
) -> Views:
    """A 3x3 grid of patches with `points` points each, seen from a path of that many heights in `number` equal steps.

    trajectory_deg : of the first step from the vertical.  bend_deg : by which later steps are turned against it.
    one_plane : all patches lie on one plane, but for tilts and heights of `roughness_deg`.
    relief : RMS height of the points off their planes over the distance.
    """
    rng = np.random.default_rng([seed, number])
    half, cells = 512.0 / FOCAL_PX, 3
    corner = np.array([[c, r] for r in range(cells) for c in range(cells)]) * 2 * half / cells - half
    x1 = (corner[:, None] + rng.random((cells**2, points, 2)) * 2 * half / cells).reshape(-1, 2)
    patch = np.repeat(np.arange(cells**2), points)
    centre = homogeneous(corner + half / cells)
    if one_plane:
        n = np.repeat(_tilted(rng, steepest_deg, 1), cells**2, axis=0)
        normals = n + np.radians(roughness_deg) * rng.standard_normal(n.shape)
    else:
        n = _tilted(rng, steepest_deg, cells**2)
        normals = n / ((n * centre).sum(axis=1) * rng.uniform(0.95, 1.05, cells**2))[:, None]
    R, T = _path(rng, number, trajectory_deg, bend_deg, path / number)
    u = (normals[patch] * homogeneous(x1)).sum(axis=1)
    u = u * (1.0 + relief * rng.standard_normal(len(u)))
    y = R @ homogeneous(x1).T - (R @ T[:, :, None]) * u
    x = (y[:, :2] / y[:, 2:]).transpose(0, 2, 1)
    noise, unit = noise_px / FOCAL_PX, float(np.linalg.norm(T[0]))
    return Views(x1, x + noise * rng.standard_normal(x.shape), patch, R, T / unit, normals * unit, noise)


def _tilted(rng: np.random.Generator, steepest_deg: float, m: int) -> FloatArray:
    slope, azimuth = np.radians(rng.uniform(0.0, steepest_deg, m)), rng.uniform(0.0, 2 * np.pi, m)
    return np.stack([np.sin(slope) * np.cos(azimuth), np.sin(slope) * np.sin(azimuth), np.cos(slope)], axis=1)


def _path(
    rng: np.random.Generator, number: int, trajectory_deg: float, bend_deg: float, step: float
) -> tuple[FloatArray, FloatArray]:
    angle = np.radians(trajectory_deg)
    first = np.array([np.sin(angle), 0.0, np.cos(angle)])
    later = (
        rotation_from_vector(np.radians([bend_deg, 0.0, 0.0]) if trajectory_deg < 45 else np.radians([0, 0, bend_deg]))
        @ first
    )
    T = step * np.cumsum([first] + [later] * (number - 1), axis=0)
    w = rng.standard_normal((number, 3))
    R = rotation_from_vector(np.radians(5.0) * w / np.linalg.norm(w, axis=1, keepdims=True))
    return R, T
