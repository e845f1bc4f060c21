"""From joined patches to an answer: the joint solution, known motions, the test of the cameras, merged patches."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np

from slopecli.errors import DegenerateConfiguration, SlopemapError
from slopecli.findings.camera_checks import with_aspect
from slopecli.findings.camera_suspicion import Again, suspicion
from slopecli.findings.camera_test import TEST, Cameras, CameraTest, examine_cameras
from slopecli.findings.focal_use import focal_note, focal_to_use, prior_sigma, refocused
from slopecli.findings.given_checks import refuse_unrelated, review
from slopecli.findings.known_motion import contradiction, motion_prior
from slopecli.findings.solution_checks import POOR_FIT_PX, merged_groups
from slopecli.geometry.motion import MotionEstimate
from slopecli.geometry.solver.free_camera import FOCAL_STEPS
from slopecli.geometry.solver.intrinsics import Settled, score_camera, with_focal_sigma
from slopecli.geometry.solver.scatter import with_scatter
from slopecli.geometry.statistics import CERTAIN_SIGMAS, median
from slopecli.look.scene import Scene
from slopecli.options import Options
from slopecli.patches.given import RAYS, settling_rows, solve_given
from slopecli.patches.join import Joined, merge_patches, solve_jointly
from slopecli.patches.settling import set_aside_unsettled
from slopecli.patches.sightings import every_sighting, seen_by, sightings_of
from slopecli.patches.windows.window_finder import join_widely
from slopecli.types import Diagnostic, Solution


@dataclass(frozen=True, eq=False)
class Answer:
    """A solution with what it was computed from and what a user should know of it.

    cameras : those it was solved with.  test : what the images say of the focal length.
    focal_sigma : relative 1-sigma of the focal length that the covariances of the solution hold.
    """

    joined: Joined
    solution: Solution
    cameras: Cameras
    diagnostics: list[Diagnostic]
    test: CameraTest
    focal_sigma: float

    def noisier(self, other: Answer) -> bool:
        """Whether the matches of this answer fit it clearly less well than those of another, in px, fit that."""
        noise_px, least_px = (answer.solution.noise * answer.cameras[1].focal_px for answer in (self, other))
        return noise_px > TEST.clearly * least_px


def is_no_better(again: Answer, before: Answer, off: float) -> bool:
    """Whether images matched again with a focal length that the images prefer tell it no better than before.

    off : share by which it is another than the one before. Under one far off, matches are too few for their noise to
    say so.
    """
    return off < FOCAL_STEPS[0] and again.noisier(before)


def solve_scene(
    joined: Joined,
    scene: Scene,
    motions: list[MotionEstimate],
    known: list[Diagnostic],
    options: Options,
    given: Cameras,
) -> Answer:
    """Solve the patches of a scene jointly.

    known : diagnostics so far.  given : cameras of the user, if those of the scene have another focal length.
    """
    cameras = scene.camera1, scene.camera2
    joined, solution, against_prior = _solve_settled(joined, scene, motions, options)
    test = examine_cameras(joined, solution, cameras, scene, free=options.free_focal)
    if options.free_focal and options.planes == "windows":
        wide = _examined_widely(solution, scene, options)
        test = wide if wide and not _differ(wide, test) else test
    answer = Answer(joined, solution, cameras, known, test, 0.0)
    answer = _with_focal(answer, given, options, partial(_solve_scene_again, scene, options))
    joined, solution = answer.joined, answer.solution
    solution = with_scatter(solution, sightings_of(joined, solution, answer.cameras))
    joined, solution, merged = _merge_coplanar(joined, solution, options)
    diagnostics = [*answer.diagnostics, *against_prior, *merged]
    return replace(answer, joined=joined, solution=solution, diagnostics=diagnostics)


def _differ(wide: CameraTest, own: CameraTest) -> bool:
    """Whether a focal length that is told to be far off is another one by windows all over.

    Matched under the wrong one, so many windows may come to fit it; near the right one they tell it better.
    """
    if own.focal_factor is None or abs(own.step) < FOCAL_STEPS[0]:
        return False
    return abs(wide.step - own.step) > CERTAIN_SIGMAS * float(np.hypot(wide.sigma, own.sigma))


def _examined_widely(solution: Solution, scene: Scene, options: Options) -> CameraTest | None:
    """The test of the cameras by windows all over image 1, which tell more than those asked for; None if they do not.

    solution : of those asked for, whose motion these start from.
    """
    cameras, wide = (scene.camera1, scene.camera2), join_widely(scene)
    if wide is None:
        return None
    try:
        solved = _solve_scene_again(scene, options, wide, cameras, Settled.of(solution))
    except SlopemapError:
        return None
    test = examine_cameras(wide, solved, cameras, scene, free=True, patches_tell=True)
    return test if test.focal_factor is not None else None


def _with_focal(answer: Answer, given: Cameras, options: Options, again: Again) -> Answer:
    """The answer with the focal length that is to be used and its uncertainty, and with a suspicion of the camera.

    given : cameras of the user.  again : solves the same matches as seen by other cameras.
    """
    joined, solution, cameras, test = answer.joined, answer.solution, answer.cameras, answer.test
    if cameras[1] is RAYS:
        return answer
    known = prior_sigma(given, options)
    freed = options.free_focal and test.focal_factor is not None
    doubted = contradicted(test, np.inf if freed else known)
    use = focal_to_use(test, known, options.free_focal, doubted)
    step = test.step + float(np.log(answer.cameras[0].focal_px / given[0].focal_px))
    notes = answer.diagnostics
    if doubted:
        notes = suspicion(test, joined, solution, options, again, notes)
    notes = with_aspect(notes, given[0])
    agreed = freed and abs(step) <= use.sigma
    cameras = given if agreed else refocused(cameras, use.step)
    if cameras is not answer.cameras:
        joined = seen_by(joined, cameras)
        solution = again(joined, cameras, test.start or Settled.of(solution))
    if use.sigma:
        solution = with_focal_uncertainty(solution, joined, cameras, use.sigma, options)
    preferred_px = given[0].focal_px * float(np.exp(step)) if agreed or (doubted and not options.free_focal) else None
    told = test.focal_factor is not None
    notes = [*notes, *focal_note(given, cameras, use.sigma, options, told, preferred_px)]
    return Answer(joined, solution, cameras, notes, replace(test, step=step, used=freed), use.sigma)


def contradicted(test: CameraTest, prior: float) -> bool:
    """Whether a test contradicts the camera; prior: relative 1-sigma to which its focal length is known, 0 if exact."""
    if prior == 0.0:
        return test.centre or test.suspect
    focal_agrees = abs(test.step) < CERTAIN_SIGMAS * np.hypot(test.sigma, prior)
    return test.centre or test.only_contradicted or not focal_agrees


def with_focal_uncertainty(
    solution: Solution, joined: Joined, cameras: Cameras, sigma: float, options: Options
) -> Solution:
    """The solution and its second root with the uncertainty of the focal length in their covariances."""
    prior, kept = motion_prior(options), sightings_of(joined, solution, cameras)

    def widened(root: Solution) -> Solution:
        """One root, with its covariances larger."""
        try:
            score = score_camera(kept, Settled.of(root), prior)
        except DegenerateConfiguration:  # three points of a plane that were kept lie on one line
            score = score_camera(every_sighting(joined, cameras, 1.0, None), Settled.of(root), prior)
        return with_focal_sigma(root, score, sigma)

    other = solution.ambiguity.alternative
    if other is not None:
        solution = replace(solution, ambiguity=replace(solution.ambiguity, alternative=widened(other)))
    return widened(solution)


def _solve_settled(
    joined: Joined, scene: Scene, motions: list[MotionEstimate], options: Options
) -> tuple[Joined, Solution, list[Diagnostic]]:
    """The joint solution of all patches but those that keep it from settling, see `set_aside_unsettled`."""

    @cache  # the last of those tried is the answer
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
    joined, notes = review(solved, joined, noise, *cameras, planes_found=options.planes == "found")
    test = examine_cameras(joined, solved.solution, cameras, free=options.free_focal)
    answer = Answer(joined, solved.solution, cameras, diagnostics, test, 0.0)
    answer = _with_focal(answer, cameras, options, partial(_solve_rows_again, options))
    joined, solution, merged = _merge_coplanar(answer.joined, answer.solution, options)
    return replace(answer, joined=joined, solution=solution, diagnostics=[*answer.diagnostics, *notes, *merged])


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
