"""The checks, in the order in which their diagnostics are reported.

To add a diagnostic: a function in the file of its subject, its name here, a row in `codes`, a test.
"""

from __future__ import annotations

from slopecli.findings import level_checks, metadata_checks, pair_checks, parallax, plane_checks, solution_checks
from slopecli.findings.facts import AnswerFacts, PairFacts
from slopecli.types import Diagnostic

PAIR_CHECKS = (
    pair_checks.mirrored,
    pair_checks.cameras_as_made,
    pair_checks.image_notes,
    metadata_checks.metadata_taken,
    pair_checks.stands_still,
    pair_checks.contradicting_matches,
    parallax.low_parallax,
    pair_checks.lens_distortion,
)
ANSWER_CHECKS = (
    metadata_checks.contradicted,
    level_checks.level_assumed,
    level_checks.pitch_mirrored,
    plane_checks.on_no_plane,
    plane_checks.changed_areas,
    solution_checks.one_plane,
    solution_checks.straight_descent,
    plane_checks.upside_down,
    plane_checks.partly_matched,
    parallax.parallax_for_tolerance,
    plane_checks.focus_of_expansion_in_plane,
    plane_checks.not_planar,
    solution_checks.second_root,
    metadata_checks.root_stated,
    solution_checks.large_residuals,
    solution_checks.not_converged,
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
