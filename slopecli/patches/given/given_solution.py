"""Correspondences of the user's own, solved: on exact planes, or as rough ground where they show that they are not."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from slopecli.geometry.solver.flatness import Flatness, flatness
from slopecli.geometry.solver.priors import MotionPrior
from slopecli.geometry.solver.solve import solve_planes
from slopecli.patches.given.rows import FEWEST
from slopecli.patches.join import Joined
from slopecli.types import BoolArray, Solution

MOST_LEFT_OUT = 0.25  # share of a patch's rows off its plane beyond which it is not one plane


@dataclass(frozen=True, eq=False)
class GivenSolution:
    """The solution; how flat its patches are; which (m,) had too many rows off their plane in an exact fit; and which
    (m,) were left with no more rows than make a plane, which would fit whichever was left out."""

    solution: Solution
    flatness: Flatness
    emptied: BoolArray
    unchecked: BoolArray


def solve_given(
    joined: Joined,
    solver: Literal["mle", "ha", "lh"],
    noise: float | None,
    prior: MotionPrior | None = None,
) -> GivenSolution:
    """One motion and one plane per patch, whose points are held coplanar unless they show that they are not.

    Points that stand off their planes, by more than they miss their epipolar lines, bend the motion of an exact fit.
    Then it is solved once more with relief in mind, as ground in images is.

    noise : 1-sigma of a coordinate of weight 1 in image 2, normalised; None estimates it.
    """
    given = (joined.matches.x1, joined.matches.x2, joined.plane)
    exact = solve_planes(*given, solver, noise, weights=joined.weight, prior=prior)
    counted = joined.plane >= 0
    total, kept = (np.bincount(joined.plane[chosen]) for chosen in (counted, counted & exact.inlier))
    emptied = kept < (1 - MOST_LEFT_OUT) * total
    unchecked = (kept <= FEWEST) & (kept < total)
    if solver == "mle":
        rough = solve_planes(*given, solver, noise, weights=joined.weight, prior=prior, relief=True)
        seen = flatness(rough, *given, joined.weight)
        # many mismatches upset the fit with relief, which takes them for noise
        if seen.off.any() and rough.noise <= exact.noise:
            return GivenSolution(rough, seen, emptied, unchecked)
    return GivenSolution(exact, flatness(exact, *given, joined.weight), emptied, unchecked)
