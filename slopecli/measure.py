"""Slopes of a solution against the up direction, with all their uncertainty, and verdicts on them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, TypedDict

import numpy as np

from slopecli.errors import InputError
from slopecli.geometry.epipolar import checked_direction
from slopecli.geometry.slope import (
    ASPECT_SIGMAS,
    CAMERA_UP,
    aspect_sigmas,
    measure_slopes,
    normal_covariances,
    slope_sigmas,
    surface_normals,
    tilt_axes,
    tilt_growth,
)
from slopecli.geometry.statistics import CERTAIN_SIGMAS
from slopecli.geometry.tilt_distribution import probability_below, slope_interval
from slopecli.options import Options
from slopecli.patches.join import Joined
from slopecli.patches.patch import IN_DOUBT_DEG, Patch
from slopecli.types import BoolArray, FloatArray, Report, Slopes, Solution, Up, Verdict


class SlopeNumbers(TypedDict):
    """The slope of a plane as written to slopes.json, deg."""

    slope_deg: float
    slope_sigma_deg: float | None
    slope_ci95_deg: tuple[float, float] | None
    aspect_deg: float | None
    dip_direction_deg: float | None
    azimuth_sigma_deg: float | None


@dataclass(frozen=True, eq=False)
class Measured:
    """One root of the solution, measured: its slopes, and P(slope < tolerance) of every plane (m,).

    growth : (m,) `tilt_growth` of its planes.
    level : index of the plane whose normal is taken as up, None if up is not a plane's normal.
    """

    solution: Solution
    up: Up
    slopes: Slopes
    p_safe: FloatArray
    growth: FloatArray
    level: int | None = None

    @cached_property
    def numbers(self) -> list[SlopeNumbers]:
        """The slope of every plane, in degrees, that of `level` without sigma; all at once, which is faster."""
        numbers = slope_numbers(self.slopes)
        if self.level is not None:
            numbers[self.level] = {**numbers[self.level], "slope_sigma_deg": None, "slope_ci95_deg": None}
        return numbers

    @cached_property
    def tells_tilt(self) -> BoolArray:
        """(m,) whether a sigma holds for the tilt of a plane: the solution converged, and it is not near infinity.

        A scaled normal that is zero within its sigma, as at infinity, has a direction whose errors are not Gaussian.
        """
        largest = np.linalg.eigvalsh(self.solution.normal_covariance)[:, -1]
        length = np.linalg.norm(self.solution.scaled_normals, axis=1)
        return np.asarray(self.solution.converged & (largest <= (length / CERTAIN_SIGMAS) ** 2))


def measure(solution: Solution, joined: Joined, options: Options) -> Measured:
    """Measure all planes of one root against the up direction the options ask for. InputError if there is none."""
    north = None if options.north is None else np.array(options.north, float)
    sigma, of_north = float(np.radians(options.up_sigma_deg)), float(np.radians(options.north_sigma_deg))
    given: Literal["given", "exif"] = "exif" if options.stated is not None and options.stated.up else "given"
    source: Literal["camera", "given", "dominant-plane", "exif"] = "camera" if options.up == "camera" else given
    level: int | None = None
    growth = tilt_growth(solution.scaled_normals, solution.normal_covariance)
    if options.up == "dominant-plane":
        source, level = "dominant-plane", dominant_plane(joined)
        vector = surface_normals(solution)[level]
        slopes = measure_slopes(solution, None, sigma, north, up_plane=level, north_sigma_rad=of_north, growth=growth)
    elif isinstance(options.up, str) and options.up != "camera":
        raise InputError(f"up is {options.up!r}; it must be camera, dominant-plane or three numbers X,Y,Z")
    else:
        vector = CAMERA_UP if isinstance(options.up, str) else checked_direction("up", options.up)
        slopes = measure_slopes(solution, vector, sigma, north, north_sigma_rad=of_north, growth=growth)
    widened = _with_tilt_variance(slopes, joined, surer_tilts(joined, surface_normals(solution), vector), level)
    if widened is not slopes:
        facing = aspect_sigmas(widened, surface_normals(solution), vector, sigma, north, of_north)
        slopes = replace(widened, aspect_sigma_rad=facing)
    level_id = None if level is None else joined.patches[level].id
    up = Up((float(vector[0]), float(vector[1]), float(vector[2])), source, options.up_sigma_deg, level_id)
    p_safe = probability_below(slopes, float(np.radians(options.tolerance_deg)))
    return Measured(solution, up, slopes, p_safe, growth, level)


def up_sigma_rad(report: Report, joined: Joined, solution: Solution) -> float:
    """1-sigma of the direction taken as up about a horizontal axis: as given, and of the plane whose normal it is."""
    sigma = math.radians(report.up.sigma_deg)
    for k, patch in enumerate(joined.patches):
        if patch.id == report.up.plane_id:
            length = float(np.linalg.norm(solution.scaled_normals[k]))
            own = float(np.sqrt(np.linalg.eigvalsh(solution.normal_covariance[k])[-1])) / length
            sigma = math.hypot(sigma, own, patch.tilt_sigma_rad)
    return sigma


def dominant_plane(joined: Joined) -> int:
    """Index of the answered patch with the largest footprint; borrowed ones only if there are no others.

    Footprints within 1 % of the largest, such as windows of a grid, count as equal; the most matches decide.
    """
    own = [patch.origin == "own" for patch in joined.patches]
    counted = np.array(own) if any(own) else True
    areas = np.array([patch.footprint.area_px for patch in joined.patches]) * counted
    matches = np.array([len(patch.matches) for patch in joined.patches])
    return int(np.argmax(np.where(areas >= 0.99 * areas.max(), matches, -1)))


def surer_tilts(joined: Joined, normals: FloatArray, up: FloatArray) -> FloatArray:
    """(m, 2) `Patch.surer_cam1` of all planes, along their slopes and across, rad.

    normals : (m, 3) unit.  up : (3,) unit.
    """
    surer = np.array([patch.surer_cam1 for patch in joined.patches])
    return np.stack([(surer * axis).sum(axis=1) for axis in tilt_axes(normals, up)], axis=1)


def _with_tilt_variance(slopes: Slopes, joined: Joined, surer: FloatArray, level: int | None = None) -> Slopes:
    """Add the tilt variance that residuals do not show: of borrowed patches, and of those matched in part.

    surer : (m, 2) of `surer_tilts`.
    level : index of the plane that slopes are measured against, if any. Its own variance is added to all others.
    """
    extra = np.array([np.hypot(borrowed_sigma_rad(patch), patch.tilt_sigma_rad) for patch in joined.patches])
    if level is not None:
        extra = np.hypot(extra, extra[level])
        extra[level] = 0.0
        surer = np.where((np.arange(len(extra)) == level)[:, None], 0.0, surer)
    if not extra.any():
        return slopes
    variance = extra**2
    covariance = slopes.tilt_covariance + variance[:, None, None] * np.eye(2) - surer[:, :, None] * surer[:, None]
    sigma = np.sqrt(slopes.sigma_rad**2 + variance)
    if (part := surer.any(axis=1)).any():
        # what is nearly level may face anywhere, and errs by what is open across its slope as well
        least = np.sqrt(sigma[part] ** 2 - surer[part, 0] ** 2)
        sigma[part] = np.clip(slope_sigmas(slopes.slope_rad[part], covariance[part]), least, sigma[part])
    aspect = np.where(slopes.slope_rad < ASPECT_SIGMAS * sigma, np.nan, slopes.aspect_rad)
    return Slopes(slopes.slope_rad, sigma, aspect, slopes.aspect_sigma_rad, covariance)


def normal_covariances_deg2(root: Measured, joined: Joined) -> list[FloatArray | None]:
    """(3, 3) covariances of the unit normals of all planes, deg^2, those of borrowed patches and of patches matched in
    part with the tilt variance that residuals do not show; None for one that is not finite. Up has no part in them."""
    normals = surface_normals(root.solution)
    extra = [borrowed_sigma_rad(patch) ** 2 + patch.tilt_sigma_rad**2 for patch in joined.patches]
    across = np.eye(3) - normals[:, :, None] * normals[:, None]
    surer = np.einsum("mij,mj->mi", across, np.array([patch.surer_cam1 for patch in joined.patches]))
    added = np.array(extra)[:, None, None] * across - surer[:, :, None] * surer[:, None]
    covariance = np.degrees(np.degrees(normal_covariances(root.solution, root.growth) + added))
    return [one if np.isfinite(one).all() else None for one in 0.5 * (covariance + covariance.swapaxes(1, 2))]


def borrowed_sigma_rad(patch: Patch) -> float:
    """1-sigma of the tilt that is added for a patch whose matches are not its own: it is in doubt; 0 where they are."""
    return math.radians(IN_DOUBT_DEG) if patch.origin == "borrowed" else 0.0


def slope_numbers(slopes: Slopes) -> list[SlopeNumbers]:
    """The slope of every plane, in degrees."""
    each = (slopes.slope_rad, slopes.sigma_rad, slope_interval(slopes), slopes.aspect_rad, slopes.aspect_sigma_rad)
    return [
        {
            "slope_deg": slope,
            "slope_sigma_deg": sigma,
            "slope_ci95_deg": (lower, upper),
            "aspect_deg": None if math.isnan(aspect) else aspect,
            "dip_direction_deg": _dip_direction(slope, sigma, aspect),
            "azimuth_sigma_deg": None if math.isnan(aspect) else of_azimuth,
        }
        for slope, sigma, (lower, upper), aspect, of_azimuth in zip(
            *(np.degrees(one).tolist() for one in each), strict=True
        )
    ]


def _dip_direction(slope_deg: float, sigma_deg: float, aspect_deg: float) -> float | None:
    """Azimuth of the steepest descent of the plane itself, deg: of an overhang, whose normal points down, opposite to
    its aspect. None where the dip, of an overhang 180 - slope, is below twice its sigma."""
    if math.isnan(aspect_deg) or min(slope_deg, 180.0 - slope_deg) < ASPECT_SIGMAS * sigma_deg:
        return None
    return aspect_deg if slope_deg <= 90.0 else (aspect_deg + 180.0) % 360.0


def signed_distance(normal: FloatArray, x1: FloatArray) -> float:
    """Distance from camera 1, baselines, of a plane with a scaled normal (3,); negative unless most x1 lie ahead."""
    ahead = 2 * np.count_nonzero(x1 @ normal[:2] + normal[2] > 0) > len(x1)
    return (1 if ahead else -1) / math.sqrt(normal @ normal)


def judge(
    p_safe: float, p_other: float | None, seen_as_plane: bool, confidence: float, guessed: bool = False
) -> Verdict:
    """Verdict on one plane: safe only if both roots are safe and the window's own matches confirm the plane.

    p_safe : P(slope < tolerance); p_other : the same in the second root, None if there is none.
    guessed : its orientation is borrowed and not known, or its sigma does not hold: no evidence for or against it.
    """
    worst, best = (p_safe, p_safe) if p_other is None else (min(p_safe, p_other), max(p_safe, p_other))
    if guessed:
        return "undecided"
    if seen_as_plane and worst >= confidence:
        return "safe"
    return "unsafe" if best <= 1 - confidence else "undecided"
