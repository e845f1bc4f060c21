"""Dense matching of a working grid with image 2 already pulled close: inverse-search flow, checked both ways, in cells.

A cell's match is the mean over all its checked pixels, not that of its best corner: a window's slope is that of all
its ground, and picking corners picks ridges.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from slopecli.types import FloatArray
from slopecli.vision.features import Grey
from slopecli.vision.warp import FloatImage, Grid, Pyramid, block_sum, covered, resample

FORWARD_BACKWARD_PX = 0.6  # flow there and back must close within this, px of the grid
MIN_SIDE = 24  # the flow's own patches and pyramid need this much


@dataclass(frozen=True, eq=False)
class Cells:
    """Matches of the cells of a grid.

    uv1, uv2 (n, 2) full-resolution px; information (n, 2, 2): structure tensor of the cell in grey levels squared per
    grid pixel squared, in the axes of the grid; index (n, 2) row and column of the cell, to tell neighbours;
    share (n,) of the cell's pixels that passed the checks; agreement (n,) photometric correlation after matching.
    """

    uv1: FloatArray
    uv2: FloatArray
    information: FloatArray
    index: NDArray[np.int64]
    share: FloatArray
    agreement: FloatArray
    pixel_scale: float  # grid px per full px

    def __len__(self) -> int:
        return len(self.uv1)

    def take(self, keep: NDArray[np.bool_]) -> Cells:
        """The cells where `keep` (n,) is true."""
        return Cells(
            self.uv1[keep],
            self.uv2[keep],
            self.information[keep],
            self.index[keep],
            self.share[keep],
            self.agreement[keep],
            self.pixel_scale,
        )


def flow_engine(finest: int) -> cv2.DISOpticalFlow:
    """Dense inverse search (Kroeger et al. 2016); `finest` 0 measures at every px, 1 at every second."""
    engine: cv2.DISOpticalFlow = cv2.DISOpticalFlow_create(  # type: ignore[attr-defined]
        cv2.DISOPTICAL_FLOW_PRESET_FAST
    )
    engine.setFinestScale(finest)
    return engine


def match_exposure(pulled: FloatImage, grey: Grey, valid: NDArray[np.bool_]) -> Grey:
    """Give the pulled image the mean and contrast of image 1 where both are seen: flow assumes equal brightness."""
    if valid.sum() < 16:
        return np.clip(pulled, 0, 255).astype(np.uint8)
    ours, theirs = grey[valid], pulled[valid]
    gain = float(np.clip(ours.std() / max(float(theirs.std()), 1e-3), 0.5, 2.0))
    return np.clip((pulled - float(theirs.mean())) * gain + float(ours.mean()) + 0.5, 0, 255).astype(np.uint8)


def dense_cells(
    grid: Grid, mapping: FloatImage, pyramid2: Pyramid, shape2: tuple[int, int], cell: int, finest: int
) -> Cells:
    """Match every cell of `cell` px of the grid; cells with less than a third of checked pixels are left out."""
    valid = covered(mapping, shape2)
    pulled = match_exposure(resample(pyramid2, mapping, grid, cv2.INTER_LINEAR), grid.grey, valid)
    engine = flow_engine(finest)
    forward, backward = engine.calc(grid.grey, pulled, None), engine.calc(pulled, grid.grey, None)  # type: ignore[call-overload]
    x, y = np.meshgrid(np.arange(grid.shape[1], dtype=np.float32), np.arange(grid.shape[0], dtype=np.float32))
    qx, qy = x + forward[..., 0], y + forward[..., 1]
    back = cv2.remap(backward, qx, qy, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    closes = np.abs(forward + back).max(2) < FORWARD_BACKWARD_PX
    target = cv2.remap(mapping, qx, qy, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).astype(np.float32)
    inside = (qx >= 0) & (qy >= 0) & (qx <= grid.shape[1] - 1) & (qy <= grid.shape[0] - 1)
    seen = closes & inside & valid & covered(target, shape2)
    found = np.asarray(cv2.remap(pulled, qx, qy, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), np.uint8)
    return _collect(grid, seen, np.stack([x, y], -1), target, found, cell)


def _collect(
    grid: Grid, seen: NDArray[np.bool_], points: FloatImage, target: FloatImage, found: Grey, cell: int
) -> Cells:
    rows, columns = grid.shape[0] // cell, grid.shape[1] // cell
    ours, theirs = grid.grey.astype(np.float32), found.astype(np.float32)
    gx, gy = cv2.Sobel(ours, cv2.CV_32F, 1, 0, scale=1 / 8), cv2.Sobel(ours, cv2.CV_32F, 0, 1, scale=1 / 8)
    mask = seen.astype(np.float32)
    count = block_sum(mask, cell)
    layers = [points[..., 0], points[..., 1], target[..., 0], target[..., 1]]
    layers += [gx * gx, gx * gy, gy * gy, ours, theirs, ours * ours, theirs * theirs, ours * theirs]
    sums = np.stack([block_sum(layer * mask, cell) for layer in layers], -1).reshape(rows * columns, -1)
    share = (count / cell**2).reshape(-1)
    keep = share >= 1 / 3
    mean = sums[keep] / count.reshape(-1)[keep, None]
    variance1, variance2 = mean[:, 9] - mean[:, 7] ** 2, mean[:, 10] - mean[:, 8] ** 2
    covariance = mean[:, 11] - mean[:, 7] * mean[:, 8]
    agreement = covariance / np.sqrt(np.maximum(variance1, 0.25) * np.maximum(variance2, 0.25))
    tensor = sums[keep][:, [4, 5, 5, 6]].reshape(-1, 2, 2)
    index = np.stack(np.divmod(np.flatnonzero(keep), columns), -1)
    scale = float(np.sqrt(np.prod(grid.scale)))
    return Cells(
        grid.full(mean[:, :2]), mean[:, 2:4].astype(float), tensor.astype(float), index, share[keep], agreement, scale
    )
