"""The joint solution of many views: their motions and one normal a plane, refined, with relief, noise and covariance.

The first view's baseline is the unit of length, so k views have 5 + 6 (k - 1) numbers of motion and m planes 3m.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from slopecli.geometry.epipolar import tangent_basis
from slopecli.geometry.solver.relief import standing_off
from slopecli.geometry.solver.solve import EXACT_RESIDUAL
from slopecli.geometry.solver.views import (
    Reduced,
    Terms,
    ViewPoints,
    ViewState,
    motion_basis,
    normal_equations_of_views,
    regular,
    take_step,
    view_terms,
)
from slopecli.types import Ambiguity, BoolArray, FloatArray, Solution

MOST_JOINT = 100  # planes whose covariances with each other are computed; of more those through the pair's motion


class Root(NamedTuple):
    """One minimum: its state, linearised there; relief (m,) and the information q (n,) that follows from it.

    cost : chi-square less constants, in units of noise^2, plus the log determinant of the relief.
    """

    state: ViewState
    terms: Terms
    system: Reduced
    relief: FloatArray
    q: FloatArray
    noise: float
    converged: bool
    iterations: int

    @property
    def cost(self) -> float:
        """What roots are compared by, in units of noise^2; only roots of the same `noise` can be."""
        q, V = self.q, self.system.V
        loose = np.isfinite(q) & (q > 0.0) & (V > 0.0)
        spread = float(np.log1p(V[loose] / q[loose]).sum())
        return self.system.chi2 + self.noise**2 * spread


def refine(
    points: ViewPoints, state: ViewState, q: FloatArray, *, most: int = 40, tolerance: float = 1e-3
) -> tuple[ViewState, Terms, Reduced, bool, int]:
    """Levenberg-Marquardt from a state to the minimum of chi-square under fixed information q of the planes.

    most : number of iterations.
    tolerance : the iteration ends when the decrease promised is below this part of the variance of a residual.
    Returns the state, its terms and reduced system, whether it converged, and the iterations taken.
    """
    terms = view_terms(points, state.R, state.T, state.u)
    system = normal_equations_of_views(points, state, q, terms)
    freedom = max(2.0 * float(np.count_nonzero(points.weight)) - len(system.gradient) - 3 * points.n_planes, 1.0)
    damping, iteration = 1e-9, 0
    for iteration in range(1, most + 1):
        move = take_step(points, state, system, damping)
        floor = max(abs(system.chi2) / freedom, EXACT_RESIDUAL**2)
        trial_terms = view_terms(points, move.state.R, move.state.T, move.state.u)
        trial = normal_equations_of_views(points, move.state, q, trial_terms)
        better = trial.chi2 <= system.chi2 + 1e-6 * tolerance * floor
        if better:
            state, terms, system = move.state, trial_terms, trial
            damping = max(0.2 * damping, 1e-14)
        else:
            damping = min(max(5.0 * damping, 1e-9) * 5.0, 1e7)
        if move.predicted <= tolerance * floor or damping > 1e6:
            return state, terms, system, bool(move.predicted <= tolerance * floor), iteration
    return state, terms, system, False, iteration


def information_of_relief(points: ViewPoints, N: FloatArray, relief: FloatArray, noise: float) -> FloatArray:
    """(n,) information, in units of 1/noise^2, that the plane of a point holds on its inverse depth."""
    u = (points.per_point(N.T) * points.p).sum(axis=0)
    spread = points.per_point(relief) * np.abs(u)
    on_plane = points.per_point(np.ones(points.n_planes)) > 0.0
    with np.errstate(divide="ignore"):
        q = np.where(spread > 0.0, noise**2 / np.maximum(spread, 1e-150) ** 2, np.inf)
    return np.where(on_plane, q, 0.0)


def noise_of(points: ViewPoints, terms: Terms, system: Reduced) -> tuple[float, float]:
    """1-sigma of a coordinate of weight 1 from the residuals of the views kept, and their degrees of freedom."""
    squares = float((points.weight * (terms.residual**2).sum(axis=1)).sum())
    own = terms.V.sum(axis=0)
    on_plane = points.per_point(np.ones(points.n_planes)) > 0.0
    spent = float((own * system.t).sum())
    planes = 3.0 * points.n_planes * float(system.s[on_plane].mean())
    share = float(own.sum() / max(float(system.V.sum()), np.finfo(float).tiny))
    freedom = 2.0 * float(np.count_nonzero(points.weight)) - spent - planes * share - 6.0 * points.n_views
    return float(np.sqrt(squares / max(freedom, 1.0))), freedom


class Heights(NamedTuple):
    """Points off their planes: height (n,) over the distance, from their views alone, its noise sigma (n,), and known
    (n,): on a plane and seen."""

    height: FloatArray
    sigma: FloatArray
    known: BoolArray


def heights_of(points: ViewPoints, system: Reduced, state: ViewState, noise: float) -> Heights:
    """Heights of all points off their planes."""
    plane = (points.per_point(state.N.T) * points.p).sum(axis=0)
    on_plane = np.arange(len(plane)) < points.n_on_planes
    known = on_plane & (system.V > 0.0) & (plane > 0.0)
    V, distance = np.where(known, system.V, 1.0), np.where(known, plane, 1.0)
    height = np.where(known, (state.u - plane - system.h / V) / distance, 0.0)
    return Heights(height, np.where(known, noise / np.sqrt(V) / distance, 0.0), known)


def off_planes(points: ViewPoints, heights: Heights) -> BoolArray:
    """(n,) outliers of each plane, such as rocks: see `relief.standing_off`."""
    slices = [slice(int(first), int(first + count)) for first, count in zip(points.first, points.count, strict=True)]
    return standing_off(heights.height, heights.sigma, heights.known, slices)


def off_in_last(points: ViewPoints, state: ViewState, before: Root) -> BoolArray:
    """(n,) points off the planes of the root before the last view came, by that view too.

    A bush that only this view shows would tilt the plane of its window first, and stand less far off it then.
    """
    last = replace(points, x=points.x[-1:], weight=points.weight[-1:])
    terms, system = view_terms(last, state.R[-1:], state.T[-1:], state.u), before.system
    known = system._replace(V=system.V + terms.V[0], h=system.h + terms.h[0])
    return off_planes(points, heights_of(points, known, state, before.noise))


def relief_of(points: ViewPoints, heights: Heights, left_out: BoolArray) -> FloatArray:
    """(m,) RMS height of the points off their plane over its distance, by Fisher scoring; noise is subtracted.

    left_out : (n,) points that do not belong to their plane.
    """
    variance = np.where(heights.known, heights.sigma**2, 1.0)
    kept = (heights.known & ~left_out).astype(float)
    count = points.sum_planes(kept)
    freedom = points.per_point(np.where(count > 3.0, count / np.maximum(count - 3.0, 1.0), 0.0))
    excess = freedom * heights.height**2 - variance
    squared = np.zeros(points.n_planes)
    for _ in range(5):  # each step reduces the error several times
        share = kept / (variance + points.per_point(squared)) ** 2
        information = points.sum_planes(share)
        squared = np.maximum(points.sum_planes(share * excess) / np.maximum(information, np.finfo(float).tiny), 0.0)
    return np.sqrt(squared)


@dataclass(frozen=True, eq=False)
class ViewsSolution:
    """Motions of k views and one scaled normal a plane.

    R : (k, 3, 3) rotations, reference to view.  T : (k, 3) positions in axes of the reference, unit: the baseline of
    the first view.  scaled_normals : (m, 3).  inverse_depth : (n,) of the points, in the caller's order.
    motion_covariance : (d, d) of the coordinates `basis` (6k, d) of the motions (w, T) of all views, d = 6k - 1.
    normal_gain : (m, 3, d) and own_covariance (m, 3, 3): cov(N_i, N_j) = G_i C G_j^T, plus own_covariance for i = j.
    noise, relief, noise_gain, chi2, inlier, converged, iterations: as of `types.Solution`; inlier is (k, n).
    alternative : the second root, None without one; status, delta_chi2, joined: as of `types.Ambiguity`.
    """

    R: FloatArray
    T: FloatArray
    scaled_normals: FloatArray
    inverse_depth: FloatArray
    motion_covariance: FloatArray
    basis: FloatArray
    normal_gain: FloatArray
    own_covariance: FloatArray
    noise: float
    relief: FloatArray
    rms: float
    chi2: float
    inlier: BoolArray
    converged: bool
    iterations: int
    noise_gain: float
    alternative: ViewsSolution | None = None
    status: str = "none"
    delta_chi2: float | None = None
    joined: bool = False

    @cached_property
    def normal_covariance(self) -> FloatArray:
        """(m, 3, 3) of the scaled normals, that of the motions included."""
        return self.own_covariance + self.normal_gain @ self.motion_covariance @ self.normal_gain.swapaxes(1, 2)

    def pair(self, view: int = -1) -> Solution:
        """The reference and one view as a `Solution`, in the unit of that view's own baseline."""
        view %= len(self.R)
        length = float(np.linalg.norm(self.T[view]))
        T, m, C = self.T[view] / length, len(self.scaled_normals), self.motion_covariance
        tangent = tangent_basis(T)
        turn, move = self.basis[6 * view : 6 * view + 3], self.basis[6 * view + 3 : 6 * view + 6]
        # derivatives of the pair's motion and normals by the motions of all views
        of_motion = np.concatenate([turn, tangent.T @ move / length])
        of_normals = length * self.normal_gain + self.scaled_normals[:, :, None] * (T @ move)
        own = length**2 * self.own_covariance
        motion = of_motion @ C @ of_motion.T
        flat = of_normals.reshape(3 * m, -1)
        other = self.alternative.pair(view) if self.alternative is not None else None
        ambiguity = Ambiguity(self.status, self.delta_chi2, other, None, self.joined)  # type: ignore[arg-type]
        return Solution(
            R=self.R[view],
            T=T,
            scaled_normals=length * self.scaled_normals,
            normal_covariance=own + of_normals @ C @ of_normals.swapaxes(1, 2),
            motion_covariance=motion,
            tangent=tangent,
            normal_gain=(flat @ C @ of_motion.T @ np.linalg.pinv(motion)).reshape(m, 3, 5),
            noise=self.noise,
            relief=self.relief,
            rms=self.rms,
            chi2=self.chi2,
            inlier=np.asarray(self.inlier.any(axis=0)),
            converged=self.converged,
            iterations=self.iterations,
            ambiguity=ambiguity,
            joint_normals=flat @ C @ flat.T + _diagonal(own) if m <= MOST_JOINT else None,
            noise_gain=self.noise_gain,
        )


