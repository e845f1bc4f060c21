"""Covariance of motion and normals from noise in image 2: Fisher information and the Cramer-Rao bound."""

from __future__ import annotations

from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from slopecli.errors import DegenerateConfiguration, InputError
from slopecli.geometry.epipolar import tangent_basis
from slopecli.geometry.solver.observations import Observations, linearise, observe, predict
from slopecli.geometry.solver.priors import MotionPrior
from slopecli.geometry.solver.refinement import State, System, normal_equations
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
    """Exact Gauss-Newton system of the points at a state: J^T W J and J^T W e with the normals eliminated.

    motion : (1, 7, 7) terms of a prior on the motion, see `MotionPrior.terms`.
    """
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
