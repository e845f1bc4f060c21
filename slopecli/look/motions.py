"""Starting motions from matches of which many are wrong. Several, since the best-looking one may be the wrong root."""

from __future__ import annotations

import cv2
import numpy as np

from slopecli.geometry.motion import MotionEstimate, assess_motion, refine_motion
from slopecli.look.noise import LEAST_MATCH_PX, WORST_MATCH_PX
from slopecli.types import BoolArray, FloatArray

Motion = tuple[FloatArray, FloatArray]

SCORE_PX = 0.5  # motions compete on squared residuals truncated at four of these
MIN_MATCHES = 8  # for a motion at all
HALVES = 16  # random halves of the matches that are searched when most may be wrong
HOMOGRAPHY_PX = 2.0  # distance of matches on the dominant plane from its prediction
DISTINCT_RAD = np.radians(1.0)  # motions closer than this in rotation, twice this in direction, are one


def starting_motions(
    x1: FloatArray, x2: FloatArray, focal_px: float, thorough: bool = False, seed: int = 0
) -> list[MotionEstimate]:
    """Robustly estimated and refined motions, best first, duplicates removed.

    Essential matrices come from five-point RANSAC in several variants (many when `thorough`, for matches of which most
    may be wrong), and from the decompositions of the dominant homography, since a flat scene determines the essential
    matrix badly.
    The list is empty when there are too few matches or no model fits.
    """
    if len(x1) < MIN_MATCHES:
        return []
    candidates = _essential_motions(x1, x2, focal_px, thorough, seed) + _homography_motions(x1, x2, focal_px)
    bounds = (LEAST_MATCH_PX / focal_px, WORST_MATCH_PX / focal_px)
    refined = [refine_motion(R, T, x1, x2, bounds) for R, T in _without_opposites(candidates)]
    return rank_motions(refined, x1, x2, focal_px)


def _without_opposites(motions: list[Motion]) -> list[Motion]:
    """Motions of which none repeats an earlier one or goes the opposite way: refined, the two would be one."""
    kept: list[Motion] = []
    for R, T in motions:
        if not any(np.abs(R - S).max() < 1e-9 and abs(T @ U) > 1 - 1e-9 for S, U in kept):
            kept.append((R, T))
    return kept


def rank_motions(
    motions: list[MotionEstimate], x1: FloatArray, x2: FloatArray, focal_px: float
) -> list[MotionEstimate]:
    """Motions by how well they fit these matches, best first, repeats dropped."""
    scored = [assess_motion(m.R, m.T, x1, x2, SCORE_PX / focal_px) for m in motions]
    return distinct_motions(sorted(scored, key=lambda m: m.cost))


def distinct_motions(motions: list[MotionEstimate], limit: int = 5) -> list[MotionEstimate]:
    """Drop motions that repeat a better one."""
    kept: list[MotionEstimate] = []
    for motion in motions:
        if len(kept) < limit and all(_apart(motion, other) for other in kept):
            kept.append(motion)
    return kept


def _apart(a: MotionEstimate, b: MotionEstimate) -> bool:
    turn = np.linalg.norm(a.R - b.R) / np.sqrt(2)
    return bool(turn > DISTINCT_RAD or np.linalg.norm(a.T - b.T) > 2 * DISTINCT_RAD)


def _essential_motions(x1: FloatArray, x2: FloatArray, focal_px: float, thorough: bool, seed: int) -> list[Motion]:
    motions: list[Motion] = []
    for method, threshold_px in ((cv2.USAC_MAGSAC, 1.0), (cv2.RANSAC, 1.5)):
        motions += _five_point(x1, x2, method, threshold_px / focal_px)
    if thorough:
        rng = np.random.default_rng(seed)
        for _ in range(HALVES):  # random halves: each run of RANSAC otherwise repeats the same draw
            half = rng.permutation(len(x1))[: max(MIN_MATCHES, len(x1) // 2)]
            motions += _five_point(x1[half], x2[half], cv2.RANSAC, 1.0 / focal_px)
    return motions


def _five_point(x1: FloatArray, x2: FloatArray, method: int, threshold: float) -> list[Motion]:
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
    """Both roots of the dominant homography, found without a threshold (relief may be many pixels) and with one
    (most matches may be wrong)."""
    found = (
        cv2.findHomography(x1, x2, cv2.LMEDS),
        cv2.findHomography(x1, x2, cv2.RANSAC, HOMOGRAPHY_PX / focal_px),
    )
    return [motion for H, _ in found if H is not None for motion in _roots(np.asarray(H, float))]


def _roots(H: FloatArray) -> list[Motion]:
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
    """Matches whose epipolar residual (n,) is small enough to count."""
    return np.asarray(np.abs(residual) < 4 * SCORE_PX / focal_px)
