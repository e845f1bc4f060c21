"""What a user knows of the motion, as the solver wants it, and whether the images agree with it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from slopecli.errors import InputError
from slopecli.geometry.solver.priors import MotionPrior
from slopecli.look.noise import SYSTEMATIC_PX
from slopecli.options import Options
from slopecli.patches.join import excess_px
from slopecli.types import Diagnostic, FloatArray, Solution

# chi-square at 0.999 by the number of directions a prior fixes
CONTRADICTED = {2: 13.8, 3: 16.3, 5: 20.5}
USELESS_DEG = 90.0  # a 1-sigma that leaves every direction open
EXACT_RAD = 1e-6  # 1-sigma of a pose that comes without one: far less than images can tell


def motion_prior(options: Options) -> MotionPrior | None:
    """The prior of `--rotation-prior`, `--direction-prior` or `--pose`; None without any.

    Raises
    ------
    InputError : a quaternion or direction of length zero, or a sigma that is not positive or says nothing.
    """
    if options.pose is not None:
        R, sigma_deg = np.array(options.pose.rotation).reshape(3, 3), options.pose_sigma_deg
        sigma = EXACT_RAD if sigma_deg is None else _sigma("pose", sigma_deg)
        return MotionPrior.checked(R, sigma, np.array(options.pose.baseline_m), sigma)
    if options.rotation_prior is None and options.direction_prior is None:
        return None
    rotation, direction = options.rotation_prior, options.direction_prior
    return MotionPrior.checked(
        None if rotation is None else rotation_of_quaternion(np.array(rotation[:4])),
        np.inf if rotation is None else _sigma("rotation", rotation[4]),
        None if direction is None else np.array(direction[:3]),
        np.inf if direction is None else _sigma("direction", direction[3]),
    )


def known_length_m(options: Options) -> float | None:
    """Metres between the cameras, of `--pose` or `--baseline`; None without either."""
    if options.pose is not None:
        return float(np.linalg.norm(options.pose.baseline_m))
    return options.baseline_m


def _sigma(name: str, sigma_deg: float) -> float:
    """In rad, when it says anything."""
    if not sigma_deg < USELESS_DEG:
        raise InputError(
            f"the {name} known beforehand has a sigma of {sigma_deg:g} deg, which says nothing; give one below "
            f"{USELESS_DEG:g} deg, or leave it out"
        )
    return math.radians(sigma_deg)


def rotation_of_quaternion(q: FloatArray) -> FloatArray:
    """(3, 3) rotation of a quaternion w, x, y, z of any length but zero."""
    length = math.hypot(*q)
    if not 0.0 < length < math.inf:
        raise InputError(f"the quaternion {q.tolist()} has no direction; it must be four finite numbers, not all zero")
    w, x, y, z = q / length
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def _may_be_feigned(prior: MotionPrior, alone: Solution, focal_px: float) -> bool:
    """Whether errors as small as those of calibration and interpolation take the images' motion to what was known."""
    other = alone.ambiguity.alternative
    nearer = alone if other is None else min(alone, other, key=prior.chi2)
    return excess_px(nearer, prior.strain(nearer), focal_px) <= SYSTEMATIC_PX


@dataclass(frozen=True)
class Contradiction:
    """That the images and what was known beforehand disagree by more than chance.

    doubt : how many times larger the sigmas of matches must be for the two to agree, as calibration and interpolation
        may make them; None where those cannot explain it, and what was known is to be left out.
    """

    doubt: float | None
    diagnostic: Diagnostic


def contradiction(
    prior: MotionPrior, solution: Solution, alone: Callable[[], Solution], focal_px: float | None, options: Options
) -> Contradiction | None:
    """Where the images contradict what was known beforehand by more than chance, and what to make of it.

    solution : with what was known; alone : solves without.  focal_px : of camera 2; None for matches whose noise is the
    user's word, with nothing systematic to allow for.
    """
    fixed = 3 * (prior.rotation is not None) + 2 * (prior.direction is not None)
    chi2, limit = solution.prior_chi2 or 0.0, CONTRADICTED[fixed]
    if chi2 <= limit:
        return None
    what = {2: "direction", 3: "rotation", 5: "motion"}[fixed]
    said = f"chi-square {chi2:.3g}, by chance it is below {limit:g}"
    if focal_px is not None and _may_be_feigned(prior, alone(), focal_px):
        # the errors that matches share with the calibration are the larger ones then, by about this ratio
        doubt = float(np.sqrt(chi2 / fixed))
        message = (
            f"the images differ from the {what} given by more than chance ({said}), though by no more than lens models "
            f"and interpolation may: both were used, with sigmas of matches {doubt:.1f} times larger"
        )
        remedy = "check the camera file, or give it a larger sigma"
        return Contradiction(doubt, Diagnostic("prior-contradicted", "info", message, chi2, remedy))
    scale, option = "", "a larger sigma"
    if options.pose is not None:
        what, option = "pose", "its own sigma by --pose-sigma"
        scale = "; lengths still rest on its distance, which nothing has checked"
    message = f"the images contradict the {what} given, so it was left out: {said}{scale}"
    remedy = f"check its axes and its direction (camera 2 from camera 1), or give it {option}"
    return Contradiction(None, Diagnostic("prior-contradicted", "warning", message, chi2, remedy))
