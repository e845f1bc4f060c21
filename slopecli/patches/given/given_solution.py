"""Motion and planes of a user's correspondences: exactly planar, or with relief where the residuals show some."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from slopecli.geometry.solver.priors import MotionPrior
from slopecli.geometry.solver.relief import Flatness, flatness
from slopecli.geometry.solver.solve import solve_planes
from slopecli.patches.given.rows import FEWEST
from slopecli.patches.join import Joined
from slopecli.types import BoolArray, Solution

MOST_LEFT_OUT = 0.25  # share of a patch's rows off its plane beyond which it is not one plane


@dataclass(frozen=True, eq=False)
class GivenSolution:
    """The solution and checks of its patches (m,).

    flatness : whether residuals along the epipolar lines exceed those across.  emptied : too many rows lie off the
    exactly planar fit.  unchecked : no more rows are left than determine a plane, so none of them is checked.
    """

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
    """One motion and one plane per patch, exactly planar unless the residuals show relief.

    Points whose residuals along the epipolar lines exceed those across bias an exactly planar fit. It is then solved
    once more with relief, as for images.

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
        # a fit with relief takes many mismatches for noise
        if seen.off.any() and rough.noise <= exact.noise:
            return GivenSolution(rough, seen, emptied, unchecked)
    return GivenSolution(exact, flatness(exact, *given, joined.weight), emptied, unchecked)
