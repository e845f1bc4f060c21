"""Areas that stand still in both images while the ground moves: they belong to the camera or to the image, not to the
ground, as landing gear, a rotor guard or a logo do.

Texture that both images show at the same pixels, but not where the rest of the image moves to. What both explain is
left alone: ground around the focus of expansion, edges along the motion, a pattern that moves by its own period.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from slopecli.look.changes import LEAST_AREA
from slopecli.look.dense import CLEAR_AGREEMENT, fill_from_coarse, sparse_transfer
from slopecli.look.dense_depth import DEPTH
from slopecli.look.features import EFFORTS, QUICK, Grey, match_sift, shrink
from slopecli.look.matches import LEAST_MATCHES
from slopecli.look.noise import ROUNDING_GREY, SAME_GROUND
from slopecli.look.scene_from_images import COARSE
from slopecli.look.warp import FloatImage, Grid, image_gradient, transfer_map
from slopecli.types import BoolArray, FloatArray

# squared gradients of an area in the direction of the least, over those in that of the largest: edges that all run one
# way stay where they are when they move along it. Ground in 100 pairs, and dark rims of images, had up to 0.015
LEAST_ISOTROPY = 0.03
SIGMA_PX = DEPTH.window_px  # px of the copies of the images that are compared, of the window of a correlation


@dataclass(frozen=True, eq=False)
class Still:
    """What stands still: `mask` (rows, columns) over both images alike, shrunk by `scale` (2,) along x and y."""

    mask: BoolArray
    scale: FloatArray

    @property
    def share(self) -> float:
        """Of an image."""
        return float(self.mask.mean())

    def holds(self, uv: FloatArray | FloatImage) -> BoolArray:
        """(...) whether px (..., 2) of either image lie on it; False for NaN and outside."""
        if not uv.size:
            return np.zeros(uv.shape[:-1], bool)
        at = np.asarray((uv + 0.5) * self.scale.astype(np.float32) - 0.5, np.float32)
        mask = self.mask.astype(np.uint8)
        place = at if at.ndim == 3 else at[:, None]  # OpenCV takes at most 32766 rows, and as many columns
        found = cv2.remap(mask, place, None, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT)  # type: ignore[call-overload]
        return np.asarray(found > 0).reshape(at.shape[:-1])

    def painted(self, grey: Grey) -> Grey:
        """An image in which it has no texture: the brightness of what surrounds it instead."""
        height, width = grey.shape
        small = cv2.resize(grey, self.mask.shape[::-1], interpolation=cv2.INTER_AREA).astype(np.float64)
        filled = fill_from_coarse(small[..., None], (~self.mask).astype(np.float64))[..., 0].astype(np.float32)
        smooth = cv2.resize(cv2.GaussianBlur(filled, (0, 0), SIGMA_PX), (width, height))
        mask = cv2.resize(self.mask.astype(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST) > 0
        return np.asarray(np.where(mask, np.clip(smooth + 0.5, 0, 255), grey), np.uint8)


def without_still(grey: Grey, still: Still | None) -> Grey:
    """An image without the texture of what stands still, if anything does."""
    return grey if still is None else still.painted(grey)


def find_still(grey1: Grey, grey2: Grey) -> Still | None:
    """What stands still in two images; None where nothing does, or where not enough else can be matched to tell."""
    if grey1.shape != grey2.shape:
        return None
    small1, scale = shrink(grey1, COARSE.max_pixels)
    small2, _ = shrink(grey2, COARSE.max_pixels)
    first, second = _texture(small1), _texture(small2)
    alike = _without_lines(_correlation(first, second) > CLEAR_AGREEMENT)
    areas = [area for area in _large_areas(alike) if _isotropy(first, area) > LEAST_ISOTROPY]
    if not areas:
        return None
    candidates = Still(_grown(alike), scale)
    places = _moved(grey1, grey2, candidates, Grid(small1, 0.0, 0.0, scale))
    if places is None:
        return None
    moved = cv2.remap(small2, places, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)  # type: ignore[call-overload]
    unlike = _correlation(first, _texture(moved)) < SAME_GROUND
    return Still(_grown(alike & unlike), scale) if any(unlike[area].mean() > 0.5 for area in areas) else None


def _texture(grey: Grey) -> FloatImage:
    """Grey values without shading."""
    plain = grey.astype(np.float32)
    return np.asarray(plain - _mean(plain), np.float32)


def _mean(values: FloatImage) -> FloatImage:
    return np.asarray(cv2.GaussianBlur(values, (0, 0), SIGMA_PX), np.float32)


def _correlation(first: FloatImage, second: FloatImage) -> FloatImage:
    """(h, w) correlation of two textures over the window around a pixel; low where that is flat."""
    rounding = np.float32(ROUNDING_GREY**2)
    size = np.sqrt((_mean(first * first) + rounding) * (_mean(second * second) + rounding))
    return np.asarray(_mean(first * second) / size, np.float32)


def _without_lines(mask: BoolArray) -> BoolArray:
    """A mask without what a window sees of a single edge, and without narrow frames of images.

    The robust solution copes with these, and gains nothing if they are left out.
    """
    outside = {"borderType": cv2.BORDER_CONSTANT, "borderValue": 0}
    wide = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, _disc(3.0), **outside)  # type: ignore[call-overload]
    return np.asarray(wide, bool)


def _large_areas(mask: BoolArray) -> list[BoolArray]:
    """The 8-connected areas of a mask that are not small."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    large = np.flatnonzero(stats[1:, cv2.CC_STAT_AREA] >= LEAST_AREA * mask.size) + 1
    return [labels == k for k in large]


