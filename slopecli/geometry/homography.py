"""Homographies, image 1 to image 2: x2~ ~ H x1~, and H = s R (I - T N^T) for a plane N.P = 1 (Cheng, eqs. 3-5).

Their fit to points, and their decomposition in closed form: Longuet-Higgins as given in Cheng, eqs. (6)-(8).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slopecli.errors import DegenerateConfiguration, InputError
from slopecli.geometry.epipolar import homogeneous
from slopecli.types import FloatArray


def homography_of_plane(R: FloatArray, T: FloatArray, N: FloatArray) -> FloatArray:
    """H = R (I - T N^T), eq. (3). R (3, 3), T (3,), N (..., 3) scaled normals -> (..., 3, 3)."""
    return R - (R @ T)[:, None] * np.asarray(N)[..., None, :]


def homography_in_pixels(H: FloatArray, K1: FloatArray, K2: FloatArray) -> FloatArray:
    """Homographies (..., 3, 3) between undistorted pixels: K2 H K1^-1, scaled to a last entry of 1 if that is not 0."""
    pixel = K2 @ H @ np.linalg.inv(K1)
    last = pixel[..., 2:, 2:]
    scaled = np.abs(last) > 1e-12 * np.abs(pixel).max(axis=(-2, -1), keepdims=True)
    return np.asarray(pixel / np.where(scaled, last, 1.0))


def apply_homography(H: FloatArray, x: FloatArray) -> FloatArray:
    """Map points (n, 2) by H (3, 3), eq. (5). Points on the line that H sends to infinity come back as inf."""
    y = homogeneous(np.asarray(x, dtype=float)) @ H.T
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(y[:, :2] / y[:, 2:])


def fit_homography(x1: FloatArray, x2: FloatArray, weights: FloatArray | None = None) -> FloatArray:
    """Least-squares homography (3, 3) of points (n, 2), n >= 4, with weights (n,): inverse relative variances, or None.

    It has Frobenius norm 1 and a positive depth ratio at most points.

    Source: normalised direct linear transform (Hartley and Zisserman, algorithm 4.2), then Gauss-Newton on the
    residuals themselves, so the answer is the maximum-likelihood one for noise in image 2.

    Raises
    ------
    InputError : the arrays do not match or are not finite.
    DegenerateConfiguration : fewer than four points, or three of every four are collinear.
    """
    x1, x2 = np.asarray(x1, dtype=float), np.asarray(x2, dtype=float)
    if x1.shape != x2.shape or x1.ndim != 2 or x1.shape[1] != 2 or not np.isfinite(x1 + x2).all():
        raise InputError(f"x1 {x1.shape} and x2 {x2.shape} must be finite and of the same shape (n, 2)")
    if len(x1) < 4:
        raise DegenerateConfiguration(f"a homography needs at least 4 correspondences, found {len(x1)}")
    root_weight = np.ones(len(x1)) if weights is None else np.sqrt(weights)
    C1, C2 = _conditioner(x1), _conditioner(x2)
    a, b = apply_homography(C1, x1), apply_homography(C2, x2)
    H = _linear(a, b, root_weight)
    for _ in range(3):  # from the linear solution, the change is then at rounding or far below the noise
        H = _gauss_newton(H, a, b, root_weight)
    H = np.linalg.inv(C2) @ H @ C1
    depth = homogeneous(x1) @ H[2]
    return H * (np.sign(np.sum(np.sign(depth))) or 1.0) / np.linalg.norm(H)


def _conditioner(x: FloatArray) -> FloatArray:
    """Shift and scale (3, 3) that bring points to the origin and a mean distance of sqrt(2)."""
    centre = x.mean(axis=0)
    spread = np.linalg.norm(x - centre, axis=1).mean()
    if spread <= 1e-12 * max(1.0, np.abs(centre).max()):
        raise DegenerateConfiguration("all correspondences coincide in one image; they fix no homography")
    scale = np.sqrt(2.0) / spread
    return np.array([[scale, 0.0, -scale * centre[0]], [0.0, scale, -scale * centre[1]], [0.0, 0.0, 1.0]])


def four_point_homographies(x1: FloatArray, x2: FloatArray) -> FloatArray:
    """The homography (k, 3, 3), last entry 1, through each of k samples of four points, eq. (5).

    x1, x2 : (k, 4, 2) coordinates of about unit size. A sample with three points on one line gives some finite matrix
    that may not even map its own points; test it on other points.
    """
    rows = homography_rows(homogeneous(x1), x2)
    # the small ridge keeps the systems of collinear samples and of repeated points regular
    ridge = 1e-12 * max(1.0, float(np.abs(rows).max()))
    systems, right = rows[..., :8] + ridge * np.eye(8), -rows[..., 8:]
    try:
        h = np.linalg.solve(systems, right)[..., 0]
    except np.linalg.LinAlgError:  # the ridge happened to cancel a pivot of one of them
        h = (np.linalg.pinv(systems) @ right)[..., 0]
    return np.concatenate([h, np.ones((len(h), 1))], axis=1).reshape(-1, 3, 3)


def homography_rows(p: FloatArray, x2: FloatArray) -> FloatArray:
    """(..., 2n, 9) rows of [I | -x2] (x) p, which vanish on vec(H) if H p ~ x2~; p (..., n, 3), x2 (..., n, 2)."""
    rows = np.zeros((*p.shape[:-2], 2, p.shape[-2], 9))
    rows[..., 0, :, :3] = rows[..., 1, :, 3:6] = p
    rows[..., 0, :, 6:], rows[..., 1, :, 6:] = -x2[..., :1] * p, -x2[..., 1:] * p
    return rows.reshape(*p.shape[:-2], -1, 9)


def _linear(x1: FloatArray, x2: FloatArray, root_weight: FloatArray) -> FloatArray:
    _, singular, vt = np.linalg.svd(homography_rows(homogeneous(x1) * root_weight[:, None], x2), full_matrices=True)
    if singular[7] <= 1e-7 * singular[0]:
        raise DegenerateConfiguration("the correspondences are collinear or coincide; they fix no homography")
    return vt[8].reshape(3, 3)


def _gauss_newton(H: FloatArray, x1: FloatArray, x2: FloatArray, root_weight: FloatArray) -> FloatArray:
    """One step on the image-2 residuals; h h^T in the normal matrix keeps the scale of H."""
    depth = homogeneous(x1) @ H[2]
    if np.abs(depth).min() <= 1e-6 * np.abs(depth).max():
        return H  # a point near the line sent to infinity: keep the linear solution
    predicted = apply_homography(H, x1)
    J = homography_rows(homogeneous(x1) * (root_weight / depth)[:, None], predicted)
    h = H.ravel()
    e = ((predicted - x2) * root_weight[:, None]).T.ravel()
    try:
        return np.asarray(h - np.linalg.solve(J.T @ J + np.outer(h, h), J.T @ e)).reshape(3, 3)
    except np.linalg.LinAlgError:  # the points hold no more than the linear solution
        return H


class PlaneMotion(NamedTuple):
    """Motion and plane of a homography: H ~ R (I - T N^T), |T| = 1, N scaled (3,) in 1/baseline."""

    R: FloatArray
    T: FloatArray
    N: FloatArray


@np.errstate(over="ignore", divide="ignore", invalid="ignore")
def longuet_higgins(H: FloatArray, rounding: float = 1e-14) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The two essentially different motions of each homography; (T, N) and (-T, -N) give the same H.

    Eqs. (6)-(8) hold only for |T| = 1 and H scaled so that the middle eigenvalue of W = H^T H is 1 and det H > 0, which
    the paper does not say; any scale and sign is accepted here.

    Parameters
    ----------
    H : (k, 3, 3) homographies, image 1 to image 2.
    rounding : differences of eigenvalues of W from 1 that count as 0. T and N are square roots of them, and the root
        of a rounding error of 1e-16 is 1e-8.

    Returns
    -------
    R : (k, 2, 3, 3), T : (k, 2, 3) unit vectors, N : (k, 2, 3) scaled normals, 1/baseline. A homography that is a
    rotation to working precision gives that rotation twice, with T along z and N = 0; a singular one may give nan.
    """
    d, U_transposed = np.linalg.eigh(np.swapaxes(H, -1, -2) @ H)  # eq. (6), ascending
    middle = d[:, 1]
    d1, d3 = d[:, 2] / middle, d[:, 0] / middle
    spread = d1 - d3
    moves = spread > 1e-12  # else a rotation to working precision
    safe = np.where(moves, spread, 1.0)
    above, below = (np.where(value > rounding, value, 0.0) for value in (d1 - 1.0, 1.0 - d3))
    t1, t3 = np.sqrt(above * d3 / safe), np.sqrt(below * d1 / safe)  # eq. (7)
    p1, p3 = -np.sqrt(above * d1 / safe), -np.sqrt(below * d3 / safe)
    # s1 = +1 and s3 = +-1; s1 = -1 mirrors both T and N
    axis1, axis3 = U_transposed[:, None, :, 2], U_transposed[:, None, :, 0] * np.array([1.0, -1.0])[:, None]
    T = t1[:, None, None] * axis1 + t3[:, None, None] * axis3
    N = (t1 + p1)[:, None, None] * axis1 + (t3 + p3)[:, None, None] * axis3
    T[~moves], N[~moves] = [0.0, 0.0, 1.0], 0.0
    # the norm in eq. (8) is the spectral norm, which is the scale (and sign) of H once T and N are known
    scale = np.where(np.linalg.det(H) < 0.0, -1.0, 1.0) * np.sqrt(middle)
    TN = T[..., :, None] * N[..., None, :]
    inverse = np.eye(3) + TN / (1.0 - np.sum(T * N, axis=-1))[..., None, None]  # (I - T N^T)^-1, Sherman and Morrison
    return (H / scale[:, None, None])[:, None] @ inverse, T, N  # eq. (8)


