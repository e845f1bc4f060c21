"""When a glance at a pair is enough: features of shrunken images and an overview that leave nothing in doubt."""

from __future__ import annotations

import numpy as np

from slopecli.geometry.statistics import median
from slopecli.look.dense import SMOOTHINGS
from slopecli.look.features import Grey
from slopecli.look.overview import CELL, OverviewEffort
from slopecli.look.scene import Scene
from slopecli.look.sparse import Sparse
from slopecli.windows import Window

# one for large windows, which are matched finer later and have only to be found on it, and one for all others
COARSE = OverviewEffort(max_pixels=0.15e6, finest=0, smoothings=1)
FINE = OverviewEffort(max_pixels=0.5e6, finest=1, smoothings=SMOOTHINGS)
# cells of the overview along the shorter side of every window: fewer tell too little of its plane; enough for COARSE
LEAST_CELLS, ENOUGH_CELLS = 6, 12
MOST = 0.5  # of image 1 that windows cover: where they cover less, the motion owes its accuracy to the overview
ENOUGH_INLIERS, ENOUGH_SHARE = 120, 0.85  # sparse matches that obey one motion, and their share of all
# cells of the overview that obey the motion, as shares of those matched and of those there are; their agreement
CONSISTENT, COVERED, AGREEMENT = 0.9, 0.4, 0.9


def may_suffice(windows: list[Window], grey1: Grey) -> bool:
    """Whether windows (px of image 1) are so large that a coarse overview tells their planes, and they the motion."""
    covered = sum(width * height for _, _, width, height in windows)
    return _cells_along(windows, grey1, FINE) >= LEAST_CELLS and covered >= MOST * grey1.size


def overview_effort(windows: list[Window], grey1: Grey) -> OverviewEffort:
    """How finely the overview has to look for windows of this size."""
    return COARSE if _cells_along(windows, grey1, COARSE) >= ENOUGH_CELLS else FINE


def _cells_along(windows: list[Window], grey1: Grey, effort: OverviewEffort) -> float:
    """Cells of the overview along the shortest side of any window."""
    scale = min(1.0, effort.max_pixels / grey1.size) ** 0.5
    return min(min(width, height) for _, _, width, height in windows) * scale / CELL


def is_decided(sparse: Sparse) -> bool:
    """Whether the matches are many, agree, and leave one motion only."""
    enough = max(ENOUGH_INLIERS, ENOUGH_SHARE * len(sparse.matches))
    return sparse.n_inliers >= enough and len(sparse.rivals()) == 1


def is_clear(scene: Scene) -> bool:
    """Whether the overview matched most of what image 2 shows, under one motion, well."""
    matched, obeying = len(scene.cells), len(scene.evidence)
    possible = float(np.prod(scene.shape1) * np.prod(scene.pyramid1.overview_scale)) / CELL**2
    enough = max(CONSISTENT * matched, COVERED * possible)
    return obeying >= enough and median(scene.cells.agreement) >= AGREEMENT