def _diagonal(blocks: FloatArray) -> FloatArray:
    """(3m, 3m) with blocks (m, 3, 3) on its diagonal."""
    m = len(blocks)
    full = np.zeros((m, 3, m, 3))
    full[np.arange(m), :, np.arange(m)] = blocks
    return full.reshape(3 * m, 3 * m)


def solution_of(points: ViewPoints, root: Root, unit: float, gain: float = 1.0) -> ViewsSolution:
    """A root with its covariance; unit : 1-sigma of a residual of weight 1 that the covariance is to hold for."""
    system, d = root.system, len(motion_basis(points, root.state.T)[0])
    response = np.linalg.solve(regular(system.plane), system.cross.transpose(1, 2, 0))
    left = system.S - np.einsum("dma,mae->de", system.cross, response)
    C = unit**2 * _inverse(left)
    kept = points.weight > 0.0
    squares = float(((root.terms.residual**2).sum(axis=1) * kept).sum())
    return ViewsSolution(
        R=root.state.R,
        T=root.state.T,
        scaled_normals=root.state.N,
        inverse_depth=points.in_given_order(root.state.u),
        motion_covariance=C,
        basis=np.pad(motion_basis(points, root.state.T), ((0, 0), (0, len(C) - d))),
        normal_gain=np.asarray(-response),
        own_covariance=unit**2 * _inverse(system.plane),
        noise=root.noise,
        relief=root.relief,
        rms=float(np.sqrt(squares / max(int(np.count_nonzero(kept)), 1))),
        chi2=system.chi2 / max(root.noise, 1e-12) ** 2,
        inlier=points.in_given_order(kept.astype(float)) > 0.0,
        converged=root.converged,
        iterations=root.iterations,
        noise_gain=gain,
    )


def _inverse(information: FloatArray) -> FloatArray:
    """Inverses (..., d, d) of positive semi-definite matrices scaled to a unit diagonal; null directions get 1e15."""
    scale = 1.0 / np.sqrt(np.maximum(np.diagonal(information, axis1=-2, axis2=-1), 1e-150))
    values, vectors = np.linalg.eigh(information * scale[..., :, None] * scale[..., None, :])
    inverse = (vectors / np.maximum(values, 1e-15)[..., None, :]) @ vectors.swapaxes(-1, -2)
    return np.asarray(inverse * scale[..., :, None] * scale[..., None, :])
