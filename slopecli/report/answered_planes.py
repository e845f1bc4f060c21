"""The planes of a report: numbers, verdict, status and reasons; which are not reported, with cause and remedy."""

from __future__ import annotations

from itertools import starmap
from typing import NamedTuple

import numpy as np

from slopecli.errors import NoAnswer
from slopecli.findings.plane_checks import NON_PLANAR, ROUGH
from slopecli.findings.wording import beside
from slopecli.geometry.epipolar import homogeneous
from slopecli.geometry.homography import homography_in_pixels, homography_of_plane
from slopecli.geometry.slope import surface_normals
from slopecli.measure import Measured, judge, normal_covariances_deg2, signed_distance
from slopecli.options import MOST_SIGMA_DEG, Options
from slopecli.patches.given import MOST_LEFT_OUT
from slopecli.patches.join import Joined
from slopecli.patches.patch import LEAST_MATCHED, Patch
from slopecli.report.sigma_parts import sigma_causes
from slopecli.report.units import residual_in_unit
from slopecli.types import Camera, FloatArray, Plane, Rejected, Solution, Verdict

TAKEN_AS_LEVEL = "taken-as-level"  # first reason of the plane that defines what is level: it has no verdict


def planes_of(
    root: Measured, second: Measured | None, joined: Joined, cameras: tuple[Camera, Camera], options: Options
) -> list[Plane]:
    """The planes of all patches with matches, in the solver's order, their lengths in baselines.

    root, second : the first and the second root, None if there is none; verdicts hold in both unless it is ruled out.
    """
    possible = second if root.solution.ambiguity.status == "unresolved" else None
    seen = _seen(root, joined, cameras)
    return [_plane(k, root, possible, joined, cameras, options, one) for k, one in enumerate(seen)]


class Seen(NamedTuple):
    """What is known of a plane from the solution, for all planes at once, which is faster.

    normal : unit, towards camera 1.  homography_px : between undistorted pixels.  rms : of the residuals of its kept
    matches in image 2, normalised coordinates, NaN where none is kept.  causes, covariance: as in `types.Plane`.
    """

    normal: FloatArray
    homography_px: FloatArray
    rms: float
    causes: dict[str, float] | None
    covariance: FloatArray | None


def _seen(root: Measured, joined: Joined, cameras: tuple[Camera, Camera]) -> list[Seen]:
    solution = root.solution
    homographies = homography_of_plane(solution.R, solution.T, solution.scaled_normals)
    kept = (joined.plane >= 0) & solution.inlier
    plane, matches = joined.plane[kept], joined.matches
    mapped = np.einsum("nij,nj->ni", homographies[plane], homogeneous(matches.x1[kept]))
    squares = ((mapped[:, :2] / mapped[:, 2:] - matches.x2[kept]) ** 2).sum(1)
    count, total = (np.bincount(plane, weights, len(homographies)) for weights in (None, squares))
    with np.errstate(invalid="ignore"):
        rms = np.sqrt(total / (2 * count))
    columns = (
        surface_normals(solution),
        homography_in_pixels(homographies, cameras[0].K, cameras[1].K),
        rms.tolist(),
        sigma_causes(root, joined),
        normal_covariances_deg2(root, joined),
    )
    return list(starmap(Seen, zip(*columns, strict=True)))


def _plane(
    k: int,
    root: Measured,
    second: Measured | None,
    joined: Joined,
    cameras: tuple[Camera, Camera],
    options: Options,
    seen: Seen,
) -> Plane:
    solution, patch = root.solution, joined.patches[k]
    kept = solution.inlier[joined.rows(k)]
    is_level, limit = k == root.level, options.max_sigma_deg
    sigma = float(np.degrees(root.slopes.sigma_rad[k]))
    known = is_level or not sigma > limit
    reasons = _reasons(k, patch, solution, float(kept.sum() / max(len(kept), 1)))
    if not known:
        reasons.append(f"sigma {beside(sigma, limit)}° is above --max-sigma {limit:g}°")
    verdict, p_safe = (None, None) if is_level else _judged(k, root, second, patch, known, not reasons, options)
    rms_px, rms_mrad = residual_in_unit(seen.rms, cameras[1])
    # only the joint solution tells relief from noise, and given points are held coplanar unless they show relief
    estimated = options.solver == "mle" and (patch.source != "given" or solution.relief.any())
    return Plane(
        id=patch.id,
        source=patch.source,
        polygon_px=patch.footprint.polygon_px,
        normal_cam1=seen.normal,
        distance=signed_distance(solution.scaled_normals[k], patch.matches.x1),
        **root.numbers[k],
        n_correspondences=len(kept),
        n_inliers=int(kept.sum()),
        rms_px=rms_px,
        rms_mrad=rms_mrad,
        roughness=float(solution.relief[k]) if estimated else float("nan"),
        homography_px=seen.homography_px,
        verdict=verdict,
        p_safe=p_safe,
        status="poor" if reasons else "ok",
        reason="; ".join([*([TAKEN_AS_LEVEL] if is_level else []), *reasons]) or None,
        slope_known=known,
        slope_sigma_causes_deg=seen.causes,
        normal_covariance_cam1=seen.covariance,
        noun=patch.finder.noun,
        found=patch.finder.found,
    )


