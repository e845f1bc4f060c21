"""Gross mismatches among correspondences: robust scale of residuals, gates, consensus of a patch, significance."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from slopecli.geometry.homography import four_point_homographies
from slopecli.geometry.solver.observations import FINEST_RESIDUAL, Observations, Prediction, parameter_count
from slopecli.geometry.statistics import CHI2, median
from slopecli.types import BoolArray, FloatArray

FALSE_ALARM = 0.01  # probability that any point of a clean data set is called a mismatch
LEAST_FREEDOM = 2  # degrees of freedom that must remain when points are left out; with fewer, any rest fits


class Kept(NamedTuple):
    """Which patch points (n,) and which free points (k,) a fit uses."""

    planes: BoolArray
    free: BoolArray

    def same_as(self, other: Kept) -> bool:
        """Whether both choose the same points."""
        return np.array_equal(self.planes, other.planes) and np.array_equal(self.free, other.free)

    def applied_to(self, observations: Observations) -> Observations:
        """The observations with the weight of every other point set to 0."""
        return observations.reweighted(observations.weight * self.planes, observations.free_weight * self.free)


def gate_squared(n: int) -> float:
    """Squared residual, in sigma, that any of n clean two-dimensional residuals exceeds in 1 of 100 data sets."""
    return 2.0 * float(np.log(max(n, 1) / FALSE_ALARM))


def chi2_quantile(dof: float, at: float) -> float:
    """Chi-square at the probability of a standard normal quantile `at` (Wilson and Hilferty 1931)."""
    third = 2.0 / (9.0 * dof)
    return float(dof * (1.0 - third + at * np.sqrt(third)) ** 3)


def noise_at_least(given: float, squares: float, freedom: int) -> float:
    """The given noise, or that of the residuals if it is significantly larger (probability of 0.001 by chance).

    squares : weighted sum of squared residuals.  freedom : their degrees of freedom.
    """
    larger = squares > given**2 * chi2_quantile(max(freedom, 1), 3.09)
    return float(np.sqrt(squares / max(freedom, 1))) if larger else given


def is_beyond_chance(before: float, after: float, freedom: int, removed: int, n: int) -> bool:
    """Whether leaving some points out improves the fit more than leaving out the worst of as many clean points would.

    before, after : weighted sums of squares of all points and of those left.  freedom : of `after`.
    removed : residuals left out.  n : number of points to choose from.

    For clean points after / before follows a beta distribution; its tail times the number of choices bounds the
    probability of a false alarm. False if fewer than LEAST_FREEDOM degrees of freedom are left.
    Source: Hawkins, "Identification of Outliers", 1980, for one; Bonferroni's inequality for the choices.
    """
    if freedom < LEAST_FREEDOM:
        return False
    if not removed or before <= 0.0:
        return True
    a, q = 0.5 * freedom, 0.5 * removed
    chosen = math.ceil(q)
    choices = math.lgamma(n + 1) - math.lgamma(chosen + 1) - math.lgamma(max(n - chosen, 0) + 1)
    tail = math.lgamma(a + q) - math.lgamma(a + 1) - math.lgamma(q) + a * math.log(max(after / before, 1e-300))
    return choices + tail < math.log(FALSE_ALARM)


def residual_scale(squared: FloatArray, kept: BoolArray, dimensions: int, lost: float) -> float:
    """Robust 1-sigma of residuals from the median of their squares.

    squared, kept : (n,) squared residuals (weighted), and those in the fit.  dimensions : 1 or 2 numbers a residual.
    lost : part of the degrees of freedom used by the fit, 0..1.
    """
    if not kept.any():
        return FINEST_RESIDUAL
    values = squared[kept]
    middle = len(values) // 2
    expected = CHI2[2, 0.5] if dimensions == 2 else CHI2[1, 0.5]
    variance = float(np.partition(values, middle)[middle]) / expected / max(1.0 - lost, 0.1)
    return max(variance**0.5, FINEST_RESIDUAL)


def inliers(
    observations: Observations,
    prediction: Prediction,
    index: int,
    kept: Kept,
    each_patch: bool = False,
    one_scale: bool = False,
) -> tuple[Kept, float]:
    """Points within the gate of motion number `index` by their robust scale, and the cost of all points.

    The cost is the truncated sum of squared residuals, in units of the squared scale.

    observations : every point under its full weight.  kept : the points the motion was fitted to.
    each_patch : use a patch's own scale, doubled, where that is larger: its points need not be coplanar.
    one_scale : limit the scale of free points to 1.25 that of patch points, once the motion is fitted to both.
    """
    squared = observations.weight * (prediction.residual[index] ** 2).sum(axis=0)
    free_squared = observations.free_weight * prediction.distance[index] ** 2
    used = 2 * int(np.count_nonzero(kept.planes)) + int(np.count_nonzero(kept.free))
    lost = min(parameter_count(observations.n_patches) / max(used, 1), 1.0)
    gate = gate_squared(len(squared) + len(free_squared))
    scale = np.full(len(squared), residual_scale(squared, kept.planes, 2, lost))
    # a motion from few points predicts epipolar lines poorly; free points then have a scale of their own
    trusted = kept.free if kept.free.any() else observations.free_weight > 0.0
    free_scale = residual_scale(free_squared, trusted, 1, 0.0)
    if each_patch:
        scale = np.maximum(scale, 2.0 * _patch_scales(observations, squared))
    else:
        free_scale = max(scale[0], min(free_scale, 1.25 * scale[0]) if one_scale else free_scale)
    relative, free_relative = squared / scale**2, free_squared / free_scale**2
    planes = (relative <= gate) & (observations.weight > 0.0)
    planes = _enough_each(observations, planes, squared)
    cost = np.minimum(relative, gate).sum() + np.minimum(free_squared / scale[0] ** 2, gate).sum()
    return Kept(planes, (free_relative <= gate) & (observations.free_weight > 0.0)), float(cost) * scale.min() ** 2


def _patch_scales(observations: Observations, squared: FloatArray) -> FloatArray:
    """(n,) robust scale of the patch each point is on."""
    medians = [median(squared[patch]) for patch in observations.slices()]
    return observations.per_point(np.sqrt(np.array(medians) / CHI2[2, 0.5]))


def _enough_each(observations: Observations, keep: BoolArray, squared: FloatArray) -> BoolArray:
    """Keep at least the best quarter of every patch, and three points."""
    left = observations.sum_patches(keep.astype(np.int64))
    least = np.minimum(observations.count, np.maximum(3, observations.count // 4))
    for i in np.flatnonzero(left < least):
        patch = slice(observations.first[i], observations.first[i] + observations.count[i])
        best = np.argsort(squared[patch])[: least[i]]
        keep[patch] = False
        keep[observations.first[i] + best] = True
    return keep


def consensus(observations: Observations) -> BoolArray:
    """(n,) points of each patch that agree with its least-median-of-squares homography.

    Source: Rousseeuw, "Least Median of Squares Regression", JASA 1984. Patches of fewer than six points are kept
    whole. The seed is fixed: the same input gives the same result.
    """
    keep = np.ones(len(observations.weight), dtype=bool)
    for patch, count in zip(observations.slices(), observations.count, strict=True):
        if count >= 6:
            keep[patch] = _patch_consensus(observations.p[:, patch], observations.x2[:, patch])
    return keep


def _patch_consensus(p: FloatArray, x2: FloatArray) -> BoolArray:
    """p : (3, n), x2 : (2, n) of one patch, n >= 6."""
    n = p.shape[1]
    # samples are numbered by invariants of a turn of the images, not by the order of rows
    by_radius = np.lexsort(((x2 * x2).sum(axis=0), (p * p).sum(axis=0)))
    # with 40 % outliers, one of 64 samples is clean with probability 0.9999
    samples = by_radius[np.random.default_rng(0).random((64, n)).argpartition(4, axis=1)[:, :4]]
    H = four_point_homographies(p[:2].T[samples], x2.T[samples])
    y = H @ p
    with np.errstate(all="ignore"):
        squared = ((y[:, :2] / y[:, 2:] - x2) ** 2).sum(axis=1)
    squared = np.where(np.isfinite(squared), squared, np.inf)
    rank = min((n + 5) // 2, n - 1)
    medians = np.partition(squared, rank, axis=1)[:, rank]
    best = int(np.argmin(medians))
    scale = max(float(np.sqrt(medians[best] / CHI2[2, 0.5])) * (1.0 + 5.0 / (n - 4)), FINEST_RESIDUAL)
    return squared[best] <= gate_squared(n) * scale**2
