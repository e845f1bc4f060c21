"""Dense matches of a working grid: optical flow against image 2 resampled by an approximate map, averaged over cells.

Flow is checked forward and backward. A cell's match is the mean over all its checked pixels rather than its best
corner, as corners lie on ridges and would bias the slope of a window. The overview matches all of image 1 coarsely: it
covers all textured parts, so it determines the motion better than sparse matches do, and gives each window a first
plane.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from slopecli.look.features import Grey
from slopecli.look.noise import ROUNDING_GREY
from slopecli.look.warp import (
    FloatImage,
    Grid,
    Layer,
    Pyramid,
    Transfer,
    block_sum,
    covered,
    image_gradient,
    resample,
    transfer_map,
)
from slopecli.types import FloatArray

FULL_SMOOTHINGS = 5  # rounds of variational refinement of the flow at every scale
# Share of pixels with consistent flow, and correlation of nine tenths of the cells, above which a coarse backward flow
# suffices as a check
CLOSED_SHARE, CLEAR_AGREEMENT = 0.97, 0.9
CELL = 8  # px of the working grid


@dataclass(frozen=True, eq=False)
class Cells:
    """Matches of the cells of a grid, one each.

    uv1, uv2 (n, 2) full px; information (n, 2, 2): structure tensor of the cell, grey levels squared per grid px
    squared, in the axes of the grid; index (n, 2) row and column of the cell; share (n,) of the cell's pixels that
    passed the checks; agreement (n,) correlation of grey values after matching.
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
        names = ("uv1", "uv2", "information", "index", "share", "agreement")
        return replace(self, **{name: getattr(self, name)[keep] for name in names})

    def joined(self, other: Cells) -> Cells:
        """These cells and others of the same grid."""
        return Cells(
            np.concatenate([self.uv1, other.uv1]),
            np.concatenate([self.uv2, other.uv2]),
            np.concatenate([self.information, other.information]),
            np.concatenate([self.index, other.index]),
            np.concatenate([self.share, other.share]),
            np.concatenate([self.agreement, other.agreement]),
            self.pixel_scale,
        )

    @cached_property
    def textured(self) -> NDArray[np.bool_]:
        """(n,) whether noise hardly moves the match."""
        # grey^2/px^2, smaller eigenvalue of the structure tensor
        return np.asarray(np.linalg.eigvalsh(self.information)[:, 0] > 100.0)


def flow(image1: Grey, image2: Grey, finest: int, smoothings: int = FULL_SMOOTHINGS) -> FloatImage:
    """Optical flow (h, w, 2) px from image 1 to image 2 by dense inverse search (Kroeger et al. 2016).

    finest : 0 measures at every px, 1 at every second; of a narrow strip the coarsest that leaves it 8 px wide.
    smoothings : rounds of variational refinement at every scale, each a third of the time of the search itself.
    """
    engine = cv2.DISOpticalFlow_create(cv2.DISOPTICAL_FLOW_PRESET_FAST)  # type: ignore[attr-defined]
    # OpenCV compares patches of 8 px, and reads beyond an image that has fewer rows at the finest scale
    engine.setFinestScale(max(0, min(finest, int(np.log2(min(image1.shape) / 8)))))
    engine.setVariationalRefinementIterations(smoothings)
    return np.asarray(engine.calc(image1, image2, None), np.float32)


def match_exposure(pulled: FloatImage, grey: Grey, valid: NDArray[np.bool_]) -> Grey:
    """Image 2 with the mean and contrast of image 1 where both are seen, as flow assumes equal brightness."""
    if valid.sum() < 16:
        return np.clip(pulled, 0, 255).astype(np.uint8)
    first, second = grey[valid], pulled[valid]
    gain = contrast_ratio(float(first.std()), float(second.std()))
    return np.clip((pulled - float(second.mean())) * gain + float(first.mean()) + 0.5, 0, 255).astype(np.uint8)


def contrast_ratio(first: float, second: float) -> float:
    """One contrast over another, RMS grey levels, 0.1 to 10: beyond, noise is most of what is seen."""
    return float(np.clip(first / max(second, 1e-3), 0.1, 10.0))


def dense_cells(
    grid: Grid,
    mapping: FloatImage,
    pyramid2: Pyramid,
    shape2: tuple[int, int],
    cell: int,
    finest: int,
    smoothings: int = FULL_SMOOTHINGS,
    *,
    check: int | None = None,
) -> Cells:
    """Match every cell of `cell` px of the grid; cells of which less than a third of the pixels pass are left out.

    mapping : (h, w, 2) approximate full px of image 2 of the grid's pixels.  shape2 : (rows, columns) of image 2.
    finest, smoothings : see `flow`.  check : `finest` of the backward flow where a coarse one leaves doubt; that of the
        forward flow by default.
    """
    valid = covered(mapping, shape2)
    pulled = match_exposure(resample(pyramid2, mapping, grid), grid.grey, valid)
    x, y = np.meshgrid(np.arange(grid.shape[1], dtype=np.float32), np.arange(grid.shape[0], dtype=np.float32))
    forward = flow(grid.grey, pulled, finest, smoothings)
    qx, qy = x + forward[..., 0], y + forward[..., 1]
    target = _at(mapping, qx, qy)
    inside = (qx >= 0) & (qy >= 0) & (qx <= grid.shape[1] - 1) & (qy <= grid.shape[0] - 1)
    inside &= valid & covered(target, shape2)
    found, points = _at(pulled, qx, qy), np.stack([x, y], -1)

    def closing(back: FloatImage) -> NDArray[np.bool_]:
        """(h, w) where forward and backward flow cancel to within 0.6 px along either axis."""
        off = np.abs(forward + _at(back, qx, qy))
        return np.asarray(inside & (off[..., 0] < 0.6) & (off[..., 1] < 0.6))

    def collected(closes: NDArray[np.bool_]) -> Cells:
        return _collect(grid, closes, points, target, found, cell)

    # backward flow is only a check: first at half the resolution and not smoothed, for a tenth of the time
    closes = closing(flow(pulled, grid.grey, finest + 1, 0))
    if np.count_nonzero(closes) >= CLOSED_SHARE * np.count_nonzero(inside):
        cells = collected(closes)
        if len(cells) and np.quantile(cells.agreement, 0.1) > CLEAR_AGREEMENT:
            return cells
    return collected(closing(flow(pulled, grid.grey, finest if check is None else check, smoothings)))


