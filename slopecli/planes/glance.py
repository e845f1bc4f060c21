"""When a glance at a pair is enough: features of shrunken images and an overview that leave nothing in doubt."""

from __future__ import annotations

import numpy as np

from slopecli.planes.scene import Scene
from slopecli.planes.windows import Window
from slopecli.vision.features import Grey
from slopecli.vision.overview import CELL
from slopecli.vision.sparse import Sparse

OVERVIEW_PIXELS = (0.15e6, 0.5e6)  # between these, as many as the windows need
# cells of the overview along the shorter side of every window: what its plane takes at least, and what is wanted
LEAST_CELLS, WANTED_CELLS = 6, 12
MOST = 0.5  # of image 1 that windows cover: where they cover less, the motion owes its accuracy to the overview
ENOUGH_INLIERS, ENOUGH_SHARE = 150, 0.85  # sparse matches that obey one motion, and their share of all
# cells of the overview that obey the motion, as shares of those matched and of those there are; their agreement
CONSISTENT, COVERED, AGREEMENT = 0.9, 0.4, 0.9


def may_suffice(windows: list[Window], grey1: Grey) -> bool:
    """Whether windows (px of image 1) are so large that a coarse overview tells their planes, and they the motion."""
    sides = np.array(windows, float)[:, 2:]
    scale = np.sqrt(min(1.0, OVERVIEW_PIXELS[1] / grey1.size))
    return bool(sides.min() * scale >= LEAST_CELLS * CELL and sides.prod(axis=1).sum() >= MOST * grey1.size)


def overview_pixels(windows: list[Window], grey1: Grey) -> float:
    """To how many pixels image 1 is averaged down: the windows, matched finer later, have only to be found on it."""
    scale = WANTED_CELLS * CELL / min(min(width, height) for _, _, width, height in windows)
    return float(np.clip(scale**2 * grey1.size, *OVERVIEW_PIXELS))


def is_decided(sparse: Sparse) -> bool:
    """Whether the matches are many, agree, and leave one motion only."""
    enough = max(ENOUGH_INLIERS, ENOUGH_SHARE * len(sparse.matches))
    return sparse.n_inliers >= enough and len(sparse.rivals()) == 1


def is_clear(scene: Scene) -> bool:
    """Whether the overview matched most of what image 2 shows, under one motion, well."""
    matched, obeying = len(scene.cells), len(scene.evidence)
    possible = float(np.prod(scene.shape1) * np.prod(scene.pyramid1.overview_scale)) / CELL**2
    enough = max(CONSISTENT * matched, COVERED * possible)
    return obeying >= enough and float(np.median(scene.cells.agreement)) >= AGREEMENT
