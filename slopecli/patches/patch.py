"""A patch: a part of image 1 held to be one plane, its footprint, and the matches on that plane."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from slopecli.geometry.statistics import CHI2, median
from slopecli.look.gradient_components import Labels, boxes_of, resized
from slopecli.look.matches import Matches
from slopecli.look.noise import LEAST_MATCH_PX
from slopecli.patches import FINDER_OF, Finder
from slopecli.types import BoolArray, FloatArray, IntArray, Segmentation
from slopecli.windows import Window, box_polygon, window_polygon

# 1-sigma of a tilt from which on a plane tells nothing of other planes, of what is level, or of what is ground. A
# borrowed plane, that of ground nobody has seen, has at least this, so that it is in doubt everywhere
IN_DOUBT_DEG = 5.0
LEAST_MATCHED = 0.5  # share of a window that must be matched to tell its slope


@dataclass(frozen=True, eq=False)
class Footprint:
    """Pixels of image 1: `mask` (h, w) bool, its top left pixel at `corner` (x, y); `polygon_px` (k, 2) the outline,
    of a window along the edges of its pixels, of a region through the outermost pixels of its largest piece."""

    corner: tuple[int, int]
    mask: BoolArray
    polygon_px: FloatArray

    @property
    def area_px(self) -> int:
        """Pixels covered."""
        return int(np.count_nonzero(self.mask))

    @cached_property
    def largest_share(self) -> float:
        """Share of the pixels that the largest connected piece holds; 1 for a patch in one piece."""
        if self.mask.all():
            return 1.0
        _, _, stats, _ = cv2.connectedComponentsWithStats(self.mask.astype(np.uint8), connectivity=8)
        return float(stats[1:, cv2.CC_STAT_AREA].max(initial=0) / max(self.area_px, 1))

    @property
    def bounds(self) -> Window:
        """The rectangle around it."""
        return (*self.corner, int(self.mask.shape[1]), int(self.mask.shape[0]))

    def covers(self, uv: FloatArray) -> BoolArray:
        """(n,) whether pixels (n, 2) of image 1 lie in it."""
        x, y, w, h = self.bounds
        column, row = np.floor(uv[:, 0] + 0.5).astype(int) - x, np.floor(uv[:, 1] + 0.5).astype(int) - y
        inside = (column >= 0) & (column < w) & (row >= 0) & (row < h)
        return np.asarray(inside & self.mask[np.clip(row, 0, h - 1), np.clip(column, 0, w - 1)])


def window_footprint(window: Window) -> Footprint:
    """All pixels of a window."""
    x, y, w, h = window
    return Footprint((x, y), np.ones((h, w), bool), window_polygon(window))


def region_footprints(labels: Labels, shape: tuple[int, int]) -> list[Footprint]:
    """Footprints of labels 1, 2, ..., none without pixels, enlarged to the image's shape (rows, columns) if smaller."""
    labels = resized(labels, shape)
    footprints = []
    for number, (rows, columns) in boxes_of(labels).items():
        mask, corner = labels[rows, columns] == number, (columns.start, rows.start)
        footprints.append(Footprint(corner, mask, _outline(mask.astype(np.uint8)) + np.array(corner)))
    return footprints


def _outline(mask: NDArray[np.uint8]) -> FloatArray:
    """(k, 2) polygon within 1.5 px of the outer border of the largest piece; holes are ignored."""
    contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    largest = max(contours, key=cv2.contourArea)
    simple = np.asarray(cv2.approxPolyDP(largest, 1.5, True), float).reshape(-1, 2)
    # a piece one pixel wide has no contour
    return simple if len(simple) >= 3 else box_polygon(simple.min(0) - 0.5, simple.max(0) + 0.5)


def paint_labels(footprints: Sequence[Footprint], ids: Sequence[int], shape: tuple[int, int]) -> NDArray[np.uint16]:
    """(h, w) uint16 with each footprint's id on its pixels; where they overlap the later one wins."""
    labels = np.zeros(shape, np.uint16)
    for footprint, number in zip(footprints, ids, strict=True):
        x, y, w, h = footprint.bounds
        labels[y : y + h, x : x + w][footprint.mask] = number
    return labels


