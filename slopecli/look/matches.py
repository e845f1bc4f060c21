"""Matches in pixels and in normalised coordinates; evidence: those of the overview consistent with the motion, with
inverse depths; the dominant planes among them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from slopecli.geometry.camera import rays_from_pixels
from slopecli.geometry.epipolar import homogeneous
from slopecli.geometry.motion import epipolar_residual, inverse_depth
from slopecli.geometry.plane_fit import robust_plane
from slopecli.geometry.statistics import median
from slopecli.look.noise import LEAST_MATCH_PX
from slopecli.types import BoolArray, Camera, FloatArray, IntArray
from slopecli.windows import Window

TOLERANCE_PX = 1.5  # largest epipolar residual of a consistent match
ON_PLANE_PX = 1.0  # of image 2 or a working grid: off its plane, or its epipolar line, a match is a mismatch
LEAST_MATCHES = 8  # through fewer a motion, which five determine, or a plane is chance
MIN_ON_PLANE = 6  # matches that determine a plane: three, and as many to check it; of many planes, one has twice that
TRIES = 400  # triples of neighbours drawn per plane, and points that these are compared by
BEST = 20  # of these triples, compared by all points


@dataclass(frozen=True, eq=False)
class Matches:
    """Points seen in both images: uv1, uv2 (n, 2) px as stored (distorted); x1, x2 (n, 2) normalised, undistorted."""

    uv1: FloatArray
    uv2: FloatArray
    x1: FloatArray
    x2: FloatArray

    @classmethod
    def none(cls) -> Matches:
        """No match at all."""
        nothing = np.empty((0, 2))
        return Matches(nothing, nothing, nothing, nothing)

    @classmethod
    def between(cls, camera1: Camera, camera2: Camera, uv1: FloatArray, uv2: FloatArray) -> Matches:
        """Matched pixels (n, 2) with their rays; those without a ray in either camera are dropped."""
        x1, x2, seen = pair_rays(camera1, camera2, uv1, uv2)
        return Matches(uv1[seen], uv2[seen], x1[seen], x2[seen])

    def __len__(self) -> int:
        return len(self.uv1)

    def take(self, which: IntArray | BoolArray) -> Matches:
        """The matches of these indices, or those of a mask (n,)."""
        return Matches(self.uv1[which], self.uv2[which], self.x1[which], self.x2[which])

    def joined(self, *others: Matches) -> Matches:
        """These matches, then the others."""
        every = (self, *others)
        uv1, uv2, x1, x2 = (np.concatenate([getattr(m, name) for m in every]) for name in ("uv1", "uv2", "x1", "x2"))
        return Matches(uv1, uv2, x1, x2)


def pair_rays(
    camera1: Camera, camera2: Camera, uv1: FloatArray, uv2: FloatArray
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Matched pixels (n, 2) as normalised coordinates x1, x2 (n, 2), and (n,) which have them in both images.

    Pixels beyond the reach of a lens model have no ray (NaN).
    """
    x1, x2 = rays_from_pixels(camera1, uv1), rays_from_pixels(camera2, uv2)
    return x1, x2, np.asarray(np.isfinite(x1).all(1) & np.isfinite(x2).all(1))


def thin(uv: FloatArray, index: IntArray, limit: int) -> IntArray:
    """At most `limit` of the points uv[index], spread evenly over the image: bins take turns giving one point each."""
    if len(index) <= limit:
        return index
    points = uv[index]
    low, extent = points.min(0), np.maximum(np.ptp(points, axis=0), 1.0)
    side = np.sqrt(extent.prod() / limit)
    bins = np.floor((points - low) / side).astype(np.int64)
    code = bins[:, 0] * (bins[:, 1].max() + 1) + bins[:, 1]
    order = np.argsort(code, kind="stable")
    starts = np.flatnonzero(np.r_[True, np.diff(code[order]) > 0])
    rank = np.arange(len(order)) - np.repeat(starts, np.diff(np.r_[starts, len(order)]))
    by_rank = np.argsort(rank, kind="stable")
    whole = by_rank[: np.searchsorted(rank[by_rank], rank[by_rank[limit]])]  # rounds that fit in full
    last = by_rank[rank[by_rank] == rank[by_rank[limit]]]
    evenly = last[np.linspace(0, len(last) - 1, limit - len(whole)).round().astype(int)]
    chosen = order[np.concatenate([whole, evenly])]
    return np.sort(index[chosen])


