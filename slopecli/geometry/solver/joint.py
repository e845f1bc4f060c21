"""Maximum likelihood over all points: every root, mismatches left out, terrain relief allowed for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from slopecli.geometry.solver.mismatches import LEAST_FREEDOM, Kept, consensus, gate_squared, inliers, is_beyond_chance
from slopecli.geometry.solver.observations import Observations, Prediction, QuadraticForm, linearise, predict
from slopecli.geometry.solver.priors import MotionPrior
from slopecli.geometry.solver.refinement import GRACE, Refined, State, System, levenberg_marquardt, optimal_normals
from slopecli.geometry.solver.relief import Relief, estimate_relief
from slopecli.geometry.solver.starts import COARSE_STEPS, scattered_motions, starting_states
from slopecli.types import BoolArray, FloatArray

Motion = tuple[FloatArray, FloatArray]

_DISTINCT = 2e-3  # rad; roots closer than this are one
_ROOTS = 3  # a scene has at most two visible roots; a third start covers a start that strays
_RESTARTS = 3  # from the points that are left; the second is mostly the first again
_HANDFUL = 5.0  # mismatches that may fit one root better than the other by chance, besides two standard deviations
_MANY = 40  # degrees of freedom that tell the scale of residuals well enough for a gate on them to tell mismatches
_FEW_STEPS, _FEW_GRACE = 15, 40  # iterations before starts are left out, and given up, where few points tell
_MAX_TRIMS = 10  # inlier sets usually settle in two or three rounds, among many mismatches not always in ten
_RELIEF_ROUNDS = 8
_RELIEF_SETTLED = 0.01  # relative change of noise and relief that changes no weight that matters


class WeighedPrior(NamedTuple):
    """What is known of the motion, and the 1-sigma of a unit-weight residual it is weighed against."""

    prior: MotionPrior
    noise: float

    def favour(self, state: State) -> float:
        """By how much of chi-square what is known speaks for the first root against the second."""
        of = self.prior.terms(state.R[:2], state.T[:2], 1.0)[:, 6, 6]
        return float(of[1] - of[0])


@dataclass(frozen=True, eq=False)
class Fit:
    """Roots fitted to one choice of points, best first.

    The observations carry the choice of points in their weights. prediction: of image 2, roots in the same order.
    cost (s,): what roots are compared by, in units of noise^2 (chi-square, plus log determinants with relief).
    relief: of each root, or empty. prior: what was known of the motion besides, and the noise it is weighed against.
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

    def noise_squared(self) -> float:
        """Variance of a unit-weight residual, by the best root."""
        return float(self.system.chi2[0]) / degrees_of_freedom(self.observations)

    def noise_freedom(self) -> int:
        """Degrees of freedom that the noise is estimated from: with relief, residuals across epipolar lines alone."""
        if not self.relief:
            return degrees_of_freedom(self.observations)
        used = np.count_nonzero(self.observations.weight) + np.count_nonzero(self.observations.free_weight)
        return max(int(used) - 5, 1)

    def form(self, state: State, W: FloatArray | None) -> QuadraticForm:
        """The chi-square around a state, under the points' own weights or W (s, 3, n), and what is known besides."""
        return _form(self.observations, state, W, self.prior)


def _form(observations: Observations, state: State, W: FloatArray | None, prior: WeighedPrior | None) -> QuadraticForm:
    form = linearise(observations, predict(observations, *state), W)
    return form if prior is None else form._replace(motion=prior.prior.terms(state.R, state.T, prior.noise))


def degrees_of_freedom(observations: Observations) -> int:
    """Residuals less the 5 + 3m parameters, at least 1."""
    return max(_spare(observations), 1)


def _spare(observations: Observations) -> int:
    return observations.residual_count() - 5 - 3 * observations.n_patches


