"""Sparse matches with many mismatches, and the camera motions estimated from them; several, as the best fit may be the
wrong root."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from slopecli.geometry.motion import MotionEstimate, assess_motion, epipolar_residual, refine_motion
from slopecli.look.features import Grey, Images
from slopecli.look.matches import LEAST_MATCHES, Matches
from slopecli.look.noise import LEAST_MATCH_PX, WORST_MATCH_PX
from slopecli.types import BoolArray, FloatArray

# two grey images -> matches uv1, uv2 (n, 2) px and the number of features in each image
FeatureMatcher = Callable[[Grey, Grey], tuple[FloatArray, FloatArray, tuple[int, int]]]

Motion = tuple[FloatArray, FloatArray]

SCORE_PX = 0.5  # motions are ranked by squared epipolar residuals truncated at four times this
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


def find_motions(images: Images, matchers: Sequence[FeatureMatcher], seed: int = 0, thorough: bool = True) -> Sparse:
    """Run matchers in turn until enough matches are consistent with one motion.

    The result may have few consistent matches or no motion; the caller decides whether that suffices.

    thorough : repeat the search for motions with many more samples where few of the matches agree.
    """
    focal_px = images.camera2.focal_px
    sparse = Sparse(Matches.none(), [], (0, 0), focal_px)
    for matcher in matchers:
        uv1, uv2, n_features = matcher(images.grey1, images.grey2)
        new = Matches.between(images.camera1, images.camera2, uv1, uv2)
        every = sparse.matches.joined(new)
        for repeated in (False, True) if thorough else (False,):
            starts = starting_motions(new.x1, new.x2, focal_px, repeated, seed)
            motions = rank_motions(sparse.motions + starts, every.x1, every.x2, focal_px)
            sparse = Sparse(every, motions, n_features, focal_px)
            if sparse.is_consistent:
                break
        if sparse.is_consistent and sparse.n_inliers >= ENOUGH_INLIERS:
            break
    return sparse


def starting_motions(
    x1: FloatArray, x2: FloatArray, focal_px: float, thorough: bool = False, seed: int = 0
) -> list[MotionEstimate]:
    """Robustly estimated and refined motions, best first, repeats dropped.

    Essential matrices come from five-point RANSAC (also on random halves of the matches when `thorough`). The
    decompositions of the dominant homography are added, as a flat scene determines the essential matrix badly.
    The list is empty when there are too few matches or no model fits.
    """
    if len(x1) < LEAST_MATCHES:
        return []
    candidates = _essential_motions(x1, x2, focal_px, thorough, seed) + _homography_motions(x1, x2, focal_px)
    bounds = (LEAST_MATCH_PX / focal_px, WORST_MATCH_PX / focal_px)
    refined = [refine_motion(R, T, x1, x2, bounds) for R, T in _without_opposites(candidates)]
    return rank_motions(refined, x1, x2, focal_px)


def _without_opposites(motions: list[Motion]) -> list[Motion]:
    """Motions without those equal to an earlier one up to the sign of T, which refinement would make equal."""
    kept: list[Motion] = []
    for R, T in motions:
        if not any(np.abs(R - S).max() < 1e-9 and abs(T @ U) > 1 - 1e-9 for S, U in kept):
            kept.append((R, T))
    return kept


def rank_motions(
    motions: list[MotionEstimate], x1: FloatArray, x2: FloatArray, focal_px: float
) -> list[MotionEstimate]:
    """Motions ordered by their fit to these matches, best first, repeats dropped."""
    scored = [assess_motion(m.R, m.T, x1, x2, SCORE_PX / focal_px) for m in motions]
    return distinct_motions(sorted(scored, key=lambda m: m.cost))


def distinct_motions(motions: list[MotionEstimate], limit: int = 5) -> list[MotionEstimate]:
    """At most `limit` motions, each at least 1 degree in rotation or 2 in direction from every better one."""
    least = np.radians(1.0)

    def apart(a: MotionEstimate, b: MotionEstimate) -> bool:
        return bool(np.linalg.norm(a.R - b.R) / np.sqrt(2) > least or np.linalg.norm(a.T - b.T) > 2 * least)

    kept: list[MotionEstimate] = []
    for motion in motions:
        if len(kept) < limit and all(apart(motion, other) for other in kept):
            kept.append(motion)
    return kept


def _essential_motions(x1: FloatArray, x2: FloatArray, focal_px: float, thorough: bool, seed: int) -> list[Motion]:
    motions: list[Motion] = []
    for method, threshold_px in ((cv2.USAC_MAGSAC, 1.0), (cv2.RANSAC, 1.5)):
        motions += _five_point(x1, x2, method, threshold_px / focal_px)
    if thorough:
        rng = np.random.default_rng(seed)
        for _ in range(16):  # OpenCV's RANSAC repeats its own draws, so each run gets other matches
            half = rng.permutation(len(x1))[: max(LEAST_MATCHES, len(x1) // 2)]
            motions += _five_point(x1[half], x2[half], cv2.RANSAC, 1.0 / focal_px)
    return motions


def _five_point(x1: FloatArray, x2: FloatArray, method: int, threshold: float) -> list[Motion]:
    """Motions of all essential matrices that one run of OpenCV returns; empty where it fails."""
    try:
        stacked, _ = cv2.findEssentialMat(x1, x2, np.eye(3), method=method, prob=0.9999, threshold=threshold)
    except cv2.error:
        return []
    motions: list[Motion] = []
    for E in () if stacked is None else np.asarray(stacked, float).reshape(-1, 3, 3):
        _, R, t, _ = cv2.recoverPose(E, x1, x2, np.eye(3))
        motions.append((np.asarray(R, float), np.asarray(-R.T @ t[:, 0], float)))
    return motions


def _homography_motions(x1: FloatArray, x2: FloatArray, focal_px: float) -> list[Motion]:
    """Both roots of the dominant homography, fitted without a threshold (relief may be many pixels) and with 2 px
    (most matches may be mismatches); pure rotations are left out."""
    motions: list[Motion] = []
    for H, _ in (cv2.findHomography(x1, x2, cv2.LMEDS), cv2.findHomography(x1, x2, cv2.RANSAC, 2.0 / focal_px)):
        if H is None:
            continue
        _, rotations, translations, _ = cv2.decomposeHomographyMat(np.asarray(H, float), np.eye(3))
        for R, t in zip(rotations, translations, strict=True):
            length = float(np.linalg.norm(t))
            if length > 1e-6:
                motions.append((np.asarray(R, float), np.asarray(-R.T @ t[:, 0] / length, float)))
    return motions


def inliers_of(residual: FloatArray, focal_px: float) -> BoolArray:
    """(n,) whether an epipolar residual (n,) is below the truncation of the ranking: the match is no mismatch."""
    return np.asarray(np.abs(residual) < 4 * SCORE_PX / focal_px)
