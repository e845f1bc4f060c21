"""Second root of the motion: the chi-square test that rules it out, and the covariance of two joined roots.

Each root fits the noise along its own epipolar lines. So even on exactly flat ground, which both roots explain, their
chi-squares differ by chance, and by more the more patches there are (`by_chance`).

Joined roots are two shallow minima in one broad valley, as in vertical descent over nearly level ground. The curvature
at either minimum underestimates the uncertainty, which spans the distance between the two.
"""

from __future__ import annotations

import numpy as np

from slopecli.geometry.epipolar import nearest_rotation, rotation_vector
from slopecli.geometry.solver.joint import Fit
from slopecli.geometry.solver.refinement import State, optimal_normals
from slopecli.geometry.solver.uncertainty import Covariance
from slopecli.types import FloatArray

JOINED_CHI2 = 6.63  # chi-square, 1 degree of freedom, at 0.99: roots with a lower ridge between them are joined


def by_chance(freedom: float, spare: float = np.inf) -> float:
    """Difference of chi-square by which a wrong root fits better than the true one in one of a thousand scenes.

    Both roots explain flat ground exactly. Their minima differ by n^T (A - B) n for noise n and the projections A, B
    onto the subspaces the two roots can fit; its eigenvalues are +-sin of the angles between these. Source: Chernoff's
    bound on the tail of that form, which depends on the sum of the squared sines only.

    Parameters
    ----------
    freedom : that sum, see `separate_freedom`; 0 gives the quantile of chi-square with two degrees of freedom.
    spare : degrees of freedom the noise was estimated from, infinite if it was given; if finite, the bound is that of
        the likelihood ratio.
    """
    s = np.linspace(0.005, 0.4995, 200)  # parameters of the bound; the tightest is taken
    tail = (np.log(1e3) - 0.5 * freedom * np.log1p(-4.0 * s**2)) / s
    most = float(tail.min())
    return most if np.isinf(spare) else float(spare * np.expm1(min(most / spare, 700.0)))


def rules_out(worse_by: float, by_prior: float, chance: float) -> bool:
    """Whether the second root is ruled out: by the images, or by the prior if the images do not contradict it.

    worse_by : difference of chi-square to the best root; by_prior : the part of it due to the prior.
    chance : difference that occurs by chance, see `by_chance`.
    """
    by_images = worse_by - by_prior
    return by_images > chance or (by_prior > by_chance(0.0) and by_images > -chance)


def separate_freedom(fit: Fit) -> float:
    """Sum of squared sines of the angles between the subspaces that the two roots can fit, see `by_chance`.

    A patch has three degrees of freedom along its epipolar lines, a point on no patch or off its plane one. The angles
    are those between the epipolar lines of the two roots. The motions account for one of the patches.
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
    """(n,) squared sine of the angle between two fields of directions; (2, 2, n): field, coordinate, point."""
    a, b = directions
    lengths = (a * a).sum(axis=0) * (b * b).sum(axis=0)
    return np.asarray((a[0] * b[1] - a[1] * b[0]) ** 2 / np.maximum(lengths, np.finfo(float).tiny))


def _off_plane(slide: FloatArray, W: FloatArray, weight: FloatArray) -> FloatArray:
    """(n,) share of a point's weight that relief removes along its slide (2, n), 0..1; W (3, n) its 2x2 weight."""
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
    return cost - float(fit.system.chi2[0]) < JOINED_CHI2 * noise**2


def _clearly_apart(fit: Fit, noise: float) -> bool:
    """Cheap test by curvature: between two equal minima D sigmas apart the ridge rises to D^2 / 16; tenfold margin."""
    apart = np.concatenate([rotation_vector(fit.state.R[1] @ fit.state.R[0].T), fit.state.T[1] - fit.state.T[0]])
    squared = apart @ fit.system.reduced[0, :6, :6] @ apart
    return bool(squared > 10.0 * 16.0 * JOINED_CHI2 * noise**2)


def reaching_across(covariance: Covariance, state: State, index: int) -> Covariance:
    """Widen the covariance of root `index` (0 or 1), so that two sigmas span the distance to the other root."""
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
