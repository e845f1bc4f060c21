"""The planes of a report: numbers, verdict, and status with its reasons."""

from __future__ import annotations

import numpy as np

from slopecli.findings.plane_checks import NON_PLANAR, ROUGH
from slopecli.findings.wording import beside
from slopecli.geometry.homography import apply_homography, homography_in_pixels, homography_of_plane
from slopecli.geometry.slope import surface_normals
from slopecli.measure import Measured, judge, signed_distance
from slopecli.options import Options
from slopecli.patches.given.given_solution import MOST_LEFT_OUT
from slopecli.patches.join import Joined
from slopecli.patches.patch import Patch
from slopecli.report.units import residual_in_unit
from slopecli.types import Camera, Plane, Solution

LEAST_MATCHED = 0.5  # share of a window that must be matched to tell its slope
LEAST_WHOLE = 0.5  # share of a plane found that its largest piece must have: less is no surface


def planes_of(
    root: Measured, second: Measured | None, joined: Joined, cameras: tuple[Camera, Camera], options: Options
) -> list[Plane]:
    """The planes of all patches with matches, in the solver's order, their lengths in baselines.

    second : the second root, None where there is none; verdicts hold in both where it is not ruled out.
    """
    possible = second if root.solution.ambiguity.status == "unresolved" else None
    return [_plane(k, root, possible, joined, cameras, options) for k in range(len(joined.patches))]


def _plane(
    k: int, root: Measured, second: Measured | None, joined: Joined, cameras: tuple[Camera, Camera], options: Options
) -> Plane:
    solution, patch = root.solution, joined.patches[k]
    member = joined.on(k)
    kept = member & solution.inlier
    slope = root.numbers[k]
    known = not slope["slope_sigma_deg"] > options.max_sigma_deg
    reasons = _reasons(k, patch, solution, float(kept.sum() / max(member.sum(), 1)))
    if not known:
        limit = options.max_sigma_deg
        reasons.append(f"sigma {beside(slope['slope_sigma_deg'], limit)}° is above --max-sigma {limit:g}°")
    p_safe, p_second = float(root.p_safe[k]), None if second is None else float(second.p_safe[k])
    both_known = known and (second is None or np.degrees(second.slopes.sigma_rad[k]) <= options.max_sigma_deg)
    H = homography_of_plane(solution.R, solution.T, solution.scaled_normals[k])
    matches = joined.matches.take(kept)
    squares = (apply_homography(H, matches.x1) - matches.x2) ** 2
    rms_px, rms_mrad = residual_in_unit(float(np.sqrt(squares.mean())) if kept.any() else float("nan"), cameras[1])
    return Plane(
        id=patch.id,
        source=patch.source,
        polygon_px=patch.footprint.polygon_px,
        normal_cam1=surface_normals(solution)[k],
        distance=signed_distance(solution.scaled_normals[k], patch.matches.x1),
        **slope,
        n_correspondences=int(member.sum()),
        n_inliers=int(kept.sum()),
        rms_px=rms_px,
        rms_mrad=rms_mrad,
        roughness=_roughness(solution, k, patch.source, options),
        homography_px=homography_in_pixels(H, cameras[0].K, cameras[1].K),
        verdict=judge(p_safe, p_second, both_known and not reasons, options.confidence),
        p_safe=p_safe if p_second is None else min(p_safe, p_second),
        status="poor" if reasons else "ok",
        reason="; ".join(reasons) or None,
        slope_known=known,
        noun=patch.finder.noun,
        found=patch.finder.found,
    )


def _reasons(k: int, patch: Patch, solution: Solution, inlier_share: float) -> list[str]:
    """Why a plane is poor, its sigma apart; empty when nothing is against it."""
    reasons, whole = [], patch.footprint.largest_share
    if patch.reason:  # borrowed, or of a user's own and contradicted by their residuals
        reasons = [patch.reason]
    elif patch.share < LEAST_MATCHED:
        share = beside(100 * patch.share, 100 * LEAST_MATCHED)
        reasons = [f"only {share} % of the {patch.finder.noun} could be matched"]
    elif solution.relief[k] > ROUGH or patch.left_out > MOST_LEFT_OUT or inlier_share < 1 - MOST_LEFT_OUT:
        reasons = [NON_PLANAR]
    elif whole < LEAST_WHOLE:
        reasons = [f"scattered: its largest piece is {beside(100 * whole, 100 * LEAST_WHOLE)} % of it"]
    if not solution.converged:  # planes share its motion, so none of them is better than it
        reasons.append("the joint solution did not converge")
    return reasons


def _roughness(solution: Solution, k: int, source: str, options: Options) -> float:
    """Relief of a plane over its distance, NaN where it was not estimated.

    Only the joint solution tells relief from noise, and given points are held coplanar unless they show relief.
    """
    estimated = options.solver == "mle" and (source != "given" or bool(solution.relief.any()))
    return float(solution.relief[k]) if estimated else float("nan")
