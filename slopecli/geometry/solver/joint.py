"""Maximum likelihood of motion and planes over all points: every root, mismatches left out, relief estimated."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from slopecli.geometry.epipolar import rotation_angle
from slopecli.geometry.solver.mismatches import LEAST_FREEDOM, Kept, consensus, gate_squared, inliers, is_beyond_chance
from slopecli.geometry.solver.observations import Observations, Prediction, QuadraticForm, linearise, predict
from slopecli.geometry.solver.priors import MotionPrior
from slopecli.geometry.solver.refinement import Refined, State, System, levenberg_marquardt, optimal_normals
from slopecli.geometry.solver.relief import Relief, estimate_relief
from slopecli.geometry.solver.starts import FEW_FREEDOM, largest_worth_trying, starting_states, states_of
from slopecli.types import BoolArray, FloatArray

Motion = tuple[FloatArray, FloatArray]  # R (3, 3) and T (3,)

MANY_FREEDOM = 40  # degrees of freedom from which on the scale of residuals is known well enough to gate mismatches


class WeighedPrior(NamedTuple):
    """A prior on the motion, and the 1-sigma of a unit-weight residual it is weighed against."""

    prior: MotionPrior
    noise: float

    def worse_by_prior(self, state: State) -> float:
        """Chi-square of the prior at the second root less that at the first."""
        chi2 = self.prior.terms(state.R[:2], state.T[:2], 1.0)[:, 6, 6]
        return float(chi2[1] - chi2[0])


@dataclass(frozen=True, eq=False)
class Fit:
    """Roots fitted to one choice of points, best first.

    observations: points left out have weight 0.  state: motion and normals of each root.
    system: normal equations there.  prediction: of the points in image 2.  converged (s,): of each root.
    cost (s,): roots are compared by it, in units of noise^2 (chi-square, plus log determinants with relief).
    relief: of each root, or empty.  prior: on the motion, and the noise it is weighed against.
    """

    observations: Observations
    state: State
    system: System
    prediction: Prediction
    cost: FloatArray
    converged: BoolArray
    iterations: int
    relief: tuple[Relief, ...] = ()
    prior: WeighedPrior | None = None

    def noise_freedom(self) -> int:
        """Degrees of freedom that the noise is estimated from: with relief, residuals across epipolar lines only."""
        if not self.relief:
            return max(self.observations.freedom(), 1)
        used = np.count_nonzero(self.observations.weight) + np.count_nonzero(self.observations.free_weight)
        return max(int(used) - 5, 1)

    def form(self, state: State, W: FloatArray | None) -> QuadraticForm:
        """Quadratic form of chi-square around a state, prior included; points have their own weights or W (s, 3, n)."""
        return _form(self.observations, state, W, self.prior)


def _form(observations: Observations, state: State, W: FloatArray | None, prior: WeighedPrior | None) -> QuadraticForm:
    form = linearise(observations, predict(observations, *state), W)
    return form if prior is None else form._replace(motion=prior.prior.terms(state.R, state.T, prior.noise))


def maximum_likelihood(
    observations: Observations,
    noise: float | None,
    relief: bool,
    robust: bool,
    initial: list[Motion],
    initial_only: bool = False,
) -> Fit:
    """Roots of the joint least squares, best first. Arguments as in `solve.solve_planes`.

    The best is visible (all points in front of both cameras) if any is; the others always are.
    """
    starts = partial(states_of, motions=initial) if initial_only else partial(_starts, initial=initial)
    fit = _refit(observations, starts(observations))
    if robust:
        fit = _without_mismatches(fit, starts, relief, once=initial_only)
    return _with_relief(fit, noise, robust and fit.observations.freedom() >= MANY_FREEDOM) if relief else fit


def with_prior(fit: Fit, prior: MotionPrior, noise: float) -> Fit:
    """The roots refined with a prior on the motion, from themselves and from the motion of the prior.

    noise : 1-sigma of a unit-weight residual, errors common to several points included.
    """
    known = WeighedPrior(prior, noise)
    rotation = fit.state.R if prior.rotation is None else np.repeat(prior.rotation[None], len(fit.state.R), axis=0)
    direction = fit.state.T if prior.direction is None else np.repeat(prior.direction[None], len(fit.state.T), axis=0)
    W = np.stack([r.W for r in fit.relief]) if fit.relief else None
    there, _ = optimal_normals(rotation, direction, linearise(fit.observations, fit.prediction, W))
    states = State(*(np.concatenate(pair) for pair in zip(fit.state, there, strict=True)))
    return _refit(fit.observations, states, fit.relief * 2, known)


def _refit(
    observations: Observations, state: State, relief: tuple[Relief, ...] = (), prior: WeighedPrior | None = None
) -> Fit:
    """Least squares on the points from given states, under the weights of their relief."""
    W = np.stack([r.W for r in relief]) if relief else None
    form = partial(_form, observations, W=W, prior=prior)
    few = observations.freedom() < FEW_FREEDOM
    # a root of few points may still win after it had ten times the chi-square of the best, so all are waited for; they
    # converge to rounding, so that the answer does not depend on the turn of the images or on the order of points
    refined = levenberg_marquardt(
        state, form, max(observations.freedom(), 1), tolerance=1e-20 if few else 1e-3, grace=100 if few else 4
    )
    cost = refined.system.chi2
    if relief:
        cost = cost + np.array([r.noise**2 * r.log_determinant for r in relief])
    return ranked(observations, refined, cost, relief, prior)


def ranked(
    observations: Observations,
    refined: Refined,
    cost: FloatArray,
    relief: tuple[Relief, ...] = (),
    prior: WeighedPrior | None = None,
) -> Fit:
    """Fit of the best root, visible if any is, then of the others that are visible and converged, without repeats.

    cost : (s,) by which they are compared.
    """
    prediction = predict(observations, *refined.state)
    behind = np.sign(prediction.inverse_depth) @ (observations.weight > 0.0) < 0.0
    if prior is None and behind.any():
        refined = _negated(refined, behind)
        prediction = predict(observations, *refined.state)
    visible = (prediction.visible() | (observations.weight == 0.0)).all(axis=1)  # at every point with weight
    order = sorted(range(len(cost)), key=lambda i: (not visible[i], cost[i]))
    best, *others = _equal_by_rotation(order, cost, visible, refined.state.R, observations)
    roots = visible & refined.converged
    if prior is None:
        roots &= refined.system.chi2 <= largest_worth_trying(refined.system.chi2[best], observations.residual_count())
    kept = refined.state.distinct([best, *(i for i in others if roots[i])])
    system = System(*(a[kept] for a in refined.system))
    converged = refined.converged[kept] & visible[kept]
    relief = tuple(relief[i] for i in kept) if relief else ()
    state, prediction = refined.state.pick(kept), prediction.pick(kept)
    return Fit(observations, state, system, prediction, cost[kept], converged, refined.iterations, relief, prior)


def _negated(refined: Refined, which: BoolArray) -> Refined:
    """Motions (s,) with T and normals negated, which predicts the same points on the other side of the camera."""
    state, system = refined.state, refined.system
    sign = np.where(which, -1.0, 1.0)
    motion = np.ones((len(sign), 7))
    motion[:, 3:6] = sign[:, None]
    system = system._replace(
        response=system.response * (sign[:, None] * motion)[:, None, None, :],
        reduced=system.reduced * motion[:, :, None] * motion[:, None, :],
    )
    state = State(state.R, state.T * sign[:, None], state.N * sign[:, None, None])
    return refined._replace(state=state, system=system)


def _equal_by_rotation(
    order: list[int], cost: FloatArray, visible: BoolArray, R: FloatArray, observations: Observations
) -> list[int]:
    """The order of roots, those in front that fit as well as the best by increasing angle of rotation R.

    The two roots of a single plane fit equally well, and rounding must not choose between them.
    """
    best = order[0]
    equal = 1e-6 * abs(cost[best]) / max(observations.freedom(), 1) + 1e-29 * observations.residual_count()
    ties = [i for i in order if visible[i] == visible[best] and cost[i] <= cost[best] + equal]
    return sorted(ties, key=lambda i: float(rotation_angle(R[i]))) + order[len(ties) :]


def _without_mismatches(fit: Fit, starts: Callable[[Observations], State], each_patch: bool, once: bool = False) -> Fit:
    """The given fit if all residuals are within the gate, else a fit without mismatches.

    With few points a fit follows a mismatch, and a subset agrees by chance: then a fit to a subset is always computed,
    and accepted if it is significantly better. Mismatches may hide a root from the starts, so starts are computed again
    from the points kept. Every root chooses its own points, as points chosen by one root are biased against another.

    starts : states to begin at, of the points kept.  each_patch : as in `inliers`.
    once : one round only, as the starts do not depend on the points kept.
    """
    full = fit.observations
    everything = Kept(full.weight > 0.0, full.free_weight > 0.0)
    if full.freedom() >= MANY_FREEDOM:
        within, _ = inliers(full, fit.prediction, 0, everything, each_patch)
        if within.same_as(everything):
            return fit
    elif full.freedom() < LEAST_FREEDOM:
        return fit
    agreed = Kept(everything.planes & consensus(full), np.zeros_like(everything.free))
    best = _settled(full, agreed, starts(agreed.applied_to(full)), each_patch)
    if once:
        return best.fit if _is_better(best.fit, fit) else fit
    others, before = [], best
    for _ in range(3):  # the second round mostly repeats the first
        left = best.kept.applied_to(full)
        states = _refit(left, starts(left)).state
        others = [_settled(full, best.kept, states.pick([i]), each_patch) for i in range(len(states.R))]
        before, best = best, min([best, *others], key=lambda one: one.cost)
        if best.kept.same_as(before.kept):
            break
    # of two equal fits rounding chooses the best, so the roots of both are taken
    found = [best, *(one for one in [before, *others] if one is not best)]
    states = State(*(np.concatenate(parts) for parts in zip(*(one.fit.state for one in found), strict=True)))
    chosen = _refit(_uncontested(full, found).applied_to(full), states)
    return chosen if _is_better(chosen, fit) else fit


def _is_better(chosen: Fit, fit: Fit) -> bool:
    """Whether a fit without some points is significantly better than the fit to all; assumed from MANY_FREEDOM on."""
    spare, removed = chosen.observations.freedom(), fit.observations.residual_count()
    removed -= chosen.observations.residual_count()
    points = fit.observations.weight.size + fit.observations.free_weight.size
    before, after = float(fit.system.chi2[0]), float(chosen.system.chi2[0])
    return spare >= MANY_FREEDOM or is_beyond_chance(before, after, spare, removed, points)


class _Settled(NamedTuple):
    """A fit, the points it uses, and its truncated cost over all points."""

    fit: Fit
    kept: Kept
    cost: float


def _starts(observations: Observations, initial: list[Motion]) -> State:
    """All starts of few points, else the best three (two may be visible roots) and one for each of `initial`."""
    most = None if observations.freedom() < FEW_FREEDOM else 3 + len(initial)
    return starting_states(observations, initial).pick(slice(most))


def _settled(full: Observations, kept: Kept, states: State, each_patch: bool) -> _Settled:
    """Alternate between the fit to the points kept and the choice of points by the root of least cost.

    If two choices alternate for ever, the one of less cost is returned.
    """
    # points on no patch are gated by a scale of their own, then by one near that of the patches' points (`one_scale`)
    two_scales = not each_patch and bool(full.free_weight.size)
    for one_scale in (False, True) if two_scales else (False,):
        before: _Settled | None = None
        for _ in range(10):  # two or three rounds are usual
            fit = _refit(kept.applied_to(full), states)
            choices = [inliers(full, fit.prediction, i, kept, each_patch, one_scale) for i in range(len(fit.cost))]
            chosen, cost = min(choices, key=lambda choice: choice[1])
            now = _Settled(fit, kept, cost)
            if before is not None and chosen.same_as(before.kept):
                now = min(now, before, key=lambda one: one.cost)
                break
            if chosen.same_as(kept):
                break
            before, kept, states = now, chosen, fit.state
        kept, states = now.kept, now.fit.state
    return now


def _uncontested(full: Observations, found: list[_Settled]) -> Kept:
    """The points kept by the best root, the first, and by every other root of nearly the same cost.

    Some of many mismatches fit a wrong root by chance. The limit is the cost of five mismatches and two standard
    deviations of their number; a root beyond it is compared on the points of the best.
    """
    best, *others = found
    kept = best.kept
    n = full.weight.size + full.free_weight.size
    removed = n - np.count_nonzero(kept.planes) - np.count_nonzero(kept.free)
    noise_squared = float(best.fit.system.chi2[0]) / max(best.fit.observations.freedom(), 1)
    limit = (5.0 + 2.0 * np.sqrt(removed)) * noise_squared * gate_squared(n)
    for other in others:
        if other.cost - best.cost < limit:
            kept = Kept(kept.planes & other.kept.planes, kept.free & other.kept.free)
    return kept


def _with_relief(fit: Fit, noise: float | None, robust: bool) -> Fit:
    """Alternate between weights from residuals and the fit under these weights, until noise and relief settle."""
    matched, before = fit.observations, None
    for _ in range(8):
        prediction = fit.prediction
        best = estimate_relief(matched, prediction, 0, noise, robust)
        observations = best.kept.applied_to(matched)
        # roots are compared on the same points and the same noise
        others = [
            estimate_relief(observations, prediction, i, best.noise, False, settled=True)
            for i in range(1, len(fit.cost))
        ]
        fit = _refit(observations, fit.state, (best, *others))
        now = np.append(best.relative, best.noise)
        if before is not None and np.abs(now - before).max() <= 0.01 * now.max():
            break
        before = now
    return fit
