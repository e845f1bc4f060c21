"""Motion and fit of a report, and residuals in the unit they are reported in."""

from __future__ import annotations

import numpy as np

from slopecli.geometry.metrics import rotation_angle
from slopecli.geometry.statistics import median
from slopecli.patches.given.rows import RAYS
from slopecli.patches.join import Joined
from slopecli.types import Camera, Fit, Motion, Solution


def motion_of(solution: Solution, length: float) -> Motion:
    """The motion with its sigmas.  length : of the baseline, in the unit of the report."""
    rotation_sigma = np.sqrt(np.linalg.eigvalsh(solution.motion_covariance[:3, :3])[-1])
    direction_sigma = np.sqrt(np.linalg.eigvalsh(solution.direction_covariance)[-1])
    return Motion(
        solution.R,
        solution.T * length,
        float(np.degrees(rotation_angle(solution.R))),
        float(np.degrees(rotation_sigma)),
        float(np.degrees(direction_sigma)),
    )


def fit_of(solution: Solution, joined: Joined, camera2: Camera) -> Fit:
    """Residuals and counts of the solution; the noise is that of the median match, not of one of weight one."""
    noise = solution.noise / float(np.sqrt(median(joined.weight)))
    return Fit(
        solver=solution.solver,
        refine="points",
        rms_px=residual_px(solution.rms, camera2),
        noise_px=residual_px(noise, camera2),
        iterations=solution.iterations,
        converged=solution.converged,
        n_correspondences=len(solution.inlier),
        n_inliers=int(solution.inlier.sum()),
        rms_mrad=residual_mrad(solution.rms, camera2),
        noise_mrad=residual_mrad(noise, camera2),
    )


def residual_px(residual: float, camera2: Camera) -> float:
    """A residual in px, NaN where there is no camera."""
    return float("nan") if camera2 is RAYS else residual * camera2.focal_px


def residual_mrad(residual: float, camera2: Camera) -> float | None:
    """A residual in milliradians where there is no camera to give it in px, else None."""
    return 1e3 * residual if camera2 is RAYS else None
