"""Points of one reference image seen in several other views, and the normal equations of all motions and planes.

A view k has its own motion, P_k = R_k (P - T_k) with P in the axes of the reference camera; a plane has one scaled
normal, N.P = 1, for all of them. A point p of the reference has the inverse depth u and is predicted in view k where
R_k (p - T_k u) projects. On a plane u = N.p exactly, or, where points have relief, with a 1-sigma of r u that is the
same in every view; on no plane u is free. So u is eliminated point by point, then N plane by plane, and a system of
six numbers a view is left.

Views no longer kept are represented by `Summed`: their information on every u, and a few variables z for what the
errors of their motions have in common.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from slopecli.errors import DegenerateConfiguration, InputError
from slopecli.geometry.epipolar import rotation_from_vector, tangent_basis
from slopecli.geometry.solver.observations import away_from_zero, checked_points, checked_weights
from slopecli.types import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Summed:
    """Information of views no longer kept: quadratic in the inverse depths u, the normals N and variables z.

    chi2 = sum_j (u_information_j u_j^2 - 2 u_vector_j u_j) + 2 u.(u_modes z) + N.(n_information N) - 2 n_vector.N
           + 2 N.(n_modes z) + z.z + 2 z_vector.z, up to a constant; n_information is one 3x3 block a plane.

    u_information, u_vector (n,); u_modes (n, r); n_information (m, 3, 3); n_vector (m, 3); n_modes (m, 3, r);
    z_vector (r,).  scaled : whether it fixes the unit of length; else the first view kept has a baseline of 1.
    """

    u_information: FloatArray
    u_vector: FloatArray
    u_modes: FloatArray
    n_information: FloatArray
    n_vector: FloatArray
    n_modes: FloatArray
    z_vector: FloatArray
    scaled: bool = False

    @classmethod
    def nothing(cls, n: int, m: int) -> Summed:
        """No information on n points and m planes."""
        blank = np.zeros
        return cls(blank(n), blank(n), blank((n, 0)), blank((m, 3, 3)), blank((m, 3)), blank((m, 3, 0)), blank(0))

    @property
    def n_variables(self) -> int:
        return len(self.z_vector)


@dataclass(frozen=True, eq=False)
class ViewPoints:
    """Points of the reference, sorted by plane, those on no plane last, and where the views show them.

    p (3, n) homogeneous; x (k, 2, n) found, 0 where a view does not show the point; weight (k, n) inverse relative
    variances, 0 there; count, first (m,) points of each plane; order (n,) their index in the caller's arrays.
    summed : information of views that are not kept.
    """

    p: FloatArray
    x: FloatArray
    weight: FloatArray
    count: IntArray
    first: IntArray
    order: IntArray
    summed: Summed

    @property
    def n_views(self) -> int:
        return len(self.x)

    @property
    def n_planes(self) -> int:
        return len(self.count)

    @property
    def n_on_planes(self) -> int:
        return int(self.count.sum())

    def per_point(self, per_plane: FloatArray, otherwise: float = 0.0) -> FloatArray:
        """Repeat values (..., m) of planes for each of their points, points on no plane get `otherwise`: (..., n)."""
        repeated = np.repeat(per_plane, self.count, axis=-1)
        rest = np.full((*repeated.shape[:-1], self.p.shape[1] - repeated.shape[-1]), otherwise)
        return np.concatenate([repeated, rest], axis=-1)

    def sum_planes(self, per_point: FloatArray) -> FloatArray:
        """Sum values (..., n) over the points of each plane: (..., m)."""
        filled = self.count > 0
        if filled.all():
            return np.add.reduceat(per_point[..., : self.n_on_planes], self.first, axis=-1)
        sums = np.zeros((*per_point.shape[:-1], self.n_planes))
        if filled.any():
            sums[..., filled] = np.add.reduceat(per_point[..., : self.n_on_planes], self.first[filled], axis=-1)
        return sums

    def in_given_order(self, per_point: FloatArray) -> FloatArray:
        """Bring values (..., n) back into the caller's order of points."""
        restored = np.empty_like(per_point)
        restored[..., self.order] = per_point
        return restored

    def plane_of_point(self) -> IntArray:
        """(n,) plane of every point, -1 for none."""
        planes = self.per_point(np.arange(self.n_planes).astype(float), -1.0)
        return planes.astype(np.int64)


