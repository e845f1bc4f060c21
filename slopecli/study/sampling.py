"""Sampling errors of the statistics of a simulation study: whether its trials are enough to judge a claim."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from slopecli.study.parameters import StudyOptions
from slopecli.study.trials import QUANTITIES, Study


def is_large(study: Study) -> bool:
    """Whether a study has the paper's number of trials, by which the paper judges its own claims."""
    return study.options.terrains >= StudyOptions.terrains and _noisy(study) >= sum(
        noise > 0.0 for noise in StudyOptions.noises_px
    )


def jackknifed(study: Study, measure: Callable[[Study], float]) -> float:
    """Return the one-sided 90 % sampling error of a statistic, from how it changes as terrains are left out.

    It is infinite for one terrain. Terrains are what is drawn at random: one is the same for all trajectories and
    noises. Source: Efron, "The Jackknife, the Bootstrap and Other Resampling Plans", 1982.
    """
    from scipy.special import stdtrit

    terrains = study.options.terrains
    groups = min(terrains, 20)  # left out in turn
    if groups < 2:
        return float("inf")
    values = np.array([measure(_without(study, range(first, terrains, groups))) for first in range(groups)])
    widening = round(float(stdtrit(groups - 1, 0.9)), 2)
    return widening * float(np.sqrt((groups - 1) / groups * ((values - values.mean()) ** 2).sum()))


def counted(_: Study) -> float:
    """Return 0, the sampling error of a count of what was run."""
    return 0.0


def chance_of_ratios(study: Study) -> float:
    """Return how far the largest of all ratios of an RMS error to the bound departs from 1 by chance.

    The RMS of n Gaussian errors has the standard deviation 1/sqrt(2 n) of itself; the largest of k departs by about
    sqrt(2 ln k) of them.
    """
    o = study.options
    count = len(o.trajectories_deg) * (len(QUANTITIES) - 1 + o.grid[0] * o.grid[1])  # rotation, direction, normals
    return float(np.sqrt(np.log(count) / (o.terrains * _noisy(study))))


def _noisy(study: Study) -> int:
    return sum(noise > 0.0 for noise in study.options.noises_px)


def _without(study: Study, left_out: range) -> Study:
    return replace(
        study,
        options=replace(study.options, terrains=study.options.terrains - len(left_out)),
        trials=[trial for trial in study.trials if trial.terrain not in left_out],
        bounds=[least for least in study.bounds if least.terrain not in left_out],
    )
