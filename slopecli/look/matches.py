"""Points found in both images: the one container of matches, in pixels and in normalised coordinates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slopecli.geometry.camera import rays_from_pixels
from slopecli.types import BoolArray, Camera, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Matches:
    """Points seen in both images: uv1, uv2 (n, 2) px as stored (distorted); x1, x2 (n, 2) normalised, undistorted."""

    uv1: FloatArray
    uv2: FloatArray
    x1: FloatArray
    x2: FloatArray

    @classmethod
    def none(cls) -> Matches:
        """No match at all."""
        return Matches(*(np.empty((0, 2)) for _ in range(4)))

    @classmethod
    def between(cls, camera1: Camera, camera2: Camera, uv1: FloatArray, uv2: FloatArray) -> Matches:
        """Matched pixels (n, 2) with their rays; those without a ray in either camera are dropped."""
        x1, x2, seen = pair_rays(camera1, camera2, uv1, uv2)
        return Matches(uv1[seen], uv2[seen], x1[seen], x2[seen])

    def __len__(self) -> int:
        return len(self.uv1)

    def take(self, which: IntArray | BoolArray) -> Matches:
        """The matches of these indices, or those of a mask (n,)."""
        return Matches(self.uv1[which], self.uv2[which], self.x1[which], self.x2[which])

    def joined(self, *others: Matches) -> Matches:
        """These matches, then the others."""
        every = (self, *others)
        uv1, uv2, x1, x2 = (np.vstack([getattr(one, name) for one in every]) for name in ("uv1", "uv2", "x1", "x2"))
        return Matches(uv1, uv2, x1, x2)


def pair_rays(
    camera1: Camera, camera2: Camera, uv1: FloatArray, uv2: FloatArray
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Matched pixels (n, 2) as normalised coordinates x1, x2 (n, 2), and (n,) which have them in both images.

    Pixels beyond the reach of a lens model have no ray (NaN).
    """
    x1, x2 = rays_from_pixels(camera1, uv1), rays_from_pixels(camera2, uv2)
    return x1, x2, np.asarray(np.isfinite(x1).all(1) & np.isfinite(x2).all(1))


def thin(uv: FloatArray, index: IntArray, limit: int) -> IntArray:
    """At most `limit` of the points uv[index], spread evenly over the image: bins take turns giving one point each."""
    if len(index) <= limit:
        return index
    points = uv[index]
    low, extent = points.min(0), np.maximum(np.ptp(points, axis=0), 1.0)
    side = np.sqrt(extent.prod() / limit)
    bins = np.floor((points - low) / side).astype(np.int64)
    code = bins[:, 0] * (bins[:, 1].max() + 1) + bins[:, 1]
    order = np.argsort(code, kind="stable")
    starts = np.flatnonzero(np.r_[True, np.diff(code[order]) > 0])
    rank = np.arange(len(order)) - np.repeat(starts, np.diff(np.r_[starts, len(order)]))
    by_rank = np.argsort(rank, kind="stable")
    whole = by_rank[: np.searchsorted(rank[by_rank], rank[by_rank[limit]])]  # rounds that fit in full
    last = by_rank[rank[by_rank] == rank[by_rank[limit]]]
    evenly = last[np.linspace(0, len(last) - 1, limit - len(whole)).round().astype(int)]
    chosen = order[np.concatenate([whole, evenly])]
    return np.sort(index[chosen])
