"""Overview: coarse dense matches of the whole of image 1, guided by sparse matches.

They cover all textured parts, so they determine the motion better than the sparse matches do, and give each window a
first plane.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from slopecli.look.dense import FULL_SMOOTHINGS, Cells, dense_cells
from slopecli.look.warp import Grid, Layer, Pyramid, Transfer, transfer_map
from slopecli.types import FloatArray

CELL = 8  # px of the working grid
FIELD_STEP = 16  # px of the working grid between nodes of the displacement field


@dataclass(frozen=True)
class OverviewEffort:
    """Resolution: image 1 is shrunk to at most `max_pixels`; `finest` and `smoothings` are those of `dense.flow`.

    Flow at every pixel of an image is as precise as at every second pixel of one three times as large.
    """

    max_pixels: float
    finest: int
    smoothings: int


WHOLE = OverviewEffort(max_pixels=1.0e6, finest=1, smoothings=FULL_SMOOTHINGS)


def overview_cells(
    layer1: Layer,
    pyramid2: Pyramid,
    shape2: tuple[int, int],
    uv1: FloatArray,
    uv2: FloatArray,
    effort: OverviewEffort = WHOLE,
) -> Cells:
    """Cells over all of image 1, guided by sparse matches uv1 -> uv2 (n, 2), full px, without mismatches."""
    height, width = layer1.grey.shape
    grid = Grid(layer1.grey, 0, 0, layer1.scale)
    mapping = transfer_map(grid, sparse_transfer(uv1, uv2, layer1.scale, (height, width)))
    return dense_cells(grid, mapping, pyramid2, shape2, CELL, effort.finest, effort.smoothings)


def sparse_transfer(uv1: FloatArray, uv2: FloatArray, scale: FloatArray, shape: tuple[int, int]) -> Transfer:
    """A smooth map near the matches: their dominant homography plus its interpolated residuals."""
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
        at = node[:, None]  # a column, as OpenCV allows at most 32767 points in a row
        missed = cv2.remap(field, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(apply(uv) + missed[:, 0], float)

    return transfer


def _spread(points: FloatArray, values: FloatArray, shape: tuple[int, int]) -> np.ndarray:
    """Field (rows, columns, 2) of values (n, 2) averaged in bins, empty bins filled from coarser averages."""
    rows, columns = -(-shape[0] // FIELD_STEP), -(-shape[1] // FIELD_STEP)
    column = np.clip((points[:, 0] / FIELD_STEP).astype(int), 0, columns - 1)
    row = np.clip((points[:, 1] / FIELD_STEP).astype(int), 0, rows - 1)
    total, count = np.zeros((rows, columns, 2)), np.zeros((rows, columns))
    np.add.at(total, (row, column), values)
    np.add.at(count, (row, column), 1.0)
    filled = _pull_push(total / np.maximum(count, 1)[..., None], np.minimum(count, 1))
    return cv2.GaussianBlur(filled.astype(np.float32), (0, 0), 0.7)


def _pull_push(values: FloatArray, weight: FloatArray) -> FloatArray:
    """Values (h, w, 2) where the weight (h, w) is 1, else values of half the resolution, recursively (pull-push)."""
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
    """Sums over blocks of 2 x 2."""
    return np.asarray(a[::2, ::2] + a[1::2, ::2] + a[::2, 1::2] + a[1::2, 1::2])
