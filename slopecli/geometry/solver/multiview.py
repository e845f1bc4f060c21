"""Entry point for many views: their motions and one normal a plane from the places of points, with covariance.

The twin of `solve_planes` for a reference image and two or more views of the same planes. Each plane has one normal
for all views, so that a third view, off the line of the first move, decides between the two roots of a pair.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from slopecli.errors import DegenerateConfiguration, InputError, NoAnswer
from slopecli.geometry.epipolar import fit_rotation, rotation_angle
from slopecli.geometry.solver.many_views import (
    Root,
    ViewsSolution,
    heights_of,
    information_of_relief,
    noise_of,
    off_planes,
    refine,
    relief_of,
    solution_of,
)
from slopecli.geometry.solver.mismatches import gate_squared, noise_at_least
from slopecli.geometry.solver.one_thread import one_blas_thread
from slopecli.geometry.solver.resection import resect
from slopecli.geometry.solver.solve import EXACT_RESIDUAL, solve_planes
from slopecli.geometry.solver.uncertainty import small_sample
from slopecli.geometry.solver.view_roots import judged
from slopecli.geometry.solver.views import ViewPoints, ViewState, normal_equations_of_views, observe_views, view_terms
from slopecli.geometry.statistics import CHI2, median
from slopecli.types import FloatArray, IntArray, Solution


@one_blas_thread()
def solve_views(
    x1: FloatArray,
    x: FloatArray,
    patch: IntArray,
    noise: float | None = None,
    *,
    weights: FloatArray | None = None,
    relief: bool = False,
    robust: bool = True,
    noise_gain: float = 1.0,
) -> ViewsSolution:
    """Solve for the motions of k views and one plane per patch, with their covariance and a second root if one is left.

    Parameters
    ----------
    x1 : (n, 2) normalised coordinates in the reference image.  x : (k, n, 2) in the views, NaN where not seen.
    patch : (n,) int labels 0..m-1; -1 = on no plane.
    noise : 1-sigma of a normalised coordinate in the views; estimated if None or if residuals are larger.
    weights : (k, n) inverse relative variances, None for equal ones.
    relief : points lie near their plane, not on it, by the same height in every view.
    robust : leave out gross mismatches.  noise_gain : factor on standard errors for common errors of points.

    Returns
    -------
    solution : `ViewsSolution`; lengths are in baselines of the first view.

    Raises
    ------
    InputError : arrays of wrong shape, type or value.
    DegenerateConfiguration : a patch has fewer than three or collinear points, or there are too few points in all.
    NoAnswer : all views are related to the reference by rotations alone.
    """
    if noise is not None and not (np.isfinite(noise) and noise > 0.0):
        raise InputError(f"noise is {noise}; it must be a positive 1-sigma in normalised coordinates, or None")
    points = observe_views(x1, x, patch, weights)
    _check_enough(points, noise)
    found: list[_Found] = []
    for start in _starts(points, relief, robust):
        one = _root_from(points, start, noise, relief, robust)
        if one is not None:
            found.append(one)
    if not found:
        raise NoAnswer(
            "poor-fit", "no motions explain the places of the points in all views", "check the correspondences"
        )
    return _best(found, noise, noise_gain)


class _Found(NamedTuple):
    """A root, and the points with their weights that it was fitted to."""

    root: Root
    points: ViewPoints


def _check_enough(points: ViewPoints, noise: float | None) -> None:
    free = points.p.shape[1] - points.n_on_planes
    found = 2 * int(np.count_nonzero(points.weight))
    needed = 6 * points.n_views - 1 + 3 * points.n_planes + free + (noise is None)
    if found < needed:
        raise DegenerateConfiguration(
            f"{points.n_planes} patches and {points.n_views} views need {needed} measurements, found {found} "
            "(two for every place of a point); add correspondences"
        )


def _starts(points: ViewPoints, relief: bool, robust: bool) -> list[ViewState]:
    """States of all views from the roots of the pairs of most parallax, each view placed by its points.

    The roots of two pairs are taken, as noise may hide one of them in either.
    """
    states: list[ViewState] = []
    reason: NoAnswer | DegenerateConfiguration | None = None
    for view in _by_parallax(points)[:2]:
        try:
            solution = _pair_solution(points, view, relief, robust)
        except (NoAnswer, DegenerateConfiguration) as problem:
            reason = reason or problem
            continue
        other = solution.ambiguity.alternative
        states += [_placed(points, view, one) for one in (solution, other) if one is not None]
    if not states and reason is not None:
        raise reason
    return states


def _by_parallax(points: ViewPoints) -> list[int]:
    """The views, the one first whose points a rotation of the camera explains least."""
    left = []
    for x, weight in zip(points.x, points.weight, strict=True):
        R = fit_rotation(points.p, x, weight)
        y = R @ points.p
        left.append(float((weight * ((y[:2] / y[2] - x) ** 2).sum(axis=0)).sum()))
    return sorted(range(len(left)), key=lambda k: -left[k])


def _pair_solution(points: ViewPoints, view: int, relief: bool, robust: bool) -> Solution:
    """The pair of the reference and one view, planes with fewer than three points in it left out of the motion."""
    weight = points.weight[view]
    seen = weight > 0.0
    return solve_planes(
        points.p[:2, seen].T,
        points.x[view][:, seen].T,
        points.plane_of_point()[seen],
        relief=relief,
        robust=robust,
        weights=weight[seen],
    )


def _placed(points: ViewPoints, view: int, solution: Solution) -> ViewState:
    """Motions of all views for the planes of one pair, in the unit of the first view's baseline."""
    N = solution.scaled_normals
    u = np.asarray((points.per_point(N.T) * points.p).sum(axis=0))
    on_plane = slice(0, points.n_on_planes)
    R, T = np.empty((points.n_views, 3, 3)), np.empty((points.n_views, 3))
    known: tuple[FloatArray, FloatArray] = (solution.R, solution.T)
    for k in range(points.n_views):
        if k == view:
            R[k], T[k] = solution.R, solution.T
            continue
        seen = points.weight[k, on_plane] > 0.0
        p, x, depth = points.p[:, on_plane][:, seen], points.x[k][:, on_plane][:, seen], u[on_plane][seen]
        R[k], T[k] = resect(p, x, depth, [known], 0.1 * max(solution.noise, EXACT_RESIDUAL))[:2]
    length = max(float(np.linalg.norm(T[0])), 1e-9)
    u = _with_free_points(points, R, T, u)
    return ViewState(R, T / length, N * length, u * length, np.zeros(0))


