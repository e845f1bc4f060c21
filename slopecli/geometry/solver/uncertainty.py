"""Covariance of motion and normals from noise in image 2, and whether a second root of the motion is ruled out.

Each root fits the noise along its own epipolar lines. So even on exactly flat ground, which both roots explain, their
chi-squares differ by chance, and by more the more patches there are (`by_chance`).

Joined roots are two shallow minima in one broad valley, as in vertical descent over nearly level ground. The curvature
at either minimum underestimates the uncertainty, which spans the distance between the two.
"""

from __future__ import annotations

from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from slopecli.errors import DegenerateConfiguration, InputError
from slopecli.geometry.epipolar import nearest_rotation, rotation_vector, tangent_basis
from slopecli.geometry.solver.joint import Fit
from slopecli.geometry.solver.observations import Observations, linearise, observe, predict
from slopecli.geometry.solver.priors import MotionPrior
from slopecli.geometry.solver.refinement import State, System, normal_equations, optimal_normals
from slopecli.geometry.statistics import CHI2
from slopecli.types import FloatArray, IntArray


class Covariance(NamedTuple):
    """Covariances of one solution, fields as in `types.Solution`."""

    normal_covariance: FloatArray
    motion_covariance: FloatArray
    tangent: FloatArray
    normal_gain: FloatArray


def covariance_of(system: System, T: FloatArray, index: int, noise: float) -> Covariance:
    """Covariance of motion number `index` of a solved system and of its normals.

    The motion's information is the Schur complement U of the normal blocks V_i: C = noise^2 U^-1 on the five free
    coordinates (w, T along its tangent); each normal adds its own noise^2 V_i^-1 to what it inherits through its gain.

    T : (3,) unit vector; noise : 1-sigma of a unit-weight residual.
    """
    tangent = tangent_basis(T)
    P = np.zeros((6, 5))
    P[:3, :3], P[3:, 3:] = np.eye(3), tangent
    C = noise**2 * _inverse(P.T @ system.reduced[index, :6, :6] @ P)
    gain = -system.response[index, :, :, :6] @ P
    own = noise**2 * _inverse(system.plane_block[index])
    return Covariance(own + gain @ C @ gain.swapaxes(1, 2), C, tangent, gain)


def small_sample(freedom: float) -> float:
    """Factor on standard errors whose noise was estimated from `freedom` degrees of freedom (infinite: given).

    The error over an estimated sigma follows Student's t. The factor t_0.975 / 1.96 turns the Gaussian 95 % interval
    into Student's: 6.5 with one degree of freedom, 1.4 with four, 1.01 with a hundred. Sources: Student, "The probable
    error of a mean", 1908; for regressions Seber and Lee, "Linear Regression Analysis", 2003.
    """
    if freedom >= 300:  # the factor is below 1.005
        return 1.0
    from scipy.special import stdtrit

    return float(stdtrit(max(int(freedom), 1), 0.975)) / NormalDist().inv_cdf(0.975)


def _inverse(information: FloatArray) -> FloatArray:
    """Inverses (..., k, k) of positive semi-definite matrices; null directions get a very large variance."""
    values, vectors = np.linalg.eigh(information)
    least = np.maximum(1e-15 * values[..., -1:], 1e-100)
    return np.asarray((vectors / np.maximum(values, least)[..., None, :]) @ vectors.swapaxes(-1, -2))


def information_system(observations: Observations, state: State, motion: FloatArray | None = None) -> System:
    """Exact Gauss-Newton system of the points at a state; motion (1, 7, 7): see `MotionPrior.terms`."""
    return normal_equations(state, linearise(observations, predict(observations, *state))._replace(motion=motion))


