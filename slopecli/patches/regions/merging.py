"""Planes fitted to the pixels labelled with them, and merged where they are one.

Source: Cheng, experiment 3, step 6, on pixels in place of features.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from slopecli.look.gradient_components import Labels, renumbered_by_size
from slopecli.look.transfer_error import OUTSIDE, Comparison, Points
from slopecli.patches.regions.region_tunables import REGION
from slopecli.types import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Labelled:
    """Planes, scaled normals (3,), and labels (h, w): the plane of every pixel, 1..k, 0 for none."""

    planes: list[FloatArray]
    labels: Labels

    def by_size(self, least_px: float) -> Labelled:
        """Return the same, largest first, without planes that hold fewer pixels than `least_px`."""
        labels, order = renumbered_by_size(self.labels, least_px)
        return Labelled([self.planes[k - 1] for k in order], labels)


def refitted(comparison: Comparison, found: Labelled, rng: np.random.Generator) -> Labelled:
    """Return the planes fitted to their pixels, those at borders left out."""
    layer = found.labels.astype(np.uint16)
    square = np.ones((3, 3), np.uint8)
    inside = np.where(cv2.erode(layer, square) == cv2.dilate(layer, square), found.labels, 0)
    drawn = _drawn(inside, len(found.planes), REGION.fit_pixels, rng)
    planes = [
        comparison.fit(points, normal) if len(points[0]) >= REGION.least_pixels else normal
        for points, normal in zip(drawn, found.planes, strict=True)
    ]
    return Labelled(planes, found.labels)


def merged(comparison: Comparison, found: Labelled, merge_px: float, rng: np.random.Generator) -> Labelled:
    """Return the planes after merging those that are one, in one piece or in several, smallest first.

    Two planes are one if they send the pixels of the smaller within `merge_px` of each other (median, working px) and
    one plane fitted to both transfers their pixels hardly worse than the two do.
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
    """State of merging: planes, their present labels, their areas, and pixels drawn from each with their mean cost."""

    def __init__(self, comparison: Comparison, found: Labelled, rng: np.random.Generator) -> None:
        self._comparison, self._labels = comparison, found.labels
        self._planes = np.array(found.planes).reshape(-1, 3)
        self._now = np.arange(len(found.planes) + 1)
        self.area = np.bincount(found.labels.ravel(), minlength=len(found.planes) + 1)[1:].astype(float)
        self._points = _drawn(found.labels, len(found.planes), REGION.test_pixels, rng)
        self._cost = [self._mean_cost(k, normal) for k, normal in enumerate(self._planes)]

    def likeliest(self, j: int, others: IntArray, merge_px: float) -> int | None:
        """Return the plane that transfers plane j's pixels best, of those that send them near where j does; or None."""
        apart = self._comparison.apart_px(self._points[j], self._planes[j], self._planes[others])
        close = [int(i) for i in others[apart <= merge_px]]
        return min(close, key=lambda i: self._mean_cost(j, self._planes[i]), default=None)

    def try_merging(self, i: int, j: int) -> None:
        """Merge plane j into plane i if one plane fitted to both costs hardly more."""
        share = self.area[i] / (self.area[i] + self.area[j])
        both = self._joint_points(i, j, share)
        one = self._comparison.fit(both, self._planes[i])
        cost_i, cost_j = self._mean_cost(i, one), self._mean_cost(j, one)
        lost = (cost_i - self._cost[i]) * self.area[i] + (cost_j - self._cost[j]) * self.area[j]
        if lost >= REGION.saved + REGION.saved_per_px * self.area[j]:
            return
        self._cost[i] = share * cost_i + (1 - share) * cost_j
        self._planes[i], self._points[i] = one, both
        self.area[i], self.area[j] = self.area[i] + self.area[j], 0.0
        self._now[self._now == j + 1] = i + 1

    def result(self) -> Labelled:
        """Return the planes left, largest first."""
        return Labelled(list(self._planes), self._now[self._labels].astype(np.int32)).by_size(1)

    def _joint_points(self, i: int, j: int, share: float) -> Points:
        """Return pixels of both, as many of each as its share of the area, and at least a fifth of `test_pixels`."""
        n, m = (max(REGION.test_pixels // 5, int(REGION.test_pixels * s)) for s in (share, 1 - share))
        (rows_i, columns_i), (rows_j, columns_j) = self._points[i], self._points[j]
        return np.concatenate([rows_i[:n], rows_j[:m]]), np.concatenate([columns_i[:n], columns_j[:m]])

    def _mean_cost(self, k: int, normal: FloatArray) -> float:
        points = self._points[k]
        return float(self._comparison.cost_at(points, normal).mean()) if len(points[0]) else OUTSIDE


def _drawn(labels: Labels, count: int, most: int, rng: np.random.Generator) -> list[Points]:
    """Return, for labels 1..count, at most `most` random pixels each, in random order, as rows and columns."""
    flat = labels.ravel().astype(np.uint16)  # sorted by radix
    order = rng.permutation(len(flat))
    order = order[np.argsort(flat[order], kind="stable")]
    ends = np.cumsum(np.bincount(flat, minlength=count + 1))
    return [np.divmod(order[ends[k] : ends[k + 1]][:most], labels.shape[1]) for k in range(count)]
