"""Motion and plane from one homography in closed form: Longuet-Higgins as given in Cheng, eqs. (6)-(8)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slopecli.errors import DegenerateConfiguration, InputError
from slopecli.geometry.epipolar import homogeneous
from slopecli.types import FloatArray


class PlaneMotion(NamedTuple):
    """Motion and plane of a homography: H ~ R (I - T N^T), |T| = 1, N scaled (3,) in 1/baseline."""

    R: FloatArray
    T: FloatArray
    N: FloatArray


def longuet_higgins(H: FloatArray, rounding: float = 1e-14) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The two essentially different motions of each homography; (T, N) and (-T, -N) give the same H.

    Source: Cheng, eqs. (6)-(8). They hold only for |T| = 1 and H scaled so that the middle eigenvalue of W = H^T H is 1
    and det H > 0, which the paper does not say; any scale and sign is accepted here.

    Parameters
    ----------
    H : (k, 3, 3) homographies, image 1 to image 2.
    rounding : differences of eigenvalues of W from 1 that count as 0. T and N are square roots of them, and the root
        of a rounding error of 1e-16 is 1e-8.

    Returns
    -------
    R : (k, 2, 3, 3), T : (k, 2, 3) unit vectors, N : (k, 2, 3) scaled normals, 1/baseline. A homography that is a
    rotation to working precision gives that rotation twice, with T along z and N = 0.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        d, U_transposed = np.linalg.eigh(np.swapaxes(H, -1, -2) @ H)  # eq. (6), ascending
    middle = d[:, 1]
    d1, d3 = d[:, 2] / middle, d[:, 0] / middle
    spread = d1 - d3
    moves = spread > 1e-12  # else a rotation to working precision
    safe = np.where(moves, spread, 1.0)
    above, below = _snap(d1 - 1.0, rounding), _snap(1.0 - d3, rounding)
    t1, t3 = np.sqrt(above * d3 / safe), np.sqrt(below * d1 / safe)  # eq. (7)
    p1, p3 = -np.sqrt(above * d1 / safe), -np.sqrt(below * d3 / safe)
    # s1 = +1 and s3 = +-1; s1 = -1 mirrors both T and N
    axis1, axis3 = U_transposed[:, None, :, 2], U_transposed[:, None, :, 0] * np.array([1.0, -1.0])[:, None]
    T = t1[:, None, None] * axis1 + t3[:, None, None] * axis3
    N = (t1 + p1)[:, None, None] * axis1 + (t3 + p3)[:, None, None] * axis3
    T[~moves], N[~moves] = [0.0, 0.0, 1.0], 0.0
    return _rotation(H, np.sqrt(middle), T, N), T, N


def _snap(value: FloatArray, rounding: float) -> FloatArray:
    return np.where(value > rounding, value, 0.0)


def _rotation(H: FloatArray, scale: FloatArray, T: FloatArray, N: FloatArray) -> FloatArray:
    """Eq. (8). Its norm is the spectral norm, which is the scale (and sign) of H once T and N are known."""
    TN = T[..., :, None] * N[..., None, :]
    denominator = 1.0 - np.sum(T * N, axis=-1)
    inverse = np.eye(3) + TN / denominator[..., None, None]  # (I - T N^T)^-1, Sherman and Morrison
    scale = np.where(np.linalg.det(H) < 0.0, -scale, scale)
    return (H / scale[:, None, None])[:, None] @ inverse  # eq. (8)


def decompose_homography(H: FloatArray, x1: FloatArray | None = None) -> list[PlaneMotion]:
    """All motions and planes of one homography, or only those with every given point in front of both cameras.

    Source: Cheng, eqs. (6)-(8) after Longuet-Higgins (1986).

    Parameters
    ----------
    H : (3, 3) homography, image 1 to image 2, any scale and sign.
    x1 : (n, 2) normalised points of image 1 that lie on the plane, or None. With points, a candidate is kept when
        the plane is in front of both cameras at every one of them.

    Returns
    -------
    candidates : four without points, one or two with points; the two coincide when T is parallel to N.

    Raises
    ------
    InputError : H is not a finite 3x3 matrix.
    DegenerateConfiguration : H is singular, is a rotation (no baseline), or no candidate is visible.
    """
    H = _checked(H)
    R, T, N = longuet_higgins(H[None])
    if not N.any():
        raise DegenerateConfiguration(
            "the homography is a pure rotation: it has no baseline, so no plane can be measured; move the camera"
        )
    signs = (1.0, -1.0)
    candidates = [PlaneMotion(R[0, i], sign * T[0, i], sign * N[0, i]) for i in (0, 1) for sign in signs]
    if x1 is None:
        return candidates
    visible = [c for c in candidates if is_visible(c, x1)]
    if not visible:
        raise DegenerateConfiguration(
            "no decomposition of the homography has the plane in front of both cameras at every given point; "
            "check the matches and that both images use the same camera convention"
        )
    return visible


def _checked(H: FloatArray) -> FloatArray:
    H = np.asarray(H, dtype=float)
    if H.shape != (3, 3) or not np.isfinite(H).all():
        raise InputError(f"a homography must be a finite 3x3 matrix, found shape {H.shape}")
    singular_values = np.linalg.svd(H, compute_uv=False)
    if singular_values[2] <= 1e-7 * singular_values[0]:  # eq. (6) squares it, down to rounding
        raise DegenerateConfiguration(
            "the homography is singular: collinear points, points too close together for their noise, "
            "or a plane through a camera"
        )
    return H


def is_visible(motion: PlaneMotion, x1: FloatArray) -> bool:
    """Whether the plane lies in front of both cameras at every point x1 (n, 2)."""
    rays = homogeneous(np.asarray(x1, dtype=float))
    inverse_depth = rays @ motion.N
    depth_ratio = rays @ motion.R[2] - (motion.R[2] @ motion.T) * inverse_depth
    return bool(np.all(inverse_depth > 0.0) and np.all(depth_ratio > 0.0))