def _grown(mask: BoolArray) -> BoolArray:
    """A mask and what lies within two sigmas of the window around it: there, ground spoils the correlation."""
    return np.asarray(cv2.dilate(mask.astype(np.uint8), _disc(2.0)), bool)


def _disc(sigmas: float) -> NDArray[np.uint8]:
    """So many sigmas of the window of a correlation to every side."""
    side = 2 * int(sigmas * SIGMA_PX) + 1
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side)), np.uint8)


def _isotropy(texture: FloatImage, area: BoolArray) -> float:
    """Squared gradients of an area in the direction in which they are least, over those in which they are largest."""
    gx, gy = (gradient[area].astype(np.float64) for gradient in image_gradient(texture))
    least, largest = np.linalg.eigvalsh([[gx @ gx, gx @ gy], [gx @ gy, gy @ gy]])
    return float(least / max(largest, 1e-12))


def _moved(grey1: Grey, grey2: Grey, candidates: Still, grid: Grid) -> FloatImage | None:
    """(h, w, 2) where the small image 2 shows the pixels of image 1 if they move as the matches outside the candidates
    do; None if these are too few."""
    painted = candidates.painted(grey1), candidates.painted(grey2)
    uv1 = uv2 = np.empty((0, 2))
    for effort in (QUICK, EFFORTS[0]):
        uv1, uv2, _ = match_sift(*painted, effort)
        apart = ~(candidates.holds(uv1) | candidates.holds(uv2))
        uv1, uv2 = uv1[apart], uv2[apart]
        if len(uv1) >= 10 * LEAST_MATCHES:
            break
    if len(uv1) < LEAST_MATCHES:
        return None
    # px of image 2, within which matches count as of the ground, with its relief. With anything from 5 to 80, what was
    # laid over a ninth of both images was found in 90 of 90 pairs, and nothing in them without it
    found = cv2.findHomography(uv1, uv2, cv2.USAC_MAGSAC, 20.0)[1]
    near = np.zeros(len(uv1), bool) if found is None else found[:, 0] > 0
    if near.sum() < LEAST_MATCHES:
        return None
    mapping = transfer_map(grid, sparse_transfer(uv1[near], uv2[near], grid.scale, grid.shape))
    return np.asarray((mapping + 0.5) * grid.scale.astype(np.float32) - 0.5, np.float32)
