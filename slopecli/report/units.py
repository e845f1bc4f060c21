"""Units of a report: lengths in baselines or metres, residuals in px or mrad; its motion, fit and planes in them."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from slopecli.errors import InputError
from slopecli.findings.camera_test import CameraTest
from slopecli.findings.known_motion import known_length_m
from slopecli.geometry.epipolar import homogeneous, rotation_angle
from slopecli.geometry.statistics import median
from slopecli.measure import Measured
from slopecli.options import Options
from slopecli.patches.given import RAYS
from slopecli.patches.join import Joined
from slopecli.types import Camera, Fit, Motion, Plane, Scale, Solution

LEVEL_LOOK = 0.05  # mean drop to the ground over its distance below which an altitude gives no scale


def scale_of(root: Measured, joined: Joined, options: Options) -> tuple[Scale, float]:
    """The unit of lengths, and the length of the baseline in it.

    Raises
    ------
    InputError : an altitude is given for a camera that looks along the horizon, or up.
    """
    known, sigma = known_length_m(options), options.scale_sigma_percent / 100.0
    from_metadata = options.stated is not None and options.stated.scale
    if known is not None:
        return Scale("m", "pose" if options.pose else "exif" if from_metadata else "baseline", sigma), known
    if options.altitude_m is None:
        return Scale(), 1.0
    source: Literal["exif", "altitude"] = "exif" if from_metadata else "altitude"
    return Scale("m", source, sigma), options.altitude_m / _mean_drop(root, joined, options.altitude_m)


def _mean_drop(root: Measured, joined: Joined, altitude_m: float) -> float:
    """Median height of camera 1 above the points of the planes, baselines."""
    drops, distances = [], []
    up = root.up.vector_cam1
    for patch, normal in zip(joined.patches, root.solution.scaled_normals, strict=True):
        rays = homogeneous(patch.matches.x1)
        points = rays / (rays @ normal)[:, None]
        drops.append(median(-points @ np.array(up)))
        distances.append(median(np.linalg.norm(points, axis=1)))
    drop = median(drops)
    if drop < LEVEL_LOOK * median(distances):
        raise InputError(
            f"--altitude {altitude_m:g} needs ground below the camera, but against up {up} what is seen lies level "
            "with it or above; give --up for this camera, or --baseline instead"
        )
    return drop


def in_unit(plane: Plane, scale: Scale, length: float) -> Plane:
    """The plane with its lengths in the report's unit; roughness becomes a height only when that is metres."""
    if length == 1.0 and scale.unit != "m":
        return plane
    distance = plane.distance * length
    roughness = plane.roughness * distance if scale.unit == "m" else plane.roughness
    return replace(plane, distance=distance, roughness=roughness)


def motion_of(solution: Solution, length: float) -> Motion:
    """The motion with its sigmas.  length : of the baseline, in the unit of the report."""
    rotation, direction = solution.motion_covariance[:3, :3], solution.direction_covariance
    sigmas_deg = [float(np.degrees(np.sqrt(np.linalg.eigvalsh(part)[-1]))) for part in (rotation, direction)]
    return Motion(solution.R, solution.T * length, float(np.degrees(rotation_angle(solution.R))), *sigmas_deg)


def fit_of(solution: Solution, joined: Joined, camera2: Camera, test: CameraTest) -> Fit:
    """Residuals and counts of the solution; the noise is that of the median match, not of one of weight one."""
    rms_px, rms_mrad = residual_in_unit(solution.rms, camera2)
    noise_px, noise_mrad = residual_in_unit(solution.noise / float(np.sqrt(median(joined.weight))), camera2)
    return Fit(
        solver=solution.solver,
        refine="points",
        rms_px=rms_px,
        noise_px=noise_px,
        iterations=solution.iterations,
        converged=solution.converged,
        n_correspondences=len(solution.inlier),
        n_inliers=int(solution.inlier.sum()),
        rms_mrad=rms_mrad,
        noise_mrad=noise_mrad,
        focal_factor=test.focal_factor,
        focal_factor_sigma=test.focal_factor_sigma,
    )


def residual_in_unit(residual: float, camera2: Camera) -> tuple[float, float | None]:
    """A residual in px, and None; without a camera to give it in px, NaN and milliradians."""
    return (float("nan"), 1e3 * residual) if camera2 is RAYS else (residual * camera2.focal_px, None)
