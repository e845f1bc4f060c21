"""What a user knows of the motion, as the solver wants it, and whether the images agree with it."""

from __future__ import annotations

import math

import numpy as np

from slopecli.errors import InputError
from slopecli.geometry.priors import MotionPrior
from slopecli.options import Options
from slopecli.planes.joint import SYSTEMATIC_PX, excess_px
from slopecli.types import Diagnostic, FloatArray, Solution

# chi-square at 0.999 by the number of directions a prior fixes
CONTRADICTED = {2: 13.8, 3: 16.3, 5: 20.5}
USELESS_DEG = 90.0  # a 1-sigma that leaves every direction open
EXACT_RAD = 1e-6  # 1-sigma of a pose, which comes without one: far less than images can tell


def motion_prior(options: Options) -> MotionPrior | None:
    """The prior of `--rotation-prior`, `--direction-prior` or `--pose`; None without any.

    Raises
    ------
    InputError : a quaternion or direction of length zero, or a sigma that is not positive or says nothing.
    """
    if options.pose is not None:
        R = np.array(options.pose.rotation).reshape(3, 3)
        return MotionPrior.checked(R, EXACT_RAD, np.array(options.pose.baseline_m), EXACT_RAD)
    if options.rotation_prior is None and options.direction_prior is None:
        return None
    rotation, direction = options.rotation_prior, options.direction_prior
    for name, given in (("rotation", rotation), ("direction", direction)):
        if given is not None and not given[-1] < USELESS_DEG:
            raise InputError(
                f"the {name} known beforehand has a sigma of {given[-1]:g} deg, which says nothing; give one below "
                f"{USELESS_DEG:g} deg, or leave it out"
            )
    return MotionPrior.checked(
        None if rotation is None else rotation_of_quaternion(np.array(rotation[:4])),
        np.inf if rotation is None else float(np.radians(rotation[4])),
        None if direction is None else np.array(direction[:3]),
        np.inf if direction is None else float(np.radians(direction[3])),
    )


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


def contradiction(prior: MotionPrior, solution: Solution, focal_px: float | None) -> Diagnostic | None:
    """A warning where the images contradict what was known beforehand, by more than chance and systematic errors.

    focal_px : of camera 2; None for matches whose noise is the user's word, with nothing systematic to allow for.
    """
    fixed = 3 * (prior.rotation is not None) + 2 * (prior.direction is not None)
    chi2 = solution.prior_chi2 or 0.0
    feigned = focal_px is not None and excess_px(solution, chi2, focal_px) <= SYSTEMATIC_PX
    if chi2 <= CONTRADICTED[fixed] or feigned:
        return None
    what = {2: "direction", 3: "rotation", 5: "motion"}[fixed]
    return Diagnostic(
        "prior-contradicted",
        "warning",
        f"the images contradict the {what} given, so it was left out: chi-square {chi2:.3g}, by chance it is below "
        f"{CONTRADICTED[fixed]:g}",
        chi2,
        "check its axes and its direction (camera 2 from camera 1), or give it a larger sigma",
    )
