"""The motion given by the user, as a prior of the solver, and whether the images contradict it."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from slopecli.errors import InputError
from slopecli.findings.wording import finding
from slopecli.geometry.epipolar import skew
from slopecli.geometry.solver.priors import MotionPrior
from slopecli.look.noise import SYSTEMATIC_PX
from slopecli.options import Options
from slopecli.patches.join import excess_px
from slopecli.types import Diagnostic, FloatArray, Solution


def motion_prior(options: Options) -> MotionPrior | None:
    """The prior of `--rotation-prior`, `--direction-prior` or `--pose`; None without any.

    Raises
    ------
    InputError : a quaternion or direction of length zero, or a sigma that is not positive or excludes nothing.
    """
    if options.pose is not None:  # exact without a sigma: to 1e-6 rad, far less than images measure
        R, sigma_deg = np.array(options.pose.rotation).reshape(3, 3), options.pose_sigma_deg
        sigma = 1e-6 if sigma_deg is None else _sigma("pose", sigma_deg)
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
    """In rad; InputError where it is too large to exclude anything."""
    if not sigma_deg < 90.0:  # it excludes no direction
        raise InputError(
            f"the {name} given has a sigma of {sigma_deg:g} deg, which excludes nothing; give one below "
            f"90 deg, or leave it out"
        )
    return math.radians(sigma_deg)


def rotation_of_quaternion(q: FloatArray) -> FloatArray:
    """(3, 3) rotation of a quaternion w, x, y, z of any length but zero."""
    length = math.hypot(*q)
    if not 0.0 < length < math.inf:
        raise InputError(f"the quaternion {q.tolist()} has no direction; it must be four finite numbers, not all zero")
    w, S = q[0] / length, skew(q[1:] / length)
    return np.asarray(np.eye(3) + 2.0 * w * S + 2.0 * S @ S)


class Contradiction(NamedTuple):
    """That the images and the motion given disagree by more than chance.

    noise_factor : by which the sigmas of matches must grow for the two to agree, as errors of calibration and
        interpolation may require; None where those cannot explain it, and the motion given is to be left out.
    """

    noise_factor: float | None
    diagnostic: Diagnostic


def contradiction(
    prior: MotionPrior, solution: Solution, alone: Callable[[], Solution], focal_px: float | None, options: Options
) -> Contradiction | None:
    """Whether the images contradict the motion given by more than chance; None where they do not.

    solution : with the prior; alone : solves without.  focal_px : of camera 2; None for correspondences of the user's
    own, whose noise is given and which have no systematic errors to allow for.
    """
    fixed = 3 * (prior.rotation is not None) + 2 * (prior.direction is not None)
    # limit: quantile 0.999
    what, limit = {2: ("direction", 13.8), 3: ("rotation", 16.3), 5: ("motion", 20.5)}[fixed]
    chi2 = solution.prior_chi2 or 0.0
    if chi2 <= limit:
        return None
    by = f"chi-square {chi2:.3g}, by chance it is below {limit:g}"
    if focal_px is not None:
        unaided = alone()
        nearer = min(unaided, unaided.ambiguity.alternative or unaided, key=prior.chi2)
        if excess_px(nearer, prior.strain(nearer), focal_px) <= SYSTEMATIC_PX:
            # the errors that matches share with the calibration are the larger ones then, by about this ratio
            factor = float(np.sqrt(chi2 / fixed))
            message = (
                f"the images differ from the {what} given by more than chance ({by}), though by no more than errors of "
                f"calibration and interpolation: both were used, with sigmas of matches {factor:.1f} times larger"
            )
            return Contradiction(factor, finding("prior-contradicted", message, chi2, severity="info"))
    message = f"the images contradict the {what if options.pose is None else 'pose'} given, so it was left out: {by}"
    remedy = None
    if options.pose is not None:
        message += "; lengths still rest on its distance, which nothing has checked"
        remedy = "check its axes and its direction (camera 2 from camera 1), or give it its own sigma by --pose-sigma"
    return Contradiction(None, finding("prior-contradicted", message, chi2, remedy, severity="warning"))
