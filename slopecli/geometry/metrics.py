"""Angles between directions, normals and rotations, accurate for tiny angles too."""

from __future__ import annotations

import numpy as np

from slopecli.types import FloatArray


def direction_angle(a: FloatArray, b: FloatArray) -> FloatArray:
    """Angle between two vectors (paper, section 4: translation and structural error).

    Uses atan2 of the cross and the dot product: the arc cosine of a dot product loses half the digits near 0 and pi.

    Parameters
    ----------
    a, b : (..., 3) float arrays of any non-zero length; their leading shapes broadcast.

    Returns
    -------
    angle : (...) float array, rad, 0..pi.
    """
    a, b = np.asarray(a, float), np.asarray(b, float)
    return np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), np.sum(a * b, axis=-1))


def normal_angle(a: FloatArray, b: FloatArray) -> FloatArray:
    """Angle between two plane normals, scaled or not, rad: the paper's structural error. See `direction_angle`."""
    return direction_angle(a, b)


def rotation_angle(a: FloatArray, b: FloatArray | None = None) -> FloatArray:
    """Magnitude of the rotation `a`, or of the rotation that takes `a` to `b`: ||a^T b|| (paper, section 4).

    Parameters
    ----------
    a, b : (..., 3, 3) rotations.

    Returns
    -------
    angle : (...) float array, rad, 0..pi.
    """
    a = np.asarray(a, float)
    relative = a if b is None else np.swapaxes(a, -1, -2) @ np.asarray(b, float)
    # 2 sin(angle) is the length of the antisymmetric part, 2 cos(angle) + 1 the trace
    axis = np.stack(
        [
            relative[..., 2, 1] - relative[..., 1, 2],
            relative[..., 0, 2] - relative[..., 2, 0],
            relative[..., 1, 0] - relative[..., 0, 1],
        ],
        axis=-1,
    )
    trace = np.trace(relative, axis1=-2, axis2=-1)
    return np.arctan2(np.linalg.norm(axis, axis=-1), trace - 1.0)