def maximum_likelihood(
    observations: Observations, noise: float | None, relief: bool, robust: bool, initial: list[Motion]
) -> Fit:
    """All visible roots of the joint least squares. Arguments as in `solve_planes`."""
    if _spare(observations) < _MANY:
        initial = initial + scattered_motions(observations)
    fit = _refit(observations, _starts(observations, initial))
    if robust:
        fit = _without_mismatches(fit, initial, relief)
    return _with_relief(fit, noise, robust and _spare(fit.observations) >= _MANY) if relief else fit


def with_prior(fit: Fit, prior: MotionPrior, noise: float) -> Fit:
    """The roots solved again with what is known of the motion, and from there.

    noise : 1-sigma of a unit-weight residual, whatever the points share in errors included.
    """
    known = WeighedPrior(prior, noise)
    rotation = fit.state.R if prior.rotation is None else np.repeat(prior.rotation[None], len(fit.state.R), axis=0)
    direction = fit.state.T if prior.direction is None else np.repeat(prior.direction[None], len(fit.state.T), axis=0)
    W = np.stack([r.W for r in fit.relief]) if fit.relief else None
    there, _ = optimal_normals(rotation, direction, linearise(fit.observations, fit.prediction, W))
    states = State(*(np.concatenate(pair) for pair in zip(fit.state, there, strict=True)))
    return _refit(fit.observations, states, fit.relief * 2, known)


def _refit(
    observations: Observations,
    state: State,
    relief: tuple[Relief, ...] = (),
    prior: WeighedPrior | None = None,
) -> Fit:
    """Exact least squares on the points from given states, under the weights their relief asks for."""
    W = np.stack([r.W for r in relief]) if relief else None

    def form(state: State) -> QuadraticForm:
        return _form(observations, state, W, prior)

    grace = _FEW_GRACE if _spare(observations) < _MANY else GRACE
    refined = levenberg_marquardt(state, form, degrees_of_freedom(observations), grace=grace)
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
    """Best visible root first, other visible and settled ones after it, repeated ones dropped."""
    prediction = predict(observations, *refined.state)
    visible = _visible(observations, prediction)
    kept: list[int] = []
    for i in sorted(range(len(cost)), key=lambda i: (not visible[i], cost[i])):
        if not kept or (visible[i] and refined.converged[i] and not any(_same(refined.state, i, k) for k in kept)):
            kept.append(i)
    system = System(*(a[kept] for a in refined.system))
    converged = refined.converged[kept] & visible[kept]
    relief = tuple(relief[i] for i in kept) if relief else ()
    state, prediction = refined.state.pick(kept), prediction.pick(kept)
    return Fit(observations, state, system, prediction, cost[kept], converged, refined.iterations, relief, prior)


def _visible(observations: Observations, prediction: Prediction) -> BoolArray:
    """(s,) whether each root has its planes in front of both cameras at every point that counts."""
    return (prediction.visible() | (observations.weight == 0.0)).all(axis=1)


def _same(state: State, i: int, k: int) -> bool:
    # the Frobenius norm of a difference of rotations is sqrt(2) times the small angle between them
    turned = np.sqrt(0.5) * np.linalg.norm(state.R[i] - state.R[k])
    return bool(max(turned, np.linalg.norm(state.T[i] - state.T[k])) < _DISTINCT)


def _without_mismatches(fit: Fit, initial: list[Motion], each_patch: bool) -> Fit:
    """The fit as it is when no residual is out of the ordinary, else one to the points that agree with each other.

    A fit to few points bends to a mismatch, and some of them agree by chance. So one to a part is always sought, and
    taken if its points agree better than that.
    Mismatches may hide a root from the starts, so these are found again from the points that are left; and every root
    chooses its points by itself, because those that one root has chosen speak against the other.
    """
    full = fit.observations
    everything = Kept(full.weight > 0.0, full.free_weight > 0.0)
    if _spare(full) >= _MANY and inliers(full, fit.prediction, 0, everything, each_patch)[0].same_as(everything):
        return fit
    if _spare(full) < LEAST_FREEDOM:
        return fit
    agreed = Kept(everything.planes & consensus(full), np.zeros_like(everything.free))
    best = _settled(full, agreed, _starts(agreed.applied_to(full), initial), each_patch)
    rivals: list[_Settled] = []
    for _ in range(_RESTARTS):
        left = best.kept.applied_to(full)
        states = _refit(left, _starts(left, initial)).state
        rivals = [_settled(full, best.kept, states.pick([i]), each_patch) for i in range(len(states.R))]
        before, best = best, min([best, *rivals], key=lambda one: one.cost)
        if best.kept.same_as(before.kept):
            break
    states = State(*(np.concatenate(parts) for parts in zip(*(one.fit.state for one in [best, *rivals]), strict=True)))
    chosen = _refit(_uncontested(full, best, rivals).applied_to(full), states)
    return chosen if _is_better(chosen, fit) else fit


