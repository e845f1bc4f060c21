"""The whole image matched densely, once: the motion from it, and what it says about every part of the scene."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from slopecli.geometry.motion import MotionEstimate, assess_motion, epipolar_residual, refine_motion
from slopecli.look.dense import Cells
from slopecli.look.evidence import gather_evidence, scene_planes
from slopecli.look.features import Grey, shrink
from slopecli.look.motions import distinct_motions
from slopecli.look.noise import SYSTEMATIC_PX, WORST_MATCH_PX
from slopecli.look.overview import WHOLE, OverviewEffort, overview_cells
from slopecli.look.scene import Scene
from slopecli.look.sparse import Matches, Sparse
from slopecli.look.warp import Layer, Pyramid, sample_grey
from slopecli.types import Camera, FloatArray

MIN_INFORMATION = 100.0  # grey^2/px^2 over a cell of the overview: weaker texture moves with the noise
ENOUGH_CELLS = 500  # of the overview: then the coarser sparse matches, mismatches among them, are left out
CONSISTENT_PX = 0.7  # epipolar residual of a dense match that a motion explains
SCORE_PX = 0.5  # motions compete on squared residuals truncated at four of these, or of the noise where it is larger


@dataclass(frozen=True, eq=False)
class _Reading:
    """Dense matches as one motion leads to them, all motions refined on them, best first, and the cells they are of."""

    matches: Matches
    motions: list[MotionEstimate]
    cells: Cells

    def n_consistent(self, focal_px: float) -> int:
        """How many dense matches the best motion explains: flow led astray does not close and obeys none."""
        best = self.motions[0]
        residual = np.abs(epipolar_residual(best.R, best.T, self.matches.x1, self.matches.x2)) * focal_px
        return int((residual < CONSISTENT_PX).sum())


def survey(
    grey1: Grey,
    grey2: Grey,
    camera1: Camera,
    camera2: Camera,
    sparse: Sparse,
    seed: int = 0,
    effort: OverviewEffort = WHOLE,
) -> tuple[Scene, list[MotionEstimate]]:
    """Match all of image 1 densely under each motion the sparse matches leave open, and keep the one that holds.

    Parameters
    ----------
    effort : of the overview.

    Returns
    -------
    scene : what is known of the pair under the best motion.
    motions : that motion and its rivals, refined on the dense matches, best first.
    """
    layer = Layer(*shrink(grey1, effort.max_pixels))
    pyramid1, pyramid2 = Pyramid(grey1, layer.scale), Pyramid(grey2)
    readings = [_read(motion, sparse, layer, pyramid2, camera1, camera2, effort) for motion in sparse.rivals()]
    reading = max(readings, key=lambda r: r.n_consistent(camera2.focal_px))
    found, best = reading.matches, reading.motions[0]
    grey = sample_grey(grey1, found.uv1)
    evidence = gather_evidence(found.uv1, found.x1, found.x2, grey, best.R, best.T, camera2.focal_px)
    planes = partial(scene_planes, evidence, seed)
    scene = Scene(camera1, camera2, pyramid1, pyramid2, best.R, best.T, evidence, planes, reading.cells)
    return scene, reading.motions


def _read(
    motion: MotionEstimate,
    sparse: Sparse,
    layer: Layer,
    pyramid2: Pyramid,
    camera1: Camera,
    camera2: Camera,
    effort: OverviewEffort,
) -> _Reading:
    obey = sparse.obeying(motion)
    lead1, lead2 = sparse.matches.uv1[obey], sparse.matches.uv2[obey]
    every = overview_cells(layer, pyramid2, (camera2.height, camera2.width), lead1, lead2, effort)
    cells = every.take(np.linalg.eigvalsh(every.information)[:, 0] > MIN_INFORMATION)
    uv1, uv2 = cells.uv1, cells.uv2
    if len(cells) < ENOUGH_CELLS:
        uv1, uv2 = np.vstack([uv1, lead1]), np.vstack([uv2, lead2])
    dense = Matches.between(camera1, camera2, uv1, uv2)
    starts = [motion, *(m for m in sparse.motions if m is not motion)]
    return _Reading(dense, _refined(starts, dense.x1, dense.x2, camera2.focal_px), every)


def _refined(motions: list[MotionEstimate], x1: FloatArray, x2: FloatArray, focal_px: float) -> list[MotionEstimate]:
    bounds = (SYSTEMATIC_PX / focal_px, WORST_MATCH_PX / focal_px)
    refined = [refine_motion(m.R, m.T, x1, x2, bounds) for m in motions]
    common = max(SCORE_PX / focal_px, min(m.scale for m in refined))
    scored = [replace(assess_motion(m.R, m.T, x1, x2, common), scale=m.scale) for m in refined]
    return distinct_motions(sorted(scored, key=lambda m: m.cost))
