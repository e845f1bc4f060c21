"""From joined patches to an answer: the joint solution, known motions, the test of the cameras, merged patches."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from slopecli.findings.camera_test import Cameras, CameraTest, examine_cameras, suspicion
from slopecli.findings.given_checks import refuse_unrelated, review
from slopecli.findings.known_motion import contradiction, motion_prior
from slopecli.findings.solution_checks import POOR_FIT_PX, merged_groups
from slopecli.geometry.motion import MotionEstimate
from slopecli.geometry.solver.intrinsics import Settled
from slopecli.geometry.statistics import median
from slopecli.look.scene import Scene
from slopecli.options import Options
from slopecli.patches.given import settling_rows, solve_given
from slopecli.patches.join import Joined, merge_patches, solve_jointly
from slopecli.patches.settling import set_aside_unsettled
from slopecli.types import Diagnostic, Solution


@dataclass(frozen=True, eq=False)
class Answer:
    """A solution with what it was computed from and what a user should know of it.

    cameras : those it was solved with.  test : what the images say of the focal length.
    """

    joined: Joined
    solution: Solution
    cameras: Cameras
    diagnostics: list[Diagnostic]
    test: CameraTest


def solve_scene(
    joined: Joined, scene: Scene, motions: list[MotionEstimate], known: list[Diagnostic], options: Options
) -> Answer:
    """Solve the patches of a scene jointly; known: diagnostics so far."""
    cameras = scene.camera1, scene.camera2
    joined, solution, against_prior = _solve_settled(joined, scene, motions, options)
    test = examine_cameras(joined, solution, cameras, scene)
    notes = suspicion(test, joined, solution, options, partial(_solve_scene_again, scene, options), known)
    joined, solution, merged = _merge_coplanar(joined, solution, options)
    return Answer(joined, solution, cameras, [*notes, *against_prior, *merged], test)


def _solve_settled(
    joined: Joined, scene: Scene, motions: list[MotionEstimate], options: Options
) -> tuple[Joined, Solution, list[Diagnostic]]:
    """The joint solution of all patches but those that keep it from settling, see `set_aside_unsettled`."""

    def solve_patches(some: Joined) -> tuple[Solution, list[Diagnostic]]:
        return _solve_with_prior(some, scene, motions, options)

    solution, diagnostics = solve_patches(joined)
    if options.solver != "mle":
        return joined, solution, diagnostics
    most_noise = POOR_FIT_PX / scene.camera2.focal_px * float(np.sqrt(median(joined.weight)))
    rest = set_aside_unsettled(joined, solution, lambda some: solve_patches(some)[0], most_noise)
    return (joined, solution, diagnostics) if rest is joined else (rest, *solve_patches(rest))


def _solve_scene_again(scene: Scene, options: Options, joined: Joined, cameras: Cameras, start: Settled) -> Solution:
    """Solve the matches of a scene as seen by other cameras, from a motion under these."""
    scene = replace(scene, camera1=cameras[0], camera2=cameras[1], R=start.R, T=start.T)
    motion = MotionEstimate(start.R, start.T, start.noise, cost=0.0, front=1.0)
    return _solve_with_prior(joined, scene, [motion], options)[0]


def _solve_with_prior(
    joined: Joined, scene: Scene, motions: list[MotionEstimate], options: Options
) -> tuple[Solution, list[Diagnostic]]:
    """Solve all patches jointly, with the prior; if the matches contradict it, a diagnostic says so.

    The solution is then without the prior, or with it and a larger sigma of the matches (`noise_factor`).
    """
    prior = motion_prior(options)
    solve_patches = partial(solve_jointly, joined, scene, motions, options.solver)
    solution = solve_patches(prior)
    against = prior and contradiction(prior, solution, solve_patches, scene.camera2.focal_px, options)
    if not against:
        return solution, []
    factor = against.noise_factor
    return solve_patches(prior, factor) if factor else solve_patches(), [against.diagnostic]


def solve_rows(joined: Joined, cameras: Cameras, noise: float | None, options: Options) -> Answer:
    """Solve a user's own correspondences; noise: 1-sigma of a coordinate in image 2, normalised, or None.

    Raises
    ------
    DegenerateConfiguration, NoAnswer : too few rows, no parallax, or no motion explains the rows.
    """
    prior = motion_prior(options)
    # joint solution, with the known motion unless the rows contradict it
    solved, diagnostics = solve_given(joined, options.solver, noise, prior), list[Diagnostic]()
    rest = settling_rows(joined, solved, options.solver, noise, prior)
    alone = partial(solve_given, rest, options.solver, noise)
    if rest is not joined:
        joined, solved = rest, alone(prior)
    if prior and (against := contradiction(prior, solved.solution, lambda: alone().solution, None, options)):
        solved, diagnostics = alone(), [against.diagnostic]

    # whether the rows of each patch are on one plane
    refuse_unrelated(solved.solution, joined, cameras[1])
    joined, notes = review(solved, joined, noise, *cameras)
    test = examine_cameras(joined, solved.solution, cameras)
    again = partial(_solve_rows_again, options)
    diagnostics = suspicion(test, joined, solved.solution, options, again, diagnostics)
    joined, solution, merged = _merge_coplanar(joined, solved.solution, options)
    return Answer(joined, solution, cameras, [*diagnostics, *notes, *merged], test)


def _solve_rows_again(options: Options, joined: Joined, cameras: Cameras, start: Settled) -> Solution:
    """Solve correspondences as seen by other cameras; their noise is estimated, as a given one holds for the right."""
    return solve_given(joined, options.solver, None, motion_prior(options)).solution


def _merge_coplanar(joined: Joined, solution: Solution, options: Options) -> tuple[Joined, Solution, list[Diagnostic]]:
    """Solve again with one plane, or one normal, for patches that are coplanar or parallel; one diagnostic a group.

    Nothing changes without the option `merge_coplanar`.
    """
    if not options.merge_coplanar:
        return joined, solution, []
    joined, solution, groups = merge_patches(joined, solution)
    return joined, solution, merged_groups(groups)
