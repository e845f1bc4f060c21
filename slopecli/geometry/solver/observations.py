"""Correspondences sorted by patch, predictions of image 2, and their chi-square as a quadratic form.

One pass over the points condenses each patch into a 9x9 quadratic form on its homography; after that the cost of an
iteration does not depend on the number of points.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from slopecli.errors import DegenerateConfiguration, InputError
from slopecli.geometry.epipolar import skew
from slopecli.types import BoolArray, FloatArray, IntArray

FINEST_RESIDUAL = 1e-9  # normalised coordinates, a millionth of a pixel; below it residuals are rounding
# rows of a symmetric 3x3 matrix stored as its 6 upper entries 00 01 02 11 12 22
_PACKED = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])
# where entry ((j, a), (k, b)) of a patch's 9x9 form sits among the 6 x 6 packed sums
_UNPACK = (6 * _PACKED[:, None, :, None] + _PACKED[None, :, None, :]).ravel()


@dataclass(frozen=True, eq=False)
class Observations:
    """Points sorted by patch, coordinates along the first axis so that sums run over contiguous memory.

    Attributes
    ----------
    p : (3, n) homogeneous points of image 1 that lie on patches.  x2 : (2, n) the same points in image 2.
    products : (6, n) x x, x y, x, y y, y, 1 of p.  weight : (n,) inverse relative variances.
    first, count : (m,) where each patch starts and how many points it has.
    free1 : (3, k), free2 : (2, k), free_weight : (k,) points on no patch; they constrain the motion only.
    order : (k + n,) index of the free points, then of the patch points, in the caller's arrays.
    """

    p: FloatArray
    x2: FloatArray
    products: FloatArray
    weight: FloatArray
    first: IntArray
    count: IntArray
    free1: FloatArray
    free2: FloatArray
    free_weight: FloatArray
    order: IntArray

    @property
    def n_patches(self) -> int:
        return len(self.count)

    @property
    def n_free(self) -> int:
        return int(self.free1.shape[1])

    def residual_count(self) -> int:
        """Two residuals for a point on a patch, one (the distance to its epipolar line) for a point on none."""
        return 2 * int(np.count_nonzero(self.weight)) + int(np.count_nonzero(self.free_weight))

    def freedom(self) -> int:
        """Degrees of freedom: residuals less parameters; not positive when there are too few points."""
        return self.residual_count() - parameter_count(self.n_patches)

    def per_point(self, per_patch: FloatArray) -> FloatArray:
        """Repeat values (..., m) of patches for each of their points: (..., n)."""
        return np.repeat(per_patch, self.count, axis=-1)

    def sum_patches(self, per_point: FloatArray) -> FloatArray:
        """Sum values (..., n) over the points of each patch: (..., m)."""
        return np.add.reduceat(per_point, self.first, axis=-1)

    def slices(self) -> list[slice]:
        """Where the points of each patch are."""
        return [slice(first, first + count) for first, count in zip(self.first, self.count, strict=True)]

    def largest_first(self) -> IntArray:
        """(m,) patches by number of points, those of equal number by their distance from the optical axis."""
        return np.lexsort((-self.sum_patches(self.products[0] + self.products[3]), -self.count))

    def all_points(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Points of image 1 (3, k + n) and image 2 (2, k + n) and weights (k + n,), those on no patch first."""
        p, x2 = np.concatenate([self.free1, self.p], axis=1), np.concatenate([self.free2, self.x2], axis=1)
        return p, x2, np.concatenate([self.free_weight, self.weight])

    def reweighted(self, plane_weight: FloatArray, free_weight: FloatArray) -> Observations:
        """The same points under other weights; a weight of 0 leaves a point out."""
        return Observations(
            self.p, self.x2, self.products, plane_weight, self.first, self.count,
            self.free1, self.free2, free_weight, self.order,
        )  # fmt: skip

    def in_given_order(self, free: BoolArray, planes: BoolArray) -> BoolArray:
        """Bring values of free (k,) and patch points (n,) back into the caller's order (k + n,)."""
        values = np.concatenate([free, planes])
        restored = np.empty_like(values)
        restored[self.order] = values
        return restored


