"""Two images and their cameras in, slopes out: the whole line, top to bottom."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from slopecli.diagnosis import check_parallax, parallax_px, refuse_identical, refuse_unmatched
from slopecli.errors import NoAnswer
from slopecli.geometry.camera import rays_from_pixels
from slopecli.geometry.motion import MotionEstimate, assess_motion, epipolar_residual, refine_motion
from slopecli.geometry.solve import solve_planes
from slopecli.options import Options
from slopecli.planes.corners import match_window_corners
from slopecli.planes.evidence import Evidence, gather_evidence, scene_planes
from slopecli.planes.matching import match_window
from slopecli.planes.scene import Scene
from slopecli.planes.window_match import WindowMatch
from slopecli.planes.windows import Window, check_windows, grid_windows
from slopecli.report import Matched, build_report
from slopecli.types import BoolArray, Camera, Correspondences, Diagnostic, FloatArray, Image, Report, Solution
from slopecli.vision.features import EFFORTS, Grey, match_sift, shrink
from slopecli.vision.foerstner import match_foerstner
from slopecli.vision.overview import MAX_PIXELS, overview_cells
from slopecli.vision.sampling import correlation_gain, sample_grey, thin
from slopecli.vision.starts import distinct_motions, inliers_of, rank_motions, starting_motions
from slopecli.vision.warp import Layer, Pyramid

OnStage = Callable[[str, float], None]
FeatureMatcher = Callable[[Grey, Grey], tuple[FloatArray, FloatArray, tuple[int, int]]]

# what `--features` names: matchers of whole images, tried in turn, and the matcher of a window
SIFT_MATCHERS: tuple[FeatureMatcher, ...] = tuple(partial(match_sift, effort=effort) for effort in EFFORTS)
FEATURE_MATCHERS: dict[str, tuple[FeatureMatcher, ...]] = {"sift": SIFT_MATCHERS, "foerstner": (match_foerstner,)}
WINDOW_MATCHERS: dict[str, Callable[[Window, Scene], WindowMatch]] = {
    "sift": match_window,
    "foerstner": match_window_corners,
}

ENOUGH_INLIERS, ENOUGH_SHARE = 300, 0.7  # sparse matches that need no second, costlier look
DENSE_SIGMA_PX = (0.02, 0.7)
OUTSIDE_POINTS = 1500  # matches outside the windows that join the solution: more add time, not accuracy
OUTSIDE_SIGMA_PX = 0.10  # of a cell of the overview, px of its working grid
ENOUGH_CELLS = 500  # of the overview: then the coarser sparse matches, mismatches among them, are left out
SYSTEMATIC_PX = 0.02  # RMS misfit that lens models, interpolation and shading leave in the best of pairs
REFERENCE_PX = 0.05  # weights are relative to a match this good


@dataclass(frozen=True, eq=False)
class Sparse:
    """Sparse matches, mismatches among them, and the motions they allow, best first."""

    matches: Matches
    motions: list[MotionEstimate]

    def rivals(self) -> list[MotionEstimate]:
        """Motions that the sparse matches hardly tell from the best."""
        return [m for m in self.motions if m.cost <= RIVAL_COST * self.motions[0].cost][:MAX_RIVALS]


@dataclass(frozen=True, eq=False)
class Matches:
    """Sparse matches uv1 -> uv2 (n, 2) px, and as normalised coordinates x1, x2; features found in each image."""

    uv1: FloatArray
    uv2: FloatArray
    x1: FloatArray
    x2: FloatArray
    n_features: tuple[int, int]


def estimate(
    image1: Image,
    image2: Image,
    camera1: Camera,
    camera2: Camera,
    options: Options,
    *,
    on_stage: OnStage | None = None,
) -> Report:
    """Estimate the slope of every window of image 1, with its uncertainty.

    Parameters
    ----------
    image1, image2 : images as stored (distorted), of the cameras' sizes.
    options : `Options`; windows in px of image 1.
    on_stage : called with (name, seconds of processor time) after each stage.

    Raises
    ------
    InputError : a window is not inside image 1.
    NoAnswer : the pair cannot tell (no overlap, no texture, no parallax, pure rotation), with reason and remedy.
    """
    clock = _Clock(on_stage)
    windows = list(options.windows) or grid_windows(*options.grid, image1.width, image1.height)
    check_windows(windows, image1.width, image1.height)
    refuse_identical(image1, image2)

    sparse = find_motions(image1, image2, camera1, camera2, FEATURE_MATCHERS[options.features])
    clock.tick("features")
    scene, motions, diagnostics = survey(image1, image2, camera1, camera2, sparse)
    clock.tick("overview")
    matches = [WINDOW_MATCHERS[options.features](window, scene) for window in windows]
    clock.tick("windows")
    matched, solution = solve(windows, matches, scene, motions, options)
    clock.tick("solve")
    report = build_report((image1, image2), (camera1, camera2), options, matched, solution, diagnostics)
    clock.tick("report")
    return report


def find_motions(
    image1: Image, image2: Image, camera1: Camera, camera2: Camera, matchers: Sequence[FeatureMatcher] = SIFT_MATCHERS
) -> Sparse:
    """Sparse features, and the camera motions they allow; a costlier search where the first finds little."""
    focal = camera2.focal_px
    found: list[Matches] = []
    motions: list[MotionEstimate] = []
    for matcher in matchers:
        found.append(_match(image1, image2, camera1, camera2, matcher))
        every = _joined(found)
        motions = rank_motions(motions + starting_motions(found[-1].x1, found[-1].x2, focal), every.x1, every.x2, focal)
        inlier = _agreeing(motions[:1], every, focal)
        if len(inlier) and inlier.mean() < ENOUGH_SHARE:
            more = starting_motions(found[-1].x1, found[-1].x2, focal, thorough=True)
            motions = rank_motions(motions + more, every.x1, every.x2, focal)
            inlier = _agreeing(motions[:1], every, focal)
        if len(inlier) and inlier.sum() >= ENOUGH_INLIERS and inlier.mean() > ENOUGH_SHARE:
            break
    refuse_unmatched(found[-1].n_features, len(inlier), int(inlier.sum()))
    return Sparse(every, motions)


def _match(image1: Image, image2: Image, camera1: Camera, camera2: Camera, matcher: FeatureMatcher) -> Matches:
    uv1, uv2, n_features = matcher(image1.grey, image2.grey)
    x1, x2 = rays_from_pixels(camera1, uv1), rays_from_pixels(camera2, uv2)
    seen = np.isfinite(x1).all(1) & np.isfinite(x2).all(1)
    return Matches(uv1[seen], uv2[seen], x1[seen], x2[seen], n_features)


def _joined(found: list[Matches]) -> Matches:
    if len(found) == 1:
        return found[0]
    uv1, uv2, x1, x2 = (np.vstack([getattr(m, name) for m in found]) for name in ("uv1", "uv2", "x1", "x2"))
    return Matches(uv1, uv2, x1, x2, found[-1].n_features)


def _agreeing(motions: list[MotionEstimate], matches: Matches, focal_px: float) -> BoolArray:
    """Matches that obey the first of the motions; none when there is none."""
    if not motions:
        return np.zeros(len(matches.x1), bool)
    return inliers_of(epipolar_residual(motions[0].R, motions[0].T, matches.x1, matches.x2), focal_px)


def survey(
    image1: Image, image2: Image, camera1: Camera, camera2: Camera, sparse: Sparse
) -> tuple[Scene, list[MotionEstimate], list[Diagnostic]]:
    """Match the whole image densely once: the motion from it, and what it says about every part of the scene."""
    layer = Layer(*shrink(image1.grey, MAX_PIXELS))
    pyramid1, pyramid2 = Pyramid(image1.grey, layer.scale), Pyramid(image2.grey)
    surveys = [_survey_under(motion, sparse, layer, pyramid2, camera1, camera2) for motion in sparse.rivals()]
    uv1, x1, x2, motions = max(surveys, key=lambda s: _consistent(s[1], s[2], s[3], camera2.focal_px))
    best = motions[0]
    evidence = gather_evidence(uv1, x1, x2, sample_grey(image1.grey, uv1), best.R, best.T, camera2.focal_px)
    parallax = parallax_px(evidence.x1, evidence.x2, camera2.focal_px)
    diagnostics = check_parallax(parallax, best.scale * camera2.focal_px)
    planes = scene_planes(evidence)
    return Scene(camera1, camera2, pyramid1, pyramid2, best.R, best.T, evidence, planes), motions, diagnostics


Survey = tuple[FloatArray, FloatArray, FloatArray, list[MotionEstimate]]


def _survey_under(
    motion: MotionEstimate, sparse: Sparse, layer: Layer, pyramid2: Pyramid, camera1: Camera, camera2: Camera
) -> Survey:
    """Dense matches led by the sparse ones that obey a motion, uv1, x1, x2 (n, 2), and all motions refined on them."""
    focal = camera2.focal_px
    obey = _agreeing([motion], sparse.matches, focal)
    lead1, lead2 = sparse.matches.uv1[obey], sparse.matches.uv2[obey]
    cells = overview_cells(layer, pyramid2, (camera2.height, camera2.width), lead1, lead2)
    cells = cells.take(np.linalg.eigvalsh(cells.information)[:, 0] > MIN_INFORMATION)
    uv1, uv2 = cells.uv1, cells.uv2
    if len(cells) < ENOUGH_CELLS:
        uv1, uv2 = np.vstack([uv1, lead1]), np.vstack([uv2, lead2])
    x1, x2 = rays_from_pixels(camera1, uv1), rays_from_pixels(camera2, uv2)
    seen = np.isfinite(x1).all(1) & np.isfinite(x2).all(1)
    first = [motion, *(m for m in sparse.motions if m is not motion)]
    return uv1[seen], x1[seen], x2[seen], refine_motions(first, x1[seen], x2[seen], focal)


def _consistent(x1: FloatArray, x2: FloatArray, motions: list[MotionEstimate], focal_px: float) -> int:
    """How many dense matches the best motion explains: flow led astray does not close and obeys none."""
    residual = np.abs(epipolar_residual(motions[0].R, motions[0].T, x1, x2)) * focal_px
    return int((residual < CONSISTENT_PX).sum())


RIVAL_COST, MAX_RIVALS = 1.08, 3
CONSISTENT_PX = 0.7
MIN_INFORMATION = 100.0  # grey^2/px^2 over a cell of the overview: weaker texture moves with the noise


def refine_motions(
    motions: list[MotionEstimate], x1: FloatArray, x2: FloatArray, focal_px: float
) -> list[MotionEstimate]:
    """All starting motions refined on the dense matches, best first."""
    bounds = (DENSE_SIGMA_PX[0] / focal_px, DENSE_SIGMA_PX[1] / focal_px)
    refined = [refine_motion(m.R, m.T, x1, x2, bounds) for m in motions]
    common = max(0.5 / focal_px, min(m.scale for m in refined))
    scored = [replace(assess_motion(m.R, m.T, x1, x2, common), scale=m.scale) for m in refined]
    return distinct_motions(sorted(scored, key=lambda m: m.cost))


def solve(
    windows: list[Window], matches: list[WindowMatch], scene: Scene, motions: list[MotionEstimate], options: Options
) -> tuple[Matched, Solution]:
    """One motion and all planes together, from the windows' matches and, for the motion, those outside them."""
    answered = [i for i, match in enumerate(matches) if match.origin != "none"]
    if not answered:
        raise NoAnswer(
            "low-texture",
            f"none of the {len(windows)} windows can be matched: {matches[0].reason}",
            "choose windows with texture that both images show",
        )
    outside = _outside(scene.evidence, [windows[i] for i in answered])
    parts = [matches[i] for i in answered]
    uv1 = np.vstack([*(p.uv1 for p in parts), scene.evidence.uv1[outside]])
    x1 = np.vstack([*(p.x1 for p in parts), scene.evidence.x1[outside]])
    x2 = np.vstack([*(p.x2 for p in parts), scene.evidence.x2[outside]])
    labels = [np.full(len(p.x1), k) for k, p in enumerate(parts)]
    patch = np.concatenate([*labels, np.full(len(outside), -1)])
    spread = OUTSIDE_SIGMA_PX / float(scene.pyramid1.overview_scale.mean())
    variance = np.concatenate([*(p.variance_px[:, 0] for p in parts), np.full(len(outside), spread**2)])
    weights = REFERENCE_PX**2 / variance
    gain = correlation_gain([(p.index, epipolar_residual(scene.R, scene.T, p.x1, p.x2)) for p in parts])
    initial = [(m.R, m.T) for m in motions]
    relief = options.solver == "mle"
    solution = solve_planes(
        x1, x2, patch, options.solver, weights=weights, relief=relief, initial=initial, noise_gain=gain
    )
    solution = _facing(solution, scene.T)
    solution = _beyond_systematics(solution, camera2_focal=scene.camera2.focal_px)
    correspondences = Correspondences(uv1, np.empty((0, 2)), x1, x2, patch)
    return Matched(windows, matches, answered, correspondences, weights), solution


