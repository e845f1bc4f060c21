"""Sparse matches of whole images, many of them wrong, and the camera motions they allow."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from slopecli.geometry.camera import rays_from_pixels
from slopecli.geometry.motion import MotionEstimate, epipolar_residual
from slopecli.look.features import Grey
from slopecli.look.motions import inliers_of, rank_motions, starting_motions
from slopecli.types import BoolArray, Camera, FloatArray, IntArray

# two grey images -> matches uv1, uv2 (n, 2) px and how many features each image has
FeatureMatcher = Callable[[Grey, Grey], tuple[FloatArray, FloatArray, tuple[int, int]]]

ENOUGH_INLIERS, ENOUGH_SHARE = 300, 0.7  # sparse matches that need no second, costlier look
RIVAL_COST, MAX_RIVALS = 1.08, 3  # motions that cost at most this much more than the best are not yet ruled out


def pair_rays(
    camera1: Camera, camera2: Camera, uv1: FloatArray, uv2: FloatArray
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Matched pixels (n, 2) as normalised coordinates x1, x2 (n, 2), and (n,) which have them in both images.

    A lens model need not reach the corners of its image; pixels beyond it have no ray (NaN).
    """
    x1, x2 = rays_from_pixels(camera1, uv1), rays_from_pixels(camera2, uv2)
    return x1, x2, np.asarray(np.isfinite(x1).all(1) & np.isfinite(x2).all(1))


def thin(uv: FloatArray, index: IntArray, limit: int) -> IntArray:
    """At most `limit` of the points `index`, spread evenly over the image: one a bin, round after round."""
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


@dataclass(frozen=True, eq=False)
class Matches:
    """Matches uv1 -> uv2 (n, 2) px as stored, and as normalised coordinates x1, x2 (n, 2)."""

    uv1: FloatArray
    uv2: FloatArray
    x1: FloatArray
    x2: FloatArray

    @classmethod
    def between(cls, camera1: Camera, camera2: Camera, uv1: FloatArray, uv2: FloatArray) -> Matches:
        """Those of the matched pixels that have rays."""
        x1, x2, seen = pair_rays(camera1, camera2, uv1, uv2)
        return cls(uv1[seen], uv2[seen], x1[seen], x2[seen])

    def __len__(self) -> int:
        return len(self.uv1)

    def joined(self, other: Matches) -> Matches:
        """These matches, then the others."""
        uv1, uv2, x1, x2 = (np.vstack([getattr(self, name), getattr(other, name)]) for name in vars(self))
        return Matches(uv1, uv2, x1, x2)


@dataclass(frozen=True, eq=False)
class Sparse:
    """Sparse matches, the motions they allow, best first, and the features found in each image by the last matcher."""

    matches: Matches
    motions: list[MotionEstimate]
    n_features: tuple[int, int]
    focal_px: float

    def obeying(self, motion: MotionEstimate) -> BoolArray:
        """(n,) matches that obey the epipolar geometry of a motion."""
        return inliers_of(epipolar_residual(motion.R, motion.T, self.matches.x1, self.matches.x2), self.focal_px)

    @property
    def n_inliers(self) -> int:
        """Matches that obey the best motion; 0 when there is none."""
        return int(self.obeying(self.motions[0]).sum()) if self.motions else 0

    @property
    def is_consistent(self) -> bool:
        """Whether so many of the matches obey the best motion that it is hardly in doubt."""
        return self.n_inliers > ENOUGH_SHARE * len(self.matches)

    def rivals(self) -> list[MotionEstimate]:
        """Motions that the sparse matches hardly tell from the best, itself the first."""
        return [m for m in self.motions if m.cost <= RIVAL_COST * self.motions[0].cost][:MAX_RIVALS]


def find_motions(
    grey1: Grey,
    grey2: Grey,
    camera1: Camera,
    camera2: Camera,
    matchers: Sequence[FeatureMatcher],
    seed: int = 0,
    thorough: bool = True,
) -> Sparse:
    """Match features with one matcher after the other until enough of them agree on a motion.

    The result may hold no motion at all, and its motions few inliers: whether that is an answer is for others to say.

    thorough : search again, harder, where few of the matches agree.
    """
    none = np.empty((0, 2))
    sparse = Sparse(Matches(none, none, none, none), [], (0, 0), camera2.focal_px)
    for matcher in matchers:
        uv1, uv2, n_features = matcher(grey1, grey2)
        sparse = _with_more(sparse, Matches.between(camera1, camera2, uv1, uv2), n_features, seed, thorough)
        if sparse.is_consistent and sparse.n_inliers >= ENOUGH_INLIERS:
            break
    return sparse


def _with_more(sparse: Sparse, new: Matches, n_features: tuple[int, int], seed: int, may_search: bool) -> Sparse:
    """Motions from the new matches compete with those so far on all matches; thoroughly where few of them agree."""
    every, focal = sparse.matches.joined(new), sparse.focal_px
    for thorough in (False, True) if may_search else (False,):
        starts = starting_motions(new.x1, new.x2, focal, thorough, seed)
        motions = rank_motions(sparse.motions + starts, every.x1, every.x2, focal)
        sparse = Sparse(every, motions, n_features, focal)
        if sparse.is_consistent:
            break
    return sparse
