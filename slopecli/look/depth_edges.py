"""Steps of depth put where the images have them, and what a nearer surface hides.

The window of an alignment that reaches across a step takes the depth of one side, mostly of the nearer one, for both.
Around a step every pixel is asked again, with the depth of either side alone, by its own grey values and those beside.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from slopecli.geometry.statistics import GATE_SIGMAS, robust_sigma
from slopecli.look.matches import ON_PLANE_PX
from slopecli.look.noise import APART, ROUNDING_GREY
from slopecli.look.warp import FloatImage
from slopecli.types import BoolArray, IntArray

Kind = TypeVar("Kind", bound=np.generic)
Grey2 = Callable[[IntArray, FloatImage], FloatImage]  # flat indices and logarithms (r, c) -> grey values of image 2


class Edges(NamedTuple):
    """Steps of the depth of pixels (h, w).

    step : pixels on a step.  shift_px : displacement by a change of the logarithm of inverse depth.
    reach_px : by which a step may be misplaced.  own_px : sigma of the Gaussian over which pixels are asked together.
    """

    step: BoolArray
    shift_px: FloatImage
    reach_px: int
    own_px: float

    def settled(
        self, logarithm: FloatImage, grey: FloatImage, pulled: FloatImage, grey2: Grey2
    ) -> tuple[FloatImage, FloatImage]:
        """Logarithms (h, w) of inverse depth with the pixels around steps on their own side, and image 2 by them.

        grey, pulled (h, w) : image 1, and image 2 by the logarithms given.
        """
        pixels, sides = self._sides(logarithm) if self.step.any() else (np.empty(0, np.int64), [])
        if not len(pixels):
            return logarithm, pulled
        at = _in_rows(pixels)
        sides = [_in_rows(side) for side in sides]
        seen = [grey2(at, side) for side in sides]
        noise = robust_sigma((grey - pulled).ravel()[:: grey.shape[1] // 8 + 1].astype(float))
        limit = np.float32(GATE_SIGMAS * max(noise, ROUNDING_GREY))
        misfits = [np.minimum(np.abs(grey.ravel()[at] - one), limit) ** 2 for one in seen]
        worse = np.zeros_like(logarithm)
        worse.ravel()[at] = misfits[0] - misfits[1]
        evidence = cv2.GaussianBlur(worse, (0, 0), self.own_px)
        first = cv2.medianBlur((evidence < 0).astype(np.uint8), 5).ravel()[at] > 0  # without specks
        found = np.where(first, *sides)
        other = np.abs(found - logarithm.ravel()[at]) * self.shift_px.ravel()[at] > 0.5 * ON_PLANE_PX
        other &= evidence.ravel()[at] != 0.0  # blank ground tells no side
        logarithm, pulled = logarithm.copy(), pulled.copy()
        logarithm.ravel()[at[other]] = found[other]
        pulled.ravel()[at[other]] = np.where(first, *seen)[other]
        return logarithm, pulled

    def _sides(self, logarithm: FloatImage) -> tuple[IntArray, list[FloatImage]]:
        """Flat indices (n,) of the pixels around steps, and the logarithms (n,) of the nearer and the farther side.

        These are of the pixels next to them that are on no step, of every second row and column.
        """
        around = np.ones((2 * self.reach_px + 1, 2 * self.reach_px + 1), np.uint8)
        highest, lowest = cv2.dilate(logarithm, around), cv2.erode(logarithm, around)
        near_step = (highest - lowest) * self.shift_px > 3 * ON_PLANE_PX
        zone = near_step & (cv2.dilate(self.step.astype(np.uint8), around) > 0)
        nearer = (logarithm > 0.5 * (highest + lowest))[::2, ::2]
        some, level = logarithm[::2, ::2], (near_step & ~self.step)[::2, ::2]
        first, second = nearer & level, ~nearer & level
        if not (zone.any() and first.any() and second.any()):
            return np.empty(0, np.int64), []
        rows, columns = np.nonzero(zone)
        sides = [_nearest(some, side, rows // 2, columns // 2) for side in (first, second)]
        apart = (sides[0] - sides[1]) * self.shift_px[zone] > 2 * ON_PLANE_PX
        return np.flatnonzero(zone)[apart], [side[apart] for side in sides]


def _nearest(values: FloatImage, where: BoolArray, rows: IntArray, columns: IntArray) -> FloatImage:
    """(n,) the value of the pixel of `where` (h, w) that is nearest to each of these pixels."""
    kind = cv2.DIST_LABEL_PIXEL
    labels = cv2.distanceTransformWithLabels((~where).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=kind)[1]
    table = np.zeros(int(labels.max()) + 1, np.float32)
    table[labels[where]] = values[where]
    return np.asarray(table[labels[rows, columns]])


def _in_rows(values: NDArray[Kind]) -> NDArray[Kind]:
    """(r, 1024) the values (n,), the last one repeated to the end: OpenCV samples no rows above 32766 px."""
    return np.pad(values, (0, -len(values) % 1024), mode="edge").reshape(-1, 1024)


def hidden(w: FloatImage, uv2: FloatImage, known: BoolArray, shape2: tuple[int, int]) -> BoolArray:
    """(h, w) whether a nearer surface stands before a pixel in image 2.

    w (h, w) : inverse depths.  uv2 (h, w, 2) : px of image 2, of this height and width.  known (h, w) : pixels to use.
    """
    step = 2.0 * max(1.0, float(np.sqrt(np.prod(shape2) / w.size)))
    height, width = (int(np.ceil(n / step)) for n in shape2)
    # not np.clip, which keeps the NaN of pixels that have no place in image 2; these are not known
    row, column = (
        (np.fmin(np.fmax(uv2[..., 1 - k], 0), shape2[k] - 1) / np.float32(step)).astype(np.int64) for k in (0, 1)
    )
    place = row * width + column
    nearest, logarithm = np.full(height * width, -np.inf, np.float32), np.log(w)
    np.maximum.at(nearest, place[known], logarithm[known])
    return np.asarray(nearest[place] - logarithm > APART)