def parameter_count(n_patches: int) -> int:
    """Parameters of the joint solution, 5 + 3m: rotation and direction of the motion, a normal for each patch."""
    return 5 + 3 * n_patches


def checked_points(x1: FloatArray, x2: FloatArray, patch: IntArray) -> tuple[FloatArray, FloatArray, IntArray]:
    """The three arrays as float64 and int64. InputError when a shape, type or value is unusable."""
    try:
        x1, x2, labels = np.asarray(x1, dtype=float), np.asarray(x2, dtype=float), np.asarray(patch)
    except (TypeError, ValueError) as error:
        raise InputError("x1 or x2 is no array of numbers, needed (n, 2) normalised coordinates each") from error
    for name, x in (("x1", x1), ("x2", x2)):
        if x.ndim != 2 or x.shape[1] != 2:
            raise InputError(f"{name} has shape {x.shape}, needed (n, 2) normalised coordinates; one row per point")
        if not np.isfinite(x).all():
            bad = int(np.count_nonzero(~np.isfinite(x).all(axis=1)))
            raise InputError(f"{name} has {bad} rows that are not finite; leave those correspondences out")
    if len(x1) != len(x2) or labels.shape != (len(x1),):
        raise InputError(
            f"x1 has {len(x1)} rows, x2 {len(x2)} and patch has shape {labels.shape}; "
            "needed one of each for every correspondence"
        )
    if labels.dtype.kind not in "iu" and (labels.dtype.kind != "f" or not np.array_equal(labels, np.floor(labels))):
        raise InputError(f"patch holds {labels.dtype} values, needed whole numbers 0..m-1, or -1 for no patch")
    return x1, x2, labels.astype(np.int64)


def checked_weights(weights: FloatArray | None, n: int) -> FloatArray:
    """Weights (n,), ones when None; InputError when they are not n finite, non-negative numbers."""
    if weights is None:
        return np.ones(n)
    weights = np.asarray(weights, dtype=float)
    if weights.shape != (n,) or not np.isfinite(weights).all() or (weights < 0.0).any():
        raise InputError(f"weights must be {n} finite numbers >= 0, one a correspondence, found shape {weights.shape}")
    return weights


def observe(x1: FloatArray, x2: FloatArray, patch: IntArray, weights: FloatArray | None = None) -> Observations:
    """Validate and sort correspondences x1, x2 (n, 2) with labels 0..m-1 or -1 (n,) and weights (n,) or None.

    Raises
    ------
    InputError : shapes, types or values are unusable, or no point is on any patch.
    DegenerateConfiguration : a patch has fewer than three points or its points are collinear.
    """
    x1, x2, patch = checked_points(x1, x2, patch)
    weights = checked_weights(weights, len(x1))
    if not len(patch) or patch.max() < 0:
        raise InputError("no correspondence is on a patch (all labels are -1); a slope needs at least one patch")
    if patch.min() < -1:
        raise InputError(f"patch label {patch.min()} found; labels are 0..m-1, or -1 for a point on no patch")
    order = np.argsort(patch, kind="stable")
    count = np.bincount(patch + 1)
    k, count = int(count[0]), count[1:]
    short = np.flatnonzero(count < 3)
    if len(short):
        raise DegenerateConfiguration(
            f"patch {short[0]} has {count[short[0]]} correspondences, a plane needs at least 3; "
            "enlarge the patch, or give its points the label -1 and renumber the patches"
        )
    rows = np.ones((3, len(x1)))
    rows[:2] = x1.T[:, order]
    second, weights = x2.T[:, order], weights[order]
    products = np.empty((6, len(x1) - k))
    products[:3], products[3:5], products[5] = rows[0, k:] * rows[:, k:], rows[1, k:] * rows[1:, k:], 1.0
    first = np.cumsum(count) - count
    _check_spread(np.add.reduceat(products, first, axis=1))
    return Observations(
        rows[:, k:], second[:, k:], products, weights[k:], first, count,
        rows[:, :k], second[:, :k], weights[:k], order,
    )  # fmt: skip


