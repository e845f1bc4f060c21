"""Checks of the joint solution: its residuals, its convergence, and the part the solver has in them."""

from __future__ import annotations

from slopecli.findings.facts import AnswerFacts
from slopecli.findings.wording import finding
from slopecli.types import Diagnostic, Solution

POOR_FIT_PX = 0.5  # noise of matches beyond which the cameras or the images are suspect


def solver_remedy(solution: Solution) -> str:
    """What to do about large residuals that are due to the solver; "" where they are those of the matches."""
    if solution.solver == "lh" or (solution.solver == "ha" and not solution.converged):
        return f"--solver {solution.solver} does not minimise residuals; use mle"
    return ""


def large_residuals(facts: AnswerFacts) -> list[Diagnostic]:
    """Residuals larger than matching noise."""
    noise_px = facts.noise_px
    if not noise_px > POOR_FIT_PX:  # NaN without a camera
        return []
    if remedy := solver_remedy(facts.solution):
        message = f"residuals of the matches are {noise_px:.2f} px, due to the solver or to the matches"
        return [finding("poor-fit", message, noise_px, remedy)]
    message = f"matches miss their epipolar lines by {noise_px:.2f} px, good pairs by less than {POOR_FIT_PX:g} px"
    remedy = "check the camera file and its distortion; blur, a rolling shutter and moving things do the same"
    return [finding("poor-fit", message, noise_px, remedy)]


def not_converged(facts: AnswerFacts) -> list[Diagnostic]:
    """A joint solution that did not converge."""
    if facts.solution.converged:
        return []
    return [finding("poor-fit", "the joint solution did not converge", remedy=solver_remedy(facts.solution))]