def _with_free_points(points: ViewPoints, R: FloatArray, T: FloatArray, u: FloatArray) -> FloatArray:
    """Inverse depths (n,), those of points on no plane by least squares over the views, from the mean of the others."""
    n = points.n_on_planes
    if n == len(u):
        return u
    u = u.copy()
    u[n:] = median(u[:n])
    for _ in range(5):
        terms = view_terms(points, R, T, u)
        step = terms.h.sum(axis=0) / np.maximum(terms.V.sum(axis=0), np.finfo(float).tiny)
        u[n:] = np.maximum(u[n:] - step[n:], 1e-3 * median(u[:n]))
    return u


def _root_from(points: ViewPoints, start: ViewState, noise: float | None, relief: bool, robust: bool) -> _Found | None:
    """The minimum from a start, mismatches left out and relief estimated; None if it lies behind a camera."""
    flat = information_of_relief(points, start.N, np.zeros(points.n_planes), 1.0)
    kept = _within(points, start, relief) if robust else points
    one = _fitted(kept, start, flat, np.zeros(points.n_planes), noise)
    for _ in range(4 if robust else 0):  # two or three are usual
        kept = _within(points, one.root.state, relief)
        if np.array_equal(kept.weight > 0.0, one.points.weight > 0.0):
            break
        one = _fitted(kept, one.root.state, one.root.q, one.root.relief, noise)
    for _ in range(8 if relief else 0):
        before = one.root
        heights = heights_of(one.points, before.system, before.state, before.noise)
        off = off_planes(points, heights) if robust else np.zeros(len(before.q), bool)
        r = relief_of(one.points, heights, off)
        q = np.where(off, 0.0, information_of_relief(points, before.state.N, r, before.noise))
        one = _fitted(one.points, before.state, q, r, noise)
        change = np.abs(np.append(one.root.relief - before.relief, one.root.noise - before.noise)).max()
        if change <= 0.01 * max(float(r.max()), one.root.noise):
            break
    state, ahead = one.root.state, one.root.terms.ahead
    used = one.points.weight > 0.0
    visible = (state.u > 0.0)[None] & (ahead > 0.0) | ~used
    return one if visible.mean() > 0.999 else None


def _fitted(points: ViewPoints, start: ViewState, q: FloatArray, relief: FloatArray, noise: float | None) -> _Found:
    state, terms, system, converged, iterations = refine(points, start, q)
    now, freedom = noise_of(points, terms, system)
    if noise is not None:
        now = noise_at_least(noise, now**2 * max(freedom, 1.0), max(int(freedom), 1))
    return _Found(Root(state, terms, system, relief, q, max(now, EXACT_RESIDUAL), converged, iterations), points)


