"""The checks, in the order in which their diagnostics are reported.

To add a diagnostic: a function in the file of its subject, its name here, a row in `codes.CODES`, a test.
"""

from __future__ import annotations

from slopecli.findings.changed_areas import changed_areas, on_no_plane
from slopecli.findings.facts import AnswerFacts, PairFacts
from slopecli.findings.fit_checks import large_residuals, not_converged
from slopecli.findings.flat_scene import one_plane, second_root, straight_descent
from slopecli.findings.pair_checks import contradicting_matches, image_notes, lens_distortion, mirrored
from slopecli.findings.parallax import low_parallax, parallax_for_tolerance
from slopecli.findings.partly_matched import hidden_parts, steps_and_objects
from slopecli.findings.plane_checks import focus_of_expansion_in_plane, not_planar, upside_down
from slopecli.types import Diagnostic

PAIR_CHECKS = (mirrored, image_notes, contradicting_matches, low_parallax, lens_distortion)
ANSWER_CHECKS = (
    on_no_plane,
    changed_areas,
    one_plane,
    straight_descent,
    upside_down,
    steps_and_objects,
    hidden_parts,
    parallax_for_tolerance,
    focus_of_expansion_in_plane,
    not_planar,
    second_root,
    large_residuals,
    not_converged,
)


def check_pair(pair: PairFacts) -> list[Diagnostic]:
    """What a user should know of a pair before its planes are found.

    Raises
    ------
    NoAnswer : the pair cannot tell any slope (mirrored, no common motion, no parallax), with reason and remedy.
    """
    return [found for check in PAIR_CHECKS for found in check(pair)]


def check_answer(facts: AnswerFacts) -> list[Diagnostic]:
    """What a user should know of the planes and of the solution they come from."""
    return [found for check in ANSWER_CHECKS for found in check(facts)]