def _is_better(chosen: Fit, fit: Fit) -> bool:
    """Whether a fit to part of the points may stand for one to all of them."""
    spare, removed = _spare(chosen.observations), fit.observations.residual_count()
    removed -= chosen.observations.residual_count()
    points = fit.observations.weight.size + fit.observations.free_weight.size
    before, after = float(fit.system.chi2[0]), float(chosen.system.chi2[0])
    return spare >= _MANY or is_beyond_chance(before, after, spare, removed, points)


class _Settled(NamedTuple):
    """A fit, the points it rests on, and how badly it explains all, none counting for more than a mismatch."""

    fit: Fit
    kept: Kept
    cost: float


def _starts(observations: Observations, initial: list[Motion]) -> State:
    # chi-squares of few points are so small that a start looks hopeless long before it has come down a bent valley
    steps = _FEW_STEPS if _spare(observations) < _MANY else COARSE_STEPS
    return starting_states(observations, initial, steps).pick(slice(_ROOTS + len(initial)))


def _settled(full: Observations, kept: Kept, states: State, each_patch: bool) -> _Settled:
    """Alternate between the fit to the points kept and the choice of points, by the root that explains all best.

    Some points may come and go for ever; of the two choices then, the one that explains all better is taken.
    """
    # only points on no patch are judged by two scales, one after the other, and not where each patch has its own
    two_scales = not each_patch and bool(full.free_weight.size)
    for one_scale in (False, True) if two_scales else (False,):
        before: _Settled | None = None
        for _ in range(_MAX_TRIMS):
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


def _uncontested(full: Observations, best: _Settled, rivals: list[_Settled]) -> Kept:
    """The points the best root keeps, without those a rival leaves out where mismatches may have made the difference.

    Among many mismatches some fit a wrong root and not the true one. A rival whose cost is larger by more than such a
    handful is judged by all points of the best.
    """
    kept = best.kept
    n = full.weight.size + full.free_weight.size
    removed = n - np.count_nonzero(kept.planes) - np.count_nonzero(kept.free)
    handful = _HANDFUL + 2.0 * np.sqrt(removed)
    least = best.fit.noise_squared() * gate_squared(n)
    for rival in rivals:
        if rival.cost - best.cost < handful * least:
            kept = Kept(kept.planes & rival.kept.planes, kept.free & rival.kept.free)
    return kept


def _with_relief(fit: Fit, noise: float | None, robust: bool) -> Fit:
    """Alternate between weights from residuals and the fit under these weights, until noise and relief settle."""
    matched, before = fit.observations, None
    for _ in range(_RELIEF_ROUNDS):
        prediction = fit.prediction
        best = estimate_relief(matched, prediction, 0, noise, robust)
        observations = Kept(best.keep, best.keep_free).applied_to(matched)
        # roots are compared on the same points and the same noise
        others = [
            estimate_relief(observations, prediction, i, best.noise, False, settled=True)
            for i in range(1, len(fit.cost))
        ]
        fit = _refit(observations, fit.state, (best, *others))
        now = np.append(best.relative, best.noise)
        if before is not None and np.abs(now - before).max() <= _RELIEF_SETTLED * now.max():
            break
        before = now
    return fit