def _at(values: NDArray[Any], x: FloatImage, y: FloatImage) -> NDArray[Any]:
    """Values (h, w, ...) of a grid at points (h, w) of it, bilinear, of the same type."""
    return np.asarray(cv2.remap(values, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))


def _collect(
    grid: Grid, seen: NDArray[np.bool_], points: FloatImage, target: FloatImage, found: Grey, cell: int
) -> Cells:
    """Cells as means over their seen pixels: points of the grid, target px of image 2, found grey values of image 2."""
    first, second = grid.grey.astype(np.float32), found.astype(np.float32)
    gx, gy = image_gradient(first)
    mask = seen.astype(np.float32)
    count = block_sum(mask, cell).ravel()
    share = count / cell**2
    keep = share >= 1 / 3

    def sums(*layers: FloatImage) -> FloatArray:
        return np.stack([block_sum(layer * mask, cell).ravel()[keep] for layer in layers], -1)

    def means(*layers: FloatImage) -> FloatArray:
        return sums(*layers) / count[keep, None]

    layers = (first, second, first * first, second * second, first * second)
    mean1, mean2, square1, square2, product = means(*layers).T
    variance1 = np.maximum(square1 - mean1**2, ROUNDING_GREY**2)
    variance2 = np.maximum(square2 - mean2**2, ROUNDING_GREY**2)
    return Cells(
        uv1=grid.full(means(points[..., 0], points[..., 1])),
        uv2=means(target[..., 0], target[..., 1]),
        information=sums(gx * gx, gx * gy, gx * gy, gy * gy).reshape(-1, 2, 2),
        index=np.stack(np.divmod(np.flatnonzero(keep), grid.shape[1] // cell), -1),
        share=share[keep],
        agreement=(product - mean1 * mean2) / np.sqrt(variance1 * variance2),
        pixel_scale=grid.mean_scale,
    )


# ---- overview: coarse matches of the whole of image 1, guided by sparse matches ----


class OverviewEffort(NamedTuple):
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

    def apply(uv: FloatArray) -> FloatArray:
        return np.asarray(cv2.perspectiveTransform(np.asarray(uv, float)[:, None], H)[:, 0], float)

    field = spread((uv1 + 0.5) * scale, uv2 - apply(uv1), shape, 2 * CELL, np.ones(len(uv1)))

    def transfer(uv: FloatArray) -> FloatArray:
        node = (((uv + 0.5) * scale) / (2 * CELL) - 0.5).astype(np.float32)
        at = node[:, None]  # OpenCV takes at most 32766 points
        missed = cv2.remap(field, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(apply(uv) + missed[:, 0], float)

    return transfer


def spread(
    points: FloatArray, values: FloatArray, shape: tuple[int, int], step: int, weight: FloatArray
) -> NDArray[np.float32]:
    """Field (rows, columns, k) of values (n, k) averaged in bins of `step` px, the rest filled from coarser averages.

    weight : (n,) 0..1, of every value; where it is below 1, coarser averages count for the rest.
    """
    rows, columns = -(-shape[0] // step), -(-shape[1] // step)
    column = np.clip((points[:, 0] / step).astype(int), 0, columns - 1)
    row = np.clip((points[:, 1] / step).astype(int), 0, rows - 1)
    place = row * columns + column
    count = np.bincount(place, weight, rows * columns).reshape(rows, columns)
    sums = [np.bincount(place, weight * one, rows * columns).reshape(rows, columns) for one in values.T]
    filled = fill_from_coarse(np.stack(sums, -1) / np.maximum(count, 1e-9)[..., None], np.minimum(count, 1.0))
    return np.asarray(cv2.GaussianBlur(filled.astype(np.float32), (0, 0), 0.7).reshape(rows, columns, -1), np.float32)


def fill_from_coarse(values: FloatArray, weight: FloatArray) -> FloatArray:
    """Values (h, w, k) where the weight (h, w) is 1, else values of half the resolution, recursively (pull-push)."""
    if min(weight.shape) <= 2:
        mean = np.tensordot(weight, values, 2) / max(weight.sum(), 1e-9)
        return np.broadcast_to(mean, values.shape)
    rows, columns = weight.shape
    pad = ((0, rows % 2), (0, columns % 2))
    weighted, padded = np.pad(values * weight[..., None], (*pad, (0, 0))), np.pad(weight, pad)
    half_weight = _quarter(padded)
    coarse = fill_from_coarse(_quarter(weighted) / np.maximum(half_weight, 1e-9)[..., None], np.minimum(half_weight, 1))
    size = (padded.shape[1], padded.shape[0])
    grown = cv2.resize(np.ascontiguousarray(coarse, np.float32), size, interpolation=cv2.INTER_LINEAR)
    grown = grown.reshape(*padded.shape, -1)[:rows, :columns]
    return np.asarray(weight[..., None] * values + (1 - weight[..., None]) * grown)


def _quarter(a: FloatArray) -> FloatArray:
    """Sums over blocks of 2 x 2."""
    return np.asarray(a[::2, ::2] + a[1::2, ::2] + a[::2, 1::2] + a[1::2, 1::2])
