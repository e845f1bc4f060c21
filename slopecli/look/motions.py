"""Camera motions estimated from matches with many mismatches; several, as the best fit may be the wrong root."""

from __future__ import annotations

import cv2
import numpy as np

from slopecli.geometry.motion import MotionEstimate, assess_motion, refine_motion
from slopecli.look.noise import LEAST_MATCH_PX, WORST_MATCH_PX
from slopecli.types import BoolArray, FloatArray

Motion = tuple[FloatArray, FloatArray]

SCORE_PX = 0.5  # motions are ranked by squared epipolar residuals truncated at four times this
LEAST_FOR_MOTION = 8  # for a motion: five determine it, three check it


def starting_motions(
    x1: FloatArray, x2: FloatArray, focal_px: float, thorough: bool = False, seed: int = 0
) -> list[MotionEstimate]:
    """Robustly estimated and refined motions, best first, repeats dropped.

    Essential matrices come from five-point RANSAC (also on random halves of the matches when `thorough`). The
    decompositions of the dominant homography are added, as a flat scene determines the essential matrix badly.
    The list is empty when there are too few matches or no model fits.
    """
    if len(x1) < LEAST_FOR_MOTION:
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
    kept: list[MotionEstimate] = []
    for motion in motions:
        if len(kept) < limit and all(_apart(motion, other) for other in kept):
            kept.append(motion)
    return kept


def _apart(a: MotionEstimate, b: MotionEstimate) -> bool:
    turn, limit = np.linalg.norm(a.R - b.R) / np.sqrt(2), np.radians(1.0)
    return bool(turn > limit or np.linalg.norm(a.T - b.T) > 2 * limit)


def _essential_motions(x1: FloatArray, x2: FloatArray, focal_px: float, thorough: bool, seed: int) -> list[Motion]:
    motions: list[Motion] = []
    for method, threshold_px in ((cv2.USAC_MAGSAC, 1.0), (cv2.RANSAC, 1.5)):
        motions += _five_point(x1, x2, method, threshold_px / focal_px)
    if thorough:
        rng = np.random.default_rng(seed)
        for _ in range(16):  # OpenCV's RANSAC repeats its own draws, so each run gets other matches
            half = rng.permutation(len(x1))[: max(LEAST_FOR_MOTION, len(x1) // 2)]
            motions += _five_point(x1[half], x2[half], cv2.RANSAC, 1.0 / focal_px)
    return motions


def _five_point(x1: FloatArray, x2: FloatArray, method: int, threshold: float) -> list[Motion]:
    """Motions of all essential matrices that one run of OpenCV returns; empty where it fails."""
    try:
        stacked, _ = cv2.findEssentialMat(x1, x2, np.eye(3), method=method, prob=0.9999, threshold=threshold)
    except cv2.error:
        return []
    if stacked is None:
        return []
    motions: list[Motion] = []
    for k in range(len(stacked) // 3):
        _, R, t, _ = cv2.recoverPose(stacked[3 * k : 3 * k + 3], x1, x2, np.eye(3))
        motions.append(_motion(R, -R.T @ t[:, 0]))
    return motions


def _homography_motions(x1: FloatArray, x2: FloatArray, focal_px: float) -> list[Motion]:
    """Both roots of the dominant homography, fitted without a threshold (relief may be many pixels) and with 2 px
    (most matches may be mismatches)."""
    found = cv2.findHomography(x1, x2, cv2.LMEDS), cv2.findHomography(x1, x2, cv2.RANSAC, 2.0 / focal_px)
    return [motion for H, _ in found if H is not None for motion in _roots(np.asarray(H, float))]


def _roots(H: FloatArray) -> list[Motion]:
    """Motions of the decompositions of a homography, pure rotations left out."""
    count, rotations, translations, _ = cv2.decomposeHomographyMat(H, np.eye(3))
    motions: list[Motion] = []
    for R, t in zip(rotations[:count], translations[:count], strict=True):
        length = float(np.linalg.norm(t))
        if length > 1e-6:
            motions.append(_motion(R, -R.T @ t[:, 0] / length))
    return motions


def _motion(R: object, T: object) -> Motion:
    return np.asarray(R, float), np.asarray(T, float)


def inliers_of(residual: FloatArray, focal_px: float) -> BoolArray:
    """(n,) whether an epipolar residual (n,) is below the truncation of the ranking: the match is no mismatch."""
    return np.asarray(np.abs(residual) < 4 * SCORE_PX / focal_px)
