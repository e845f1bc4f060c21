"""Maps from a working grid over image 1 into image 2, resampling of images by them, and image pyramids.

A working grid is a rectangle of image 1, possibly shrunken. The map that image 2 is resampled by also turns the flow
that remains into pixels of image 2, so that its interpolation error cancels.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from slopecli.geometry.camera import OUTSIDE_PX
from slopecli.geometry.statistics import median
from slopecli.look.features import Grey
from slopecli.types import FloatArray

NODE_STEP = 8  # px between exactly computed nodes of a map or a lens; bilinear in between

FloatImage = NDArray[np.float32]
Box = tuple[slice, slice]  # rows and columns of a rectangle of pixels

Transfer = Callable[[FloatArray], FloatArray]  # (n, 2) px of image 1 -> (n, 2) px of image 2


@dataclass(frozen=True, eq=False)
class Grid:
    """A working grid: grey values of a rectangle of image 1, its pixel (0, 0) at (x0, y0) of the shrunken image."""

    grey: Grey
    x0: float
    y0: float
    scale: FloatArray  # (2,) shrunken px per full px, exact per axis

    @property
    def mean_scale(self) -> float:
        """Grid px per full px, the geometric mean of the two axes."""
        return float(np.sqrt(np.prod(self.scale)))

    @property
    def shape(self) -> tuple[int, int]:
        return int(self.grey.shape[0]), int(self.grey.shape[1])

    def full(self, points: FloatArray) -> FloatArray:
        """Points (..., 2) of the grid as full-resolution pixels of image 1."""
        return (points + np.array([self.x0 + 0.5, self.y0 + 0.5])) / self.scale - 0.5

    def inside(self, uv: FloatArray) -> FloatArray:
        """Full-resolution pixels (..., 2) as points of the grid."""
        return (uv + 0.5) * self.scale - np.array([self.x0 + 0.5, self.y0 + 0.5])


def plane_transfer(
    turned: FloatArray, inverse_depth: FloatArray, epipole2: FloatArray, pixels2: Transfer
) -> FloatArray:
    """(n, 2) px of image 2 of points of image 1 with known inverse depth; OUTSIDE_PX for points behind a camera.

    turned : (n, 3) homogeneous rays of image 1 times R.T.  inverse_depth : (n,) 1/baseline.  epipole2 : R T.
    """
    moved = turned - inverse_depth[:, None] * epipole2
    ahead = (moved[:, 2] > 1e-9) & (inverse_depth > 0)
    uv = pixels2(moved[:, :2] / np.where(ahead, moved[:, 2], 1.0)[:, None])
    return np.where(ahead[:, None] & np.isfinite(uv), uv, OUTSIDE_PX)


def transfer_map(grid: Grid, transfer: Transfer) -> FloatImage:
    """Map (h, w, 2) float32 in full px of image 2, exact on nodes NODE_STEP apart and bilinear in between."""
    return spread_table(transfer(map_nodes(grid)).reshape(*node_shape(grid.shape), 2), grid.shape)


def map_nodes(grid: Grid) -> FloatArray:
    """Nodes (n, 2) of a map over the grid, full-resolution px of image 1, one before and one past its border."""
    rows, columns = node_shape(grid.shape)
    x, y = np.meshgrid(*((np.arange(count) - 0.5) * NODE_STEP - 0.5 for count in (columns, rows)))
    return grid.full(np.stack([x, y], -1).reshape(-1, 2))


def spread_table(table: FloatArray, shape: tuple[int, int]) -> FloatImage:
    """Map (h, w, ...) float32 of the given shape from its values at `node_shape` nodes (rows, columns, ...)."""
    (rows, columns), (height, width) = table.shape[:2], shape
    dense = cv2.resize(
        table.astype(np.float32), (columns * NODE_STEP, rows * NODE_STEP), interpolation=cv2.INTER_LINEAR
    )
    return np.ascontiguousarray(dense[NODE_STEP : NODE_STEP + height, NODE_STEP : NODE_STEP + width], np.float32)


def node_shape(shape: tuple[int, int]) -> tuple[int, int]:
    """Rows and columns of the nodes of a map over (h, w) pixels."""
    return -(-shape[0] // NODE_STEP) + 2, -(-shape[1] // NODE_STEP) + 2


@dataclass(frozen=True, eq=False)
class Layer:
    """One resolution of an image. `scale` (2,): its pixels per full pixel."""

    grey: Grey
    scale: FloatArray


class Pyramid:
    """An image at full and halved resolutions, each computed when first needed; the scale of the overview besides."""

    def __init__(self, grey: Grey, overview_scale: FloatArray | None = None) -> None:
        self._full = grey
        self.overview_scale = np.ones(2) if overview_scale is None else overview_scale
        self._layers = [Layer(grey, np.ones(2))]

    def at(self, shrink_by: float) -> Layer:
        """The coarsest layer of at most `shrink_by` full px a pixel, with a tolerance of 0.17 octaves."""
        level = max(0, int(np.floor(np.log2(max(shrink_by, 1.0)) + 0.17)))
        while len(self._layers) <= level:
            last = self._layers[-1].grey
            size = (max(1, last.shape[1] // 2), max(1, last.shape[0] // 2))
            small = np.asarray(cv2.resize(last, size, interpolation=cv2.INTER_AREA), np.uint8)
            full = np.array([self._full.shape[1], self._full.shape[0]])
            self._layers.append(Layer(small, np.array(size) / full))
        return self._layers[level]


def cut(layer: Layer, x: float, y: float, width: float, height: float, side: int | None = None) -> Grid:
    """Working grid over a rectangle (full px of image 1), clipped to the image.

    side : the grid is shrunk until the rectangle's longer side has this many pixels; None leaves it as the layer is.
    """
    rows, columns = layer.grey.shape
    x0, y0 = max(0, int(np.floor(x * layer.scale[0]))), max(0, int(np.floor(y * layer.scale[1])))
    x1 = min(columns, int(np.ceil((x + width) * layer.scale[0])))
    y1 = min(rows, int(np.ceil((y + height) * layer.scale[1])))
    crop = np.ascontiguousarray(layer.grey[y0:y1, x0:x1])
    factor = 1.0 if side is None else side / (max(width, height) * float(layer.scale.mean()))
    if factor >= 1.0 or min(crop.shape) < 2:
        return Grid(crop, x0, y0, layer.scale)
    size = (max(1, round(crop.shape[1] * factor)), max(1, round(crop.shape[0] * factor)))
    ratio = np.array(size) / [crop.shape[1], crop.shape[0]]
    small = np.asarray(cv2.resize(crop, size, interpolation=cv2.INTER_AREA), np.uint8)
    return Grid(small, x0 * float(ratio[0]), y0 * float(ratio[1]), layer.scale * ratio)


def magnification(transfer_values: FloatImage, grid: Grid) -> float:
    """Median length in image 2 of one full pixel of image 1, from a map over the grid; 1 where that has no values."""
    if min(grid.shape) < 3:
        return 1.0
    step = max(1, min(grid.shape) // 24)
    sub = transfer_values[::step, ::step].astype(float)
    if min(sub.shape[:2]) < 2:
        return 1.0
    dx, dy = np.diff(sub, axis=1)[:-1], np.diff(sub, axis=0)[:, :-1]
    area = np.abs(dx[..., 0] * dy[..., 1] - dx[..., 1] * dy[..., 0]) / step**2
    area = area[np.isfinite(area)]  # a lens has no ray for some places
    return float(np.sqrt(median(area))) * grid.mean_scale if len(area) else 1.0


def sample_layer(layer: Layer, mapping: FloatImage, *, cubic: bool = False) -> FloatImage:
    """Grey values (h, w) of a layer at full px (h, w, 2), bilinear and in whole levels; outside, the border repeats.

    cubic : interpolate with a cubic kernel and do not round, which takes twice as long.
    """
    whole = bool((layer.scale == 1.0).all())
    local = mapping if whole else (mapping + 0.5) * layer.scale.astype(np.float32) - np.float32(0.5)
    grey = layer.grey.astype(np.float32) if cubic else layer.grey
    kernel = cv2.INTER_CUBIC if cubic else cv2.INTER_LINEAR
    found = cv2.remap(grey, local, None, kernel, borderMode=cv2.BORDER_REPLICATE)  # type: ignore[call-overload]
    return np.asarray(found, np.float32)


def resample(pyramid2: Pyramid, mapping: FloatImage, grid: Grid, *, cubic: bool = False) -> FloatImage:
    """Image 2 resampled onto the grid by a map of full px, from the layer that is as sharp as image 1 there.

    Outside image 2 the border repeats; see `covered`.  cubic : see `sample_layer`.
    """
    return sample_layer(pyramid2.at(magnification(mapping, grid) / grid.mean_scale), mapping, cubic=cubic)


def covered(mapping: FloatImage | FloatArray, shape2: tuple[int, int], margin: float = 2.0) -> NDArray[np.bool_]:
    """(...) whether points (..., 2), full px, lie in image 2, at least `margin` px from its border."""
    u, v = mapping[..., 0], mapping[..., 1]
    return (u >= margin) & (v >= margin) & (u <= shape2[1] - 1 - margin) & (v <= shape2[0] - 1 - margin)


def image_gradient(image: FloatImage) -> tuple[FloatImage, FloatImage]:
    """Gradients (h, w) along x and y, grey levels per px."""
    gx, gy = cv2.Sobel(image, cv2.CV_32F, 1, 0, scale=1 / 8), cv2.Sobel(image, cv2.CV_32F, 0, 1, scale=1 / 8)
    return np.asarray(gx, np.float32), np.asarray(gy, np.float32)


def gaussian_reach(sigma_px: float) -> float:
    """Px from its middle within which a Gaussian window lies, but for 6e-5 of its weight along an axis: four sigmas."""
    return 4.0 * sigma_px


def local_mean(image: FloatImage, sigma: float) -> FloatImage:
    """Image (h, w) smoothed by a Gaussian of `sigma` px, at the resolution that suffices for it."""
    height, width = image.shape
    shrink = max(1, int(sigma / 3.0))  # the Gaussian has a sigma of at least 3 px: so wide, pixels do not show
    small = cv2.resize(image, (-(-width // shrink), -(-height // shrink)), interpolation=cv2.INTER_AREA)
    # mirrored at the edge of the image; at the middle of the first pixel, which is larger here, would be elsewhere
    smooth = cv2.GaussianBlur(small, (0, 0), sigma / shrink, borderType=cv2.BORDER_REFLECT)
    return np.asarray(cv2.resize(smooth, (width, height), interpolation=cv2.INTER_LINEAR), np.float32)


def block_sum(layer: FloatImage, cell: int) -> FloatArray:
    """Sums over square blocks of `cell` px, (h // cell, w // cell); the rest at right and bottom is dropped."""
    rows, columns = layer.shape[0] // cell, layer.shape[1] // cell
    # rows first: NumPy adds long lines many times faster than short ones
    lines = layer[: rows * cell].reshape(rows, cell, layer.shape[1]).sum(1, dtype=np.float64)[:, : columns * cell]
    return np.asarray(lines.reshape(rows, columns, cell).sum(2))


def sample_grey(grey: Grey | FloatImage, uv: FloatArray) -> FloatArray:
    """(n,) grey values of an image at pixels (n, 2), bilinear."""
    if len(uv) == 0:
        return np.empty(0)
    at = uv.astype(np.float32)[:, None]  # OpenCV takes at most 32766 points
    return np.asarray(
        cv2.remap(grey, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)[:, 0], float
    )


def sample_map(mapping: FloatImage, points: FloatArray) -> FloatArray:
    """Values (n, 2) of a map at points (n, 2) of its grid, bilinear in double precision."""
    height, width = mapping.shape[:2]
    x, y = np.clip(points[:, 0], 0, width - 1), np.clip(points[:, 1], 0, height - 1)
    i, j = np.minimum(x.astype(int), width - 2), np.minimum(y.astype(int), height - 2)
    fx, fy = (x - i)[:, None], (y - j)[:, None]
    top = (1 - fx) * mapping[j, i] + fx * mapping[j, i + 1]
    bottom = (1 - fx) * mapping[j + 1, i] + fx * mapping[j + 1, i + 1]
    return np.asarray((1 - fy) * top + fy * bottom, float)
