"""Entry point of the geometry: one motion and one normal per patch from correspondences.

"mle" minimises the image-2 residuals over the 5 + 3m parameters jointly: two residuals for a point on a patch, the
distance to the epipolar line for a point on none. "ha" is homography alignment as printed (Cheng, section III), "lh"
the averaged Longuet-Higgins motion it is compared with.

Standard errors from few residuals are widened as by Student's t (`uncertainty.small_sample`). A second root is
"resolved" if its chi-square, with that of a prior, is significantly larger (`uncertainty.by_chance`), else
"unresolved". If only one root is left with a sharp prior, the second root is that without it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np

from slopecli.errors import DegenerateConfiguration, InputError, NoAnswer
from slopecli.geometry.alignment import closed_form, motion_distance
from slopecli.geometry.epipolar import fit_rotation, rotation_angle
from slopecli.geometry.solver.joint import Fit, Motion, maximum_likelihood, with_prior
from slopecli.geometry.solver.mismatches import noise_at_least
from slopecli.geometry.solver.observations import Observations, observe, parameter_count
from slopecli.geometry.solver.one_thread import one_blas_thread
from slopecli.geometry.solver.priors import MotionPrior
from slopecli.geometry.solver.uncertainty import (
    by_chance,
    covariance_of,
    roots_are_joined,
    rules_out,
    separate_freedom,
    small_sample,
    widened_to_second_root,
)
from slopecli.types import Ambiguity, FloatArray, IntArray, Solution

EXACT_RESIDUAL = 1e-12  # normalised coordinates; correspondences that fit better are exact to rounding


@one_blas_thread()
def solve_planes(
    x1: FloatArray,
    x2: FloatArray,
    patch: IntArray,
    solver: Literal["mle", "ha", "lh"] = "mle",
    noise: float | None = None,
    *,
    weights: FloatArray | None = None,
    relief: bool = False,
    robust: bool = True,
    initial: list[Motion] | None = None,
    noise_gain: float = 1.0,
    prior: MotionPrior | None = None,
) -> Solution:
    """Solve for one motion and one plane per patch, with their covariance and a second root if there is one.

    Parameters
    ----------
    x1, x2 : (n, 2) normalised (undistorted) coordinates in images 1 and 2.
    patch : (n,) int labels 0..m-1; -1 = on no plane, constrains the motion only.
    solver : "mle" (joint least squares), "ha" (homography alignment) or "lh" (averaged Longuet-Higgins motions).
    noise : 1-sigma of a normalised coordinate in image 2; estimated if None or if residuals are significantly larger.
    weights : (n,) inverse relative variances of the correspondences, None for equal ones.
    relief : points lie near their plane, not on it; `Solution.relief` is its roughness. Used by "mle" only.
    robust : leave out gross mismatches, if there are significant ones (`mismatches.is_beyond_chance`).
    initial : motions (R, T) to start from besides those found in closed form.
    noise_gain : factor on standard errors for common errors of points; chi-square is divided by its square.
    prior : measured motion, weighed by its sigmas against the correspondences. "mle" only.

    Returns
    -------
    solution : `Solution`. `converged` is False if the iteration did not converge or a plane is behind a camera at a
        point kept. `ambiguity` holds the second root if it is visible too.

    Raises
    ------
    InputError : arrays of wrong shape, type or value, or an unknown solver.
    DegenerateConfiguration : a patch has fewer than three or collinear points, or there are too few points in all.
    NoAnswer : the images are related by a rotation alone ("pure-rotation"): no baseline, no planes.
    """
    _check_options(solver, noise, noise_gain, prior)
    motions = [_checked_motion(R, T) for R, T in initial or []]
    observations = observe(x1, x2, patch, weights)
    _check_enough(observations, noise)
    _check_baseline(observations)
    if solver != "mle":
        return _in_closed_form(observations, solver, noise, noise_gain)
    fit = maximum_likelihood(observations, noise, relief, robust, motions)
    return _most_likely(fit, _scale(fit, noise, noise_gain), prior)


@one_blas_thread()
def solve_from(motion: Motion, x1: FloatArray, x2: FloatArray, patch: IntArray, weights: FloatArray) -> Solution:
    """The joint solution of rough planes near a motion (R, T), in half the time of `solve_planes`, which tries others.

    Other arguments, and what is raised, as of `solve_planes`.
    """
    observations = observe(x1, x2, patch, weights)
    _check_enough(observations, None)
    _check_baseline(observations)
    fit = maximum_likelihood(observations, None, True, True, [_checked_motion(*motion)], initial_only=True)
    return _most_likely(fit, _scale(fit, None, 1.0), None)


def _in_closed_form(
    observations: Observations, solver: Literal["ha", "lh"], noise: float | None, noise_gain: float
) -> Solution:
    """HA or averaged Longuet-Higgins, with the second root of the joint solution started from it."""
    fit = closed_form(observations, solver)
    joint = maximum_likelihood(observations, noise, False, False, list(zip(fit.state.R, fit.state.T, strict=True)))
    best = _with_ambiguity(joint, solver, _scale(joint, noise, noise_gain))
    return _beside(_solution(fit, 0, solver, _scale(fit, noise, noise_gain)), best)


def _most_likely(fit: Fit, scale: _Scale, prior: MotionPrior | None) -> Solution:
    """The joint solution, refined with the prior if there is one. NoAnswer if a rotation explains the points too."""
    _check_parallax(fit, scale.noise, *_rotation_only(fit.observations))
    if prior is None:
        return _with_ambiguity(fit, "mle", scale)
    scale = scale.all_widened()
    known = with_prior(fit, prior, scale.unit)
    grown = float(known.cost[0] - fit.cost[0]) / scale.unit**2
    solution = _with_ambiguity(known, "mle", scale)
    if len(known.cost) == 1 < len(fit.cost):
        solution = replace(solution, ambiguity=_root_without_prior(known, fit, solution, scale))
    return replace(solution, prior_chi2=max(grown, 0.0))


def _check_options(solver: str, noise: float | None, noise_gain: float, prior: MotionPrior | None) -> None:
    if solver not in ("mle", "ha", "lh"):
        raise InputError(f"solver {solver!r} is unknown; choose mle, ha or lh")
    if prior is not None and solver != "mle":
        raise InputError(f"solver {solver!r} cannot take a motion known beforehand; use mle")
    if noise is not None and not (np.isfinite(noise) and noise > 0.0):
        raise InputError(f"noise is {noise}; it must be a positive 1-sigma in normalised coordinates, or None")
    if not (np.isfinite(noise_gain) and noise_gain > 0.0):
        raise InputError(f"noise_gain is {noise_gain}; it must be a positive factor, 1 for independent correspondences")


def _checked_motion(R: FloatArray, T: FloatArray) -> Motion:
    R, T = np.asarray(R, dtype=float), np.asarray(T, dtype=float)
    if R.shape != (3, 3) or T.shape != (3,) or not np.abs(R @ R.T - np.eye(3)).max() < 1e-6 or not np.any(T):
        raise InputError("an initial motion must be a 3x3 rotation and a position that is not zero, (R, T)")
    return R, T


def _check_enough(observations: Observations, noise: float | None) -> None:
    found, needed = observations.residual_count(), parameter_count(observations.n_patches) + (noise is None)
    if found >= needed:
        return
    m = observations.n_patches
    what = f"{m} patch{'es' if m > 1 else ''} and a motion need {needed} measurements, found {found}"
    if noise is None and found == needed - 1:
        remedy = "that leaves nothing to tell the noise from, so give it (--noise), or more correspondences"
    else:
        remedy = "add correspondences"
    raise DegenerateConfiguration(f"{what} (two a point on a patch, one a point on none); {remedy}")


def _rotation_only(observations: Observations) -> tuple[FloatArray, float]:
    """The best rotation for all points, and its weighted sum of squared residuals."""
    p, x2, weight = observations.all_points()
    R = fit_rotation(p, x2, weight)
    y = R @ p
    residual = y[:2] / y[2] - x2
    return R, float(((residual * residual) @ weight).sum())


def _check_baseline(observations: Observations) -> None:
    """Raise NoAnswer if a rotation explains the points to rounding, DegenerateConfiguration if they coincide."""
    seen = observations.all_points()[1]
    if (np.ptp(seen, axis=1) <= 1e-12 * np.abs(seen).max(axis=1)).all():
        raise DegenerateConfiguration("all correspondences coincide in image 2, so they fix no plane; check x2")
    R, cost = _rotation_only(observations)
    if cost <= observations.residual_count() * EXACT_RESIDUAL**2:
        raise _pure_rotation(R, "exactly")


def _check_parallax(fit: Fit, noise: float, R: FloatArray, cost: float) -> None:
    """Raise NoAnswer unless the fit is significantly better than the pure rotation R with the given cost."""
    extra = 2 + 3 * fit.observations.n_patches + int(np.count_nonzero(fit.observations.free_weight))
    gained = (cost - float(fit.system.chi2[0])) / max(noise, EXACT_RESIDUAL) ** 2
    # mean and five standard deviations of chi-square with `extra` degrees of freedom, and 10 for its tail
    if gained < extra + 5.0 * np.sqrt(2.0 * extra) + 10.0:
        raise _pure_rotation(R, "within their noise")


def _pure_rotation(R: FloatArray, how_well: str) -> NoAnswer:
    angle = float(np.degrees(rotation_angle(R)))
    what = "identical images" if angle < 1e-6 else f"a rotation of {angle:.3g} deg without any translation"
    return NoAnswer(
        "pure-rotation",
        f"{what} explain{'s' if angle >= 1e-6 else ''} all correspondences {how_well}, so there is no parallax",
        "take the second image from another place",
        value=angle,
    )


class _Scale(NamedTuple):
    """noise : 1-sigma of a unit-weight residual.  gain : factor for common errors of points.  widening : factor on
    standard errors whose noise was estimated.  freedom : its degrees of freedom, infinite if it was given."""

    noise: float
    gain: float
    widening: float
    freedom: float

    @property
    def unit(self) -> float:
        """Square root of the unit of chi-square."""
        return max(self.noise * self.gain, EXACT_RESIDUAL)

    def all_widened(self) -> _Scale:
        """With the widening moved into the gain, to weigh the points against a prior."""
        return self._replace(gain=self.gain * self.widening, widening=1.0)


def _scale(fit: Fit, given: float | None, gain: float) -> _Scale:
    """Noise as given, or from the residuals across epipolar lines, or from all residuals over their freedom."""
    squares, freedom = max(float(fit.system.chi2[0]), 0.0), max(fit.observations.freedom(), 1)
    if fit.relief:
        noise = fit.relief[0].noise
    else:
        noise = float(np.sqrt(squares / freedom)) if given is None else noise_at_least(given, squares, freedom)
    known = np.inf if given is not None and noise <= given else fit.noise_freedom()
    return _Scale(noise, gain, small_sample(known), known)


def _with_ambiguity(fit: Fit, solver: str, scale: _Scale) -> Solution:
    """The best root, with the second one attached when there is one."""
    if len(fit.cost) == 1:
        return _solution(fit, 0, solver, scale)
    worse_by = float(fit.cost[1] - fit.cost[0]) / scale.unit**2
    by_prior = 0.0 if fit.prior is None else fit.prior.worse_by_prior(fit.state)
    chance = by_chance(separate_freedom(fit), scale.freedom)
    status: Literal["resolved", "unresolved"] = "resolved" if rules_out(worse_by, by_prior, chance) else "unresolved"
    joined = status == "unresolved" and roots_are_joined(fit, scale.noise * scale.gain * scale.widening)
    best, alternative = (_solution(fit, i, solver, scale, joined) for i in (0, 1))
    return replace(best, ambiguity=Ambiguity(status, worse_by, alternative, by_prior if fit.prior else None, joined))


def _root_without_prior(known: Fit, free: Fit, solution: Solution, scale: _Scale) -> Ambiguity:
    """Second root without the prior, for a prior so sharp that only one root is left with it.

    known, free : the fits with and without the prior.  solution : the root that is left.
    """
    turned, moved = free.state.R[:2] - solution.R, free.state.T[:2] - solution.T
    twin = int(np.argmax(np.linalg.norm(turned, axis=(1, 2)) + np.linalg.norm(moved, axis=1)))
    alternative = _solution(free, twin, solution.solver, scale)
    prior = known.prior.prior if known.prior else MotionPrior()
    left = prior.chi2(alternative)
    worse_by = float(free.cost[twin] - known.cost[0]) / scale.unit**2 + left
    by_prior = left - prior.chi2(solution)
    chance = by_chance(separate_freedom(free), scale.freedom)
    # if neither rules it out, both were part of one broad minimum
    ruled_out = by_prior > by_chance(0.0) or worse_by - by_prior > chance
    return Ambiguity("resolved", worse_by, alternative, by_prior) if ruled_out else Ambiguity()


def _beside(own: Solution, joint: Solution) -> Solution:
    """A closed-form solution with the ambiguity of the joint one, as its own chi-square is not at a minimum.

    If it is not near the best joint root (0.2 rad), that root becomes its unresolved alternative.
    """
    other = joint.ambiguity.alternative
    if other is None:
        return own if motion_distance(own, joint) < 0.2 else replace(own, ambiguity=Ambiguity("unresolved", 0.0, joint))
    if motion_distance(own, joint) > motion_distance(own, other):
        return replace(own, ambiguity=Ambiguity("unresolved", joint.ambiguity.delta_chi2, joint))
    return replace(own, ambiguity=joint.ambiguity)


def _solution(fit: Fit, index: int, solver: str, scale: _Scale, joined: bool = False) -> Solution:
    """Root number `index` as a `Solution`, in the caller's order of points."""
    observations, state = fit.observations, fit.state
    covariance = covariance_of(fit.system, state.T[index], index, scale.noise * scale.gain * scale.widening)
    if joined:
        covariance = widened_to_second_root(covariance, state, index)
    return Solution(
        R=state.R[index],
        T=state.T[index],
        scaled_normals=state.N[index],
        **covariance._asdict(),
        noise=scale.noise,
        relief=fit.relief[index].relative if fit.relief else np.zeros(observations.n_patches),
        rms=_rms(observations, fit, index),
        chi2=float(fit.system.chi2[index]) / max(scale.noise, EXACT_RESIDUAL) ** 2,
        inlier=observations.in_given_order(observations.free_weight > 0.0, observations.weight > 0.0),
        converged=bool(fit.converged[index]),
        iterations=fit.iterations,
        solver=solver,
        noise_gain=scale.gain,
    )


def _rms(observations: Observations, fit: Fit, index: int) -> float:
    """RMS residual of the points kept: distance to the predicted point, or to the epipolar line on no patch."""
    kept, kept_free = observations.weight > 0.0, observations.free_weight > 0.0
    total = (fit.prediction.residual[index] ** 2).sum(axis=0) @ kept
    total += fit.prediction.distance[index] ** 2 @ kept_free
    return float(np.sqrt(total / (np.count_nonzero(kept) + np.count_nonzero(kept_free))))
