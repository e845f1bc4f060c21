"""The unit of lengths in a report, and planes with their lengths in it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from slopecli.errors import InputError
from slopecli.geometry.epipolar import homogeneous
from slopecli.geometry.statistics import median
from slopecli.measure import Measured
from slopecli.options import Options
from slopecli.patches.join import Joined
from slopecli.types import Plane, Scale

LEVEL_LOOK = 0.05  # mean drop to the ground over its distance below which an altitude gives no scale


def scale_of(root: Measured, joined: Joined, options: Options) -> tuple[Scale, float]:
    """The unit of lengths, and the length of the baseline in it.

    Raises
    ------
    InputError : an altitude is given for a camera that looks along the horizon, or up.
    """
    if options.pose is not None:
        return Scale("m", "pose"), float(np.linalg.norm(options.pose.baseline_m))
    if options.baseline_m is not None:
        return Scale("m", "baseline"), options.baseline_m
    if options.altitude_m is None:
        return Scale(), 1.0
    return Scale("m", "altitude"), options.altitude_m / _mean_drop(root, joined, options.altitude_m)


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
    distance = plane.distance * length
    roughness = plane.roughness * distance if scale.unit == "m" else plane.roughness
    return replace(plane, distance=distance, roughness=roughness)
