"""Homographies, image 1 to image 2: x2~ ~ H x1~, and H = s R (I - T N^T) for a plane N.P = 1 (Cheng, eqs. 3-5)."""

from __future__ import annotations

import numpy as np

from slopecli.errors import DegenerateConfiguration, InputError
from slopecli.geometry.epipolar import homogeneous
from slopecli.types import FloatArray


def homography_of_plane(R: FloatArray, T: FloatArray, N: FloatArray) -> FloatArray:
    """H = R (I - T N^T), eq. (3). R (3, 3), T (3,), N (..., 3) scaled normals -> (..., 3, 3)."""
    return R - (R @ T)[:, None] * np.asarray(N)[..., None, :]


def homography_in_pixels(H: FloatArray, K1: FloatArray, K2: FloatArray) -> FloatArray:
    """The homography between undistorted pixels: K2 H K1^-1, scaled to a last entry of 1 where that is not 0."""
    pixel = K2 @ H @ np.linalg.inv(K1)
    return pixel / pixel[2, 2] if abs(pixel[2, 2]) > 1e-12 * np.abs(pixel).max() else pixel


def apply_homography(H: FloatArray, x: FloatArray) -> FloatArray:
    """Map points (n, 2) by H (3, 3), eq. (5). Points on the line that H sends to infinity come back as inf."""
    y = homogeneous(np.asarray(x, dtype=float)) @ H.T
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(y[:, :2] / y[:, 2:])


def fit_homography(x1: FloatArray, x2: FloatArray, weights: FloatArray | None = None) -> FloatArray:
    """Least-squares homography: the sum of squared residuals in image 2 is smallest.

    Source: normalised direct linear transform (Hartley and Zisserman, algorithm 4.2), then Gauss-Newton on the
    residuals themselves, so the answer is the maximum-likelihood one for noise in image 2.

    Parameters
    ----------
    x1, x2 : (n, 2), n >= 4, normalised coordinates or pixels.
    weights : (n,) inverse relative variances, or None.

    Returns
    -------
    H : (3, 3) with Frobenius norm 1 and positive depth ratio at most points.

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
    """The homography through each of k samples of four points, eq. (5).

    Parameters
    ----------
    x1, x2 : (k, 4, 2) normalised coordinates, or any of about unit size.

    Returns
    -------
    H : (k, 3, 3) with last entry 1. A sample with three points on one line gives some finite matrix that may not even
        map its own points; test it on other points.
    """
    rows = homography_rows(homogeneous(x1), x2)
    # the small ridge keeps the systems of collinear samples regular
    h = np.linalg.solve(rows[..., :8] + 1e-12 * np.eye(8), -rows[..., 8:])[..., 0]
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
    return (h - np.linalg.solve(J.T @ J + np.outer(h, h), J.T @ e)).reshape(3, 3)