def _judged(
    k: int, root: Measured, second: Measured | None, patch: Patch, known: bool, is_ok: bool, options: Options
) -> tuple[Verdict, float]:
    """Verdict on a plane, smaller P(safe) of the two roots.  known, is_ok : its slope in the first root, its status."""
    p_safe, p_second = float(root.p_safe[k]), None if second is None else float(second.p_safe[k])
    both_known = known and (second is None or np.degrees(second.slopes.sigma_rad[k]) <= options.max_sigma_deg)
    # a borrowed orientation alone is no evidence against a window
    guessed = (patch.origin == "borrowed" and not both_known) or not root.tells_tilt[k]
    verdict = judge(p_safe, p_second, both_known and is_ok, options.confidence, guessed)
    return verdict, p_safe if p_second is None else min(p_safe, p_second)


def _reasons(k: int, patch: Patch, solution: Solution, inlier_share: float) -> list[str]:
    """Why a plane is poor, apart from a sigma above `max_sigma_deg`; empty if it is not.

    inlier_share : of its correspondences, kept by the solver.
    """
    reasons, whole = [], patch.footprint.largest_share
    if patch.reason:  # borrowed, or given rows whose residuals say that they are not on one plane
        reasons = [patch.reason]
    elif patch.share < LEAST_MATCHED:
        share = beside(100 * patch.share, 100 * LEAST_MATCHED)
        reasons = [f"only {share} % of the {patch.finder.noun} could be matched"]
    elif solution.relief[k] > ROUGH or patch.left_out > MOST_LEFT_OUT or inlier_share < 1 - MOST_LEFT_OUT:
        reasons = [NON_PLANAR]
    elif whole < 0.5:  # it is no surface
        reasons = [f"scattered: its largest piece is {beside(100 * whole, 50)} % of it"]
    if not solution.converged:  # all planes depend on its motion
        reasons.append("the joint solution did not converge")
    return reasons


class Cause(NamedTuple):
    """A diagnostic code, what was found in words, and a remedy."""

    code: str
    message: str
    remedy: str


def divide(
    planes: list[Plane], main: Measured, joined: Joined, options: Options
) -> tuple[list[Plane], tuple[Rejected, ...]]:
    """The planes to report, and the patches without an answer: those without matches and those of unknown slope.

    planes : of all patches with matches, in the solver's order.

    Raises
    ------
    NoAnswer : no plane can be reported.
    """
    up_variance = np.radians(options.up_sigma_deg) ** 2
    spread = np.linalg.eigvalsh(main.slopes.tilt_covariance - up_variance * np.eye(2))[:, -1]
    # the larger 1-sigma of the tilt, deg, without that of up, which is the same in both directions
    alone = np.degrees(np.sqrt(np.maximum(spread, 0.0)))
    sigmas = np.degrees(main.slopes.sigma_rad).tolist()
    known = [plane for plane, sigma in zip(planes, sigmas, strict=True) if _is_known(plane, sigma)]
    unknown = [
        (plane, _cause(plane, sigma, alone_deg, options))
        for plane, sigma, alone_deg in zip(planes, sigmas, alone.tolist(), strict=True)
        if not _is_known(plane, sigma)
    ]
    if len(unknown) == len(planes):
        codes, asked = [cause.code for _, cause in unknown], [*joined.patches, *joined.unanswered]
        code, found, remedy = max((cause for _, cause in unknown), key=lambda cause: codes.count(cause.code))
        whose = f"all {len(asked)} {asked[0].finder.noun}s"
        raise NoAnswer(code, f"the matches of {whose} do not determine their slopes: {found}", remedy)
    rejected = [
        *(Rejected(patch.id, patch.footprint.polygon_px, patch.code, patch.reason) for patch in joined.unanswered),
        *(Rejected(plane.id, plane.polygon_px, cause.code, cause.message) for plane, cause in unknown),
    ]
    return known, tuple(sorted(rejected, key=lambda one: one.id))


def _is_known(plane: Plane, sigma_deg: float) -> bool:
    """Whether a plane is reported: its slope is known, and it lies in front of the camera (NaN compares false).

    sigma_deg : of its slope; of the plane taken as level that of up.
    A window or given plane, which was asked for, is reported up to a sigma of MOST_SIGMA_DEG; one that was found only
    up to `max_sigma_deg`.
    """
    return sigma_deg <= MOST_SIGMA_DEG and plane.distance > 0 and (plane.slope_known or not plane.found)


def _cause(plane: Plane, sigma: float, alone_deg: float, options: Options) -> Cause:
    """Why a plane is not reported. sigma : of its slope, deg.  alone_deg : larger 1-sigma of its tilt, less up's."""
    most = options.max_sigma_deg if plane.found else MOST_SIGMA_DEG
    if plane.distance > 0 and options.up_sigma_deg > 0 and alone_deg <= most:
        found = f"1-sigma {sigma:.0f}°, nearly all of it that of up, {options.up_sigma_deg:g}°"
        return Cause("up-unknown", found, "give up with a smaller --up-sigma")
    vague = "" if plane.slope_known else f": 1-sigma {sigma:.0f}°"
    if plane.source == "given":
        behind = not plane.distance > 0
        found = "its rows put it behind the camera" if behind else f"its rows do not determine the slope{vague}"
        return Cause("slope-open", found, "give more rows, spread wider, of a longer baseline or known better")
    if plane.distance > 0 and sigma <= Options().max_sigma_deg:  # --max-sigma is smaller than usual
        found = f"sigma {beside(sigma, options.max_sigma_deg)}° is above --max-sigma {options.max_sigma_deg:g}°"
        return Cause("slope-open", found, "raise --max-sigma, or take the images farther apart")
    found = f"too little texture: its matches do not determine the slope{vague}"
    return Cause("low-texture", found, f"choose larger {plane.noun}s, or such with texture that both images show")
