"""How much the ground of a pair bends, by the planes of neighbouring blocks of its overview matches."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from slopecli.geometry.epipolar import homogeneous
from slopecli.geometry.plane_fit import BEND_RAD, plane_products, planes_of_sums
from slopecli.look.matches import MIN_ON_PLANE, Evidence
from slopecli.patches.windows.tunables import TUNE
from slopecli.types import FloatArray


@lru_cache(maxsize=4)  # windows of a grid are all of one size
def bend_rad(evidence: Evidence, side_px: float) -> float:
    """RMS change of tilt per axis, rad, between neighbouring blocks of ground, `side_px` wide in image 1."""
    extent = np.ptp(evidence.uv1, axis=0) if len(evidence) else np.zeros(2)
    spacing = float(np.sqrt(extent.prod() / max(len(evidence), 1)))
    normals = _block_normals(evidence, max(side_px, 4 * spacing))  # some 16 matches a block
    steps = (normals[1:] - normals[:-1], normals[:, 1:] - normals[:, :-1])
    half = 0.5 * np.linalg.norm(np.concatenate([step.reshape(-1, 3) for step in steps]), axis=1)
    angles = 2.0 * np.arcsin(np.clip(half[np.isfinite(half)], 0.0, 1.0))
    squares = TUNE.bend_count * BEND_RAD**2 + 0.5 * float((angles**2).sum())
    return float(np.sqrt(squares / (TUNE.bend_count + len(angles))))


def _block_normals(evidence: Evidence, side_px: float) -> FloatArray:
    """(rows, columns, 3) unit normals of square blocks of image 1; NaN where there are too few matches."""
    if len(evidence) < MIN_ON_PLANE:
        return np.full((1, 1, 3), np.nan)
    column, row = ((evidence.uv1 - evidence.uv1.min(0)) / side_px).astype(int).T
    columns, rows = column.max() + 1, row.max() + 1
    block = row * columns + column
    leverage = evidence.leverage
    products = plane_products(homogeneous(evidence.x1) * leverage[:, None], evidence.w * leverage)
    sums = np.array([np.bincount(block, column, rows * columns) for column in products.T]).T
    enough = np.bincount(block, minlength=rows * columns) >= MIN_ON_PLANE
    normals = np.full((rows * columns, 3), np.nan)
    normals[enough] = planes_of_sums(sums[enough])
    return np.asarray(normals / np.linalg.norm(normals, axis=1, keepdims=True)).reshape(rows, columns, 3)
