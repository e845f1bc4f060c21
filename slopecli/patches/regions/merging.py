"""Planes fitted to the pixels labelled with them, and those that are one plane merged.

Source: Cheng, experiment 3, step 6, on pixels in place of features.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from slopecli.look.gradient_components import Labels
from slopecli.look.transfer_error import OUTSIDE, Comparison, Points
from slopecli.types import FloatArray, IntArray

FIT_PIXELS = 1500  # of a region that its plane is fitted to
TEST_PIXELS = 400  # of a region on which two planes compete
FEW = 64  # of those, on which it is seen whether two planes are alike at all
LEAST_PIXELS = 100  # fewer, a pixel inside their border, leave a plane as it was
SAVED = 600.0  # cost a plane must save to be one of its own, variances: neighbouring pixels share their errors
SAVED_PER_PX = 0.12  # and per pixel: what lens and interpolation leave between two fits of one plane


@dataclass(frozen=True, eq=False)
class Labelled:
    """Planes (scaled normals) and which of them every pixel lies on: `labels` (h, w) 1..k, 0 for none."""

    planes: list[FloatArray]
    labels: Labels

    def by_size(self, least_px: float) -> Labelled:
        """The same, largest first, without planes that hold fewer pixels than `least_px`."""
        size = np.bincount(self.labels.ravel(), minlength=len(self.planes) + 1)[1:]
        order = [int(k) for k in np.argsort(-size, kind="stable") if size[k] >= max(least_px, 1)]
        number = np.zeros(len(self.planes) + 1, np.int32)
        number[[k + 1 for k in order]] = np.arange(1, len(order) + 1)
        return Labelled([self.planes[k] for k in order], number[self.labels])


def refitted(comparison: Comparison, found: Labelled, rng: np.random.Generator) -> Labelled:
    """Every plane fitted to its pixels, those at its border left out."""
    layer = found.labels.astype(np.uint16)
    square = np.ones((3, 3), np.uint8)
    inside = np.where(cv2.erode(layer, square) == cv2.dilate(layer, square), found.labels, 0)
    drawn = _drawn(inside, len(found.planes), FIT_PIXELS, rng)
    planes = [
        comparison.fit(points, normal) if len(points[0]) >= LEAST_PIXELS else normal
        for points, normal in zip(drawn, found.planes, strict=True)
    ]
    return Labelled(planes, found.labels)


def merged(comparison: Comparison, found: Labelled, merge_px: float, rng: np.random.Generator) -> Labelled:
    """Planes that are one, in one piece or in several, made one; from the smallest to the largest.

    Two are one if they send the smaller's pixels within `merge_px` of each other (median, working px) and one plane
    fitted to both transfers them hardly worse than two do.
    """
    merging = _Merging(comparison, found, rng)
    order = np.argsort(-merging.area, kind="stable")
    for at in range(len(order) - 1, 0, -1):
        j = int(order[at])
        i = merging.likeliest(j, order[:at], merge_px)
        if i is not None:
            merging.try_merging(i, j)
    return merging.result()


class _Merging:
    """State of merging: planes, what became of each, their areas, and pixels drawn from each with their mean cost."""

    def __init__(self, comparison: Comparison, found: Labelled, rng: np.random.Generator) -> None:
        self._comparison, self._labels = comparison, found.labels
        self._planes = np.array(found.planes).reshape(-1, 3)
        self._now = np.arange(len(found.planes) + 1)
        self.area = np.bincount(found.labels.ravel(), minlength=len(found.planes) + 1)[1:].astype(float)
        self._points = _drawn(found.labels, len(found.planes), TEST_PIXELS, rng)
        self._cost = [self._mean_cost(k, normal) for k, normal in enumerate(self._planes)]

    def likeliest(self, j: int, others: IntArray, merge_px: float) -> int | None:
        """The plane that transfers plane j's pixels best of those that send them where j does; None without one."""
        rows, columns = self._points[j]
        apart = self._comparison.apart_px((rows[:FEW], columns[:FEW]), self._planes[j], self._planes[others])
        close = [int(i) for i in others[apart <= merge_px]]
        return min(close, key=lambda i: self._mean_cost(j, self._planes[i]), default=None)

    def try_merging(self, i: int, j: int) -> None:
        """Merge plane j into plane i if one plane fitted to both loses hardly anything."""
        share = self.area[i] / (self.area[i] + self.area[j])
        both = self._joint_points(i, j, share)
        one = self._comparison.fit(both, self._planes[i])
        cost_i, cost_j = self._mean_cost(i, one), self._mean_cost(j, one)
        lost = (cost_i - self._cost[i]) * self.area[i] + (cost_j - self._cost[j]) * self.area[j]
        if lost >= SAVED + SAVED_PER_PX * self.area[j]:
            return
        self._cost[i] = share * cost_i + (1 - share) * cost_j
        self._planes[i], self._points[i] = one, both
        self.area[i], self.area[j] = self.area[i] + self.area[j], 0.0
        self._now[self._now == j + 1] = i + 1

    def result(self) -> Labelled:
        """What is left, largest first."""
        return Labelled(list(self._planes), self._now[self._labels].astype(np.int32)).by_size(1)

    def _joint_points(self, i: int, j: int, share: float) -> Points:
        """Pixels of both, as many of each as its share of the area, but never so few that it has no say."""
        n, m = (max(TEST_PIXELS // 5, int(TEST_PIXELS * s)) for s in (share, 1 - share))
        (rows_i, columns_i), (rows_j, columns_j) = self._points[i], self._points[j]
        return np.concatenate([rows_i[:n], rows_j[:m]]), np.concatenate([columns_i[:n], columns_j[:m]])

    def _mean_cost(self, k: int, normal: FloatArray) -> float:
        points = self._points[k]
        return float(self._comparison.cost_at(points, normal).mean()) if len(points[0]) else OUTSIDE


def _drawn(labels: Labels, count: int, most: int, rng: np.random.Generator) -> list[Points]:
    """For labels 1..count: at most `most` random pixels each, in random order, as rows and columns."""
    flat = labels.ravel().astype(np.uint16)  # sorted by radix
    order = rng.permutation(len(flat))
    order = order[np.argsort(flat[order], kind="stable")]
    ends = np.cumsum(np.bincount(flat, minlength=count + 1))
    return [np.divmod(order[ends[k] : ends[k + 1]][:most], labels.shape[1]) for k in range(count)]