class ViewState(NamedTuple):
    """R (k, 3, 3), T (k, 3), N (m, 3) scaled normals, u (n,) inverse depths, z (r,) of the views summed up."""

    R: FloatArray
    T: FloatArray
    N: FloatArray
    u: FloatArray
    z: FloatArray


def observe_views(x1: FloatArray, x: FloatArray, patch: IntArray, weights: FloatArray | None = None) -> ViewPoints:
    """Validate and sort points x1 (n, 2) of the reference, their places x (k, n, 2) in k views and labels (n,).

    Labels are 0..m-1, or -1 for none; NaN in x stands for a point that a view does not show. weights (k, n) or None.

    Raises
    ------
    InputError : shapes, types or values are unusable, or no point is on any plane.
    DegenerateConfiguration : a plane has fewer than three points.
    """
    x = np.asarray(x, dtype=float)
    if x.ndim != 3 or x.shape[2] != 2 or not len(x):
        raise InputError(f"x has shape {x.shape}, needed (views, points, 2) normalised coordinates")
    seen: BoolArray = np.logical_and.reduce(np.isfinite(x), axis=2)
    x1, _, patch = checked_points(x1, np.where(seen[0, :, None], x[0], 0.0), patch)
    weight = np.stack([checked_weights(None if weights is None else weights[k], len(x1)) for k in range(len(x))])
    if not len(patch) or patch.max() < 0 or patch.min() < -1:
        raise InputError("patch must hold labels 0..m-1, or -1 for a point on no plane, and at least one plane")
    count = np.bincount(patch + 1)[1:]
    if count.min() < 3:
        short = int(np.argmin(count))
        raise DegenerateConfiguration(f"patch {short} has {count[short]} points, a plane needs at least 3")
    order = np.argsort(np.where(patch < 0, len(count), patch), kind="stable")
    p = np.ones((3, len(x1)))
    p[:2] = x1[order].T
    places = np.where(seen[..., None], x, 0.0)[:, order].transpose(0, 2, 1)
    summed = Summed.nothing(len(x1), len(count))
    first = np.cumsum(count) - count
    return ViewPoints(p, np.ascontiguousarray(places), (weight * seen)[:, order], count, first, order, summed)


class Terms(NamedTuple):
    """Prediction of every view and its derivatives, sums over the two coordinates.

    residual (k, 2, n) predicted minus found; slide (k, 2, n) d x / d u; ahead (k, n) depth there over depth in the
    reference. U (k, 6, 6), X (k, 6, n), V (k, n): J^T J of motion, motion and u, u; g (k, 6), h (k, n): J^T residual.
    Motion perturbations: R <- exp([w]x) R, T <- T + dT.
    """

    residual: FloatArray
    slide: FloatArray
    ahead: FloatArray
    U: FloatArray
    X: FloatArray
    V: FloatArray
    g: FloatArray
    h: FloatArray


