"""Two answers: when the images rule one of them out, and what is left open where the two run into each other.

Each root bends its patches along its own epipolar lines to follow the noise, so even on exactly flat ground, where both
explain the scene, their chi-squares differ by chance, and by more the more patches there are (`by_chance`).

Roots that run into each other are one broad minimum with two dents, where each dent's curvature says too little.
Vertical descent over nearly level ground is such a case. The bound on the slope then grows without limit at the true
root, while each estimated root looks sharp by itself. What the data leave open is the whole stretch between the two.
"""

from __future__ import annotations

import numpy as np

from slopecli.geometry.epipolar import nearest_rotation, rotation_vector
from slopecli.geometry.solver.joint import Fit
from slopecli.geometry.solver.refinement import State, optimal_normals
from slopecli.geometry.solver.uncertainty import Covariance
from slopecli.types import FloatArray

# chi-square with 1 degree of freedom at 0.99: a lower ridge between two roots does not separate them
_RIDGE = 6.63
_SURELY = 10.0  # dents are not equal and curvature is local, so the cheap test leaves a wide margin
_CHANCE = 1e-3  # of a wrong root to fit so much better than the true one
_TILTS = np.linspace(0.005, 0.4995, 200)  # at which the bound on the tail is taken; its best lies well between them


def by_chance(freedom: float, spare: float = np.inf) -> float:
    """How much better than the true root a wrong one may fit, in units of noise^2, once in a thousand scenes.

    Both explain flat ground exactly. Their minima then differ by n^T (A - B) n for noise n and projections A, B onto
    what the two roots can follow; its eigenvalues are +-sin of the angles between the two. Source: Chernoff's bound on
    the tail of that form, which grows with the sum of the squared sines only.

    Parameters
    ----------
    freedom : that sum, see `separate_freedom`; 0 gives the quantile of chi-square with two degrees of freedom.
    spare : degrees of freedom the noise was estimated from, infinite when it was given: then a large difference is
        judged as the likelihood ratio it is.
    """
    tail = (-np.log(_CHANCE) - 0.5 * freedom * np.log1p(-4.0 * _TILTS**2)) / _TILTS
    most = float(tail.min())
    return most if np.isinf(spare) else float(spare * np.expm1(min(most / spare, 700.0)))


def rules_out(worse_by: float, by_prior: float, chance: float) -> bool:
    """Whether the second root is ruled out: by the images, or by what else is known where they leave it to that.

    worse_by : by how much its chi-square is larger in all; by_prior : the part of it that is not the images'.
    chance : by how much the images prefer a wrong root by chance, see `by_chance`.
    """
    by_images = worse_by - by_prior
    return by_images > chance or (by_prior > by_chance(0.0) and by_images > -chance)


def separate_freedom(fit: Fit) -> float:
    """How much the first root can follow the noise where the second cannot: a sum of squared sines, see `by_chance`.

    A patch bends in three ways along its epipolar lines, a point on no patch or off its plane in one; the lines of the
    two roots differ by an angle at each point, and so do the ways. Motions share their part with one of the patches.
    """
    observations, prediction = fit.observations, fit.prediction
    slide, counted = prediction.slide[:2], observations.weight > 0.0
    crossed = counted * _squared_sine(slide)
    patches = observations.sum_patches(crossed) / np.maximum(observations.sum_patches(counted.astype(float)), 1.0)
    m, total = observations.n_patches, float(patches.sum())
    total *= 3.0 * (m - 1) / m
    if fit.relief:
        total += float(crossed @ _off_plane(slide[0], fit.relief[0].W, observations.weight))
    K = prediction.K[:2, :, None]
    lines = prediction.foot[:2] * K[:, 2:] - K[:, :2]
    return total + float(_squared_sine(lines) @ (observations.free_weight > 0.0))


def _squared_sine(directions: FloatArray) -> FloatArray:
    """(n,) of the angle between two fields of directions (2, 2, n), the first index telling the fields apart."""
    a, b = directions
    lengths = (a * a).sum(axis=0) * (b * b).sum(axis=0)
    return np.asarray((a[0] * b[1] - a[1] * b[0]) ** 2 / np.maximum(lengths, np.finfo(float).tiny))


def _off_plane(slide: FloatArray, W: FloatArray, weight: FloatArray) -> FloatArray:
    """(n,) how far a point is free of its plane, 0 to 1: what its 2x2 weight W (3, n) lacks along its slide (2, n)."""
    along = W[0] * slide[0] ** 2 + 2.0 * W[1] * slide[0] * slide[1] + W[2] * slide[1] ** 2
    bound = weight * (slide * slide).sum(axis=0)
    return np.asarray(1.0 - along / np.maximum(bound, np.finfo(float).tiny)) * (bound > 0.0)


def roots_are_joined(fit: Fit, noise: float) -> bool:
    """Whether the motion half way between the first two roots fits nearly as well as the better one."""
    if _clearly_apart(fit, noise):
        return False
    R = nearest_rotation(fit.state.R[0] + fit.state.R[1])
    T = fit.state.T[0] + fit.state.T[1]
    if np.linalg.norm(T) < 1.0:
        return False  # directions more than 120 degrees apart are not neighbours
    midway = State(R[None], (T / np.linalg.norm(T))[None], 0.5 * (fit.state.N[:1] + fit.state.N[1:2]))
    W = fit.relief[0].W[None] if fit.relief else None
    cost = np.inf
    for _ in range(2):  # the second round has the right depths in its weights
        form = fit.form(midway, W)
        midway, chi2 = optimal_normals(midway.R, midway.T, form)
        cost = float(chi2[0])
    return cost - float(fit.system.chi2[0]) < _RIDGE * noise**2


def _clearly_apart(fit: Fit, noise: float) -> bool:
    """Cheap test. Of two equal dents a distance D apart, in sigmas by curvature, the ridge rises to D^2 / 16."""
    apart = np.concatenate([rotation_vector(fit.state.R[1] @ fit.state.R[0].T), fit.state.T[1] - fit.state.T[0]])
    squared = apart @ fit.system.reduced[0, :6, :6] @ apart
    return bool(squared > _SURELY * 16.0 * _RIDGE * noise**2)


def reaching_across(covariance: Covariance, state: State, index: int) -> Covariance:
    """Widen the covariance of root `index` (0 or 1): two standard deviations then span the stretch to the other one."""
    other = 1 - index
    half_way = 0.5 * np.concatenate(
        [
            rotation_vector(state.R[other] @ state.R[index].T),
            covariance.tangent.T @ (state.T[other] - state.T[index]),
        ]
    )
    half_normals = 0.5 * (state.N[other] - state.N[index])
    return covariance._replace(
        normal_covariance=covariance.normal_covariance + _outer(half_normals),
        motion_covariance=covariance.motion_covariance + _outer(half_way),
    )


def _outer(v: FloatArray) -> FloatArray:
    return np.asarray(v[..., :, None] * v[..., None, :])