def spans_plane(sums: FloatArray) -> BoolArray:
    """(m,) whether points are spread enough to fix a plane, by the two principal extents of each set in image 1.

    sums : (6, m) of the products xx, xy, x, yy, y, 1.
    """
    xx, xy, x, yy, y, n = sums
    a, b, c = xx / n - (x / n) ** 2, xy / n - (x / n) * (y / n), yy / n - (y / n) ** 2
    # width over length below 1e-4 fixes no plane in practice
    return np.asarray(a * c - b * b > 1e-8 * (a + c) ** 2)


def _check_spread(sums: FloatArray) -> None:
    """sums : as of `spans_plane`."""
    flat = np.flatnonzero(~spans_plane(sums))
    if len(flat):
        raise DegenerateConfiguration(
            f"the {int(sums[5, flat[0]])} correspondences of patch {flat[0]} are collinear or coincide in image 1, "
            "so they fix no plane; spread them over the patch"
        )


class QuadraticForm(NamedTuple):
    """The weighted sum of squared image-2 residuals as a quadratic in the homographies and the essential matrix.

    chi2 = constant + sum_i (2 g_i.h_i + h_i^T A_i h_i) + 2 gE.e + e^T AE e, h = vec(H), e = vec(E) row by row.
    A (s, m, 9, 9), g (s, m, 9), AE (s, 9, 9), gE (s, 9), constant (s,); s is the number of motions or 1.
    AE and gE are None when every point is on a patch.
    motion (s, 7, 7): terms of a prior on the motion, see `priors.MotionPrior.terms`; None without a prior.
    centred: the form is used at the state it was computed at. There chi2 = constant and the terms in h and e cancel;
    leaving them out avoids their rounding.
    """

    A: FloatArray
    g: FloatArray
    AE: FloatArray | None
    gE: FloatArray | None
    constant: FloatArray
    centred: bool = False
    motion: FloatArray | None = None


def patch_moments(observations: Observations, x2: FloatArray, W: FloatArray) -> FloatArray:
    """(s, m, 9, 9) forms sum_p (B^T W B) (x) p p^T with B = [I2 | -x2], the residual of x2 ~ H p being B H p / z.

    x2 : (s, 2, n); W : (s, 3, n) entries 11, 12, 22 of each point's 2x2 weight, already divided by z^2.
    """
    u, v = x2[:, 0], x2[:, 1]
    W11, W12, W22 = W[:, 0], W[:, 1], W[:, 2]
    s, m, n = len(W), observations.n_patches, W.shape[2]
    rows = np.empty((s, 6, n))
    rows[:, 0], rows[:, 1], rows[:, 3] = W11, W12, W22
    left, right = W11 * u + W12 * v, W12 * u + W22 * v
    rows[:, 2], rows[:, 4], rows[:, 5] = -left, -right, left * u + right * v
    sums = observations.sum_patches(rows[:, :, None] * observations.products)
    return sums.reshape(s, 36, m).swapaxes(1, 2)[:, :, _UNPACK].reshape(s, m, 9, 9)


def isotropic(weight: FloatArray) -> FloatArray:
    """(s, 3, n) packed 2x2 weights w I from w (s, n)."""
    W = np.zeros((len(weight), 3, weight.shape[1]))
    W[:, 0] = W[:, 2] = weight
    return W


class Prediction(NamedTuple):
    """Predicted points of image 2 under s motions and their planes. For points on patches:

    x2 (s, 2, n) predicted positions, residual (s, 2, n) predicted minus found, inverse_depth (s, n) N.p,
    depth_ratio (s, n) depth in view 2 over depth in view 1, slide (s, 2, n) d x2 / d inverse_depth.
    For free points: foot (s, 2, k) the nearest point on the epipolar line, distance (s, k) signed, length (s, k).
    """

    x2: FloatArray
    residual: FloatArray
    inverse_depth: FloatArray
    depth_ratio: FloatArray
    K: FloatArray
    foot: FloatArray
    distance: FloatArray
    length: FloatArray

    @property
    def slide(self) -> FloatArray:
        """(s, 2, n) d x2 / d inverse_depth: along the epipolar line, away from or towards the epipole."""
        return (self.x2 * self.K[:, 2, None, None] - self.K[:, :2, None]) / self.depth_ratio[:, None]

    def pick(self, index: list[int]) -> Prediction:
        """The predictions of the motions at these places."""
        return Prediction._make(a[index] for a in self)

    def visible(self) -> BoolArray:
        """(s, n) whether the plane is in front of both cameras at the point."""
        return (self.inverse_depth > 0.0) & (self.depth_ratio > 0.0)


