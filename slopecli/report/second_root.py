"""The second answer, told as fully as the first, and what would decide between the two."""

from __future__ import annotations

import math

import numpy as np

from slopecli.findings.wording import figures
from slopecli.geometry.epipolar import rotation_vector
from slopecli.geometry.slope import surface_normals
from slopecli.geometry.solver.ambiguity import by_chance
from slopecli.measure import Measured, judge, signed_distance
from slopecli.options import Options
from slopecli.types import AlternativePlane, AmbiguityReport, FloatArray, Plane, Solution

WORTH_NAMING_DEG = 0.1  # a difference of the two motions below which no sensor decides between them
OWN_ERROR = 2.0  # sigmas that what is measured may itself be off, towards the wrong answer


def second_plane(
    k: int, first: Plane, other: Measured, x1: FloatArray, length: float, options: Options
) -> AlternativePlane:
    """Plane k as the second answer has it. Like the first it is called safe only where the plane is, in both.

    first : the same plane in the first answer.  x1 : (n, 2) rays of its points.
    length : of a baseline in the second answer, in the unit of the report.
    """
    slope, p_safe = other.numbers[k], float(other.p_safe[k])
    return AlternativePlane(
        id=first.id,
        normal_cam1=surface_normals(other.solution)[k],
        distance=signed_distance(other.solution.scaled_normals[k], x1) * length,
        **slope,
        verdict=judge(p_safe, None, first.verdict == "safe", options.confidence),
        p_safe=p_safe,
        slope_known=slope["slope_sigma_deg"] <= options.max_sigma_deg,
    )


def margin(ambiguity: AmbiguityReport, n_matches: int) -> str:
    """By how much the second answer fits worse, and how much of that is not the images' word; "" where not known."""
    total, known = ambiguity.delta_chi2, ambiguity.delta_chi2_prior
    if total is None:
        return ""
    shares = (
        "" if known is None else f", {figures(total - known)} by the images and {figures(known)} by the motion given"
    )
    return f" (chi-square larger by {figures(total)}{shares}, of {n_matches} matches)"


def what_decides(solution: Solution, slopes_deg: FloatArray, other_slopes_deg: FloatArray) -> str:
    """Name what tells the two answers of an unresolved solution apart, with how well it must be known.

    Parameters
    ----------
    solution : with its alternative.
    slopes_deg, other_slopes_deg : (m,) of the planes, in either answer.
    """
    other = solution.ambiguity.alternative
    ways = ["a third image", "a wider baseline"]
    if other is not None:
        needed = by_chance(0.0) + (solution.ambiguity.delta_chi2 or 0.0)
        ways += _sensor("direction of motion", "--direction-prior", *_between_directions(solution, other), needed)
        ways += _sensor("rotation", "--rotation-prior", *_between_rotations(solution, other), needed)
    apart = float(np.abs(slopes_deg - other_slopes_deg).max(initial=0.0))
    if apart >= 1.0:
        ways.append(f"gravity (slopes differ by up to {apart:.0f} deg: how steep is one of them, roughly?)")
    return f"{', '.join(ways[:-1])} or {ways[-1]}"


def _sensor(what: str, option: str, apart: float, own_sigma: float, needed: float) -> list[str]:
    """The way by a sensor that measures an angle, rad, in which the answers differ; none where it cannot decide."""
    sigma_deg = math.degrees(deciding_sigma(apart, own_sigma, needed))
    if math.degrees(apart) < WORTH_NAMING_DEG or sigma_deg <= 0.0:
        return []
    how_well = f"{option} with a sigma below {_rounded_down(sigma_deg)} deg decides"
    return [f"the {what} (the two differ by {math.degrees(apart):.3g} deg: {how_well})"]


def deciding_sigma(apart: float, own_sigma: float, needed: float) -> float:
    """Largest 1-sigma of a measured angle that tells two answers apart; 0 where none does.

    The wrong answer gives way to the measurement within its own sigma, and the measurement may be off by twice its:
    (apart^2 - 2 * 2 sigma apart) / (sigma^2 + own_sigma^2) = needed, solved for sigma.

    Parameters
    ----------
    apart : between the two answers.  own_sigma : of either, along the way between them.
    needed : chi-square that rules an answer out.
    """
    half = OWN_ERROR * apart
    square = half**2 + needed * (apart**2 - needed * own_sigma**2)
    return max((math.sqrt(square) - half) / needed, 0.0) if square > 0.0 else 0.0


def _between_directions(a: Solution, b: Solution) -> tuple[float, float]:
    """Angle between the directions of two motions, and the larger 1-sigma of either along it, rad."""
    way = b.T - a.T
    apart = 2.0 * math.asin(min(float(np.linalg.norm(way)) / 2.0, 1.0))
    return apart, _along(way, a.direction_covariance, b.direction_covariance)


def _between_rotations(a: Solution, b: Solution) -> tuple[float, float]:
    way = rotation_vector(b.R @ a.R.T)
    return float(np.linalg.norm(way)), _along(way, a.motion_covariance[:3, :3], b.motion_covariance[:3, :3])


def _along(way: FloatArray, *covariances: FloatArray) -> float:
    unit = way / max(float(np.linalg.norm(way)), np.finfo(float).tiny)
    return math.sqrt(max(max(float(unit @ C @ unit) for C in covariances), 0.0))


def _rounded_down(value: float) -> str:
    """In two digits, never above."""
    step = 10.0 ** (math.floor(math.log10(value)) - 1)
    return f"{math.floor(value / step) * step:.2g}"
