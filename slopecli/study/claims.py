"""The claims of the paper about its simulation (section 4.1), and whether a study confirms each.

Errors are means over terrains, as in the paper ("average slope error", Fig. 5), of homography alignment unless the
claim names another solver; only the bound is held against root mean squares, as it is one. "Usual" noise is what the
paper calls normal: up to 0.3 px. A study smaller than the paper's gives no verdict where chance may decide.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from slopecli.study.parameters import StudyOptions
from slopecli.study.trials import QUANTITIES, Spread, Study, Timing
from slopecli.types import FloatArray

USUAL_PX = 0.3
MOTION = ("rotation_error", "direction_error")
TOGETHER = 0.85  # correlation that eleven noises have by chance once in a thousand times
LINEAR_FROM = 64  # windows, from which on the exponent of the time is fitted


@dataclass(frozen=True)
class Claim:
    """One claim: where it is made, what was measured, and whether it held; None: this study cannot tell, and why."""

    name: str
    source: str
    statement: str
    measured: float | None
    limit: str
    held: bool | None
    reason: str | None = None


class CannotTell(Exception):
    """The study lacks what a claim is about."""


@dataclass(frozen=True)
class _Rule:
    """How a claim is judged: `measure` gives a number, which must be `below` or `above` the limit."""

    name: str
    measure: Callable[[Study], float]
    below: float | None = None
    above: float | None = None
    error: Callable[[Study], float] | None = None  # sampling error; None: found by leaving out terrains

    def judged(self, study: Study) -> Claim:
        """Return the claim as measured; `held` is None where the study cannot tell or has too few trials."""
        limit = f"< {self.below:g}" if self.below is not None else f"> {self.above:g}"
        claim = Claim(self.name, *STATEMENTS[self.name], None, limit, None)
        try:
            value = self.measure(study)
        except CannotTell as reason:
            return replace(claim, reason=str(reason))
        margin = value - (self.below if self.below is not None else self.above or 0.0)
        error = self.error or partial(jackknifed, measure=self.measure)
        if not _is_large(study) and error(study) > abs(margin):
            return replace(claim, measured=value, reason="too few trials")
        return replace(claim, measured=value, held=bool(margin < 0.0 if self.below is not None else margin > 0.0))


def judge_study(study: Study) -> list[Claim]:
    """Return all claims about the trials, in the order the paper makes them; those of slopemap itself at the end."""
    return [rule.judged(study) for rule in RULES]


def judge_spread(spread: Spread) -> Claim:
    """Return the claim of Figure 2."""
    statement = "after alignment one epipolar geometry: a point's images under all homographies lie on one line"
    held = spread.off_line_after < 1e-6 < spread.off_line_before
    return Claim("one-epipolar-geometry", "Fig. 2", statement, spread.off_line_after, "< 1e-06 px", held)


def judge_times(timings: Sequence[Timing]) -> list[Claim]:
    """Return the claim of Figure 6 for every solver that was timed."""
    claims = []
    for solver in dict.fromkeys(timing.solver for timing in timings):
        statement = f"time of a sweep of {solver} almost linear in windows: exponent, from {LINEAR_FROM} windows on"
        exponent = time_exponent(timings, solver)
        cannot = "too few sizes were timed" if exponent is None else None
        held = None if exponent is None else exponent <= 1.05
        claims.append(Claim(f"linear-time-{solver}", "Fig. 6", statement, exponent, "<= 1.05", held, cannot))
    return claims


def time_exponent(timings: Sequence[Timing], solver: str) -> float | None:
    """Return the power of the number of windows that the time of a sweep grows with, by least squares on logarithms.

    How many sweeps a solution takes, 14 or 100, is of its scene and not of its size.
    """
    points = [
        (t.windows, t.seconds / max(t.iterations, 1))
        for t in timings
        if t.solver == solver and t.windows >= LINEAR_FROM
    ]
    if len(points) < 2:
        return None
    windows, seconds = np.log(np.array(points)).T
    return float(np.polyfit(windows, seconds, 1)[0])


# ---- sampling errors: whether trials are enough to judge a claim ----


def _is_large(study: Study) -> bool:
    """Whether a study has the paper's number of trials, by which the paper judges its own claims."""
    paper = StudyOptions()
    return study.options.terrains >= paper.terrains and _count_noisy(study.options) >= _count_noisy(paper)


def _count_noisy(options: StudyOptions) -> int:
    return sum(noise > 0.0 for noise in options.noises_px)


def jackknifed(study: Study, measure: Callable[[Study], float]) -> float:
    """Return the one-sided 90 % sampling error of a statistic, from how it changes as terrains are left out.

    It is infinite for one terrain. Terrains are what is drawn at random: one is the same for all trajectories and
    noises. Source: Efron, "The Jackknife, the Bootstrap and Other Resampling Plans", 1982.
    """
    from scipy.special import stdtrit

    groups = min(study.options.terrains, 20)  # left out in turn
    if groups < 2:
        return float("inf")
    values = np.array([measure(_without(study, first, groups)) for first in range(groups)])
    widening = round(float(stdtrit(groups - 1, 0.9)), 2)
    return widening * float(np.sqrt((groups - 1) / groups * ((values - values.mean()) ** 2).sum()))


