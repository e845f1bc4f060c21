"""Sparse matches of two images, some of them mismatches, and the camera motions consistent with them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from slopecli.geometry.motion import MotionEstimate, epipolar_residual
from slopecli.look.features import Grey
from slopecli.look.matches import Matches
from slopecli.look.motions import inliers_of, rank_motions, starting_motions
from slopecli.types import BoolArray, Camera, FloatArray

# two grey images -> matches uv1, uv2 (n, 2) px and the number of features in each image
FeatureMatcher = Callable[[Grey, Grey], tuple[FloatArray, FloatArray, tuple[int, int]]]

ENOUGH_INLIERS = 300  # consistent matches with which no further matcher is tried
CONSISTENT_SHARE = 0.7  # of all matches, consistent with the best motion, with which the search for it ends


@dataclass(frozen=True, eq=False)
class Sparse:
    """Sparse matches, the motions found from them, best first, and the number of features in each image."""

    matches: Matches
    motions: list[MotionEstimate]
    n_features: tuple[int, int]
    focal_px: float

    def consistent_with(self, motion: MotionEstimate) -> BoolArray:
        """(n,) matches that are consistent with the epipolar geometry of a motion."""
        return inliers_of(epipolar_residual(motion.R, motion.T, self.matches.x1, self.matches.x2), self.focal_px)

    @property
    def n_inliers(self) -> int:
        """Number of matches consistent with the best motion; 0 when there is none."""
        return int(self.consistent_with(self.motions[0]).sum()) if self.motions else 0

    @property
    def is_consistent(self) -> bool:
        """Whether most matches are consistent with the best motion, so that a further search would find no better."""
        return self.n_inliers > CONSISTENT_SHARE * len(self.matches)

    def roots(self) -> list[MotionEstimate]:
        """The best motion and at most two more whose cost is within 8 % of it: dense matches decide between them."""
        return [m for m in self.motions if m.cost <= 1.08 * self.motions[0].cost][:3]


def find_motions(
    grey1: Grey,
    grey2: Grey,
    camera1: Camera,
    camera2: Camera,
    matchers: Sequence[FeatureMatcher],
    seed: int = 0,
    thorough: bool = True,
) -> Sparse:
    """Run matchers in turn until enough matches are consistent with one motion.

    The result may have few consistent matches or no motion; the caller decides whether that suffices.

    thorough : repeat the search for motions with many more samples where few of the matches agree.
    """
    sparse = Sparse(Matches.none(), [], (0, 0), camera2.focal_px)
    for matcher in matchers:
        uv1, uv2, n_features = matcher(grey1, grey2)
        sparse = _with_more(sparse, Matches.between(camera1, camera2, uv1, uv2), n_features, seed, thorough)
        if sparse.is_consistent and sparse.n_inliers >= ENOUGH_INLIERS:
            break
    return sparse


def _with_more(sparse: Sparse, new: Matches, n_features: tuple[int, int], seed: int, may_repeat: bool) -> Sparse:
    """Rank the motions of the new matches and those found so far on all matches together."""
    every, focal = sparse.matches.joined(new), sparse.focal_px
    for thorough in (False, True) if may_repeat else (False,):
        starts = starting_motions(new.x1, new.x2, focal, thorough, seed)
        motions = rank_motions(sparse.motions + starts, every.x1, every.x2, focal)
        sparse = Sparse(every, motions, n_features, focal)
        if sparse.is_consistent:
            break
    return sparse
