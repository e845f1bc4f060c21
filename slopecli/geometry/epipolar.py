"""Rotations, directions and the angles between them; epipolar geometry E = R [T]x of two views, P2 = R (P1 - T)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from slopecli.errors import InputError
from slopecli.types import FloatArray

# LEVI_CIVITA[k] is the matrix [e_k]x, so that e_k x v = LEVI_CIVITA[k] @ v
LEVI_CIVITA = np.cross(np.eye(3)[:, None], np.eye(3)).swapaxes(1, 2)


def homogeneous(x: FloatArray) -> FloatArray:
    """Append a 1 to every point: (..., 2) -> (..., 3)."""
    # eq. (4): z = 1
    points = np.ones((*np.shape(x)[:-1], 3))
    points[..., :2] = x
    return points


def unit_vector(v: FloatArray) -> FloatArray:
    """The direction of v (3,), of any length; zeros where it has none: v is zero, or not finite."""
    length = math.hypot(*v)  # does not over- or underflow
    return np.asarray(v / length if 0.0 < length < math.inf else np.zeros(3))


def checked_direction(name: str, vector: ArrayLike) -> FloatArray:
    """Unit vector (3,) of a direction given by a user. InputError, with its name, if it is no direction."""
    given = np.asarray(vector, dtype=float)
    unit = unit_vector(given) if given.shape == (3,) else np.zeros(3)
    if not unit.any():
        raise InputError(f"{name} is {given.tolist()}; it must be three finite numbers, not all zero")
    return unit


def skew(v: FloatArray) -> FloatArray:
    """Cross-product matrices: (..., 3) -> (..., 3, 3) with `skew(v) @ u = v x u`."""
    return (v @ LEVI_CIVITA.reshape(3, 9)).reshape(*v.shape[:-1], 3, 3)


def rotation_from_vector(w: FloatArray) -> FloatArray:
    """Rotations exp([w]x) by Rodrigues' formula: (..., 3) rad -> (..., 3, 3)."""
    w = np.asarray(w, float)
    angle = np.linalg.norm(w, axis=-1)[..., None, None]
    W = skew(w)
    # sinc avoids the division by zero: np.sinc(x) is sin(pi x) / (pi x)
    return np.eye(3) + np.sinc(angle / np.pi) * W + 0.5 * np.sinc(angle / (2 * np.pi)) ** 2 * (W @ W)


def rotation_vector(R: FloatArray) -> FloatArray:
    """(3,) rotation vector w, rad, with exp([w]x) = R (3, 3); for angles clearly below pi."""
    axis = 0.5 * _antisymmetric_part(R)
    sine = float(np.linalg.norm(axis))
    angle = np.arctan2(sine, 0.5 * (np.trace(R) - 1.0))
    return np.asarray(axis * (angle / sine if sine > 0.0 else 1.0))


def _antisymmetric_part(R: FloatArray) -> FloatArray:
    """(..., 3) rotation axis of R (..., 3, 3) times twice the sine of the angle."""
    return np.stack([R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]], axis=-1)


def tangent_basis(v: FloatArray) -> FloatArray:
    """(3, 2) orthonormal basis of the plane perpendicular to the unit vector v (3,).

    Source: Duff et al., "Building an Orthonormal Basis, Revisited", JCGT 2017: no branch is ill-conditioned.
    """
    x, y, z = (float(c) for c in v)
    sign = 1.0 if z >= 0.0 else -1.0
    a = -1.0 / (sign + z)
    b = x * y * a
    return np.array([[1.0 + sign * x * x * a, b], [sign * b, sign + y * y * a], [-sign * x, -y]])


def essential_matrix(R: FloatArray, T: FloatArray) -> FloatArray:
    """E = R [T]x for rotations (..., 3, 3) and positions (..., 3) of camera 2 in camera-1 axes."""
    return R @ skew(T)


