"""Criteria of the quick pass: when features of small images and a coarse overview suffice for the windows asked for.

The quick pass takes about half the time of the full one. Its scene is used only if matches and motion are clear.
"""

from __future__ import annotations

import numpy as np

from slopecli.geometry.statistics import median
from slopecli.look.dense import CLEAR_AGREEMENT, FULL_SMOOTHINGS
from slopecli.look.features import Grey
from slopecli.look.overview import CELL, OverviewEffort
from slopecli.look.scene import Scene
from slopecli.look.sparse import Sparse
from slopecli.windows import Window

# Two resolutions of the overview. Large windows need it only for a first plane, as each is matched finely afterwards.
COARSE = OverviewEffort(max_pixels=0.15e6, finest=0, smoothings=1)
FINE = OverviewEffort(max_pixels=0.5e6, finest=1, smoothings=FULL_SMOOTHINGS)
WINDOW_CELLS = 6  # cells of the overview along a window's shorter side that determine a first plane
MOST_OF_IMAGE = 0.5  # share of image 1 that windows, and consistent cells, must cover to determine the motion
SPARSE_SHARE, DENSE_SHARE = 0.85, 0.9  # of the sparse matches, and of the cells, that agree on one motion


def may_suffice(windows: list[Window], grey1: Grey) -> bool:
    """Whether the windows (px of image 1) are so large, and cover so much, that the quick pass is worth trying."""
    covered = sum(width * height for _, _, width, height in windows)
    return _cells_along(windows, grey1, FINE) >= WINDOW_CELLS and covered >= MOST_OF_IMAGE * grey1.size


def overview_effort(windows: list[Window], grey1: Grey) -> OverviewEffort:
    """The coarsest overview that still has enough cells in every window."""
    return COARSE if _cells_along(windows, grey1, COARSE) >= 2 * WINDOW_CELLS else FINE


def _cells_along(windows: list[Window], grey1: Grey, effort: OverviewEffort) -> float:
    """Number of cells of an overview along the shortest side of any window."""
    scale = min(1.0, effort.max_pixels / grey1.size) ** 0.5
    return min(min(width, height) for _, _, width, height in windows) * scale / CELL


def is_decided(sparse: Sparse) -> bool:
    """Whether the sparse matches are many, agree, and leave one motion only."""
    return sparse.n_inliers >= max(120, SPARSE_SHARE * len(sparse.matches)) and len(sparse.roots()) == 1


def is_clear(scene: Scene) -> bool:
    """Whether most cells of the overview are matched, are consistent with one motion, and agree in brightness."""
    possible = float(np.prod(scene.shape1) * np.prod(scene.pyramid1.overview_scale)) / CELL**2
    enough = max(DENSE_SHARE * len(scene.cells), MOST_OF_IMAGE * possible)
    return len(scene.evidence) >= enough and median(scene.cells.agreement) >= CLEAR_AGREEMENT