def decompose_homography(H: FloatArray, x1: FloatArray | None = None) -> list[PlaneMotion]:
    """All motions and planes of one homography, or only those with every given point in front of both cameras.

    Parameters
    ----------
    H : (3, 3) homography, image 1 to image 2, any scale and sign.
    x1 : (n, 2) normalised points of image 1 that lie on the plane, or None.

    Returns
    -------
    candidates : four without points, one or two with points; the two coincide when T is parallel to N.

    Raises
    ------
    InputError : H is not a finite 3x3 matrix.
    DegenerateConfiguration : H is singular, is a rotation (no baseline), or no candidate is visible.
    """
    H = np.asarray(H, dtype=float)
    if H.shape != (3, 3) or not np.isfinite(H).all():
        raise InputError(f"a homography must be a finite 3x3 matrix, found shape {H.shape}")
    singular_values = np.linalg.svd(H, compute_uv=False)
    if singular_values[2] <= 1e-7 * singular_values[0]:  # eq. (6) squares it, down to rounding
        raise DegenerateConfiguration(
            "the homography is singular: collinear points, points too close together for their noise, "
            "or a plane through a camera"
        )
    R, T, N = longuet_higgins(H[None])
    if not N.any():
        raise DegenerateConfiguration(
            "the homography is a pure rotation: it has no baseline, so no plane can be measured; move the camera"
        )
    candidates = [PlaneMotion(R[0, i], sign * T[0, i], sign * N[0, i]) for i in (0, 1) for sign in (1.0, -1.0)]
    if x1 is None:
        return candidates
    visible = [c for c in candidates if is_visible(c, x1)]
    if not visible:
        raise DegenerateConfiguration(
            "no decomposition of the homography has the plane in front of both cameras at every given point; "
            "check the matches and that both images use the same camera convention"
        )
    return visible


def is_visible(motion: PlaneMotion, x1: FloatArray) -> bool:
    """Whether the plane lies in front of both cameras at every point x1 (n, 2)."""
    rays = homogeneous(np.asarray(x1, dtype=float))
    inverse_depth = rays @ motion.N
    depth_ratio = rays @ motion.R[2] - (motion.R[2] @ motion.T) * inverse_depth
    return bool(np.all(inverse_depth > 0.0) and np.all(depth_ratio > 0.0))