def focus_of_expansion(T: FloatArray) -> FloatArray | None:
    """(2,) normalised point of image 1 the camera moves towards (or away from); None when it lies at infinity."""
    if abs(T[2]) < 1e-9 * np.linalg.norm(T):
        return None
    return np.asarray(T[:2] / T[2])


def epipolar_distance(E: FloatArray, x1: FloatArray, x2: FloatArray) -> FloatArray:
    """Signed distance (n,) of x2 from the epipolar line of x1, in image 2; x1, x2 (n, 2) normalised coordinates.

    E : (3, 3) essential matrix of any scale. Where x1 is its epipole, the line is undefined and the distance 0.
    """
    lines = homogeneous(x1) @ E.T
    length = np.hypot(lines[:, 0], lines[:, 1])
    return np.sum(homogeneous(x2) * lines, axis=1) / np.maximum(length, np.finfo(float).tiny)


def decompose_essential(E: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rotations R (2, 3, 3) and unit baseline T (3,) of an essential matrix; its four motions are (R[i], +-T).

    E : (3, 3), any scale; it need not satisfy the essential constraint exactly.
    Source: Hartley and Zisserman, Multiple View Geometry, result 9.19, for E = R [T]x.
    """
    u, _, vt = np.linalg.svd(E)
    u, vt = u * handedness(u), vt * handedness(vt)
    quarter_turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    return np.stack([u @ quarter_turn @ vt, u @ quarter_turn.T @ vt]), vt[2]


def fit_rotation(p: FloatArray, x2: FloatArray, weight: FloatArray) -> FloatArray:
    """The least-squares rotation (3, 3) from viewing rays of image 1 to those of image 2, as without a baseline.

    p : (3, n) homogeneous points of image 1; x2 : (2, n); weight : (n,).
    Source: Kabsch, Acta Cryst. A32 (1976): singular value decomposition of the rays' cross moments.
    """
    rays2 = np.ones_like(p)
    rays2[:2] = x2
    lengths = np.sqrt((p * p).sum(axis=0) * (rays2 * rays2).sum(axis=0))
    return nearest_rotation((rays2 * (weight / lengths)) @ p.T)


def nearest_rotation(M: FloatArray) -> FloatArray:
    """The rotation nearest to M (3, 3) in the Frobenius norm; also the mean of rotations when M is their sum."""
    u, _, vt = np.linalg.svd(M)
    u[:, 2] *= handedness(u) * handedness(vt)
    return u @ vt


def handedness(M: FloatArray) -> float:
    """1.0 for a rotation, -1.0 for a reflection: the sign of the determinant of a (3, 3) matrix."""
    return 1.0 if np.linalg.det(M) >= 0.0 else -1.0


def direction_angle(a: FloatArray, b: FloatArray) -> FloatArray:
    """Angles (...) between vectors (..., 3) of any non-zero length, rad, 0..pi; their leading shapes broadcast.

    The paper's translation error (section 4). Uses atan2 of the cross and the dot product: the arc cosine of a dot
    product loses half the digits near 0 and pi.
    """
    a, b = np.asarray(a, float), np.asarray(b, float)
    return np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), np.sum(a * b, axis=-1))


def normal_angle(a: FloatArray, b: FloatArray) -> FloatArray:
    """Angle between two plane normals, scaled or not, rad: the paper's structural error. See `direction_angle`."""
    return direction_angle(a, b)


def rotation_angle(a: FloatArray, b: FloatArray | None = None) -> FloatArray:
    """Angle (...) of rotations a (..., 3, 3), or of those from a to b: ||a^T b|| (paper, section 4); rad, 0..pi."""
    a = np.asarray(a, float)
    relative = a if b is None else np.swapaxes(a, -1, -2) @ np.asarray(b, float)
    cosine = np.trace(relative, axis1=-2, axis2=-1) - 1.0  # twice the cosine
    return np.arctan2(np.linalg.norm(_antisymmetric_part(relative), axis=-1), cosine)