def predict_views(p: FloatArray, R: FloatArray, T: FloatArray, u: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Where points p (3, n) of inverse depths u (n,) are in views R (k, 3, 3), T (k, 3): (k, 2, n), and depths (k, n).

    The depths are those in the view over those in the reference.
    """
    y = R @ p - (R @ T[:, :, None]) * u
    z = away_from_zero(y[:, 2], 1e-9)
    return y[:, :2] / z[:, None], z


def view_terms(points: ViewPoints, R: FloatArray, T: FloatArray, u: FloatArray) -> Terms:
    """Linearise the views at motions R (k, 3, 3), T (k, 3) and inverse depths u (n,)."""
    k, n = len(R), points.p.shape[1]
    x, z = predict_views(points.p, R, T, u)
    K = (R @ T[:, :, None])[:, :, 0]
    slide = (x * K[:, 2, None, None] - K[:, :2, None]) / z[:, None]
    J = np.empty((k, 6, 2, n))
    first, second = x[:, 0], x[:, 1]
    product = first * second
    J[:, 0, 0], J[:, 1, 0], J[:, 2, 0] = -product, 1.0 + first * first, -second
    J[:, 0, 1], J[:, 1, 1], J[:, 2, 1] = -1.0 - second * second, product, first
    scale = (u / z)[:, None]
    for c in range(3):
        J[:, 3 + c] = (x * R[:, 2, c, None, None] - R[:, :2, c, None]) * scale
    residual = (x - points.x) * (points.weight > 0.0)[:, None]
    root = np.sqrt(points.weight)[:, None]
    J *= root[:, None]
    flat, pull, error = J.reshape(k, 6, 2 * n), slide * root, residual * root
    U = flat @ flat.swapaxes(1, 2)
    g = (flat @ error.reshape(k, 2 * n, 1))[:, :, 0]
    X = J[:, :, 0] * pull[:, None, 0] + J[:, :, 1] * pull[:, None, 1]
    V = (pull * pull).sum(axis=1)
    h = (pull * error).sum(axis=1)
    return Terms(residual, slide, z, U, X, V, g, h)


class Reduced(NamedTuple):
    """Normal equations with inverse depths and normals eliminated; d parameters of motions and z are left.

    chi2 : here.  S (d, d), gradient (d,): of what is left.  plane (m, 3, 3), cross (d, m, 3), plane_gradient (m, 3):
    of the normals.  V, h (n,), X (d, n): of the inverse depths; s, t (n,): q / (V + q) and 1 / (V + q), where q is
    the information of the plane on the point's inverse depth; offset (n,): u - N.p.
    """

    chi2: float
    S: FloatArray
    gradient: FloatArray
    plane: FloatArray
    cross: FloatArray
    plane_gradient: FloatArray
    V: FloatArray
    h: FloatArray
    X: FloatArray
    s: FloatArray
    t: FloatArray
    offset: FloatArray


def motion_basis(points: ViewPoints, T: FloatArray) -> FloatArray:
    """(6k, d) basis of the motions' free coordinates: a first view that sets the unit of length has five."""
    d = 6 * len(T)
    if points.summed.scaled:
        return np.eye(d)
    basis = np.zeros((d, d - 1))
    basis[:3, :3], basis[3:6, 3:5] = np.eye(3), tangent_basis(T[0] / np.linalg.norm(T[0]))
    basis[6:, 5:] = np.eye(d - 6)
    return basis


def normal_equations_of_views(points: ViewPoints, state: ViewState, q: FloatArray, terms: Terms) -> Reduced:
    """The reduced system at a state; q (n,) information of its plane on a point's u, inf on it, 0 for no plane."""
    summed, (k, n) = points.summed, points.weight.shape
    basis, r = motion_basis(points, state.T), points.summed.n_variables
    d = basis.shape[1]
    S, X, gradient = np.zeros((d + r, d + r)), np.empty((d + r, n)), np.empty(d + r)
    for view in range(k):
        own = basis[6 * view : 6 * view + 6]
        S[:d, :d] += own.T @ terms.U[view] @ own
    X[:d] = basis.T @ terms.X.reshape(6 * k, n)
    X[d:] = summed.u_modes.T
    gradient[:d] = basis.T @ terms.g.ravel()
    S[d:, d:] = np.eye(r)
    gradient[d:] = state.z + summed.z_vector + summed.u_modes.T @ state.u + np.einsum("mar,ma", summed.n_modes, state.N)
    V = terms.V.sum(axis=0) + summed.u_information
    h = terms.h.sum(axis=0) + summed.u_information * state.u - summed.u_vector + summed.u_modes @ state.z
    with np.errstate(divide="ignore", invalid="ignore"):
        s = np.where(np.isinf(q), 1.0, q / np.maximum(V + q, np.finfo(float).tiny))
        t = np.where(np.isinf(q), 0.0, 1.0 / np.maximum(V + q, np.finfo(float).tiny))
    t = np.where(V + q > 0.0, t, 0.0)
    offset = np.where(q > 0.0, state.u - _on_planes(points, state.N), 0.0)
    chi2 = float((points.weight * (terms.residual**2).sum(axis=1)).sum()) + _chi2_of_summed(summed, state)
    chi2 += float((np.where(np.isinf(q), 0.0, q) * offset**2).sum())
    S -= (X * t) @ X.T
    return _with_planes(points, state, Reduced(chi2, S, gradient, *(np.zeros(0),) * 3, V, h, X, s, t, offset))


def _with_planes(points: ViewPoints, state: ViewState, system: Reduced) -> Reduced:
    """Add the terms of the normals and those of the eliminated inverse depths to the gradient."""
    summed, n = points.summed, points.n_on_planes
    p, s, V, h = points.p[:, :n], system.s, system.V, system.h
    r, d = summed.n_variables, len(system.gradient)
    pull = -s * system.offset - system.t * h  # the best change of u for motions and normals held
    gradient = system.gradient + system.X @ pull
    own = (s * V)[:n] * p
    plane = points.sum_planes(own[:, None] * p[None]).transpose(2, 0, 1) + summed.n_information
    cross = np.empty((len(gradient), points.n_planes, 3))
    drawn = s[:n] * p
    for i, (first, count) in enumerate(zip(points.first.tolist(), points.count.tolist(), strict=True)):
        cross[:, i] = system.X[:, first : first + count] @ drawn[:, first : first + count].T
    if r:
        cross[d - r :] += summed.n_modes.transpose(2, 0, 1)
    plane_gradient = points.sum_planes((s * (h - V * system.offset))[:n] * p).T
    plane_gradient = plane_gradient + np.einsum("mab,mb->ma", summed.n_information, state.N) - summed.n_vector
    plane_gradient = plane_gradient + summed.n_modes @ state.z
    return system._replace(gradient=gradient, plane=plane, cross=cross, plane_gradient=plane_gradient)


def _on_planes(points: ViewPoints, N: FloatArray) -> FloatArray:
    """(n,) inverse depth of the plane at every point, 0 on no plane."""
    return np.asarray((points.per_point(N.T) * points.p).sum(axis=0))


def _chi2_of_summed(summed: Summed, state: ViewState) -> float:
    u, z = state.u, state.z
    value = float(summed.u_information @ (u * u) - 2.0 * summed.u_vector @ u + z @ z + 2.0 * summed.z_vector @ z)
    value += 2.0 * float(u @ (summed.u_modes @ z))
    value += float(np.einsum("ma,mab,mb", state.N, summed.n_information, state.N)) - 2.0 * float(
        (summed.n_vector * state.N).sum()
    )
    return value + 2.0 * float((state.N * (summed.n_modes @ z)).sum())


class Move(NamedTuple):
    """A step: the state after it, and the decrease of chi-square that the linear model promises."""

    state: ViewState
    predicted: float


def take_step(points: ViewPoints, state: ViewState, system: Reduced, damping: float) -> Move:
    """Gauss-Newton step of motions, z and normals, motions damped, and the best inverse depths after it."""
    response = np.linalg.solve(regular(system.plane), _flat(system))
    left = system.S - np.einsum("dma,mae->de", system.cross, response[:, :, :-1])
    gradient = system.gradient - np.einsum("dma,ma->d", system.cross, response[:, :, -1])
    scale = np.diag(system.S).copy()
    left = left + np.diag(damping * scale + 1e-13 * scale.max())
    move = -np.linalg.solve(left, gradient)
    dN = -(response[:, :, :-1] @ move) - response[:, :, -1]
    predicted = -float(gradient @ move) + float((system.plane_gradient * response[:, :, -1]).sum())
    d = len(move) - points.summed.n_variables
    turn = (motion_basis(points, state.T) @ move[:d]).reshape(-1, 6)
    R = rotation_from_vector(turn[:, :3]) @ state.R
    T, N = state.T + turn[:, 3:], state.N + dN
    u = system.t * -(system.X.T @ move + system.h)
    step = (points.per_point(dN.T) * points.p).sum(axis=0) - system.offset
    # u moves by (q y - b) / (V + q), y the change of the plane's inverse depth; exactly onto it where q is infinite
    u = state.u + np.where(system.s == 1.0, step, system.s * step + u)
    if not points.summed.scaled:
        T, N, u = rescaled(T, N, u)
    return Move(ViewState(R, T, N, u, state.z + move[d:]), predicted)


def rescaled(T: FloatArray, N: FloatArray, u: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Positions (k, 3), normals and inverse depths in the unit of the first view's baseline."""
    length = float(np.linalg.norm(T[0]))
    return T / length, N * length, u * length


def _flat(system: Reduced) -> FloatArray:
    """(m, 3, d + 1) cross terms of the normals with what is left, and their gradient."""
    return np.concatenate([system.cross.transpose(1, 2, 0), system.plane_gradient[:, :, None]], axis=2)


def regular(blocks: FloatArray) -> FloatArray:
    """Blocks (m, 3, 3) lifted by 1e-13 of their trace, so that one without information can be inverted."""
    lift = 1e-13 * np.trace(blocks, axis1=1, axis2=2) + np.finfo(float).tiny
    return blocks + lift[:, None, None] * np.eye(3)
