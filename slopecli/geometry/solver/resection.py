"""The motion of one view from points whose inverse depths in the reference are known: closed forms, then refinement.

The model is x ~ R (p - T u): p the homogeneous rays of the reference, u their inverse depths, x the places in the view,
all in normalised coordinates.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slopecli.errors import DegenerateConfiguration
from slopecli.geometry.epipolar import nearest_rotation, rotation_from_vector
from slopecli.geometry.homography import fit_homography
from slopecli.geometry.solver.views import predict_views
from slopecli.geometry.statistics import GATE_SIGMAS, geman_mcclure, robust_sigma
from slopecli.types import BoolArray, FloatArray

CLEAR_SHARE = 0.6  # of the points that agree with a start once it is refined, with which no other start is tried
Motion = tuple[FloatArray, FloatArray]  # R (3, 3) and T (3,)


class Resection(NamedTuple):
    """R (3, 3), T (3,) of a view; sigma: robust 1-sigma of a coordinate's residual; fits (n,): residuals within the
    gate; share: of the points that do."""

    R: FloatArray
    T: FloatArray
    sigma: float
    fits: BoolArray
    share: float


def resect(
    p: FloatArray, x: FloatArray, u: FloatArray, starts: list[Motion], floor: float, rounds: int = 12
) -> Resection:
    """The motion of a view that shows points p (3, n) of inverse depths u (n,) at x (2, n), mismatches among them.

    starts : motions to begin with; closed forms are added to them.  floor : lower bound of the 1-sigma of a
    residual, normalised coordinates.
    """
    if starts:
        near = min(starts, key=lambda motion: _score(p, x, u, *motion))
        first = _refined(p, x, u, near, floor, rounds)
        if first.share > CLEAR_SHARE:
            return first
    found = [*starts, *_closed_forms(p, x, u)]
    order = np.argsort([_score(p, x, u, *motion) for motion in found], kind="stable")[:2]
    return min((_refined(p, x, u, found[i], floor, rounds) for i in order), key=lambda one: (-one.share, one.sigma))


def _score(p: FloatArray, x: FloatArray, u: FloatArray, R: FloatArray, T: FloatArray) -> float:
    """Median length of the residuals; infinite if most points lie behind the camera."""
    seen, ahead = predict_views(p, R[None], T[None], u)
    length = np.hypot(*(seen[0] - x))
    return float(np.median(np.where(ahead[0] > 0.0, length, np.inf)))


def _closed_forms(p: FloatArray, x: FloatArray, u: FloatArray) -> list[Motion]:
    """Motions from the homography of the mean plane and from the linear equations of the twelve numbers R and R T."""
    found: list[Motion] = []
    mean = np.linalg.lstsq(p.T, u, rcond=None)[0]
    if len(u) >= 4 and np.linalg.norm(mean) > 0.0:
        try:
            found.append(_from_plane(fit_homography(p[:2].T, x.T), np.asarray(mean, float)))
        except DegenerateConfiguration:
            found = []  # the linear start is left
    if len(u) >= 6:
        found.append(_from_linear(p, x, u))
    return found


def _from_plane(H: FloatArray, N: FloatArray) -> Motion:
    """The motion of a homography H ~ R (I - T N^T) of a plane that is known; perpendicular to N it is a rotation."""
    n = N / np.linalg.norm(N)
    across = np.linalg.svd(n[None])[2][1:].T  # (3, 2)
    seen = H @ across
    scale = float(np.linalg.svd(seen, compute_uv=False).mean()) * np.sign(np.linalg.det(H))
    first, second = (seen / scale).T
    R = nearest_rotation(
        np.column_stack([first, second, np.cross(first, second)])
        @ np.column_stack([across[:, 0], across[:, 1], np.cross(across[:, 0], across[:, 1])]).T
    )
    T = (np.eye(3) - R.T @ H / scale) @ N / (N @ N)
    return R, T


def _from_linear(p: FloatArray, x: FloatArray, u: FloatArray) -> Motion:
    """The motion nearest to the least-squares solution of x ~ R p - K u for the twelve numbers of R and K = R T."""
    full = np.concatenate([p, -u[None]])  # (4, n)
    blocks = [np.zeros_like(full), np.zeros_like(full)]
    rows = np.concatenate(
        [
            np.concatenate([full, blocks[0], -x[0] * full]),
            np.concatenate([blocks[1], full, -x[1] * full]),
        ],
        axis=1,
    )
    vector = np.linalg.eigh(rows @ rows.T)[1][:, 0].reshape(3, 4)
    scale = np.cbrt(np.linalg.det(vector[:, :3]))
    if abs(scale) < 1e-12:
        return np.eye(3), np.zeros(3)
    R = nearest_rotation(vector[:, :3] / scale)
    return R, R.T @ vector[:, 3] / scale


def _refined(p: FloatArray, x: FloatArray, u: FloatArray, start: Motion, floor: float, rounds: int) -> Resection:
    """Gauss-Newton on the six numbers under Geman-McClure weights whose scale follows the residuals."""
    R, T = start
    length = np.zeros(len(u))
    sigma = floor
    for _ in range(rounds):
        seen, ahead = predict_views(p, R[None], T[None], u)
        residual, z = seen[0] - x, ahead[0]
        length = np.where(z > 0.0, np.hypot(*residual), np.inf)
        # the median length of a two-dimensional Gaussian residual is 1.18 sigma, of a one-dimensional 0.67
        sigma = robust_sigma(length, floor / 0.57) * 0.57
        if not np.isfinite(sigma):  # most points lie behind the camera
            return Resection(R, T, sigma, np.zeros(len(u), bool), 0.0)
        weight = geman_mcclure(length, GATE_SIGMAS * sigma)
        J = _jacobian(seen[0], z, R, u)
        information = (J * weight).reshape(6, -1) @ J.reshape(6, -1).T
        gradient = (J * weight).reshape(6, -1) @ np.where(np.isfinite(length), residual, 0.0).ravel()
        scale = np.diag(information)
        move = -np.linalg.solve(information + np.diag(1e-12 * scale + np.finfo(float).tiny), gradient)
        R, T = rotation_from_vector(np.asarray(move[:3], float)) @ R, T + move[3:]
        if float(move @ (scale * move)) < 1e-3 * sigma**2:
            break
    fits = length < 2.0 * GATE_SIGMAS * sigma
    return Resection(R, T, sigma, fits, float(fits.mean()))


def _jacobian(x: FloatArray, z: FloatArray, R: FloatArray, u: FloatArray) -> FloatArray:
    """(6, 2, n) derivatives of places x (2, n) by (w, T)."""
    product = x[0] * x[1]
    J = np.empty((6, 2, len(z)))
    J[0, 0], J[1, 0], J[2, 0] = -product, 1.0 + x[0] ** 2, -x[1]
    J[0, 1], J[1, 1], J[2, 1] = -1.0 - x[1] ** 2, product, x[0]
    for c in range(3):
        J[3 + c] = (x * R[2, c] - R[:2, c, None]) * (u / z)
    return J
