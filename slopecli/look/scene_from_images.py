"""First stage of the pipeline: from two images and their cameras to a scene and the motions that may explain it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from slopecli.geometry.motion import MotionEstimate, assess_motion, epipolar_residual, refine_motion
from slopecli.look.dense import Cells
from slopecli.look.evidence import gather_evidence, scene_planes
from slopecli.look.features import EFFORTS, QUICK, FeatureMemory, Grey, match_sift, shrink
from slopecli.look.foerstner import match_foerstner
from slopecli.look.matches import Matches
from slopecli.look.motions import SCORE_PX, distinct_motions
from slopecli.look.noise import SYSTEMATIC_PX, WORST_MATCH_PX
from slopecli.look.overview import WHOLE, OverviewEffort, overview_cells
from slopecli.look.quick_pass import is_clear, is_decided, may_suffice, overview_effort
from slopecli.look.scene import Scene
from slopecli.look.sparse import FeatureMatcher, Sparse, find_motions
from slopecli.look.threads import single_threaded
from slopecli.look.warp import Layer, Pyramid, sample_grey
from slopecli.options import Options
from slopecli.types import Camera, FloatArray
from slopecli.windows import Window

MIN_INFORMATION = 100.0  # grey^2/px^2, smaller eigenvalue of a cell's structure tensor: less texture moves with noise

Found = tuple[Scene, list[MotionEstimate]]  # a scene, and all motions that may explain it, best first


def find_scene(
    grey1: Grey,
    grey2: Grey,
    camera1: Camera,
    camera2: Camera,
    options: Options,
    windows: list[Window],
    *,
    check_sparse: Callable[[tuple[int, int], int, int], None],
    memory: FeatureMemory | None = None,
    on_lap: Callable[[str], None] = lambda name: None,
) -> Found:
    """Match two images, sparsely and then densely, and estimate the camera motion.

    Parameters
    ----------
    windows : px of image 1; they decide whether the quick pass is tried when the planes of windows are asked for.
    check_sparse : called with the number of features in each image, of matches, and of matches consistent with the
        best motion; raises if they are too few for an answer.
    memory : of SIFT features, if images may come again.
    on_lap : called with "features" or "overview" whenever such a step ends.

    Returns
    -------
    scene : `Scene` under the best motion.
    motions : that motion and the other roots, best first.
    """
    images = grey1, grey2, camera1, camera2
    # planes that have yet to be found need the full overview
    if options.planes == "windows" and options.features == "sift" and may_suffice(windows, grey1):
        found = _quick_scene(*images, windows, options.seed, memory, on_lap)
        if found is not None:
            return found
    sparse = find_motions(*images, feature_matchers(options.features, memory), options.seed)
    check_sparse(sparse.n_features, len(sparse.matches), sparse.n_inliers)
    on_lap("features")
    return build_scene(*images, sparse, options.seed)


def feature_matchers(name: str, memory: FeatureMemory | None = None) -> Sequence[FeatureMatcher]:
    """The matchers that a value of the option `--features` names, to be tried in turn; only SIFT uses a memory."""
    if name == "foerstner":
        return [match_foerstner]
    return [partial(match_sift, effort=effort, memory=memory) for effort in EFFORTS]


def _quick_scene(
    grey1: Grey,
    grey2: Grey,
    camera1: Camera,
    camera2: Camera,
    windows: list[Window],
    seed: int,
    memory: FeatureMemory | None,
    on_lap: Callable[[str], None],
) -> Found | None:
    """The result of the quick pass; None where matches or motion are not clear."""
    images, matcher = (grey1, grey2, camera1, camera2), partial(match_sift, effort=QUICK, memory=memory)
    with single_threaded():
        sparse = find_motions(*images, [matcher], seed, thorough=False)
        on_lap("features")
        if not is_decided(sparse):
            return None
        found = build_scene(*images, sparse, seed, overview_effort(windows, grey1))
        on_lap("overview")
    return found if is_clear(found[0]) else None


def build_scene(
    grey1: Grey,
    grey2: Grey,
    camera1: Camera,
    camera2: Camera,
    sparse: Sparse,
    seed: int = 0,
    effort: OverviewEffort = WHOLE,
) -> Found:
    """Match all of image 1 densely under each root of the sparse matches, and keep the one most cells agree with.

    Returns
    -------
    scene : under the best motion.
    motions : that motion and the other roots, refined on the dense matches, best first.
    """
    layer = Layer(*shrink(grey1, effort.max_pixels))
    pyramid1, pyramid2 = Pyramid(grey1, layer.scale), Pyramid(grey2)
    overviews = [_overview_of(root, sparse, layer, pyramid2, camera1, camera2, effort) for root in sparse.roots()]
    overview = max(overviews, key=lambda found: found.n_consistent(camera2.focal_px))
    matches, best = overview.matches, overview.motions[0]
    grey = sample_grey(grey1, matches.uv1)
    evidence = gather_evidence(matches, grey, best.R, best.T, camera2.focal_px)
    find_planes = partial(scene_planes, evidence, seed)
    scene = Scene(camera1, camera2, pyramid1, pyramid2, best.R, best.T, evidence, find_planes, overview.cells)
    return scene, overview.motions


@dataclass(frozen=True, eq=False)
class _Overview:
    """Overview guided by one root: all its cells, its matches of sufficient texture, and the motions refined on them,
    best first."""

    cells: Cells
    matches: Matches
    motions: list[MotionEstimate]

    def n_consistent(self, focal_px: float) -> int:
        """Number of matches consistent with the best motion; flow under a wrong root gives few."""
        best = self.motions[0]
        residual = np.abs(epipolar_residual(best.R, best.T, self.matches.x1, self.matches.x2)) * focal_px
        return int((residual < WORST_MATCH_PX).sum())


def _overview_of(
    root: MotionEstimate,
    sparse: Sparse,
    layer: Layer,
    pyramid2: Pyramid,
    camera1: Camera,
    camera2: Camera,
    effort: OverviewEffort,
) -> _Overview:
    consistent = sparse.consistent_with(root)
    sparse1, sparse2 = sparse.matches.uv1[consistent], sparse.matches.uv2[consistent]
    cells = overview_cells(layer, pyramid2, (camera2.height, camera2.width), sparse1, sparse2, effort)
    textured = cells.take(np.linalg.eigvalsh(cells.information)[:, 0] > MIN_INFORMATION)
    uv1, uv2 = textured.uv1, textured.uv2
    if len(textured) < 500:  # so few that the less precise sparse matches help
        uv1, uv2 = np.vstack([uv1, sparse1]), np.vstack([uv2, sparse2])
    matches = Matches.between(camera1, camera2, uv1, uv2)
    starts = [root, *(m for m in sparse.motions if m is not root)]
    return _Overview(cells, matches, _refined(starts, matches.x1, matches.x2, camera2.focal_px))


def _refined(motions: list[MotionEstimate], x1: FloatArray, x2: FloatArray, focal_px: float) -> list[MotionEstimate]:
    """Motions refined on matches, ranked by one cost, repeats dropped."""
    bounds = (SYSTEMATIC_PX / focal_px, WORST_MATCH_PX / focal_px)
    refined = [refine_motion(m.R, m.T, x1, x2, bounds) for m in motions]
    common = max(SCORE_PX / focal_px, min(m.scale for m in refined))
    scored = [replace(assess_motion(m.R, m.T, x1, x2, common), scale=m.scale) for m in refined]
    return distinct_motions(sorted(scored, key=lambda m: m.cost))