def _without(study: Study, first: int, step: int) -> Study:
    """The study without every `step`-th terrain from the first one on."""
    left_out = range(first, study.options.terrains, step)
    options = replace(study.options, terrains=study.options.terrains - len(left_out))
    trials = [trial for trial in study.trials if trial.terrain not in left_out]
    return replace(study, options=options, trials=trials, bounds=[b for b in study.bounds if b.terrain not in left_out])


def chance_of_ratios(study: Study) -> float:
    """Return how far the largest of all ratios of an RMS error to the bound departs from 1 by chance.

    The RMS of n Gaussian errors has the standard deviation 1/sqrt(2 n) of itself; the largest of k departs by about
    sqrt(2 ln k) of them.
    """
    o = study.options
    count = len(o.trajectories_deg) * (len(QUANTITIES) - 1 + o.grid[0] * o.grid[1])  # rotation, direction, normals
    return float(np.sqrt(np.log(count) / (o.terrains * _count_noisy(o))))


# ---- what is measured ----


def mean(errors: FloatArray, axis: int | tuple[int, ...] = -1) -> FloatArray:
    """Return the mean of the finite errors along axes, NaN where there are none."""
    present = np.isfinite(errors)
    count = present.sum(axis=axis)
    total = np.where(present, errors, 0.0).sum(axis=axis)
    return np.asarray(np.where(count, total / np.maximum(count, 1), np.nan))


def rms(errors: FloatArray, axis: int | tuple[int, ...] = -1) -> FloatArray:
    """Return the root mean square of the finite errors along axes, NaN where there are none."""
    return np.sqrt(mean(errors**2, axis))


def _errors(study: Study, solver: str, quantity: str) -> FloatArray:
    if solver not in study.options.solvers:
        raise CannotTell(f"solver {solver} was not run")
    return study.errors(solver, quantity)


def _noises(study: Study, fewest: int = 1) -> FloatArray:
    noises = np.array(study.options.noises_px)
    if not (noises > 0.0).any():
        raise CannotTell("there is no noise in this study")
    if len(noises) < fewest:
        raise CannotTell("there are fewer than three noises in this study")
    return noises


def _usual(study: Study, quantity: str) -> FloatArray:
    """(trajectories,) or (trajectories, m) largest mean error of ha at usual noise, rad; slopes need windows 3 x 3."""
    errors, noises = _errors(study, "ha", quantity), _noises(study)
    usual = (noises > 0.0) & (noises <= USUAL_PX + 1e-9)
    if not usual.any():
        raise CannotTell(f"no noise up to {USUAL_PX:g} px is in this study")
    return np.asarray(mean(errors[:, usual], 2).max(axis=1))


def _trajectories(study: Study, angle: float) -> tuple[int, list[int]]:
    """Number of the trajectory at an angle, deg, and the numbers of the others."""
    angles = study.options.trajectories_deg
    if angle not in angles:
        raise CannotTell(f"the {angle:g} deg trajectory is not in this study")
    if len(angles) < 2:
        raise CannotTell("there is only one trajectory in this study")
    own = angles.index(angle)
    return own, [i for i in range(len(angles)) if i != own]


def _per_noise(study: Study, errors: FloatArray) -> FloatArray:
    """Errors, or bounds, over the noise, without what has no noise."""
    noises = _noises(study)
    shape = (1, -1, *[1] * (errors.ndim - 2))
    return np.asarray(errors[:, noises > 0.0] / noises[noises > 0.0].reshape(shape))


def _all_noises(study: Study, solver: str, quantity: str) -> FloatArray:
    """(trajectories,) or (trajectories, m) mean of errors over noise, all noises that are not 0 taken together."""
    return mean(_per_noise(study, _errors(study, solver, quantity)), (1, 2))


def _unanswered(study: Study) -> float:
    return float(sum(trial.reason is not None for trial in study.trials if trial.solver != "lh"))


def _usual_translation(study: Study, vertical: bool) -> float:
    own, others = _trajectories(study, 0.0)
    return float(100.0 * _usual(study, "direction_error")[[own] if vertical else others].max())


def _usual_window(study: Study, window: int) -> float:
    _refuse_other_windows(study)
    return float(np.degrees(_usual(study, "normal_errors")[:, window].max()))


def _refuse_other_windows(study: Study) -> None:
    if study.options.grid != (3, 3):
        raise CannotTell("the windows are not those of the paper, 3 x 3")


def _against_others(study: Study, angle: float, best: bool) -> float:
    """Errors of one trajectory over those of the next best, or next worst; the less favourable of the motion's two."""
    own, others = _trajectories(study, angle)
    errors = [_all_noises(study, "ha", quantity) for quantity in MOTION]
    if best:
        return float(max(e[own] / e[others].min() for e in errors))
    return float(min(e[own] / e[others].max() for e in errors))


def _gain_over_lh(study: Study) -> float:
    """Least ratio of the errors of averaged Longuet-Higgins to those of alignment."""
    return float(min((_all_noises(study, "lh", q) / _all_noises(study, "ha", q)).min() for q in MOTION))


