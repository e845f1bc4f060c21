"""Patches that keep the joint solution from settling, set aside so that the others are solved without them.

One patch that is mismatched, moves by itself or lies at infinity bends the motion of all, or leaves it unconverged.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from slopecli.errors import DegenerateConfiguration, SlopemapError
from slopecli.geometry.epipolar import homogeneous
from slopecli.geometry.homography import apply_homography, fit_homography, homography_of_plane
from slopecli.geometry.statistics import median
from slopecli.look.matches import LEAST_MATCHES
from slopecli.patches.join import Joined
from slopecli.types import FloatArray, Solution

CLEARLY = 2.0  # times the noise: more is no chance, whatever the number of matches
MOST_TRIED, MOST_ROUNDS = 8, 3  # patches left out in turn, and how often: each costs a solution
MOST_NOISE = 0.05  # normalised: patches that leave room for more tell nothing of each other
HELPED = 0.9  # of the noise: what leaving out one patch of several bad ones must bring
BEHIND = "its matches put it behind a camera, or at infinity, and the joint solution does not settle with it"
AGAINST = "its matches contradict the motion that the others agree on: mismatches, or something that moved"

Solve = Callable[[Joined], Solution]


class _Trial(NamedTuple):
    settled: bool
    noise: float
    rest: Joined
    solution: Solution


def set_aside_unsettled(joined: Joined, solution: Solution, solve: Solve, most_noise: float) -> Joined:
    """The joined problem without patches that keep it from settling; itself if it settles, or none can be blamed.

    A solution is settled if it converged, with all planes in front of both cameras, and its noise is at most
    `most_noise` (1-sigma of a match of weight one, normalised). Patches behind a camera are left out first, then each
    in turn: the one without which the others settle, if there is only one such. More than half of them always stay.

    solution : of `joined`.  solve : gives that of a smaller problem.
    """
    most = (len(joined.patches) - 1) // 2
    hopeless = most_noise > MOST_NOISE
    if most == 0 or hopeless or (solution.converged and solution.noise <= most_noise):
        return joined

    def tried(rest: Joined) -> _Trial:
        """The solution of a smaller problem, and whether it settles."""
        try:
            found = solve(rest)
        except (SlopemapError, np.linalg.LinAlgError):
            return _Trial(False, np.inf, rest, solution)
        return _Trial(found.converged and found.noise <= most_noise, found.noise, rest, found)

    behind = _behind(joined, solution)
    if 0 < len(behind) <= most and (trial := tried(_without(joined, behind, BEHIND))).settled:
        return trial.rest
    return _one_by_one(_Trial(False, solution.noise, joined, solution), min(most, MOST_ROUNDS), tried)


def _one_by_one(best: _Trial, rounds: int, tried: Callable[[Joined], _Trial]) -> Joined:
    """The problem with patches left out one after the other until it settles; unchanged if it does not, or none can be
    blamed."""
    joined = best.rest
    for _ in range(rounds):
        trials = [tried(_without(best.rest, [k], AGAINST)) for k in _suspects(best.rest, best.solution)]
        before = best.noise
        best, *others = sorted(trials, key=lambda one: (not one.settled, one.noise))
        if best.settled:
            alike = any(one.settled and one.noise < CLEARLY * best.noise for one in others)
            return joined if alike else best.rest
        if not best.noise < HELPED * before:  # not this patch, then, or not it alone
            break
    return joined


def much_less_alone(joined: Joined, noise: float) -> float | None:
    """The noise that patches have alone, if together they have clearly more; None where they do not.

    noise : 1-sigma of a match of their joint solution, normalised.
    """
    alone = noise_of_each_alone(joined) if len(joined.patches) > 1 else np.inf
    return alone if noise > CLEARLY * alone else None


def noise_of_each_alone(joined: Joined) -> float:
    """Largest noise of a joint solution, normalised, that the patches' own homographies leave room for.

    Of the least-squares residuals of each patch, half of the patches have larger ones, so that those which are
    mismatched do not count. Infinite where no patch has enough matches.
    """
    each: list[tuple[float, int]] = []
    for k, patch in enumerate(joined.patches):
        matches, weight = patch.matches, joined.weight[joined.rows(k)]
        freedom = 2 * len(matches) - 8
        if len(matches) < LEAST_MATCHES:
            continue
        with suppress(DegenerateConfiguration):
            residual = apply_homography(fit_homography(matches.x1, matches.x2, weight), matches.x1) - matches.x2
            each.append((float(weight @ (residual**2).sum(axis=1)) / freedom, freedom))
    if not each:
        return np.inf
    variance, freedom = sorted(each)[(len(each) - 1) // 2]
    # 4 sigmas of one patch's estimate; the middle one of several is known better
    return float(np.sqrt(variance)) * (1.0 + 4.0 / np.sqrt(2.0 * freedom))


def _without(joined: Joined, chosen: Sequence[int], reason: str) -> Joined:
    """The joined problem without the patches of these indices, which have no answer, and without their matches."""
    patches = [patch.unmatched(reason, "unsettled") if k in chosen else patch for k, patch in enumerate(joined.patches)]
    free = joined.plane < 0
    every = [*patches, *joined.unanswered]
    return Joined.of(every, joined.matches.take(free), joined.weight[free], joined.segmentation)


def _behind(joined: Joined, solution: Solution) -> list[int]:
    """Patches that lie behind a camera, or at infinity, at a match that was kept."""
    on = (joined.plane >= 0) & solution.inlier
    p = homogeneous(joined.matches.x1[on])
    inverse_depth = (p * solution.scaled_normals[joined.plane[on]]).sum(axis=1)
    ratio = p @ solution.R[2] - inverse_depth * float(solution.R[2] @ solution.T)
    return [int(k) for k in np.unique(joined.plane[on][(inverse_depth <= 0.0) | (ratio <= 0.0)])]


def _suspects(joined: Joined, solution: Solution) -> list[int]:
    """At most MOST_TRIED patches, those whose matches miss their planes by most first."""
    missed: FloatArray = np.zeros(len(joined.patches))
    for k, patch in enumerate(joined.patches):
        H = homography_of_plane(solution.R, solution.T, solution.scaled_normals[k])
        off = (apply_homography(H, patch.matches.x1) - patch.matches.x2) ** 2
        missed[k] = median(np.nan_to_num(off.sum(axis=1), nan=np.inf))
    return [int(k) for k in np.argsort(-missed, kind="stable")[:MOST_TRIED]]