@dataclass(frozen=True, eq=False)
class Evidence(Matches):
    """Matches of the overview that are consistent with the motion.

    w (n,): inverse depth, 1/baseline; leverage (n,): displacement in image 2, normalised, per unit of inverse depth;
    grey (n,) of image 1; n_given: number of matches, inconsistent ones included.
    """

    w: FloatArray
    leverage: FloatArray
    grey: FloatArray
    focal_px: float
    n_given: int

    def some(self, which: IntArray | BoolArray) -> Evidence:
        """The evidence of these indices, or of a mask (n,)."""
        names = ("uv1", "uv2", "x1", "x2", "w", "leverage", "grey")
        return replace(self, **{name: getattr(self, name)[which] for name in names})

    def near(self, window: Window, grow: float) -> BoolArray:
        """(n,) whether a match is in the window enlarged on every side by `grow` times its longer side."""
        x, y, width, height = window
        d = grow * max(width, height)
        u, v = self.uv1.T
        return np.asarray((u >= x - d) & (u < x + width + d) & (v >= y - d) & (v < y + height + d))

    def plane_through(self, which: BoolArray) -> FloatArray | None:
        """Scaled normal (3,) of the robust plane through the chosen (n,) matches; None if they are too few."""
        if which.sum() < MIN_ON_PLANE:
            return None
        floor = LEAST_MATCH_PX / self.focal_px
        return robust_plane(self.x1[which], self.w[which], self.leverage[which], floor).normal

    def misfit_px(self, normal: FloatArray) -> FloatArray:
        """(n,) distance in image 2 between each match and the plane's prediction, px."""
        return np.abs(self.w - homogeneous(self.x1) @ normal) * self.leverage * self.focal_px

    def sweep_depths(self, per_px: float, least: int, most: int) -> FloatArray:
        """Inverse depths (n,), `least` to `most`, over the range of the scene and 30 % beyond.

        per_px : how many are wanted for a px by which they move a match in image 2.
        """
        low, high = np.percentile(self.w, [1, 99])
        spread = high - low
        low, high = max(low - 0.3 * spread, 1e-4 * high), high + 0.3 * spread
        pixels = (high - low) * median(self.leverage) * self.focal_px
        return np.linspace(low, high, int(np.clip(pixels * per_px, least, most)))


def gather_evidence(matches: Matches, grey: FloatArray, R: FloatArray, T: FloatArray, focal_px: float) -> Evidence:
    """Evidence of the matches that are consistent with the motion and in front of the camera; grey (n,) at them."""
    w, leverage = inverse_depth(R, T, matches.x1, matches.x2)
    keep = np.abs(epipolar_residual(R, T, matches.x1, matches.x2)) * focal_px < TOLERANCE_PX
    keep &= (w > 0) & (leverage > 0)
    kept = matches.take(keep)
    return Evidence(
        kept.uv1, kept.uv2, kept.x1, kept.x2, w[keep], leverage[keep], grey[keep], focal_px, n_given=len(keep)
    )


def scene_planes(evidence: Evidence, seed: int = 0, most: int = 8) -> list[FloatArray]:
    """Scaled normals (3,) of the dominant planes, at most so many, largest first.

    Sequential RANSAC over triples of neighbours.
    """
    rng = np.random.default_rng(seed)
    left = np.arange(len(evidence))
    rays = homogeneous(evidence.x1)
    planes: list[FloatArray] = []
    while len(left) >= 40 and len(planes) < most:
        found = _largest_plane(evidence, rays, left, rng)
        if found is None or found[1].sum() < max(30, 0.02 * len(evidence)):
            break
        planes.append(found[0])
        left = left[~found[1]]
    return planes


def _largest_plane(
    evidence: Evidence, rays: FloatArray, left: IntArray, rng: np.random.Generator
) -> tuple[FloatArray, BoolArray] | None:
    """Scaled normal (3,) of the plane that most of the matches `left` are on, and (len(left),) which; None if none."""
    triple = _neighbours(evidence.uv1, left, rng)
    matrix = rays[triple]
    area = np.abs(np.linalg.det(matrix))
    wide = area > median(area) * 0.5
    if not wide.any() or not (area[wide] > 0).all():
        return None
    normals = np.linalg.solve(matrix[wide], evidence.w[triple[wide]][..., None])[..., 0]
    rays, w, px = rays[left], evidence.w[left], evidence.leverage[left] * evidence.focal_px
    some = rng.permutation(len(left))[:TRIES]
    on_some = (np.abs(w[some] - normals @ rays[some].T) * px[some] < ON_PLANE_PX).sum(1)
    likely = normals[np.argsort(-on_some, kind="stable")[:BEST]]  # some of the points do not tell the best of these
    best = likely[(np.abs(w - likely @ rays.T) * px < ON_PLANE_PX).sum(1).argmax()]
    inlier = np.zeros(len(left), bool)
    for _ in range(3):
        inlier = np.abs(w - rays @ best) * px < ON_PLANE_PX
        if inlier.sum() < MIN_ON_PLANE:
            return None
        best = np.linalg.lstsq(rays[inlier] * px[inlier, None], w[inlier] * px[inlier], rcond=None)[0]
    return best, inlier


def _neighbours(uv1: FloatArray, left: IntArray, rng: np.random.Generator) -> IntArray:
    """(TRIES, 3) indices of matches: each third is about a twelfth of the image wide, which tends to be one surface.

    The partners of a match are the two, of 24 drawn at random, whose distance is nearest to that.
    """
    seeds = left[rng.integers(0, len(left), TRIES)]
    span = np.ptp(uv1, axis=0).max() / 12
    partners = left[rng.integers(0, len(left), (TRIES, 24))]
    distance = np.linalg.norm(uv1[partners] - uv1[seeds][:, None], axis=2)
    two = np.argsort(np.abs(distance - span), axis=1)[:, :2]
    return np.column_stack([seeds, np.take_along_axis(partners, two, 1)])
