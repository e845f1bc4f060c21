"""The procedure from two images and their cameras, or from correspondences, to slopes: the stages in order."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from slopecli.errors import NoAnswer, expect
from slopecli.findings.camera_test import Cameras
from slopecli.findings.checks import check_pair
from slopecli.findings.facts import PairFacts
from slopecli.findings.focal_use import refocused
from slopecli.findings.pair_checks import refuse_identical, refuse_mirrored, refuse_unmatched
from slopecli.findings.wording import forbidding
from slopecli.geometry.statistics import median
from slopecli.look.changes import Change, find_changes
from slopecli.look.features import FeatureMemory, Images
from slopecli.look.scene import Scene
from slopecli.look.scene_from_images import FINE, find_scene, focal_by_features
from slopecli.look.standing_still import find_still, without_still
from slopecli.measure import up_sigma_rad
from slopecli.options import MapOptions, Options
from slopecli.patches import PLANE_FINDERS
from slopecli.patches.given import RAYS, Given, join_rows
from slopecli.patches.join import Joined, join_patches
from slopecli.patches.windows.dense_planes import rough_windows, with_dense_planes, with_steps
from slopecli.patches.windows.many_windows import answer_together, many_windows
from slopecli.patches.windows.window_finder import wanted_windows
from slopecli.report.build import build_report
from slopecli.solving import Answer, is_no_better, solve_rows, solve_scene
from slopecli.types import Camera, Image, ImageInfo, Report, Solution

if TYPE_CHECKING:
    from slopecli.ground.map_task import MapTask
    from slopecli.ground.slope_map import SlopeMap
    from slopecli.sequence.frame import Frame, SequenceAnswer, SequenceStep
    from slopecli.sequence.stream import Sequence

LOGGER = logging.getLogger("slopecli")
Pair = tuple[Image, Image]
OnStage = Callable[[str, float], None]  # called with the name of a stage and its processor time, s


def estimate(
    image1: Image,
    image2: Image,
    camera1: Camera,
    camera2: Camera,
    options: Options,
    *,
    memory: FeatureMemory | None = None,
    on_stage: OnStage | None = None,
) -> Report:
    """Slope of every window, or of every plane found in image 1, with its uncertainty.

    Parameters
    ----------
    image1, image2 : not undistorted, of the cameras' sizes.  options : their windows are in px of image 1.
    memory : cache of SIFT features, for pairs that share images.  on_stage : see `OnStage`.

    Raises
    ------
    InputError : a window is not inside image 1.
    NoAnswer : the pair has no solution (no overlap, texture or parallax, pure rotation), with reason and remedy.
    """
    return _estimated((image1, image2), (camera1, camera2), options, memory, _Clock(on_stage), dense=True)[0]


def slope_map(
    image1: Image,
    image2: Image,
    camera1: Camera,
    camera2: Camera,
    options: Options,
    wanted: MapOptions | None = None,
    *,
    memory: FeatureMemory | None = None,
    on_stage: OnStage | None = None,
) -> SlopeMap:
    """Slope, its uncertainty and the probability of being safe all over image 1, and landing sites.

    As in `estimate`, the windows of the options determine the motion; `SlopeMap.report` has planes through matches.

    Parameters
    ----------
    image1, image2, memory, on_stage : as for `estimate`.  wanted : size of the footprints, limits, sites.

    Raises
    ------
    InputError : a window is not inside image 1, or the pixels cannot serve the footprint or the limit of height.
    NoAnswer : the pair has no solution, with reason and remedy.
    """
    from slopecli.ground.map_task import build_map, sizes_of
    from slopecli.look.dense_depth import DEPTH, measure_depth

    clock = _Clock(on_stage)
    options, images, cameras = _with_largest_plane(options), (image1, image2), (camera1, camera2)
    report, answer, scene = _estimated(images, cameras, options, memory, clock, dense=False)
    scene = replace(scene, R=answer.solution.R, T=answer.solution.T)
    task = _map_task(scene, report, answer.joined, answer.solution, answer.focal_sigma, options, wanted)
    cells = sizes_of(task, min(1.0, DEPTH.most_pixels / image1.grey.size) ** 0.5)
    depth = measure_depth(scene, edges=True)  # planes of windows over boulders have twice the errors with it
    clock.tick("dense")
    result = build_map(depth, cells, task)
    clock.tick("ground")
    return result


def sequence(frames: Iterable[Frame], runner: Sequence, *, stop_when_settled: bool = False) -> Iterator[SequenceStep]:
    """The answer after every frame, one set of normals for all of them: slopes of windows of the first frame.

    Parameters
    ----------
    frames : of one camera, in the order in which they were taken; those that tell nothing are skipped.
    runner : takes in the frames; it has the answer at any moment, also when the loop is left.
    stop_when_settled : end when every window is safe or unsafe; the probability that any of these verdicts is wrong
        is at most 1 - confidence, see `SettlingTest`.
    """
    from slopecli.sequence.frame import SequenceStep
    from slopecli.sequence.settling_test import SettlingTest

    test, last = SettlingTest(len(runner.windows), runner.options.confidence), None
    for frame in frames:
        # gates, tracking, one more view in the joint solution
        state = runner.take(frame)

        # slopes, verdicts and findings of the answer so far
        told = state.status == "used" and (not state.later or runner.carries)
        report = runner.report_or_none() if told else None
        settled = test.settled if report is None else test.look(report)
        last = report or last
        motion = None if report is None else report.motion
        if state.later and last is not None:
            motion = runner.motions(last)[-1].motion
        yield SequenceStep(state, report, dict(settled), motion)
        if stop_when_settled and test.complete:
            return


def sequence_answer(runner: Sequence) -> SequenceAnswer:
    """The answer after `sequence`: rough windows with planes through all pixels, by the depth that all frames tell.

    runner : made with `keep_depth`; else its planes are those through the points tracked, as after every frame.

    Raises
    ------
    NoAnswer : there is none, with the reason for which the last frame was skipped.
    """
    if not runner.has_depth:
        return runner.answer()
    report, joined, solution = runner.reported(runner.images)
    if len(rough_windows(joined, solution, runner.camera)):
        report = runner.reported(runner.images, runner.fused(FINE.max_pixels).depth).report
    return runner.answer(report)


def sequence_map(runner: Sequence, wanted: MapOptions | None = None) -> SlopeMap:
    """The map of the ground of the first frame from the depth of all, after `sequence`.

    Parameters
    ----------
    runner : made with `keep_depth`.  wanted : as for `slope_map`.

    Raises
    ------
    InputError, NoAnswer : there is no answer, or the pixels cannot serve what is wanted.
    """
    from slopecli.ground.map_task import build_map, sizes_of

    fused = runner.fused()
    report, joined, solution = runner.reported(runner.images, fused.depth)
    task = _map_task(fused.scene, report, joined, solution, runner.focal_sigma, runner.options_now, wanted)
    return build_map(fused.depth, sizes_of(task, fused.depth.grid.mean_scale), task)


def _map_task(
    scene: Scene,
    report: Report,
    joined: Joined,
    solution: Solution,
    focal_sigma: float,
    options: Options,
    wanted: MapOptions | None,
) -> MapTask:
    """What a map is made of, under the motion of a solution, and under the second one if it is not ruled out."""
    from slopecli.ground.map_task import MapTask
    from slopecli.ground.tilt_uncertainty import Root

    other = solution.ambiguity.alternative if solution.ambiguity.status == "unresolved" else None
    return MapTask(
        scene=scene,
        report=report,
        roots=[Root.of(root, focal_sigma, (scene.camera1, scene.camera2)) for root in (solution, other) if root],
        up_sigma_rad=up_sigma_rad(report, joined, solution),
        forbidden=forbidding(report.diagnostics),
        options=options,
        wanted=wanted or MapOptions(),
    )


def _with_largest_plane(options: Options) -> Options:
    """Options that find planes in the image where the largest is to be level, as windows may lie across several."""
    sought = options.up == "dominant-plane" and options.planes == "windows"
    return replace(options, planes="ransac") if sought else options


def _estimated(
    images: Pair, cameras: Cameras, options: Options, memory: FeatureMemory | None, clock: _Clock, *, dense: bool
) -> tuple[Report, Answer, Scene]:
    """The report of a pair, with the answer and the scene that it comes from.

    dense : whether windows over rough ground are to have the planes through all their pixels.
    """
    refuse_identical(*images)
    windows = many_windows(options, images[0].width, images[0].height) if dense else []
    solved = replace(options, windows=(), grid=Options().grid) if windows else options
    if options.free_focal:
        answer, changes, scene = _answer_freed(images, cameras, solved, memory, clock)
    else:
        answer, changes, scene = _answer(images, cameras, cameras, solved, memory, clock)
    scene = replace(scene, camera1=answer.cameras[0], camera2=answer.cameras[1])
    if dense:
        pair = answer.joined, answer.solution, scene, answer.focal_sigma
        joined, solution = answer_together(windows, *pair) if windows else with_dense_planes(*pair)
        answer = replace(answer, joined=joined, solution=solution)
        clock.tick("dense windows")

    # slopes, verdicts and findings
    def reported(joined: Joined) -> Report:
        test, said = answer.test, answer.diagnostics
        return build_report(images, answer.cameras, options, joined, answer.solution, said, changes, test)

    report = reported(answer.joined)
    joined = with_steps(answer.joined, answer.solution, scene, report.planes) if dense else answer.joined
    if joined is not answer.joined:
        answer, report = replace(answer, joined=joined), reported(joined)
    clock.tick("report")
    return report, answer, scene


def _answer_freed(
    images: Pair, given: Cameras, options: Options, memory: FeatureMemory | None, clock: _Clock
) -> tuple[Answer, list[Change], Scene]:
    """As `_answer`, with the focal length that the images prefer; the one given stays where they do not tell it."""
    found, answer_by = None, partial(_answer, images, given=given, options=options, memory=memory, clock=clock)
    if step := focal_by_features(Images(images[0].grey, images[1].grey, *given), memory, options.seed):
        with suppress(NoAnswer):
            found = answer_by(refocused(given, step))
    if found is None or found[0].test.focal_factor is None:
        by_given = answer_by(given)
        found = found if found and by_given[0].noisier(found[0]) else by_given
    for _ in range(2):  # far off, the second time is off by a few percent of that
        answer, _, scene = found
        off = abs(answer.cameras[0].focal_px / scene.camera1.focal_px - 1.0)
        if off <= answer.test.sigma or is_no_better((again := answer_by(answer.cameras))[0], answer, off):
            break
        found = again
    return found


def _answer(
    images: Pair, cameras: Cameras, given: Cameras, options: Options, memory: FeatureMemory | None, clock: _Clock
) -> tuple[Answer, list[Change], Scene]:
    """The answer for a pair, and what changed between its images; given: the cameras, if another focal length is used.

    Images are matched under the cameras, so this is done again where the focal length turns out to be another.
    """
    windows = wanted_windows(options, images[0].width, images[0].height)
    greys = images[0].grey, images[1].grey

    # matches of the whole images, sparse and then dense: the scene, and the motions that may explain it. What stands
    # still in both is no ground
    still = find_still(*greys)
    grey1, grey2 = (without_still(grey, still) for grey in greys)
    scene, motions = find_scene(
        grey1, grey2, *cameras, options, windows, check_sparse=refuse_unmatched, memory=memory, on_lap=clock.lap
    )
    scene = replace(scene, still=still)
    diagnostics = check_pair(PairFacts(images, scene, motions[0].scale * cameras[1].focal_px, options))
    changes = find_changes(scene)
    clock.tick("overview")

    # patches: parts of image 1 held to be planar, each with its own matches
    found = PLANE_FINDERS[options.planes](scene, options)
    clock.tick(options.planes)

    # joint solution: one motion for all patches, and one scaled normal for each; and what it says of the cameras
    answer = solve_scene(join_patches(found, scene), scene, motions, diagnostics, options, given)
    clock.tick("solve")
    return answer, changes, scene


def solve(given: Given, cameras: tuple[Camera, Camera] | None, options: Options, noise: float | None = None) -> Report:
    """Slope of every plane that a user's own correspondences lie on.

    Parameters
    ----------
    given : correspondences, px or, without cameras, rays (normalised coordinates).  cameras : None for rays.
    options : those of images and of finders have no effect.
    noise : 1-sigma of a coordinate in image 2, px or mrad; None takes that of `given`, or estimates it from residuals.

    Raises
    ------
    InputError : no patch has three rows that are not on one line, or rows without cameras are no rays.
    DegenerateConfiguration, NoAnswer : too few rows, no parallax, a mirrored image, or no motion explains the rows.
    """
    expect("given", given, Given, "as read_correspondences returns it")
    both, options = cameras or (RAYS, RAYS), replace(options, planes=str(given.options.get("planes", "one")))
    joined = join_rows(given, both)
    refuse_mirrored(joined.matches.x1, joined.matches.x2, joined.plane)
    sigma = median(given.sigma) if noise is None and given.sigma is not None else noise
    sigma_rad = None if sigma is None else sigma * (1e-3 if cameras is None else 1.0 / both[1].focal_px)
    answer = solve_rows(joined, both, sigma_rad, options)
    image1, image2 = (
        ImageInfo(path, c.width or None, c.height or None, given.sha256)
        for path, c in zip(given.paths, both, strict=True)
    )
    report = build_report(
        (image1, image2), answer.cameras, options, answer.joined, answer.solution, answer.diagnostics, test=answer.test
    )
    return replace(report, options={**report.options, **given.options, "noise": noise})


class _Clock:
    """Processor time of every stage, reported to `on_stage` and to the logger "slopecli" at level DEBUG."""

    def __init__(self, on_stage: OnStage | None) -> None:
        self._on_stage = on_stage
        self._last = time.process_time()
        self._spent: dict[str, float] = {}

    def lap(self, name: str) -> None:
        """Add the time since the last call of `lap` or `tick` to a stage; reported at the next `tick`."""
        now = time.process_time()
        self._spent[name] = self._spent.get(name, 0.0) + now - self._last
        self._last = now

    def tick(self, name: str) -> None:
        """Add the time to a stage as `lap` does, then report every stage that has some and start from zero."""
        self.lap(name)
        for stage, seconds in self._spent.items():
            LOGGER.debug("%s: %.3f s", stage, seconds)
            if self._on_stage is not None:
                self._on_stage(stage, seconds)
        self._spent = {}
