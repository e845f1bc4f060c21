"""First stage of the pipeline: from two images and their cameras to a scene and the motions that may explain it.

A quick pass, on features of small images and a coarse overview, takes about half the time of the full one. Its scene
is used only if matches and motion are clear. Where windows are large enough to determine the motion themselves, the
coarse overview is all they need; elsewhere it takes the place of the features of larger images, as a guide for the
full overview: its matches are more, and lie wherever there is texture. The full one is made of all of image 1, or only
around the windows, where these are small and near one another.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from slopecli.geometry.motion import MotionEstimate, assess_motion, epipolar_residual, refine_motion
from slopecli.geometry.solver.free_camera import FOCAL_STEPS
from slopecli.geometry.solver.seen_points import changed
from slopecli.geometry.statistics import median
from slopecli.look.dense import (
    CELL,
    CLEAR_AGREEMENT,
    FULL_SMOOTHINGS,
    WHOLE,
    Cells,
    OverviewEffort,
    dense_cells,
    overview_cells,
    sparse_transfer,
)
from slopecli.look.features import EFFORTS, QUICK, FeatureMemory, Grey, Images, match_sift, shrink
from slopecli.look.foerstner import match_foerstner
from slopecli.look.matches import Matches, gather_evidence, scene_planes
from slopecli.look.motions import SCORE_PX, FeatureMatcher, Sparse, distinct_motions, find_motions
from slopecli.look.noise import SYSTEMATIC_PX, WORST_MATCH_PX
from slopecli.look.scene import Scene
from slopecli.look.threads import single_threaded
from slopecli.look.warp import Layer, Pyramid, cut, sample_grey, transfer_map
from slopecli.options import Options
from slopecli.types import Camera, FloatArray
from slopecli.windows import Window, inside_window

# Overviews of the quick pass. Large windows need them only for a first plane, as each is matched finely afterwards.
# The pixels of the finer one are those of any working grid over all of image 1: regions, large windows.
COARSE = OverviewEffort(max_pixels=0.15e6, finest=0, smoothings=1)
FINE = OverviewEffort(max_pixels=0.5e6, finest=1, smoothings=FULL_SMOOTHINGS)
WINDOW_CELLS = 6  # least cells of the overview along a window's shorter side: with them it has a first plane

Found = tuple[Scene, list[MotionEstimate]]  # a scene, and all motions that may explain it, best first
OnLap = Callable[[str], None]  # called with "features" or "overview" whenever such a step ends


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
    on_lap: OnLap = lambda name: None,
) -> Found:
    """Match two images, sparsely and then densely, and estimate the camera motion.

    Parameters
    ----------
    windows : px of image 1; they decide whether the quick pass is tried when the planes of windows are asked for.
    check_sparse : called with the number of features in each image, of matches, and of matches consistent with the
        best motion; raises `NoAnswer` if they are too few. Not called where the quick pass succeeds.
    memory : cache of SIFT features, for pairs that share images.  on_lap : see `OnLap`.

    Returns
    -------
    scene : `Scene` under the best motion.
    motions : that motion and the other roots, best first.
    """
    images = Images(grey1, grey2, camera1, camera2)
    # planes that have yet to be found need features of every small surface as a guide
    if options.planes == "windows" and options.features == "sift":
        found = _quick_scene(images, windows, options.seed, memory, on_lap)
        if found is not None:
            return found
    sparse = find_motions(images, feature_matchers(options.features, memory), options.seed)
    check_sparse(sparse.n_features, len(sparse.matches), sparse.n_inliers)
    on_lap("features")
    return build_scene(images, sparse, options.seed)


def focal_by_features(images: Images, memory: FeatureMemory | None, seed: int = 0) -> float:
    """Logarithm of the focal length over that given under which far more features agree with one motion; else 0.

    A focal length that is far off may leave so few that they agree with quite another motion: overview and windows
    are then matched along wrong lines, and no search of the right one comes back from there.
    """
    matcher = partial(match_sift, effort=QUICK, memory=memory or FeatureMemory())

    def agreeing(step: float) -> int:
        """Number of features that agree with one motion under a focal length."""
        first, second = (changed(camera, "f", step) for camera in images[2:])
        return find_motions(images._replace(camera1=first, camera2=second), [matcher], seed, thorough=False).n_inliers

    with single_threaded():
        found = {step: agreeing(step) for size in FOCAL_STEPS for step in (size, -size)}
        best = max(found, key=lambda step: found[step])
        return best if found[best] > 1.2 * agreeing(0.0) else 0.0  # where the camera is right, others have no more


def feature_matchers(name: str, memory: FeatureMemory | None = None) -> Sequence[FeatureMatcher]:
    """The matchers that a value of the option `--features` names, to be tried in turn; only SIFT uses a memory."""
    if name == "foerstner":
        return [match_foerstner]
    return [partial(match_sift, effort=effort, memory=memory) for effort in EFFORTS]


def _quick_scene(
    images: Images, windows: list[Window], seed: int, memory: FeatureMemory | None, on_lap: OnLap
) -> Found | None:
    """The result of the quick pass; None where matches or motion are not clear."""
    effort = overview_effort(windows, images.grey1) if may_suffice(windows, images.grey1) else WHOLE
    with single_threaded():
        sparse = find_motions(images, [partial(match_sift, effort=QUICK, memory=memory)], seed, thorough=False)
        on_lap("features")
        if not is_decided(sparse):
            return None
        scene, motions = build_scene(images, sparse, seed, COARSE if effort == WHOLE else effort)
        if _is_clear(scene) and effort == WHOLE:
            guide = replace(sparse, matches=scene.evidence, motions=motions)
            around = _surroundings(windows)
            if around[2] * around[3] < 0.5 * images.grey1.size and len(guide.roots()) == 1:
                scene, motions = _finer_around(around, scene, images, guide, seed)
            else:
                scene, motions = build_scene(images, guide, seed)
        on_lap("overview")
    return (scene, motions) if _is_clear(scene) else None


def may_suffice(windows: list[Window], grey1: Grey) -> bool:
    """Whether the windows (px of image 1) are so large, and cover half of it, that the quick pass is worth trying."""
    covered = sum(width * height for _, _, width, height in windows)
    return _cells_along(windows, grey1, FINE) >= WINDOW_CELLS and covered >= 0.5 * grey1.size


def overview_effort(windows: list[Window], grey1: Grey) -> OverviewEffort:
    """The coarsest overview of the quick pass that still has enough cells in every window."""
    return COARSE if _cells_along(windows, grey1, COARSE) >= 2 * WINDOW_CELLS else FINE


def _cells_along(windows: list[Window], grey1: Grey, effort: OverviewEffort) -> float:
    """Number of cells of an overview along the shortest of all sides of the windows (px of image 1)."""
    scale = min(1.0, effort.max_pixels / grey1.size) ** 0.5
    return min(min(width, height) for _, _, width, height in windows) * scale / CELL


def is_decided(sparse: Sparse) -> bool:
    """Whether the sparse matches are many, agree, and leave one motion only."""
    return sparse.n_inliers >= max(120, 0.85 * len(sparse.matches)) and len(sparse.roots()) == 1


def _is_clear(scene: Scene) -> bool:
    """Whether half of the cells of the overview are matched, nine tenths of these consistent, and correlate well."""
    possible = float(np.prod(scene.shape1)) * scene.cells.pixel_scale**2 / CELL**2
    enough = max(0.9 * len(scene.cells), 0.5 * possible)
    return len(scene.evidence) >= enough and median(scene.cells.agreement) >= CLEAR_AGREEMENT


def _surroundings(windows: list[Window]) -> Window:
    """The rectangle around windows from which a window without matches borrows: three times its longer side beyond."""
    beyond = [3 * max(width, height) for _, _, width, height in windows]
    x, y, w, h = np.array(windows).T
    left, top = int((x - beyond).min()), int((y - beyond).min())
    return left, top, int((x + w + beyond).max()) - left, int((y + h + beyond).max()) - top


def _finer_around(around: Window, scene: Scene, images: Images, guide: Sparse, seed: int) -> Found:
    """The scene with the matches of the full overview in a rectangle, px of image 1, and the motions refined on all."""
    layer = Layer(*shrink(images.grey1, WHOLE.max_pixels))
    margin = 2 * CELL / float(layer.scale.min())  # flow is biased at the border of a grid
    x, y, width, height = around
    grid = cut(layer, x - margin, y - margin, width + 2 * margin, height + 2 * margin)
    transfer = sparse_transfer(guide.matches.uv1, guide.matches.uv2, layer.scale, layer.grey.shape)
    mapping = transfer_map(grid, transfer)
    fine = dense_cells(grid, mapping, scene.pyramid2, scene.shape2, CELL, WHOLE.finest, WHOLE.smoothings)
    beyond = scene.cells.textured & ~inside_window(scene.cells.uv1, around)
    near = fine.textured & inside_window(fine.uv1, around)
    uv1, uv2 = (np.vstack([getattr(scene.cells, at)[beyond], getattr(fine, at)[near]]) for at in ("uv1", "uv2"))
    matches, motions = _refined(uv1, uv2, guide.motions, images)
    R, T = motions[0].R, motions[0].T
    evidence = gather_evidence(matches, sample_grey(images.grey1, matches.uv1), R, T, images.camera2.focal_px)
    pyramid1, find_planes = Pyramid(images.grey1, layer.scale), partial(scene_planes, evidence, seed)
    return replace(scene, pyramid1=pyramid1, R=R, T=T, evidence=evidence, find_planes=find_planes), motions


def build_scene(images: Images, sparse: Sparse, seed: int = 0, effort: OverviewEffort = WHOLE) -> Found:
    """Match all of image 1 densely under each root of the sparse matches, and keep the one most cells agree with.

    The motions are refined on the dense matches.
    """
    grey1, grey2, camera1, camera2 = images
    layer = Layer(*shrink(grey1, effort.max_pixels))
    pyramid1, pyramid2 = Pyramid(grey1, layer.scale), Pyramid(grey2)
    focal_px = camera2.focal_px

    def n_consistent(overview: tuple[Cells, Matches, list[MotionEstimate]]) -> int:
        """Number of matches consistent with the best refined motion: few where a wrong root guided the flow."""
        _, matches, (best, *_) = overview
        residual = np.abs(epipolar_residual(best.R, best.T, matches.x1, matches.x2)) * focal_px
        return int((residual < WORST_MATCH_PX).sum())

    overviews = [_overview_of(root, sparse, images, layer, pyramid2, effort) for root in sparse.roots()]
    cells, matches, motions = max(overviews, key=n_consistent)
    R, T = motions[0].R, motions[0].T
    evidence = gather_evidence(matches, sample_grey(grey1, matches.uv1), R, T, focal_px)
    find_planes = partial(scene_planes, evidence, seed)
    return Scene(camera1, camera2, pyramid1, pyramid2, R, T, evidence, find_planes, cells), motions


def _overview_of(
    root: MotionEstimate, sparse: Sparse, images: Images, layer: Layer, pyramid2: Pyramid, effort: OverviewEffort
) -> tuple[Cells, Matches, list[MotionEstimate]]:
    """Overview guided by one root: all its cells, its matches of sufficient texture, and the motions refined on them,
    best first."""
    guide = sparse.matches.take(sparse.consistent_with(root))
    shape2 = images.camera2.height, images.camera2.width
    cells = overview_cells(layer, pyramid2, shape2, guide.uv1, guide.uv2, effort)
    uv1, uv2 = cells.uv1[cells.textured], cells.uv2[cells.textured]
    if len(uv1) < 500:  # so few that the less precise sparse matches help
        uv1, uv2 = np.vstack([uv1, guide.uv1]), np.vstack([uv2, guide.uv2])
    return cells, *_refined(uv1, uv2, [root, *(m for m in sparse.motions if m is not root)], images)


def _refined(
    uv1: FloatArray, uv2: FloatArray, starts: list[MotionEstimate], images: Images
) -> tuple[Matches, list[MotionEstimate]]:
    """Pixels (n, 2) as matches, and the motions refined on them, best first."""
    matches = Matches.between(images.camera1, images.camera2, uv1, uv2)
    x1, x2, focal_px = matches.x1, matches.x2, images.camera2.focal_px
    bounds = (SYSTEMATIC_PX / focal_px, WORST_MATCH_PX / focal_px)
    refined = [refine_motion(m.R, m.T, x1, x2, bounds) for m in starts]
    common = max(SCORE_PX / focal_px, min(m.scale for m in refined))
    scored = [replace(assess_motion(m.R, m.T, x1, x2, common), scale=m.scale) for m in refined]
    return matches, distinct_motions(sorted(scored, key=lambda m: m.cost))