def away_from_zero(value: FloatArray, least: float) -> FloatArray:
    """The value, or +-least where it is smaller than that."""
    return np.where(np.abs(value) < least, np.copysign(least, value), value)


def predict(observations: Observations, R: FloatArray, T: FloatArray, N: FloatArray) -> Prediction:
    """Predict image 2 under motions R (s, 3, 3), T (s, 3) and scaled normals N (s, m, 3)."""
    K = (R @ T[:, :, None])[:, :, 0]
    inverse_depth = np.add.reduce(observations.per_point(N.swapaxes(1, 2)) * observations.p, axis=1)
    # a step along a direction that nothing fixes may go on, but not overflow
    np.clip(inverse_depth, -1e75, 1e75, out=inverse_depth)
    y = R @ observations.p - K[:, :, None] * inverse_depth[:, None]
    z = away_from_zero(y[:, 2], 1e-9)
    x2 = y[:, :2] / z[:, None]
    foot, distance, length = _predict_free(observations, R, T)
    return Prediction(x2, x2 - observations.x2, inverse_depth, z, K, foot, distance, length)


def _predict_free(
    observations: Observations, R: FloatArray, T: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    if not observations.n_free:
        empty = np.zeros((len(R), 0))
        return np.zeros((len(R), 2, 0)), empty, empty
    lines = (R @ skew(T)) @ observations.free1
    length = np.maximum(np.hypot(lines[:, 0], lines[:, 1]), 1e-9)
    distance = ((lines[:, :2] * observations.free2).sum(axis=1) + lines[:, 2]) / length
    foot = observations.free2 - distance[:, None] * lines[:, :2] / length[:, None]
    return foot, distance, length


def linearise(observations: Observations, prediction: Prediction, W: FloatArray | None = None) -> QuadraticForm:
    """The chi-square around a prediction, exact to first order in each residual (Gauss-Newton).

    W : (s, 3, n) packed 2x2 weights of the patch points; None for the isotropic weights of the observations.
    """
    if W is None:
        W = isotropic(observations.weight[None])
    z, e, x2 = prediction.depth_ratio, prediction.residual, prediction.x2
    A = patch_moments(observations, x2, W / (z * z)[:, None])
    f = np.empty((len(z), 3, z.shape[1]))  # B^T W e
    f[:, 0] = W[:, 0] * e[:, 0] + W[:, 1] * e[:, 1]
    f[:, 1] = W[:, 1] * e[:, 0] + W[:, 2] * e[:, 1]
    constant = np.add.reduce(f[:, :2] * e, axis=(1, 2))
    f[:, 2] = -(x2[:, 0] * f[:, 0] + x2[:, 1] * f[:, 1])
    f /= z[:, None]
    sums = observations.sum_patches(f[:, :, None] * observations.p)
    g = sums.reshape(len(z), 9, -1).swapaxes(1, 2)
    if not observations.n_free:
        return QuadraticForm(A, g, None, None, constant, centred=True)
    AE, gE, free_constant = _linearise_free(observations, prediction)
    return QuadraticForm(A, g, AE, gE, constant + free_constant, centred=True)


def _linearise_free(observations: Observations, prediction: Prediction) -> tuple[FloatArray, FloatArray, FloatArray]:
    s = len(prediction.x2)
    foot = np.concatenate([prediction.foot, np.ones((s, 1, observations.n_free))], axis=1)
    rows = (foot[:, :, None] * observations.free1).reshape(s, 9, -1) / prediction.length[:, None]
    weighted = rows * observations.free_weight
    distance = prediction.distance
    AE = weighted @ rows.swapaxes(1, 2)
    gE = (weighted @ distance[:, :, None])[:, :, 0]
    return AE, gE, (observations.free_weight * distance**2).sum(axis=-1)
