"""Inverse depth of every pixel of image 1 that image 2 shows, with the motion known.

The inverse depth of the overview's matches is spread over the image, and image 2 is resampled by it. Optical flow to
the resampled image gives the displacement that remains; its part along the epipolar line corrects the depth. Then
every pixel is aligned along its line, in rounds, on a small Gaussian window (Lucas and Kanade 1981, in one dimension).
Around steps, the pixels that such a window gave the depth of the other side can be found (`depth_edges`).
What remains across the lines, where nothing should, is the check and the noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from slopecli.geometry.statistics import GATE_SIGMAS, robust_sigma
from slopecli.look.dense import Cells, contrast_ratio, dense_cells, flow, match_exposure, spread
from slopecli.look.depth_edges import Edges, hidden
from slopecli.look.depth_transfer import DepthTransfer
from slopecli.look.matches import ON_PLANE_PX
from slopecli.look.noise import LEAST_MATCH_PX, NOISE_GREY, OVERVIEW_CELL_PX, SAME_GROUND
from slopecli.look.scene import Scene, whole_grid
from slopecli.look.warp import (
    NODE_STEP,
    FloatImage,
    Grid,
    covered,
    cut,
    gaussian_reach,
    image_gradient,
    local_mean,
    magnification,
    node_shape,
    resample,
    sample_layer,
    spread_table,
)
from slopecli.types import FloatArray, IntArray
from slopecli.windows import Window


class DepthTunables(NamedTuple):
    """Tunables of the dense depth."""

    most_pixels: float = 4.2e6  # of the working grid: 2048 x 2048; larger images are shrunk to it
    rounds: int = 3  # of alignment along the epipolar lines
    # of a mean over the window: a window of 60 px, errors shared by some 8 of them
    window_noise: float = NOISE_GREY**2 / 8.0
    window_px: float = 2.5  # grid px, sigma of the Gaussian window of the alignment
    rest_px: float = 1.5  # grid px, the same of the window that shows what this one left
    side_px: int = 5  # grid px, of the median filter between rounds, the smallest bare area, and the square of a jump
    # grid px, sigma of the Gaussian below which differences of the two images are texture, not shading
    shading_px: float = 6.0
    margin_px: int = 24  # grid px around windows
    # 1-sigma of the logarithm of inverse depth before the images are asked: relief, errors of matches
    relief: float = 0.05
    reach_px: float = 0.5  # grid px, 1-sigma of what is left to align after the flow
    told: float = 0.3  # least share of a correction that the images determine, rather than these two assumptions
    own_px: float = 1.0  # grid px, sigma of the Gaussian over which gradients count as a pixel's own
    grain_px: float = 0.7  # grid px, sigma of the Gaussian that takes the noise of single pixels out of gradients
    rounding: float = 0.03  # sum of the squares of both gradients, that rounding to whole grey values makes
    untold_px: int = 7  # grid px, side of the smallest area whose depth the images do not tell that counts as bare, too
    most_change: float = 0.5  # largest change of the logarithm of inverse depth by the flow
    most_step: float = 0.2  # the same by a round of alignment
    step_gradient: float = 0.4  # of the displacement, px per px: ground of 45 degrees has a tenth to a fifth
    beside_px: int = 4  # grid px to either side of a step that may have the depth of the other side


DEPTH = DepthTunables()


@dataclass(frozen=True, eq=False)
class DenseDepth:
    """Inverse depth of the pixels of a working grid over image 1.

    w (h, w): 1/baseline, positive; to be used where `known` (h, w).
    sure (h, w): those known that are not beside a step of depth, where matching takes one side for the other.
    step (h, w): pixels on such a step.  bare (h, w): pixels without texture of their own, which may have any depth,
    though an edge beside them makes it look known.  rays (h, w, 2): normalised coordinates.
    uv2 (h, w, 2): full px of image 2.  shifts (h, w, 2): displacement, grid px, per change of ln w.
    across_px (h, w): residual across the epipolar line after alignment, as large as texture allows it along the line,
    grid px.  along_px (h, w): displacement along the line that a smaller window still asks for, grid px.
    """

    grid: Grid
    w: FloatImage
    known: NDArray[np.bool_]
    sure: NDArray[np.bool_]
    step: NDArray[np.bool_]
    bare: NDArray[np.bool_]
    rays: FloatImage
    uv2: FloatImage
    shifts: FloatImage
    across_px: FloatImage
    along_px: FloatImage

    @cached_property
    def shift_px(self) -> FloatImage:
        """(h, w) length of `shifts`."""
        return np.sqrt(_length2(self.shifts) + 1e-12)

    @cached_property
    def variance(self) -> FloatImage:
        """(h, w) of ln w, by errors of alignment; mismatches count as the largest error that is noise."""
        most = GATE_SIGMAS * robust_sigma(self.along_px[self.known].astype(float)) if self.known.any() else 0.0
        return np.asarray(np.minimum(np.abs(self.along_px), np.float32(most)) ** 2 / self.shift_px**2)

    @cached_property
    def points(self) -> FloatImage:
        """(h, w, 3) points of the pixels, camera-1 axes, baselines; of no meaning where not known."""
        z = 1.0 / self.w
        return np.dstack([self.rays[..., 0] * z, self.rays[..., 1] * z, z])

    @cached_property
    def span(self) -> FloatImage:
        """(h, w) range of ln w over a square of `DEPTH.side_px`, beyond what its noise has."""
        logarithm, kernel = np.log(self.w), np.ones((DEPTH.side_px, DEPTH.side_px), np.uint8)
        noise = robust_sigma(self.across_px[self.known]) / self.shift_px if self.known.any() else 0.0
        span = cv2.dilate(logarithm, kernel) - cv2.erode(logarithm, kernel)
        return np.asarray(np.maximum(span - GATE_SIGMAS * noise, 0.0))

    @property
    def focal_px(self) -> float:
        """Grid px per unit of normalised coordinate, over the middle row of the grid."""
        row = self.rays[self.rays.shape[0] // 2, :, 0]
        return (len(row) - 1) / float(row[-1] - row[0])


def measure_depth(
    scene: Scene,
    windows: Sequence[Window] = (),
    max_pixels: float = DEPTH.most_pixels,
    start: FloatImage | None = None,
    *,
    edges: bool = False,
) -> DenseDepth:
    """Measure the inverse depth of every pixel of image 1 under the motion of the scene.

    windows : px of image 1; with some, only the rectangle around them is measured.
    max_pixels : of the working grid; what is measured is shrunk to it.
    start : inverse depths of its pixels to begin with, right to a pixel or two; None for evidence and flow.
    edges : whether steps of depth are put where the images have them.
    """
    grid = _grid_around(scene, windows, max_pixels) if windows else whole_grid(scene, max_pixels)
    transfer = DepthTransfer(scene, grid)
    nodes = _start(scene, grid)
    shifts = transfer.shifts(nodes)
    w = spread_table(nodes, grid.shape)
    pair = _Alignment(scene, grid, transfer, shifts)
    w, across = pair.by_flow(w) if start is None else (start, np.zeros_like(w))
    for number in range(DEPTH.rounds):
        w = pair.along(w, edges=edges and number > 0)
    left = pair.check(w)
    uv2, told = left.uv2, left.told
    shown = scene.shown(grid, uv2)
    bare = shown & (_in_one_piece(~left.own, DEPTH.side_px) | _in_one_piece(~told, DEPTH.untold_px))
    known = shown & told & (np.abs(across) < ON_PLANE_PX) & (np.abs(left.across_px) < ON_PLANE_PX)
    known &= ~hidden(w, uv2, known, scene.shape2)
    step = _steps(w, shifts) & shown
    side = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * DEPTH.beside_px + 1, 2 * DEPTH.beside_px + 1))
    sure = known & ~bare & (cv2.dilate((step | ~shown).astype(np.uint8), side) == 0)
    return DenseDepth(grid, w, known, sure, step, bare, transfer.rays, uv2, shifts, left.noise_px, left.along_px)


def depth_cells(scene: Scene, grid: Grid, cell: int) -> Cells:
    """Match every cell of `cell` px of a grid over all of image 1, image 2 resampled by the depth of the overview."""
    mapping = DepthTransfer(scene, grid).pixels2(spread_table(_start(scene, grid), grid.shape))
    return dense_cells(grid, mapping, scene.pyramid2, scene.shape2, cell, finest=0)


def _grid_around(scene: Scene, windows: Sequence[Window], max_pixels: float) -> Grid:
    """Working grid over the rectangle around windows, with a margin as flow is biased at a border."""
    x, y, w, h = np.array(windows, float).T
    low, high = np.array([x.min(), y.min()]), np.array([(x + w).max(), (y + h).max()])
    shrink_by = max(1.0, float(np.prod(high - low) / max_pixels) ** 0.5)
    low, high = low - DEPTH.margin_px * shrink_by, high + DEPTH.margin_px * shrink_by
    side = None if shrink_by == 1.0 else round(float((high - low).max()) / shrink_by)
    (x0, y0), (width, height) = low, high - low
    return cut(scene.pyramid1.at(shrink_by), x0, y0, width, height, side)


def _start(scene: Scene, grid: Grid) -> FloatArray:
    """(rows, columns) inverse depths of the nodes of a map over the grid, from the matches of the overview."""
    found = scene.evidence
    error = LEAST_MATCH_PX / found.focal_px / np.maximum(found.leverage * found.w, 1e-12)
    weight = DEPTH.relief**2 / (DEPTH.relief**2 + error**2)
    places = grid.inside(found.uv1) + 0.5 + NODE_STEP  # the first node lies before the border, see `map_nodes`
    rows, columns = node_shape(grid.shape)
    shape = rows * NODE_STEP, columns * NODE_STEP
    logarithm = spread(places, np.log(found.w)[:, None], shape, NODE_STEP, weight)[..., 0]
    return np.exp(cv2.medianBlur(logarithm.astype(np.float32), 3).astype(float))


class _Left(NamedTuple):
    """What is left of an alignment, of every pixel (h, w): px of image 2 (h, w, 2), whether the images tell the depth,
    whether by texture of the pixel's own that both show, the residual across the epipolar line, what noise alike would
    be along the line, and what a smaller window still asks for along it, grid px."""

    uv2: FloatImage
    told: NDArray[np.bool_]
    own: NDArray[np.bool_]
    across_px: FloatImage
    noise_px: FloatImage
    along_px: FloatImage


class _Compared(NamedTuple):
    """Image 2 resampled by inverse depths: of every pixel (h, w) its px of image 2 (h, w, 2), whether these are in the
    image, and the grey value there with the exposure of image 1, by a factor and a summand."""

    uv2: FloatImage
    valid: NDArray[np.bool_]
    pulled: FloatImage
    gain: np.float32
    shading: FloatImage


class _Alignment:
    """Image 1 and image 2 resampled by inverse depths; corrects these so that the two agree."""

    def __init__(self, scene: Scene, grid: Grid, transfer: DepthTransfer, shifts: FloatImage) -> None:
        self._scene, self._grid, self._transfer = scene, grid, transfer
        self._grey = grid.grey.astype(np.float32)
        self._shifts = shifts
        self._length2 = _length2(shifts)
        self._hold = DEPTH.window_noise * (1.0 / DEPTH.relief**2 + self._length2 / DEPTH.reach_px**2)

    def _resampled(self, w: FloatImage) -> tuple[FloatImage, FloatImage]:
        """Px of image 2 (h, w, 2), and its grey values (h, w), of the pixels at these inverse depths."""
        uv2 = self._transfer.pixels2(w)
        return uv2, resample(self._scene.pyramid2, uv2, self._grid, cubic=True)

    def by_flow(self, w: FloatImage) -> tuple[FloatImage, FloatImage]:
        """Inverse depths corrected by optical flow, and the part of the flow across the epipolar lines, grid px."""
        uv2, pulled = self._resampled(w)
        shown = covered(uv2, self._scene.shape2)
        moved = flow(self._grid.grey, match_exposure(pulled, self._grid.grey, shown), 1)
        by_shift = moved[..., 0] * self._shifts[..., 0] + moved[..., 1] * self._shifts[..., 1]
        along = shown * by_shift / (self._length2 + (OVERVIEW_CELL_PX / DEPTH.relief) ** 2)
        side = moved[..., 1] * self._shifts[..., 0] - moved[..., 0] * self._shifts[..., 1]
        across = side / np.sqrt(self._length2 + 1e-12)
        return w * np.exp(np.clip(along, -DEPTH.most_change, DEPTH.most_change)), across

    def _compared(self, w: FloatImage) -> _Compared:
        uv2, pulled = self._resampled(w)
        valid = covered(uv2, self._scene.shape2)
        gain, shading = _exposure(pulled, self._grey, valid)
        return _Compared(uv2, valid, pulled * gain + shading, gain, shading)

    def _differences(self, seen: _Compared) -> tuple[FloatImage, FloatImage, FloatImage]:
        """Differences of grey values (h, w), and the gradients of the mean of both images."""
        return np.where(seen.valid, self._grey - seen.pulled, 0.0), *image_gradient(0.5 * (self._grey + seen.pulled))

    def along(self, w: FloatImage, *, edges: bool) -> FloatImage:
        """Inverse depths after a step of alignment along epipolar lines; edges: with steps put in their place first."""
        seen = self._compared(w)
        if edges:
            w, seen = self._at_edges(w, seen)
        difference, gx, gy = self._differences(seen)
        slope = gx * self._shifts[..., 0] + gy * self._shifts[..., 1]
        step = _window(slope * difference) / (_window(slope * slope) + self._hold)
        aligned = w * np.exp(np.clip(step, -DEPTH.most_step, DEPTH.most_step))
        return np.asarray(cv2.medianBlur(aligned, DEPTH.side_px), np.float32)

    def _at_edges(self, w: FloatImage, seen: _Compared) -> tuple[FloatImage, _Compared]:
        """Inverse depths, and image 2 resampled by them, with the pixels around steps on their own side."""
        layer = self._scene.pyramid2.at(magnification(seen.uv2, self._grid) / self._grid.mean_scale)

        def grey2(at: IntArray, logarithm: FloatImage) -> FloatImage:
            pulled = sample_layer(layer, self._transfer.pixels2(np.exp(logarithm), at), cubic=True)
            return np.asarray(pulled * seen.gain + seen.shading.ravel()[at])

        reach_px = int(gaussian_reach(DEPTH.window_px))
        edges = Edges(_steps(w, self._shifts), np.sqrt(self._length2), reach_px, DEPTH.own_px)
        logarithm, pulled = edges.settled(np.log(w), self._grey, seen.pulled, grey2)
        return (w, seen) if pulled is seen.pulled else (np.exp(logarithm), seen._replace(pulled=pulled))

    def check(self, w: FloatImage) -> _Left:
        """What is left of the alignment.

        The residual across is held back where texture is faint, as a step of alignment is; in its rounds depth is not.
        """
        seen = self._compared(w)
        difference, gx, gy = self._differences(seen)
        length = np.sqrt(self._length2 + 1e-12)
        slope = gx * self._shifts[..., 0] + gy * self._shifts[..., 1]
        side = (gy * self._shifts[..., 0] - gx * self._shifts[..., 1]) / length
        told = _window(slope * slope)
        own = self._alike(slope, difference, length) > SAME_GROUND
        across2, pull = _window(side * side), _window(side * difference)
        settled = 1.0 - (self._hold / (told + self._hold)) ** DEPTH.rounds
        alike = settled * pull * length / np.sqrt((across2 + np.float32(1e-3)) * (told + np.float32(1e-3)))
        across = pull / (across2 + DEPTH.window_noise / DEPTH.reach_px**2)
        along = _rest(slope * difference) * length / (_rest(slope * slope) + np.float32(0.3) * self._length2)
        return _Left(seen.uv2, told > DEPTH.told * (told + self._hold), own, across, alike, along)

    def _alike(self, slope: FloatImage, difference: FloatImage, length: FloatImage) -> FloatImage:
        """(h, w) correlation of the gradients of the images along the epipolar lines over the window around a pixel.

        Every pixel of the window counts alike, by the correlation over its own surroundings: an edge that the window
        reaches would outdo all other texture. slope : of the images' mean.  difference : of their grey values.
        """
        gx, gy = image_gradient(difference)
        along = np.asarray((gx * self._shifts[..., 0] + gy * self._shifts[..., 1]) / length, np.float32)
        mean, unlike = _without_grain(np.asarray(slope / length, np.float32)), _without_grain(along)
        off = unlike * unlike
        own = cv2.GaussianBlur(2.0 * mean * mean + 0.5 * off, (0, 0), DEPTH.own_px)
        rounding = np.float32(DEPTH.rounding)
        return np.asarray(1.0 - _window((off + rounding) / (own + rounding)))


def _in_one_piece(mask: NDArray[np.bool_], side_px: int) -> NDArray[np.bool_]:
    """(h, w) the mask without specks smaller than squares of this side, as where texture happens to vanish."""
    square = np.ones((side_px, side_px), np.uint8)
    return np.asarray(cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, square), bool)


def _exposure(pulled: FloatImage, grey: FloatImage, valid: NDArray[np.bool_]) -> tuple[np.float32, FloatImage]:
    """Factor, and summand (h, w), that give image 2 the contrast of image 1, and its shading."""
    gain = contrast_ratio(float(grey[valid].std()), float(pulled[valid].std())) if valid.any() else 1.0
    return np.float32(gain), local_mean(grey - pulled * np.float32(gain), DEPTH.shading_px)


def _length2(shifts: FloatImage) -> FloatImage:
    """(h, w) squared length of vectors (h, w, 2); a sum over an axis of two takes ten times as long."""
    return np.asarray(shifts[..., 0] ** 2 + shifts[..., 1] ** 2)


def _window(values: FloatImage) -> FloatImage:
    return np.asarray(cv2.GaussianBlur(values, (0, 0), DEPTH.window_px))


def _rest(values: FloatImage) -> FloatImage:
    return np.asarray(cv2.GaussianBlur(values, (0, 0), DEPTH.rest_px))


def _without_grain(values: FloatImage) -> FloatImage:
    return np.asarray(cv2.GaussianBlur(values, (0, 0), DEPTH.grain_px), np.float32)


def _steps(w: FloatImage, shifts: FloatImage) -> NDArray[np.bool_]:
    """(h, w) whether the displacement changes by `DEPTH.step_gradient` px or more from one pixel to the next."""
    gx, gy = image_gradient(np.log(w))
    return np.asarray((gx**2 + gy**2) * _length2(shifts) > DEPTH.step_gradient**2)
