"""Slope uncertainty due to the unmatched part of a window."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from slopecli.geometry.epipolar import homogeneous
from slopecli.geometry.motion import inverse_depth
from slopecli.geometry.plane_fit import plane_products, planes_of_sums
from slopecli.geometry.unmatched_tilt import BEND_RAD, lever
from slopecli.look.evidence import MIN_ON_PLANE, ON_PLANE_PX, Evidence
from slopecli.look.scene import Scene
from slopecli.patches.patch import Patch
from slopecli.patches.windows.contradiction import contradict
from slopecli.patches.windows.coverage import Gaps, gaps_of
from slopecli.patches.windows.tunables import TUNE
from slopecli.types import FloatArray


def with_unmatched_parts(patch: Patch, measured: Patch, scene: Scene) -> Patch:
    """Add the tilt variance of the window's unmatched cells; a patch with borrowed matches stays as it is.

    measured : the patch with its matches as they were found one by one, where it has since been aligned as a whole:
        alignment of a window has a match everywhere, also where the window is something else.
    """
    if patch.origin != "own":
        return patch
    plane = _Plane.through(patch, scene)
    gaps = gaps_of(patch.window, measured.matches.uv1, measured.share)
    against = max(
        beside_rad(gaps, plane.normal, scene.evidence, scene.camera1.focal_px),
        contradicted_rad(gaps, plane.normal, scene),
        stepped_rad(gaps, plane.normal, scene.evidence),
    )
    height_px = _height_px(patch.matches.x1, plane.inverse, scene.camera1.focal_px)
    unseen = max(against, unseen_rad(gaps, height_px, scene.evidence))
    total = patch.tilt_sigma_rad + unseen
    return replace(patch, tilt_sigma_rad=total, unmatched_sigma_rad=unseen, off_plane_sigma_rad=against)


class _Plane(NamedTuple):
    """Plane through a window's matches: scaled normal (3,), and the matches' inverse depths (n,), 1/baseline."""

    normal: FloatArray
    inverse: FloatArray

    @classmethod
    def through(cls, patch: Patch, scene: Scene) -> _Plane:
        w, _ = inverse_depth(scene.R, scene.T, patch.matches.x1, patch.matches.x2)
        return cls(np.asarray(np.linalg.lstsq(homogeneous(patch.matches.x1), w, rcond=None)[0]), w)


def beside_rad(gaps: Gaps, normal: FloatArray, evidence: Evidence, focal1_px: float) -> float:
    """1-sigma of the tilt if unmatched cells are as far off the plane as the overview matches next to them.

    Ground hidden by a step, or not followed by flow across it, has no match in the window; the overview often has some
    of it, or of the same surface beyond the window.

    normal : (3,) scaled, of the plane of the window's matches.  focal1_px : of camera 1.
    """
    if gaps.seen.all():
        return 0.0
    near = np.flatnonzero(evidence.near(gaps.window, TUNE.beside))
    near = near[~gaps.holds(evidence.uv1[near])]
    if len(near) < 3:
        return 0.0
    off = np.abs(homogeneous(evidence.x1[near]) @ normal - evidence.w[near])
    height = off / np.linalg.norm(normal) * focal1_px
    height = np.where(off * evidence.leverage[near] * evidence.focal_px > ON_PLANE_PX, height, 0.0)
    distance = np.sqrt(((gaps.unseen[:, None] - evidence.uv1[near][None]) ** 2).sum(2))
    nearest = np.argsort(distance, axis=1, kind="stable")[:, :8]
    distance = np.take_along_axis(distance, nearest, 1)
    within = distance < TUNE.beside * max(gaps.window[2:])
    # ground that bends is off the plane, too, increasingly with distance
    step = np.maximum(height[nearest] - distance, 0.0)
    square = (step**2 * within).sum(1) / np.maximum(within.sum(1), 1)
    return min(gaps.tilt_rad(np.sqrt(square)), TUNE.most_rad)


def contradicted_rad(gaps: Gaps, normal: FloatArray, scene: Scene) -> float:
    """1-sigma of the tilt due to textured unmatched cells that contradict the plane: an object, or something moving.

    normal : (3,) scaled, of the plane of the window's matches.
    """
    if gaps.seen.all():
        return 0.0
    off = contradict(gaps.unseen, gaps.cell_px, normal, scene)
    return min(gaps.tilt_rad(TUNE.off_plane * max(gaps.window[2:]), off), TUNE.most_rad)


def stepped_rad(gaps: Gaps, normal: FloatArray, evidence: Evidence) -> float:
    """Tilt between the plane of a window's matches and one that also fits overview matches across a step, rad.

    The window's own matches lie on one side of a step; the overview has matches on both. Overview matches off the plane
    are ignored where the window has its own matches, as they are mismatches.

    normal : (3,) scaled, of the plane of the window's matches.
    """
    inside = evidence.near(gaps.window, 0.0)
    if inside.sum() < MIN_ON_PLANE:
        return 0.0
    rays, w = homogeneous(evidence.x1[inside]), evidence.w[inside]
    off = np.abs(rays @ normal - w) * evidence.leverage[inside] * evidence.focal_px > ON_PLANE_PX
    kept = ~off
    kept[off] = gaps.filled(evidence.uv1[inside][off]) < 0.5
    rays, w, off = rays[kept], w[kept], off[kept]
    if np.count_nonzero(off) < max(MIN_ON_PLANE, 0.05 * len(w)):
        return 0.0
    points = rays / w[:, None]
    points -= points.mean(axis=0)
    whole = np.linalg.svd(points, full_matrices=False)[2][2]
    return min(float(np.arccos(min(abs(whole @ normal) / float(np.linalg.norm(normal)), 1.0))), TUNE.most_rad)


def _height_px(x1: FloatArray, w: FloatArray, focal_px: float) -> float:
    """RMS height of the matches off their best-fit plane, in pixels of image 1 at their distance."""
    points = homogeneous(x1) / w[:, None]
    normal = np.linalg.lstsq(points, np.ones(len(points)), rcond=None)[0]
    off = (points @ normal - 1) / np.linalg.norm(normal) * w
    return float(np.sqrt(np.mean(off**2))) * focal_px


def unseen_rad(gaps: Gaps, height_px: float, evidence: Evidence) -> float:
    """1-sigma of the tilt of a window's best-fit plane due to its unmatched cells.

    In unmatched cells the ground is assumed to stand off the plane as much as among the matches, and to bend as much
    as between neighbouring blocks of the image. The effect of both on the least-squares plane of the whole window
    depends on where the unmatched cells are.

    Parameters
    ----------
    height_px : RMS height of the ground off the plane, in pixels of image 1 at its distance.
    """
    if gaps.seen.all():
        return 0.0
    bend = lever(gaps.at, gaps.seen) * bend_rad(evidence, 0.5 * max(gaps.window[2:]))
    return float(np.hypot(bend, gaps.tilt_rad(height_px)))


@lru_cache(maxsize=4)  # windows of a grid are all of one size
def bend_rad(evidence: Evidence, side_px: float) -> float:
    """RMS change of tilt per axis, rad, between neighbouring blocks of ground, `side_px` wide in image 1."""
    extent = np.ptp(evidence.uv1, axis=0) if len(evidence) else np.zeros(2)
    spacing = float(np.sqrt(extent.prod() / max(len(evidence), 1)))
    normals = _block_normals(evidence, max(side_px, 4 * spacing))
    angles = np.concatenate([_change(normals[1:], normals[:-1]), _change(normals[:, 1:], normals[:, :-1])])
    squares = TUNE.bend_count * BEND_RAD**2 + 0.5 * float((angles**2).sum())
    return float(np.sqrt(squares / (TUNE.bend_count + len(angles))))


def _block_normals(evidence: Evidence, side_px: float) -> FloatArray:
    """(rows, columns, 3) unit normals of square blocks of image 1; NaN where there are too few matches."""
    if len(evidence) < MIN_ON_PLANE:
        return np.full((1, 1, 3), np.nan)
    column, row = ((evidence.uv1 - evidence.uv1.min(0)) / side_px).astype(int).T
    columns, rows = column.max() + 1, row.max() + 1
    block = row * columns + column
    leverage = evidence.leverage
    products = plane_products(homogeneous(evidence.x1) * leverage[:, None], evidence.w * leverage)
    sums = np.array([np.bincount(block, column, rows * columns) for column in products.T]).T
    enough = np.bincount(block, minlength=rows * columns) >= MIN_ON_PLANE
    normals = np.full((rows * columns, 3), np.nan)
    normals[enough] = planes_of_sums(sums[enough])
    return np.asarray(normals / np.linalg.norm(normals, axis=1, keepdims=True)).reshape(rows, columns, 3)


def _change(one: FloatArray, other: FloatArray) -> FloatArray:
    """(k,) angles between unit normals of neighbouring blocks, where both are known."""
    half = 0.5 * np.linalg.norm(one - other, axis=-1).ravel()
    return 2.0 * np.arcsin(np.clip(half[np.isfinite(half)], 0.0, 1.0))
