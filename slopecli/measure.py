"""Slopes of a solution against what is up, with every doubt in them, and what they are worth to a lander."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, TypedDict

import numpy as np

from slopecli.errors import InputError
from slopecli.geometry.epipolar import homogeneous, unit_vector
from slopecli.geometry.slope import CAMERA_UP, measure_slopes, probability_below, slope_interval, surface_normals
from slopecli.geometry.statistics import median
from slopecli.options import Options
from slopecli.patches.join import Joined
from slopecli.types import FloatArray, Slopes, Solution, Up, Verdict

SAME_AREA = 0.99  # footprints this alike count as equally large
BORROWED_SIGMA_DEG = 5.0  # terrain next to a window tells its slope no better than this


class SlopeNumbers(TypedDict):
    """A slope as a plane of either answer states it, deg."""

    slope_deg: float
    slope_sigma_deg: float
    slope_ci95_deg: tuple[float, float]
    aspect_deg: float | None
    dip_direction_deg: float | None


@dataclass(frozen=True, eq=False)
class Measured:
    """One root of the solution, measured: its slopes, and P(slope < tolerance) of every plane (m,)."""

    solution: Solution
    up: Up
    slopes: Slopes
    p_safe: FloatArray

    @cached_property
    def numbers(self) -> list[SlopeNumbers]:
        """The slope of every plane, in degrees; of all at once, as their intervals take long one by one."""
        return slope_numbers(self.slopes)


def measure(solution: Solution, joined: Joined, options: Options) -> Measured:
    """Measure all planes of one root against the up direction the options ask for.

    Raises
    ------
    InputError : up or north is not a direction, or up names none that is known.
    """
    north = None if options.north is None else np.array(options.north, float)
    sigma = float(np.radians(options.up_sigma_deg))
    if options.up == "dominant-plane":
        level = dominant_plane(joined)
        vector = surface_normals(solution)[level]
        slopes = _doubted(measure_slopes(solution, None, sigma, north, up_plane=level), joined, level)
    else:
        vector = _up_vector(options)
        slopes = _doubted(measure_slopes(solution, vector, sigma, north), joined)
    up = Up((float(vector[0]), float(vector[1]), float(vector[2])), _source(options), options.up_sigma_deg)
    return Measured(solution, up, slopes, probability_below(slopes, float(np.radians(options.tolerance_deg))))


def _source(options: Options) -> Literal["camera", "given", "dominant-plane"]:
    if not isinstance(options.up, str):
        return "given"
    return "dominant-plane" if options.up == "dominant-plane" else "camera"


def _up_vector(options: Options) -> FloatArray:
    if isinstance(options.up, str) and options.up != "camera":
        raise InputError(f"up is {options.up!r}; it must be camera, dominant-plane or three numbers X,Y,Z")
    vector = np.array(CAMERA_UP if isinstance(options.up, str) else options.up, float)
    unit = unit_vector(vector) if vector.shape == (3,) else np.zeros(3)
    if not unit.any():
        raise InputError(f"up is {options.up}; it must be three finite numbers, not all zero")
    return unit


def dominant_plane(joined: Joined) -> int:
    """Index of the patch with the largest footprint, of those with matches of their own where there are any.

    Windows of a grid are as good as equal; among those the one with the most matches is taken.
    """
    own = [patch.origin == "own" for patch in joined.patches]
    counted = np.array(own) if any(own) else True
    areas = np.array([patch.footprint.area_px for patch in joined.patches]) * counted
    matches = np.array([len(patch.matches) for patch in joined.patches])
    return int(np.argmax(np.where(areas >= SAME_AREA * areas.max(), matches, -1)))


def _doubted(slopes: Slopes, joined: Joined, level: int | None = None) -> Slopes:
    """Add the tilt variance that residuals do not show: of borrowed patches, and of those matched in part.

    level : the plane that slopes are measured against, if it is one of them: its doubt is theirs, and it has none.
    """
    least = np.radians(BORROWED_SIGMA_DEG)
    extra = np.array([np.hypot(least if p.origin == "borrowed" else 0.0, p.tilt_sigma_rad) for p in joined.patches])
    if level is not None:
        extra = np.hypot(extra, extra[level])
        extra[level] = 0.0
    if not extra.any():
        return slopes
    variance = extra**2
    covariance = slopes.tilt_covariance + variance[:, None, None] * np.eye(2)
    sigma = np.sqrt(slopes.sigma_rad**2 + variance)
    known = slopes.slope_rad >= 2 * sigma
    nothing = np.where(known, 0.0, np.nan)
    return Slopes(slopes.slope_rad, sigma, slopes.aspect_rad + nothing, slopes.aspect_sigma_rad + nothing, covariance)


def slope_numbers(slopes: Slopes) -> list[SlopeNumbers]:
    """The slope of every plane, in degrees."""
    each = (slopes.slope_rad, slopes.sigma_rad, slope_interval(slopes), slopes.aspect_rad)
    return [_numbers(*one) for one in zip(*(np.degrees(values).tolist() for values in each), strict=True)]


def _numbers(slope: float, sigma: float, interval: list[float], azimuth: float) -> SlopeNumbers:
    aspect = None if math.isnan(azimuth) else azimuth
    return {
        "slope_deg": slope,
        "slope_sigma_deg": sigma,
        "slope_ci95_deg": (interval[0], interval[1]),
        "aspect_deg": aspect,
        "dip_direction_deg": aspect,
    }


def signed_distance(normal: FloatArray, x1: FloatArray) -> float:
    """Perpendicular distance from camera 1, baselines, negative for a plane that mismatches have put behind it.

    normal : (3,) scaled.  x1 : (n, 2) rays of its points.
    """
    ahead = median(homogeneous(x1) @ normal) > 0
    return (1 if ahead else -1) / float(np.linalg.norm(normal))


def judge(p_safe: float, p_other: float | None, seen_as_plane: bool, confidence: float) -> Verdict:
    """Safe only where the window itself was seen to be a plane, and in both answers where geometry leaves two.

    p_safe : P(slope < tolerance); p_other : the same in the other root, None where there is none.
    """
    worst, best = (p_safe, p_safe) if p_other is None else (min(p_safe, p_other), max(p_safe, p_other))
    if seen_as_plane and worst >= confidence:
        return "safe"
    return "unsafe" if best <= 1 - confidence else "undecided"