def _facing(solution: Solution, T: FloatArray) -> Solution:
    """The solution on the side of the motion that puts the scene in front of the camera.

    (T, N) and (-T, -N) are one homography; a solver that sees few patches may take a mismatched one for decisive.
    """
    if solution.T @ T >= 0:
        return solution
    return replace(
        solution,
        T=-solution.T,
        scaled_normals=-solution.scaled_normals,
        tangent=-solution.tangent,
        normal_gain=-solution.normal_gain,
    )


def _beyond_systematics(solution: Solution, camera2_focal: float) -> Solution:
    """A second root is ruled out only if it fits worse by more than calibration and interpolation can feign."""
    found = solution.ambiguity
    if found.status != "resolved" or found.delta_chi2 is None:
        return solution
    excess = solution.noise * np.sqrt(found.delta_chi2 / max(int(solution.inlier.sum()), 1)) * camera2_focal
    if excess > SYSTEMATIC_PX:
        return solution
    return replace(solution, ambiguity=replace(found, status="unresolved"))


def _outside(evidence: Evidence, windows: list[Window]) -> np.ndarray:
    free = np.ones(len(evidence), bool)
    for window in windows:
        free &= ~evidence.near(window, 0.0)
    return thin(evidence.uv1, np.flatnonzero(free), OUTSIDE_POINTS)


class _Clock:
    """Processor time between ticks, for whoever listens."""

    def __init__(self, on_stage: OnStage | None) -> None:
        self._on_stage = on_stage
        self._last = time.process_time()

    def tick(self, name: str) -> None:
        now = time.process_time()
        if self._on_stage is not None:
            self._on_stage(name, now - self._last)
        self._last = now
