"""Two images and their cameras in, slopes out: the whole line, top to bottom."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial

from slopecli.findings.checks import check_pair
from slopecli.findings.facts import PairFacts
from slopecli.findings.flat_scene import merged_groups
from slopecli.findings.given_checks import alike, refuse_unrelated, review
from slopecli.findings.known_motion import contradiction, motion_prior
from slopecli.findings.pair_checks import refuse_identical, refuse_mirrored, refuse_unmatched
from slopecli.geometry.statistics import median
from slopecli.look.changes import find_changes
from slopecli.look.features import FeatureMemory
from slopecli.look.scene_from_images import find_scene
from slopecli.options import Options
from slopecli.patches import PLANE_FINDERS
from slopecli.patches.given.given_solution import solve_given
from slopecli.patches.given.rows import RAYS, Given, join_rows
from slopecli.patches.join import join_patches, solve_jointly
from slopecli.patches.merge_coplanar import merge_patches
from slopecli.patches.windows.window_finder import wanted_windows
from slopecli.report.build import build_report
from slopecli.types import Camera, Diagnostic, Image, ImageInfo, Report

OnStage = Callable[[str, float], None]


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
    """Estimate the slope of every window, or of every plane found in image 1, with its uncertainty.

    Parameters
    ----------
    image1, image2 : images as stored (distorted), of the cameras' sizes.
    options : `Options`; windows in px of image 1.
    memory : of features, for a caller with many pairs that share images; the answer is the same without.
    on_stage : called with (name, seconds of processor time) after each stage.

    Returns
    -------
    report : `Report`, which slopes.json, the pictures and the table are made from; patches without an answer stand
        in `rejected`.

    Raises
    ------
    InputError : a window is not inside image 1.
    NoAnswer : the pair cannot tell (no overlap, no texture, no parallax, pure rotation), with reason and remedy.
    """
    clock = _Clock(on_stage)
    windows = wanted_windows(options, image1.width, image1.height)
    prior = motion_prior(options)
    refuse_identical(image1, image2)

    # sparse matches, then dense ones of the whole image: the scene, and the motions that may explain it
    greys = image1.grey, image2.grey
    scene, motions = find_scene(
        *greys, camera1, camera2, options, windows, check_sparse=refuse_unmatched, memory=memory, on_lap=clock.lap
    )
    diagnostics = check_pair(PairFacts((image1, image2), scene, motions[0].scale * camera2.focal_px, options))
    changes = find_changes(scene)
    clock.tick("overview")

    # patches held to be planes, each with its own matches
    found = PLANE_FINDERS[options.planes](scene, options)
    clock.tick(options.planes)

    # all patches together: one motion, one normal each, one epipolar geometry
    joined = join_patches(found, scene)
    solution = solve_jointly(joined, scene, motions, options.solver, prior)
    alone = partial(solve_jointly, joined, scene, motions, options.solver)
    if prior and (against := contradiction(prior, solution, alone, camera2.focal_px, options)):
        diagnostics.append(against.diagnostic)
        solution = alone(prior, against.noise_factor) if against.noise_factor else alone()
    if options.merge_coplanar:
        joined, solution, groups = merge_patches(joined, solution)
        diagnostics += merged_groups(groups)
    clock.tick("solve")

    report = build_report((image1, image2), (camera1, camera2), options, joined, solution, diagnostics, changes)
    clock.tick("report")
    return report


def solve(given: Given, cameras: tuple[Camera, Camera] | None, options: Options, noise: float | None = None) -> Report:
    """Estimate the slope of every plane that a user's own correspondences lie on.

    Parameters
    ----------
    given : correspondences, px of the cameras or, without cameras, rays; with their sigmas, if they have their own.
    options : `Options`; those of images and of finding planes have no say.
    noise : 1-sigma of a coordinate in image 2, px or, without cameras, mrad; None takes the correspondences' own, or
        what the residuals say.

    Raises
    ------
    InputError : no three rows off a line lie on one plane.
    DegenerateConfiguration, NoAnswer : there are too few correspondences, no parallax, a mirrored image, or rows that
        agree on no motion.
    """
    both = cameras or (RAYS, RAYS)
    prior, diagnostics = motion_prior(options), list[Diagnostic]()
    joined = join_rows(given, both)
    if alike(joined):
        refuse_mirrored(joined.matches.x1, joined.matches.x2)
    sigma = median(given.sigma) if noise is None and given.sigma is not None else noise
    sigma_rad = None if sigma is None else sigma * (1e-3 if cameras is None else 1.0 / both[1].focal_px)
    solved = solve_given(joined, options.solver, sigma_rad, prior)
    given_alone = partial(solve_given, joined, options.solver, sigma_rad)
    if prior and (found := contradiction(prior, solved.solution, lambda: given_alone().solution, None, options)):
        diagnostics.append(found.diagnostic)
        solved = given_alone()
    refuse_unrelated(solved.solution, joined, both[1])
    joined, notes = review(solved, joined, sigma_rad, both[1])
    diagnostics += notes
    solution = solved.solution
    if options.merge_coplanar:
        joined, solution, groups = merge_patches(joined, solution)
        diagnostics += merged_groups(groups)
    image1, image2 = (ImageInfo(given.path, c.width or None, c.height or None, given.sha256) for c in both)
    report = build_report((image1, image2), both, options, joined, solution, diagnostics)
    return replace(report, options={**report.options, "noise": noise})


class _Clock:
    """Processor time between ticks, for whoever listens."""

    def __init__(self, on_stage: OnStage | None) -> None:
        self._on_stage = on_stage
        self._last = time.process_time()
        self._spent: dict[str, float] = {}

    def lap(self, name: str) -> None:
        """Count the time since the last call for a stage that may not be over."""
        now = time.process_time()
        self._spent[name] = self._spent.get(name, 0.0) + now - self._last
        self._last = now

    def tick(self, name: str) -> None:
        """End a stage, and those counted before it."""
        self.lap(name)
        if self._on_stage is not None:
            for stage, seconds in self._spent.items():
                self._on_stage(stage, seconds)
        self._spent = {}
