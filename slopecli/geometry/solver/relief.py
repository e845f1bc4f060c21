"""Relief of terrain patches, whose points lie near their plane, not on it: noise, relief and weights of points.

A point off its plane is displaced along its epipolar line only. So the residual across the line is image noise, and
the residual along it is noise plus relief. Each patch has its own relative relief r: the RMS height off the plane over
the distance of the plane. With r = 0 this is the exact-plane model.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slopecli.geometry.solver.mismatches import gate_squared, noise_at_least, residual_scale
from slopecli.geometry.solver.observations import Observations, Prediction
from slopecli.geometry.statistics import median, robust_sigma
from slopecli.types import BoolArray, FloatArray


class Relief(NamedTuple):
    """noise: 1-sigma in image 2; relative (m,): r of each patch; W (3, n): packed 2x2 weights relative to noise^2;
    log_determinant: sum of log covariance determinants over noise^2 I; keep (n,), keep_free (k,): points in the fit."""

    noise: float
    relative: FloatArray
    W: FloatArray
    log_determinant: float
    keep: BoolArray
    keep_free: BoolArray


def estimate_relief(
    observations: Observations,
    prediction: Prediction,
    index: int,
    noise: float | None,
    robust: bool,
    settled: bool = False,
) -> Relief:
    """Noise and relief from the residuals of motion number `index`, and the weights that follow from them.

    noise : known 1-sigma of a normalised coordinate of image 2, or None to estimate it from the residuals across the
        epipolar lines; also estimated if these are significantly larger.
    settled : do not estimate the noise again, as for a second root that is compared under the noise of the first.
    robust : leave out mismatches, and minorities far off their plane.
    """
    residual, slide = prediction.residual[index], prediction.slide[index]
    gain = np.hypot(slide[0], slide[1])
    direction = slide / np.maximum(gain, np.finfo(float).tiny)
    weight = observations.weight
    across = np.sqrt(weight) * (direction[0] * residual[1] - direction[1] * residual[0])
    along = direction[0] * residual[0] + direction[1] * residual[1]
    free = np.sqrt(observations.free_weight) * prediction.distance[index]
    keep, keep_free = weight > 0.0, observations.free_weight > 0.0
    if robust:
        keep, keep_free = _match_gate(across, free, keep, keep_free)
    total = float((across[keep] ** 2).sum() + (free[keep_free] ** 2).sum())
    freedom = max(int(keep.sum()) + int(keep_free.sum()) - 5, 1)
    if noise is None:
        noise = float(np.sqrt(total / freedom))
    elif not settled:
        noise = noise_at_least(noise, total, freedom)
    noise = max(noise, 1e-12)
    # one unit of relative height moves the point by this much in image 2
    lever = gain * prediction.inverse_depth[index]
    if robust:
        keep &= ~_standing_off(observations, along, lever, noise, keep)
    relative = _relative_relief(observations, along, lever, noise, keep)
    return _weights(observations, slide, prediction.inverse_depth[index], noise, relative, keep, keep_free)


def _small_sample(observations: Observations, keep: BoolArray) -> FloatArray:
    """(m,) factor on relief for the variance of Student's t: a patch's relief is estimated from n - 3 residuals."""
    freedom = observations.sum_patches(keep.astype(float)) - 3.0
    return np.sqrt(np.where(freedom > 2.0, freedom / np.maximum(freedom - 2.0, 1.0), 1.0))


def _match_gate(
    across: FloatArray, free: FloatArray, keep: BoolArray, keep_free: BoolArray
) -> tuple[BoolArray, BoolArray]:
    both = np.concatenate([across, free])
    kept = np.concatenate([keep, keep_free])
    scale = residual_scale(both**2, kept, 1, 5.0 / max(int(kept.sum()), 6))
    inside = kept & (both**2 <= gate_squared(len(both)) * scale**2)
    return inside[: len(across)], inside[len(across) :]


def _standing_off(
    observations: Observations, along: FloatArray, lever: FloatArray, noise: float, keep: BoolArray
) -> BoolArray:
    """(n,) outliers of each patch, more than 4 sigmas off its plane and less than a quarter of it, such as rocks."""
    lever = np.maximum(lever, 1e-150)  # finite heights also at the epipole and behind the camera
    height, noise_height = along / lever, noise / lever
    off = np.zeros(len(keep), dtype=bool)
    for first, count in zip(observations.first, observations.count, strict=True):
        patch = slice(first, first + count)
        kept = keep[patch]
        if kept.sum() < 6:
            continue
        h = height[patch]
        centre = median(h[kept])
        scale = robust_sigma(h[kept] - centre)
        far = kept & (np.abs(h - centre) > 4.0 * np.hypot(scale, noise_height[patch]))
        if far.sum() < 0.25 * kept.sum():  # a larger share is the shape of the terrain
            off[patch] = far
    return off


def _relative_relief(
    observations: Observations, along: FloatArray, lever: FloatArray, noise: float, keep: BoolArray
) -> FloatArray:
    """(m,) relief by Fisher scoring on the residuals along epipolar lines; 0 for patches of three points."""
    kept = keep.astype(float)
    count = observations.sum_patches(kept)
    freedom = np.where(count > 3.0, count / np.maximum(count - 3.0, 1.0), 0.0)
    variance = noise**2 / np.where(observations.weight > 0.0, observations.weight, 1.0)
    excess = observations.per_point(freedom) * along**2 - variance
    relative_squared = np.zeros(observations.n_patches)
    for _ in range(5):  # each step reduces the error several times
        expected = variance + lever**2 * observations.per_point(relative_squared)
        share = kept * lever**2 / expected**2
        information = observations.sum_patches(share * lever**2)
        relative_squared = observations.sum_patches(share * excess) / np.maximum(information, np.finfo(float).tiny)
        relative_squared = np.maximum(relative_squared, 0.0)
    return np.sqrt(relative_squared)


def _weights(
    observations: Observations,
    slide: FloatArray,
    inverse_depth: FloatArray,
    noise: float,
    relative: FloatArray,
    keep: BoolArray,
    keep_free: BoolArray,
) -> Relief:
    """Inverse of noise^2 / weight I + (w r)^2 d d^T by Sherman and Morrison, d the slide, w the inverse depth."""
    weight = observations.weight * keep
    spread = (inverse_depth * observations.per_point(relative * _small_sample(observations, keep)) / noise) ** 2
    squared = (slide * slide).sum(axis=0)
    factor = weight**2 * spread / (1.0 + weight * spread * squared)
    W = np.stack([weight - factor * slide[0] ** 2, -factor * slide[0] * slide[1], weight - factor * slide[1] ** 2])
    log_determinant = float(np.log1p(weight * spread * squared).sum())
    return Relief(noise, relative, W, log_determinant, keep, keep_free)
