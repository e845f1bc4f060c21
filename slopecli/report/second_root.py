"""The second root in the report: its planes, how much worse it fits, and what would rule one of the two out."""

from __future__ import annotations

import math
from contextlib import suppress

import numpy as np

from slopecli.errors import InputError
from slopecli.findings.wording import figures
from slopecli.geometry.epipolar import rotation_vector
from slopecli.geometry.slope import surface_normals
from slopecli.geometry.solver.uncertainty import by_chance
from slopecli.measure import Measured, judge, signed_distance
from slopecli.options import Options
from slopecli.patches.join import Joined
from slopecli.patches.patch import Patch
from slopecli.report.units import motion_of, scale_of
from slopecli.types import Alternative, AlternativePlane, AmbiguityReport, FloatArray, Plane, Solution


def ambiguity_report(
    main: Measured, second: Measured | None, joined: Joined, planes: tuple[Plane, ...], length: float, options: Options
) -> AmbiguityReport:
    """Status of the second root, with its planes, and what would decide between the two.

    planes : those reported.  length : of the baseline in the first root, in the unit of the report.
    """
    found = main.solution.ambiguity
    if second is None:
        return AmbiguityReport(found.status)
    with suppress(InputError):  # an altitude gives another length of the baseline here, or none
        length = scale_of(second, joined, options)[1]
    by_id = {plane.id: plane for plane in planes}
    kept = [(k, by_id[patch.id]) for k, patch in enumerate(joined.patches) if patch.id in by_id]
    seconds = [_second_plane(k, plane, second, joined.patches[k], length, options) for k, plane in kept]
    firsts = np.array([plane.slope_deg for _, plane in kept])
    ways = what_decides(main.solution, firsts, np.array([plane.slope_deg for plane in seconds]))
    alternative = Alternative(motion_of(second.solution, length), tuple(seconds))
    resolve_with = ways if found.status == "unresolved" else None
    return AmbiguityReport(found.status, found.delta_chi2, found.delta_chi2_prior, resolve_with, alternative)


def _second_plane(
    k: int, first: Plane, second: Measured, patch: Patch, length: float, options: Options
) -> AlternativePlane:
    """Plane k in the second root, in which the baseline has this length; `first` is the same plane in the first root.

    It is called safe only where the plane is in the first, and nothing where its orientation is borrowed and not known.
    """
    p_safe, is_level = float(second.p_safe[k]), k == second.level
    known = is_level or float(np.degrees(second.slopes.sigma_rad[k])) <= options.max_sigma_deg
    guessed = patch.origin == "borrowed" and not (known and first.slope_known)
    guessed = guessed or not second.tells_tilt[k]
    verdict = judge(p_safe, None, first.verdict == "safe", options.confidence, guessed)
    return AlternativePlane(
        id=first.id,
        normal_cam1=surface_normals(second.solution)[k],
        distance=signed_distance(second.solution.scaled_normals[k], patch.matches.x1) * length,
        **second.numbers[k],
        verdict=None if is_level else verdict,
        p_safe=None if is_level else p_safe,
        slope_known=known,
    )


def margin(ambiguity: AmbiguityReport, n_matches: int) -> str:
    """By how much the second root fits worse, and how much of that is due to the motion given; "" where not known."""
    total, known = ambiguity.delta_chi2, ambiguity.delta_chi2_prior
    if total is None:
        return ""
    by = "" if known is None else f", {figures(total - known)} by the images and {figures(known)} by the motion given"
    return f" (chi-square larger by {figures(total)}{by}, of {n_matches} matches)"


def what_decides(solution: Solution, slopes_deg: FloatArray, other_slopes_deg: FloatArray) -> str:
    """Name what tells the two roots of an unresolved solution apart, with how well it must be known.

    slopes_deg, other_slopes_deg : (m,) of the planes, in either root.
    """
    other = solution.ambiguity.alternative
    ways = ["a third image", "a wider baseline"]
    if other is not None:
        needed = by_chance(0.0) + (solution.ambiguity.delta_chi2 or 0.0)
        move, turn = other.T - solution.T, rotation_vector(other.R @ solution.R.T)
        apart = 2.0 * math.asin(min(float(np.linalg.norm(move)) / 2.0, 1.0))
        own_sigma = _sigma_along(move, solution.direction_covariance, other.direction_covariance)
        ways += _sensor("direction of motion", "--direction-prior", apart, own_sigma, needed)
        own_sigma = _sigma_along(turn, solution.motion_covariance[:3, :3], other.motion_covariance[:3, :3])
        ways += _sensor("rotation", "--rotation-prior", float(np.linalg.norm(turn)), own_sigma, needed)
    steeper = float(np.abs(slopes_deg - other_slopes_deg).max(initial=0.0))
    if steeper >= 1.0:
        ways.append(f"gravity (slopes differ by up to {steeper:.0f} deg: how steep is one of them, roughly?)")
    return f"{', '.join(ways[:-1])} or {ways[-1]}"


def _sensor(what: str, option: str, apart: float, own_sigma: float, needed: float) -> list[str]:
    """A sensor of an angle, rad, in which the roots differ, as a way to decide; none where it cannot, or hardly."""
    sigma_deg = math.degrees(deciding_sigma(apart, own_sigma, needed))
    if math.degrees(apart) < 0.1 or sigma_deg <= 0.0:
        return []
    step = 10.0 ** (math.floor(math.log10(sigma_deg)) - 1)  # two digits, rounded down
    how_well = f"{option} with a sigma below {math.floor(sigma_deg / step) * step:.2g} deg decides"
    return [f"the {what} (the two differ by {math.degrees(apart):.3g} deg: {how_well})"]


def deciding_sigma(apart: float, own_sigma: float, needed: float) -> float:
    """Largest 1-sigma of a measured angle that tells two roots apart; 0 where none does.

    The measurement may be off by two of its sigmas towards the wrong root:
    (apart^2 - 2 * 2 sigma apart) / (sigma^2 + own_sigma^2) = needed, solved for sigma.

    apart : between the two roots.  own_sigma : of either, along the line between them.
    needed : chi-square that rules a root out.
    """
    half = 2.0 * apart
    square = half**2 + needed * (apart**2 - needed * own_sigma**2)
    return max((math.sqrt(square) - half) / needed, 0.0) if square > 0.0 else 0.0


def _sigma_along(way: FloatArray, *covariances: FloatArray) -> float:
    """The larger 1-sigma of two motions along the line between them."""
    unit = way / max(float(np.linalg.norm(way)), np.finfo(float).tiny)
    return math.sqrt(max(0.0, *(float(unit @ C @ unit) for C in covariances)))