def cramer_rao_bound(
    R: FloatArray,
    T: FloatArray,
    normals: FloatArray,
    x1: FloatArray,
    patch: IntArray,
    noise: float,
    prior: MotionPrior | None = None,
) -> Covariance:
    """Smallest covariance an unbiased estimator of motion and normals can have, at the truth.

    Assumes independent Gaussian noise of the given 1-sigma on both coordinates of image 2, exact points in image 1 and
    exactly planar patches.

    Parameters
    ----------
    R : (3, 3), T : (3,) unit, normals : (m, 3) scaled; x1 : (n, 2); patch : (n,); noise : normalised coordinates.
    prior : prior on the motion, centred on the truth.

    Returns
    -------
    bound : `normal_covariance` (m, 3, 3), `motion_covariance` (5, 5), `tangent` (3, 2), `normal_gain` (m, 3, 5).

    Raises
    ------
    InputError : a point on no patch is given; its true position in image 2 is not determined by the arguments.
    DegenerateConfiguration : a patch has fewer than three points or collinear ones.
    """
    patch = np.asarray(patch)
    if (patch < 0).any():
        raise InputError("points on no patch have no known place in image 2; leave them out of the bound")
    if not np.isfinite(noise) or noise <= 0.0:
        raise DegenerateConfiguration(f"noise is {noise}, the bound needs a positive 1-sigma in normalised coordinates")
    state = State(np.asarray(R, float)[None], np.asarray(T, float)[None], np.asarray(normals, float)[None])
    blank = observe(x1, np.zeros_like(np.asarray(x1, dtype=float)), patch)
    known = None if prior is None else prior.terms(state.R, state.T, noise)
    return covariance_of(information_system(blank, state, known), state.T[0], 0, noise)


def by_chance(freedom: float, spare: float = np.inf) -> float:
    """Difference of chi-square by which a wrong root fits better than the true one in one of a thousand scenes.

    Both roots explain flat ground exactly. Their minima differ by n^T (A - B) n for noise n and the projections A, B
    onto the subspaces the two roots can fit; its eigenvalues are +-sin of the angles between these. Source: Chernoff's
    bound on the tail of that form, which depends on the sum of the squared sines only.

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
    # cheap test by curvature: between two equal minima D sigmas apart the ridge rises to D^2 / 16; tenfold margin
    apart = np.concatenate([rotation_vector(fit.state.R[1] @ fit.state.R[0].T), fit.state.T[1] - fit.state.T[0]])
    if apart @ fit.system.reduced[0, :6, :6] @ apart > 10.0 * 16.0 * CHI2[1, 0.99] * noise**2:
        return False
    R, T = nearest_rotation(fit.state.R[0] + fit.state.R[1]), fit.state.T[0] + fit.state.T[1]
    if np.linalg.norm(T) < 1.0:
        return False  # directions more than 120 degrees apart are not neighbours
    midway = State(R[None], (T / np.linalg.norm(T))[None], 0.5 * (fit.state.N[:1] + fit.state.N[1:2]))
    W = fit.relief[0].W[None] if fit.relief else None
    cost = np.inf
    for _ in range(2):  # the second round has the right depths in its weights
        form = fit.form(midway, W)
        midway, chi2 = optimal_normals(midway.R, midway.T, form)
        cost = float(chi2[0])
    return cost - float(fit.system.chi2[0]) < CHI2[1, 0.99] * noise**2


def widened_to_second_root(covariance: Covariance, state: State, index: int) -> Covariance:
    """Widen the covariance of root `index` (0 or 1), so that two sigmas span the distance to the other root."""
    other = 1 - index
    turn, move = rotation_vector(state.R[other] @ state.R[index].T), state.T[other] - state.T[index]
    half_way = 0.5 * np.concatenate([turn, covariance.tangent.T @ move])
    half_normals = 0.5 * (state.N[other] - state.N[index])
    return covariance._replace(
        normal_covariance=covariance.normal_covariance + half_normals[:, :, None] * half_normals[:, None, :],
        motion_covariance=covariance.motion_covariance + np.outer(half_way, half_way),
    )
