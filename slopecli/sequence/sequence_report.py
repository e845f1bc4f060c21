"""The report of a sequence: the first frame and the last one as a pair, with the normals of all frames."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from slopecli.geometry.camera import pixels_from_rays
from slopecli.geometry.solver.views import predict_views
from slopecli.look.dense_depth import DenseDepth
from slopecli.look.matches import LEAST_MATCHES, Evidence, Matches
from slopecli.options import Options
from slopecli.patches.join import Joined
from slopecli.patches.patch import Patch
from slopecli.patches.windows.dense_planes import with_planes_of_depth
from slopecli.patches.windows.unmatched_parts import gaps_of, unseen_rad
from slopecli.patches.windows.window_finder import window_patch
from slopecli.report.build import build_report
from slopecli.sequence.known_camera import KnownCamera
from slopecli.sequence.shared_errors import off_planes_shown
from slopecli.sequence.view_estimator import ViewEstimator
from slopecli.solving import with_focal_uncertainty
from slopecli.types import BoolArray, Camera, Diagnostic, FloatArray, Image, ImageInfo, Plane, Report, Solution
from slopecli.windows import Window


def joined_of(
    estimator: ViewEstimator, windows: list[Window], camera: Camera, *, shown_only: bool = False
) -> tuple[Joined, BoolArray]:
    """The windows with their points as the last view shows them, and (m,) which windows have enough of them.

    A point that an earlier view alone showed is where its depth puts it in the last one, or left out (`shown_only`).
    """
    tracks, line = estimator.tracks, estimator.best
    state = line.root.state
    known = estimator.alive & (line.root.system.V > 0.0) & (state.u > 0.0)
    x2 = predict_views(tracks.p, state.R[-1:], state.T[-1:], state.u)[0][0]
    shown = line.points.weight[-1] > 0.0
    if shown_only:
        known = known & shown
    x2 = np.where(shown, line.points.x[-1], x2)
    uv2 = pixels_from_rays(camera, x2.T)
    every = Matches(tracks.uv, uv2, tracks.p[:2].T, x2.T)
    baseline = float(np.linalg.norm(state.T[-1]))
    evidence = None if shown_only else evidence_of(every, state.u, known, camera, baseline)
    off = off_planes_shown(line.points, line.root)
    patches = [_patch(estimator, every, evidence, known, off, window, i) for i, window in enumerate(windows)]
    outside = every.take(known & (tracks.patch < 0))
    joined = Joined.of(patches, outside, np.ones(len(outside)))
    return joined, np.array([patch.origin == "own" for patch in patches])


def evidence_of(every: Matches, u: FloatArray, known: BoolArray, camera: Camera, baseline: float) -> Evidence:
    """All points known, as evidence of how the ground bends from one part to the next."""
    leverage = np.full(len(u), baseline)
    kept = every.take(known)
    blank = np.zeros(len(kept))
    return Evidence(
        *(kept.uv1, kept.uv2, kept.x1, kept.x2), u[known], leverage[known], blank, camera.focal_px, n_given=len(u)
    )


def _patch(
    estimator: ViewEstimator,
    every: Matches,
    evidence: Evidence | None,
    known: BoolArray,
    off: BoolArray,
    window: Window,
    i: int,
) -> Patch:
    """Window number i (from 0) with its points; its tilt sigma allows for the part that only the first frame shows.

    evidence : of the known points, None if that part is not to count.
    known, off (n,) : points of known inverse depth, and those that views show off their planes.
    """
    tracks, blank = estimator.tracks, window_patch(window, i + 1)
    own = known & (tracks.patch == i)
    n = int(np.count_nonzero(own))
    if n < LEAST_MATCHES:
        return blank.unmatched(f"{n} of its points could be tracked, at least {LEAST_MATCHES} are needed")
    share = min(n / max(int(tracks.cells[i]), 1), 1.0)
    unseen = 0.0
    if evidence is not None and share < 0.98:
        relief_px = float(estimator.best.root.relief[i]) * evidence.focal_px
        unseen = unseen_rad(gaps_of(window, tracks.uv[own], share), relief_px, evidence)
    return replace(
        blank,
        matches=every.take(own),
        weight=np.ones(n),
        cell=tracks.cell[own],
        origin="own",
        score=1.0,
        share=share,
        left_out=float(off[tracks.patch == i].sum() / (own | (off & (tracks.patch == i))).sum()),
        tilt_sigma_rad=unseen,
        unmatched_sigma_rad=unseen,
    )


class Reported(NamedTuple):
    """A report, with the matches and the solution that it comes from: the pair of the first frame and the last."""

    report: Report
    joined: Joined
    solution: Solution


def report_of(
    estimator: ViewEstimator,
    solution: Solution,
    windows: list[Window],
    images: tuple[Image | ImageInfo, Image | ImageInfo],
    camera: KnownCamera,
    options: Options,
    diagnostics: list[Diagnostic],
    length: float,
    depth: DenseDepth | None = None,
) -> Reported:
    """The report of the answer so far; lengths are in metres, or in baselines of the first move.

    solution : of the first frame and the last one that the estimator took in, of all windows.  length : its baseline.
    depth : of every pixel, for planes of rough windows through all of them; None for those through the points.

    Raises
    ------
    NoAnswer : no window has a slope that is known.
    """
    joined, enough = joined_of(estimator, windows, camera.used)
    solution = _chosen(solution, enough, joined)
    if camera.focal_sigma:
        solution = with_focal_uncertainty(solution, joined, camera.both, camera.focal_sigma, options)
    if depth is not None:
        # sigmas of the points hold what ground between them adds, so the surer plane is taken
        joined, solution = with_planes_of_depth(depth, joined, solution, camera.both, camera.focal_sigma, 1.0)
    if options.baseline_m is not None:
        options = replace(options, baseline_m=options.baseline_m * length)
    diagnostics = [*camera.notes(options), *diagnostics]
    report = build_report(images, camera.both, options, joined, solution, diagnostics, test=camera.test)
    report = in_first_baselines(report, length) if report.scale.unit == "baseline" else report
    return Reported(report, joined, solution)


def tested_by_last_view(
    camera: KnownCamera, estimator: ViewEstimator, windows: list[Window], options: Options
) -> KnownCamera:
    """The camera after its test by the points that the last view shows; as it was where it shows too few."""
    joined, enough = joined_of(estimator, windows, camera.used, shown_only=True)
    pair = estimator.solution().pair()
    if not enough.any():
        return camera
    baseline = float(np.linalg.norm(estimator.motion[1]))
    return camera.tested_by(joined, _chosen(pair, enough, joined), baseline, options)


def _chosen(solution: Solution, enough: BoolArray, joined: Joined) -> Solution:
    """The solution of the windows that have enough points, its residuals in the order of the joined matches."""
    kept = np.flatnonzero(enough)
    rows = (3 * kept[:, None] + np.arange(3)).ravel()
    other = solution.ambiguity.alternative
    n = len(joined.matches)
    joint = solution.joint_normals
    return replace(
        solution,
        scaled_normals=solution.scaled_normals[kept],
        normal_covariance=solution.normal_covariance[kept],
        normal_gain=solution.normal_gain[kept],
        relief=solution.relief[kept],
        joint_normals=None if joint is None else joint[np.ix_(rows, rows)],
        inlier=np.ones(n, bool),
        ambiguity=replace(solution.ambiguity, alternative=None if other is None else _chosen(other, enough, joined)),
    )


def in_first_baselines(report: Report, length: float) -> Report:
    """A report in baselines of the pair with its lengths in baselines of the first move, `length` to one."""

    def longer(plane: Plane) -> Plane:
        return replace(plane, distance=plane.distance * length)

    motion = replace(report.motion, baseline_cam1=report.motion.baseline_cam1 * length)
    other = report.ambiguity.alternative
    if other is not None:
        moved = replace(other.motion, baseline_cam1=other.motion.baseline_cam1 * length)
        planes = tuple(replace(plane, distance=plane.distance * length) for plane in other.planes)
        other = replace(other, motion=moved, planes=planes)
    return replace(
        report,
        motion=motion,
        planes=tuple(longer(plane) for plane in report.planes),
        ambiguity=replace(report.ambiguity, alternative=other),
    )
