"""Why the sigma of a map is what it is: the parts of its median by cause."""

from __future__ import annotations

import numpy as np

from slopecli.geometry.slope import tilt_axes
from slopecli.ground.footprint_planes import FootprintPlanes
from slopecli.ground.safety import Tilts
from slopecli.ground.tilt_uncertainty import TILT, GradientVariance, Root, focal_shift, motion_gain, normal_spread
from slopecli.types import BoolArray, FloatArray


def cell_causes(
    planes: FootprintPlanes,
    gradient: GradientVariance,
    root: Root,
    tilts: Tilts,
    told: BoolArray,
    up: FloatArray,
    up_sigma_rad: float,
) -> dict[str, float] | None:
    """Parts of the median 1-sigma of the slopes of a map, deg; names as in `report.sigma_causes`.

    Each is that sigma times the root of the cause's mean share in the variance of the slope of a cell.

    told : (rows, columns) cells with a slope.
    """
    if not told.any():
        return None
    step = max(1, int(np.sqrt(told.size / TILT.cause_cells)))
    if not told[::step, ::step].any():
        step = 1
    some, spread = planes.thinned(step), normal_spread(planes.thinned(step))
    by_motion, shift = motion_gain(some, root), focal_shift(some, root)
    alike = spread @ spread.swapaxes(-1, -2)
    noise, edges, gaps = (part[::step, ::step, None, None] * alike for part in gradient)
    covariances = {
        "matches": noise,
        "relief": edges,
        "gaps": gaps,
        "motion": by_motion @ root.covariance @ by_motion.swapaxes(-1, -2),
        "up": np.zeros_like(noise),
        "camera": shift[..., :, None] * shift[..., None, :],
    }
    here = told[::step, ::step]
    normals = some.scaled_normal[here]
    length = np.linalg.norm(normals, axis=1)
    axes = [axis / length[:, None] for axis in tilt_axes(-normals / length[:, None], up)]
    along, across = (
        {name: np.einsum("ni,nij,nj->n", axis, covariance[here], axis) for name, covariance in covariances.items()}
        for axis in axes
    )
    along["up"], across["up"] = np.full((2, len(length)), up_sigma_rad**2)
    # errors across a slope count by the share that brings the parts to its sigma
    total, other = sum(along.values()), sum(across.values())
    sigma = tilts.sigma_rad[::step, ::step][here]
    counted = np.clip((sigma**2 - total) / np.maximum(other, np.finfo(float).tiny), 0.0, 1.0)
    whole = np.maximum(total + counted * other, np.finfo(float).tiny)
    shares = {name: float(((along[name] + counted * across[name]) / whole).mean()) for name in covariances}
    median_deg = float(np.degrees(np.median(tilts.sigma_rad[told])))
    return {name: median_deg * float(np.sqrt(max(share, 0.0))) for name, share in shares.items()}