def _within(points: ViewPoints, state: ViewState, relief: bool) -> ViewPoints:
    """The points whose residuals are within the gate; with relief, those across their epipolar lines."""
    terms, where = view_terms(points, state.R, state.T, state.u), points.weight > 0.0
    if relief:
        length = np.maximum(np.hypot(terms.slide[:, 0], terms.slide[:, 1]), np.finfo(float).tiny)
        across = terms.slide[:, 0] * terms.residual[:, 1] - terms.slide[:, 1] * terms.residual[:, 0]
        squared, typical = points.weight * (across / length) ** 2, CHI2[1, 0.5]
    else:
        squared, typical = points.weight * (terms.residual**2).sum(axis=1), CHI2[2, 0.5]
    scale = max(median(squared[where]) / typical, EXACT_RESIDUAL**2)
    gate = gate_squared(int(np.count_nonzero(where))) * scale
    return replace(points, weight=np.where(squared <= gate, points.weight, 0.0))


def _best(found: list[_Found], noise: float | None, gain: float) -> ViewsSolution:
    """The best root with the second one beside it, both fitted to the points of the best and under its noise."""
    best = min(found, key=lambda one: one.root.cost + _left_out(one))
    points, roots = best.points, [best.root]
    for one in sorted(found, key=lambda one: one.root.cost + _left_out(one)):
        if one is best or not _is_another(one.root.state, [root.state for root in roots]):
            continue
        again = _fitted(points, one.root.state, one.root.q, one.root.relief, noise).root
        if _is_another(again.state, [root.state for root in roots]) and again.converged:
            roots.append(again._replace(noise=best.root.noise))
    freedom = noise_of(points, best.root.terms, best.root.system)[1]
    known = np.inf if noise is not None and best.root.noise <= noise else freedom
    unit = max(best.root.noise * gain, EXACT_RESIDUAL) * small_sample(known)
    roots.sort(key=lambda root: root.cost)
    return judged(points, roots, unit, gain)


def _left_out(one: _Found) -> float:
    """The truncated cost of the places left out, each at the gate."""
    full = one.points.weight
    out = full.size - int(np.count_nonzero(full))
    return out * gate_squared(full.size) * one.root.noise**2


def _is_another(state: ViewState, others: list[ViewState]) -> bool:
    """Whether a state is none of the others, to 2e-3 rad of the rotations and as much of the normals' directions."""
    for other in others:
        turned = float(np.max(rotation_angle(state.R.swapaxes(1, 2) @ other.R)))
        n = state.N / np.linalg.norm(state.N, axis=1, keepdims=True)
        o = other.N / np.linalg.norm(other.N, axis=1, keepdims=True)
        if max(turned, float(np.linalg.norm(n - o, axis=1).max())) < 2e-3:
            return False
    return True


def cramer_rao_bound_of_views(
    R: FloatArray, T: FloatArray, normals: FloatArray, x1: FloatArray, patch: IntArray, noise: float
) -> ViewsSolution:
    """Smallest covariance an unbiased estimator of motions and normals can have, at the truth.

    Assumes independent Gaussian noise of the given 1-sigma on both coordinates of every view, exact points in the
    reference and exactly planar patches.

    Parameters
    ----------
    R : (k, 3, 3), T : (k, 3), |T_1| = 1; normals : (m, 3) scaled; x1 : (n, 2); patch : (n,); noise : normalised.

    Returns
    -------
    bound : the truth as a `ViewsSolution`, with its covariances.

    Raises
    ------
    InputError : a point on no patch is given.
    """
    patch = np.asarray(patch)
    if (patch < 0).any():
        raise InputError("points on no patch have no known place in the views; leave them out of the bound")
    points = observe_views(x1, np.zeros((len(R), len(x1), 2)), patch)
    u = np.asarray((points.per_point(np.asarray(normals, float).T) * points.p).sum(axis=0))
    state = ViewState(np.asarray(R, float), np.asarray(T, float), np.asarray(normals, float), u, np.zeros(0))
    q = np.full(len(u), np.inf)
    terms = view_terms(points, state.R, state.T, u)
    system = normal_equations_of_views(points, state, q, terms)
    root = Root(state, terms, system, np.zeros(points.n_planes), q, noise, True, 0)
    return solution_of(points, root, noise)