def _no_direction() -> FloatArray:
    return np.zeros(3)


def _no_cells() -> IntArray:
    return np.empty((0, 2), np.int64)


@dataclass(frozen=True, eq=False)
class Patch:
    """A part of image 1 held to be one plane. A finder makes it without matches, then gives it some, or a reason.

    Attributes
    ----------
    id : the number users know it by.  source : that of its finder in `FINDERS`.  footprint : its pixels of image 1.
    matches : (n) on its plane.  weight : (n,) inverse variance along the epipolar line, relative to LEAST_MATCH_PX.
    cell : (n, 2) row and column of the matches on a lattice; errors of neighbouring matches are correlated.
    origin : "own" where the matches lie in the patch, "borrowed" where they are those of the plane around it, "none".
    score : correlation of the images after matching.  share : of the patch that is matched.
    reason, code : why it is borrowed or has no matches, in words and as a diagnostic code.
    tilt_sigma_rad : 1-sigma of the tilt in addition to what the residuals tell.
    unmatched_sigma_rad : the part of it that is due to parts of the patch without matches.
    off_plane_sigma_rad : the part of that which is due to unmatched parts that are not on the plane.
    surer_cam1 : (3,) rad, camera-1 axes: along this direction on the plane, the variance of the normal is smaller than
        tilt_sigma_rad has it, by the square of its length. Zero where the tilt is as open in all directions.
    dense_shares : of a plane through all pixels, shares of the variance of its tilt, motion apart, that are due to
        matches, relief, and ground without matches; None for a plane through matches, whose residuals tell.
    left_out : share of the matches found that was left out, far off the plane or across a step.
    """

    id: int
    source: str
    footprint: Footprint
    matches: Matches = field(default_factory=Matches.none)
    weight: FloatArray = field(default_factory=lambda: np.empty(0))
    cell: IntArray = field(default_factory=_no_cells)
    origin: Literal["own", "borrowed", "none"] = "none"
    score: float = 0.0
    share: float = 0.0
    reason: str = ""
    code: str = ""
    tilt_sigma_rad: float = 0.0
    unmatched_sigma_rad: float = 0.0
    off_plane_sigma_rad: float = 0.0
    surer_cam1: FloatArray = field(default_factory=_no_direction)
    dense_shares: tuple[float, float, float] | None = None
    left_out: float = 0.0

    @property
    def window(self) -> Window:
        """The rectangle around it, which for a window is the window."""
        return self.footprint.bounds

    @property
    def finder(self) -> Finder:
        """The row of `FINDERS` it comes from."""
        return FINDER_OF[self.source]

    def unmatched(self, reason: str, code: str = "low-texture") -> Patch:
        """This patch without matches, with the reason in words and as a diagnostic code."""
        return replace(Patch(self.id, self.source, self.footprint), reason=reason, code=code)


class Found(NamedTuple):
    """What a finder returns: patches in the order of their ids, and, for pictures, the steps of a segmentation."""

    patches: list[Patch]
    segmentation: Segmentation | None = None


def weight_of(variance_px2: FloatArray) -> FloatArray:
    """(n,) weights of matches of these noise variances, px of image 2 squared."""
    return LEAST_MATCH_PX**2 / variance_px2


def overdispersion(normalised_squares: FloatArray) -> float:
    """Robust ratio of the variance of a patch's residuals to that predicted from its texture, at least 0.25.

    The fewer residuals there are, the less a ratio below 1 is trusted: of 20 or fewer it is at least 1.
    normalised_squares : (n,) squared residuals over their predicted variances.
    """
    least = np.interp(len(normalised_squares), [20, 60], [1.0, 0.25])
    return max(median(normalised_squares) / CHI2[1, 0.5], float(least))
