"""The whole of image 1 matched densely, once: from sparse matches alone, before the motion is known.

Its cells lie everywhere texture allows, so they tell the motion better than the sparse matches they grew from, and
give every window a first idea of its plane.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from slopecli.look.dense import SMOOTHINGS, Cells, dense_cells
from slopecli.look.warp import Grid, Layer, Pyramid, Transfer, transfer_map
from slopecli.types import FloatArray

CELL = 8  # px of the working grid
FIELD_STEP = 16  # px of the working grid between nodes of the displacement field


@dataclass(frozen=True)
class OverviewEffort:
    """How finely to look: image 1 averaged down to at most `max_pixels`; the flow as `slopecli.look.dense.flow`
    says. Flow at every pixel of an image is as precise as at every second of one three times as large."""

    max_pixels: float
    finest: int
    smoothings: int


WHOLE = OverviewEffort(max_pixels=1.0e6, finest=1, smoothings=SMOOTHINGS)


def overview_cells(
    layer1: Layer,
    pyramid2: Pyramid,
    shape2: tuple[int, int],
    uv1: FloatArray,
    uv2: FloatArray,
    effort: OverviewEffort = WHOLE,
) -> Cells:
    """Dense cells over all of image 1, led by sparse matches uv1 -> uv2 (full-resolution px, mismatches removed)."""
    height, width = layer1.grey.shape
    grid = Grid(layer1.grey, 0, 0, layer1.scale)
    mapping = transfer_map(grid, sparse_transfer(uv1, uv2, layer1.scale, (height, width)))
    return dense_cells(grid, mapping, pyramid2, shape2, CELL, effort.finest, effort.smoothings)


def sparse_transfer(uv1: FloatArray, uv2: FloatArray, scale: FloatArray, shape: tuple[int, int]) -> Transfer:
    """A smooth map through the matches: their dominant homography plus what it misses, spread from near to far."""
    H = None
    if len(uv1) >= 4:
        H, _ = cv2.findHomography(uv1, uv2, cv2.USAC_MAGSAC, 20.0)
        if H is None:
            H, _ = cv2.findHomography(uv1, uv2, 0)
    if H is None:
        H = np.eye(3)
    apply = lambda uv: cv2.perspectiveTransform(np.asarray(uv, float)[:, None], H)[:, 0]  # noqa: E731
    field = _spread((uv1 + 0.5) * scale, uv2 - apply(uv1), shape)

    def transfer(uv: FloatArray) -> FloatArray:
        node = (((uv + 0.5) * scale) / FIELD_STEP - 0.5).astype(np.float32)
        at = node[:, None]  # a column: OpenCV bears no more than 32767 points in a row
        missed = cv2.remap(field, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(apply(uv) + missed[:, 0], float)

    return transfer


def _spread(points: FloatArray, values: FloatArray, shape: tuple[int, int]) -> np.ndarray:
    """Average values (n, 2) in bins and fill the empty ones from coarser and coarser averages (pull-push)."""
    rows, columns = -(-shape[0] // FIELD_STEP), -(-shape[1] // FIELD_STEP)
    column = np.clip((points[:, 0] / FIELD_STEP).astype(int), 0, columns - 1)
    row = np.clip((points[:, 1] / FIELD_STEP).astype(int), 0, rows - 1)
    total, count = np.zeros((rows, columns, 2)), np.zeros((rows, columns))
    np.add.at(total, (row, column), values)
    np.add.at(count, (row, column), 1.0)
    filled = _pull_push(total / np.maximum(count, 1)[..., None], np.minimum(count, 1))
    return cv2.GaussianBlur(filled.astype(np.float32), (0, 0), 0.7)


def _pull_push(values: FloatArray, weight: FloatArray) -> FloatArray:
    if min(weight.shape) <= 2:
        mean = np.tensordot(weight, values, 2) / max(weight.sum(), 1e-9)
        return np.broadcast_to(mean, values.shape)
    rows, columns = weight.shape
    pad = ((0, rows % 2), (0, columns % 2))
    weighted, padded = np.pad(values * weight[..., None], (*pad, (0, 0))), np.pad(weight, pad)
    half_weight = _quarter(padded)
    coarse = _pull_push(_quarter(weighted) / np.maximum(half_weight, 1e-9)[..., None], np.minimum(half_weight, 1))
    size = (padded.shape[1], padded.shape[0])
    grown = cv2.resize(np.ascontiguousarray(coarse, np.float32), size, interpolation=cv2.INTER_LINEAR)[:rows, :columns]
    return np.asarray(weight[..., None] * values + (1 - weight[..., None]) * grown)


def _quarter(a: FloatArray) -> FloatArray:
    return np.asarray(a[::2, ::2] + a[1::2, ::2] + a[::2, 1::2] + a[1::2, 1::2])