def _worst_window(study: Study) -> float:
    """How much larger the error of window 4 is, in vertical descent, than the largest of the other windows."""
    _refuse_other_windows(study)
    errors = _all_noises(study, "ha", "normal_errors")[_trajectories(study, 0.0)[0]]
    return float(errors[4] / np.delete(errors, 4).max())


def _correlation_with_noise(study: Study) -> float:
    noises = _noises(study, fewest=3)
    errors = mean(_errors(study, "ha", "rotation_error"))
    return float(min(np.corrcoef(noises, row)[0, 1] for row in errors))


def _correlation_of_motion(study: Study) -> float:
    _noises(study, fewest=3)
    rotation, translation = (mean(_errors(study, "ha", quantity)) for quantity in MOTION)
    return float(min(np.corrcoef(a, b)[0, 1] for a, b in zip(rotation, translation, strict=True)))


def _iterations(study: Study, solver: str) -> float:
    found = [trial.iterations for trial in study.trials if trial.solver == solver and trial.reason is None]
    if not found:
        raise CannotTell(f"solver {solver} was not run")
    return float(np.median(found))


def _off_bound(study: Study) -> float:
    """Largest departure from 1 of RMS error over bound, for every trajectory, of rotation, translation and normals."""
    o = study.options
    if o.relief or o.outliers or o.noise1_px:
        raise CannotTell("the bound is for noise in image 2 alone, on planes, without mismatches")
    ratios = [bound_ratios(study, "mle", quantity).ravel() for quantity in QUANTITIES]
    return float(np.abs(np.concatenate(ratios) - 1.0).max())


def bound_ratios(study: Study, solver: str, quantity: str) -> FloatArray:
    """(trajectories,) or (trajectories, m) RMS error over the bound; all noises together, in units of the noise."""
    errors, least = (_per_noise(study, e) for e in (_errors(study, solver, quantity), study.bound(quantity)))
    return np.asarray(rms(errors, (1, 2)) / rms(least, (1, 2)))


# name -> where the paper claims it, and what
STATEMENTS = {
    "all-answered": ("section V", "no trial fails: trials of ha and mle without an answer"),
    "rotation": ("Fig. 4", "rotation error below 0.1 deg at usual noise, any trajectory"),
    "vertical-translation": ("Fig. 4", "translation error of vertical descent roughly 0.5 % at usual noise"),
    "other-translation": ("Fig. 4", "translation error of the other trajectories below 0.25 % at usual noise"),
    "vertical-worst": ("Fig. 4", "vertical descent is the least accurate: its errors over the largest of the others"),
    "gliding-best": ("Fig. 4", "45 deg gliding is the most accurate: its errors over the smallest of the others"),
    "grows-with-noise": ("Fig. 4", "errors grow with noise: correlation"),
    "rotation-and-translation": ("Fig. 4", "errors of rotation and translation go together: correlation"),
    "twice-as-accurate": ("Fig. 4", "at least twice as accurate as averaged Longuet-Higgins: ratio of errors"),
    "window-3": ("Fig. 5", "slope error of window 3 below 0.5 deg at usual noise, any trajectory"),
    "window-4-worst": ("Fig. 5", "window 4 is the worst in vertical descent: its error over the largest of the others"),
    "window-5": ("Fig. 5", "slope error of window 5, a typical one, below 1 deg at usual noise"),
    "few-iterations": ("section 4.1", "a few iterations: median sweeps of ha, the slower of its two starts"),
    "few-iterations-mle": ("slopemap", "a few iterations: median of mle"),
    "at-the-bound": ("slopemap", "mle at the Cramer-Rao bound: largest departure of RMS error over bound from 1"),
}
RULES = (
    _Rule("all-answered", _unanswered, below=0.5, error=lambda study: 0.0),  # a count of what was run
    _Rule("rotation", lambda study: float(np.degrees(_usual(study, "rotation_error").max())), below=0.1),
    _Rule("vertical-translation", partial(_usual_translation, vertical=True), below=0.6),
    _Rule("other-translation", partial(_usual_translation, vertical=False), below=0.25),
    _Rule("vertical-worst", partial(_against_others, angle=0.0, best=False), above=1.0),
    _Rule("gliding-best", partial(_against_others, angle=45.0, best=True), below=1.0),
    _Rule("grows-with-noise", _correlation_with_noise, above=TOGETHER),
    _Rule("rotation-and-translation", _correlation_of_motion, above=TOGETHER),
    _Rule("twice-as-accurate", _gain_over_lh, above=2.0),
    _Rule("window-3", partial(_usual_window, window=3), below=0.5),
    _Rule("window-4-worst", _worst_window, above=1.0),
    _Rule("window-5", partial(_usual_window, window=5), below=1.0),
    _Rule("few-iterations", partial(_iterations, solver="ha"), below=10),
    _Rule("few-iterations-mle", partial(_iterations, solver="mle"), below=10),
    _Rule("at-the-bound", _off_bound, below=0.1, error=chance_of_ratios),
)
