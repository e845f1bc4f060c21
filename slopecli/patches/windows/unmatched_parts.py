"""Slope uncertainty due to the unmatched part of a window: where it is, and what the images tell of its height."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from slopecli.geometry.epipolar import homogeneous
from slopecli.geometry.motion import inverse_depth
from slopecli.geometry.plane_fit import gap_gain, lever
from slopecli.geometry.statistics import median
from slopecli.look.matches import MIN_ON_PLANE, ON_PLANE_PX, Evidence
from slopecli.look.noise import NOISE_GREY
from slopecli.look.scene import Scene
from slopecli.look.warp import FloatImage, covered, plane_transfer, sample_layer
from slopecli.patches.neighbours import nearest_of
from slopecli.patches.patch import Patch
from slopecli.patches.windows.ground_bend import bend_rad
from slopecli.patches.windows.tunables import TUNE
from slopecli.types import BoolArray, FloatArray, IntArray
from slopecli.windows import Window


def with_unmatched_parts(patch: Patch, measured: Patch, scene: Scene) -> Patch:
    """Add the tilt variance of the window's unmatched cells; a patch with borrowed matches stays as it is.

    measured : the patch with its matches as they were found one by one, where it has since been aligned as a whole:
        alignment of a window has a match everywhere, also where the window is something else.
    """
    if patch.origin != "own":
        return patch
    x1, focal_px = patch.matches.x1, scene.camera1.focal_px
    w, _ = inverse_depth(scene.R, scene.T, x1, patch.matches.x2)
    normal = np.asarray(np.linalg.lstsq(homogeneous(x1), w, rcond=None)[0])
    gaps = gaps_of(patch.window, measured.matches.uv1, measured.share)
    held = np.zeros(len(gaps.seen), bool)
    held[~gaps.seen] = confirmed_cells(gaps.uv1[~gaps.seen], gaps.cell_px, normal, scene)
    gaps = replace(gaps, confirmed=held)
    against = max(
        beside_rad(gaps, normal, scene.evidence, focal_px),
        contradicted_rad(gaps, normal, scene),
        stepped_rad(gaps, normal, scene.evidence, focal_px),
    )
    hidden = unseen_rad(gaps, _height_px(x1, w, focal_px), scene.evidence)
    unseen = max(against, hidden)
    # what is hidden knows nothing of the matches; an object beside them may have made some of these wrong as well
    total = float(np.hypot(patch.tilt_sigma_rad + against, hidden))
    return replace(
        patch,
        tilt_sigma_rad=total,
        unmatched_sigma_rad=unseen,
        off_plane_sigma_rad=against,
        surer_cam1=hidden * surer_along(gaps, normal, homogeneous(x1).mean(axis=0)),
    )


def surer_along(gaps: Gaps, normal: FloatArray, ray: FloatArray) -> FloatArray:
    """(3,) direction on the plane along the border of its unmatched part, where the normal is surer than `unseen_rad`.

    The square of its length is the share of that variance which is not there along this direction. The unmatched part
    may tilt about the border as soon as matches end. Along the border its tilt grows from nothing with the distance
    from the matches, and is half as much in the mean. (On rendered terrain: 0.53 of the sigma against 1.08, over 150
    windows.)

    normal : (3,) scaled, of the plane.  ray : (3,) about the middle of the window, camera-1 axes.
    """
    if gaps.seen.all() or not gaps.seen.any():
        return np.zeros(3)
    directions, gains, _ = np.linalg.svd(gap_gain(gaps.at, gaps.seen))
    border = np.append(directions[:, 1], 0.0)
    border = border * (normal @ ray) - ray * (normal @ border)
    along = max(float(gains[1] / max(gains[0], 1e-12)), 0.5)
    return np.asarray(border / np.linalg.norm(border) * np.sqrt(1.0 - along**2))


@dataclass(frozen=True, eq=False)
class Gaps:
    """A window divided into cells, and which of them hold a match; k cells, g of them without one.

    at, uv1 (k, 2): centres of the cells, px from the window's middle, and px of image 1; seen (k,): holds a match;
    shape: rows and columns of cells; cell_px: side of one; matched (n, 2): px of the matches; per_px: how many of them
    there are to a square px where there are no gaps; confirmed (k,): without a match, but on the plane, as their grey
    values show.
    """

    window: Window
    at: FloatArray
    uv1: FloatArray
    seen: BoolArray
    shape: tuple[int, int]
    cell_px: float
    matched: FloatArray
    per_px: float
    confirmed: BoolArray | None = None

    @property
    def off(self) -> BoolArray:
        """(g,) of the cells without a match, which may be off the plane."""
        return np.ones(np.count_nonzero(~self.seen), bool) if self.confirmed is None else ~self.confirmed[~self.seen]

    @property
    def amid(self) -> BoolArray:
        """(g,) of the cells without a match: whether most of those around one have some."""
        rows, columns = self.shape
        seen = np.pad(self.seen.reshape(rows, columns).astype(float), 1)
        inside = np.pad(np.ones((rows, columns)), 1)
        shifts = [(slice(i, i + rows), slice(j, j + columns)) for i in range(3) for j in range(3)]
        held, around = (sum(one[shift] for shift in shifts) for one in (seen, inside))
        return np.asarray(np.ravel(held >= TUNE.amid * (around - 1.0)))[~self.seen]

    def tilt_rad(self, height_px: FloatArray | float) -> float:
        """Tilt of the least-squares plane of the whole window if its unmatched cells stand off the plane, rad.

        height_px : (g,) of the cells without a match, or one for all, px of image 1 at their distance.
        """
        at = self.at[~self.seen]
        height = np.broadcast_to(height_px, len(at))
        return float(np.arctan(np.linalg.norm(np.linalg.lstsq(self.at.T @ self.at, at.T @ height, rcond=None)[0])))

    def holds(self, uv1: FloatArray) -> BoolArray:
        """(k,) whether points (k, 2) px of image 1 lie in a cell with a match, or one that is confirmed."""
        column, row, inside = _cell(self.window, self.shape, uv1)
        held = self.seen if self.confirmed is None else self.seen | self.confirmed
        return np.asarray(inside & held[row * self.shape[1] + column])

    def filled(self, uv1: FloatArray) -> FloatArray:
        """(k,) density of matches around points (k, 2) px of image 1, relative to that of the matched part.

        Outside the window the density counts as zero.
        """
        reach = 1.5 * self.cell_px
        u, v = (uv1[:, k, None] - self.matched[None, :, k] for k in (0, 1))
        around = (u * u + v * v < reach**2).sum(axis=1)
        return np.asarray(around / (self.per_px * np.pi * reach**2))


def gaps_of(window: Window, uv1: FloatArray, share: float) -> Gaps:
    """The gaps between matches (n, 2) px of image 1 that cover this share of a window."""
    x, y, w, h = window
    # cells so large that none is empty where the window is matched: 3 px or more, and 1.5 times the matches' spacing
    side = max(max(w, h) / TUNE.cells_across, 3.0, 1.5 * float(np.sqrt(w * h / max(len(uv1), 1))))
    columns, rows = max(round(w / side), 1), max(round(h / side), 1)
    column, row, _ = _cell(window, (rows, columns), uv1)
    seen = np.zeros((rows, columns), bool)
    seen[row, column] = True
    v, u = np.mgrid[:rows, :columns]
    at = np.stack([(u + 0.5) / columns * w - 0.5 * w, (v + 0.5) / rows * h - 0.5 * h], axis=-1).reshape(-1, 2)
    middle = np.array([x + 0.5 * w - 0.5, y + 0.5 * h - 0.5])
    per_px = len(uv1) / max(share, 0.01) / (w * h)
    return Gaps(window, at, at + middle, seen.ravel(), (rows, columns), side, uv1, per_px)


def _cell(window: Window, shape: tuple[int, int], uv1: FloatArray) -> tuple[IntArray, IntArray, BoolArray]:
    """Column and row (k,) of the cell of points (k, 2), the nearest for those outside, and which are inside."""
    x, y, w, h = window
    rows, columns = shape
    column = np.floor((uv1[:, 0] + 0.5 - x) * columns / w).astype(int)
    row = np.floor((uv1[:, 1] + 0.5 - y) * rows / h).astype(int)
    inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
    return np.clip(column, 0, columns - 1), np.clip(row, 0, rows - 1), inside


# ---- what stands off the plane: matches of the overview, and texture that differs ----


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
    near = near[_coherent(near, normal, evidence, focal1_px)]
    if len(near) < 3:  # one or two may be mismatches
        return 0.0
    off = np.abs(homogeneous(evidence.x1[near]) @ normal - evidence.w[near])
    height = off / np.linalg.norm(normal) * focal1_px
    height = np.where(off * evidence.leverage[near] * evidence.focal_px > ON_PLANE_PX, height, 0.0)
    # 8: to average out their noise
    distance, nearest = nearest_of(evidence.uv1[near], gaps.uv1[~gaps.seen], min(8, len(near)))
    # amid matches, only others in the same place tell more, and one or two may be mismatches
    amid = gaps.amid[:, None]
    within = distance < np.where(amid, 1.5 * gaps.cell_px, TUNE.beside * max(gaps.window[2:]))
    within &= ~amid | (within.sum(axis=1, keepdims=True) >= 3)
    # ground that bends is off the plane, too, increasingly with distance
    step = np.maximum(height[nearest] - distance, 0.0)
    square = gaps.off * (step**2 * within).sum(1) / np.maximum(within.sum(1), 1)
    return min(gaps.tilt_rad(np.sqrt(square)), TUNE.most_rad)


def stepped_rad(gaps: Gaps, normal: FloatArray, evidence: Evidence, focal1_px: float) -> float:
    """Tilt between the plane of a window's matches and one that also fits overview matches across a step, rad.

    The window's own matches lie on one side of a step; the overview has matches on both. Overview matches off the plane
    are ignored where the window has its own matches, as they are mismatches.

    normal : (3,) scaled, of the plane of the window's matches.
    """
    inside = evidence.near(gaps.window, 0.0)
    if inside.sum() < MIN_ON_PLANE:
        return 0.0
    off = inside & (evidence.misfit_px(normal) > ON_PLANE_PX)
    kept = inside & ~off
    off[off] = gaps.filled(evidence.uv1[off]) < 0.5  # half as dense as elsewhere: unmatched
    off[off] = _coherent(np.flatnonzero(off), normal, evidence, focal1_px)
    kept |= off
    if np.count_nonzero(off) < max(MIN_ON_PLANE, 0.05 * np.count_nonzero(kept)):  # 5 %: mismatches of the overview
        return 0.0
    points = homogeneous(evidence.x1[kept]) / evidence.w[kept, None]
    points -= points.mean(axis=0)
    whole = np.linalg.svd(points, full_matrices=False)[2][2]
    return min(float(np.arccos(min(abs(whole @ normal) / float(np.linalg.norm(normal)), 1.0))), TUNE.most_rad)


def _coherent(index: IntArray, normal: FloatArray, evidence: Evidence, focal1_px: float) -> BoolArray:
    """(k,) overview matches of these indices that lie on some surface, as half of the others next to them do.

    Mismatches lie at any depth, neighbours at quite another.  normal, focal1_px : as in `beside_rad`.
    """
    if len(index) <= 2:  # of one or two matches nothing is told
        return np.ones(len(index), bool)
    height = (homogeneous(evidence.x1[index]) @ normal / evidence.w[index] - 1.0) * focal1_px
    distance, nearest = nearest_of(evidence.uv1[index], evidence.uv1[index], min(5, len(index)))
    rise = np.abs(height[nearest] - height[:, None])[:, 1:]  # the first is the match itself
    return np.asarray(np.mean(rise <= TUNE.steepest * distance[:, 1:], axis=1) >= 0.5)


def contradicted_rad(gaps: Gaps, normal: FloatArray, scene: Scene) -> float:
    """1-sigma of the tilt due to textured unmatched cells that contradict the plane: an object, or something moving.

    normal : (3,) scaled, of the plane of the window's matches.
    """
    off = contradicting_cells(gaps.uv1[~gaps.seen], gaps.cell_px, normal, scene)
    height_px = np.where(off, TUNE.off_plane * max(gaps.window[2:]), 0.0)
    return min(gaps.tilt_rad(height_px), TUNE.most_rad)


def contradicting_cells(uv1: FloatArray, side_px: float, normal: FloatArray, scene: Scene) -> BoolArray:
    """(k,) cells of image 1 that are textured and in view of image 2, but do not correlate with it under a plane.

    Such a part stands off the plane, moves, or is hidden. A missing match alone does not show that: flow also fails
    on ground that is on the plane.

    uv1 : (k, 2) px of image 1, centres of the cells.  side_px : of a cell.  normal : (3,) scaled.
    """
    drifts = (-2, -1, 0, 1, 2)  # spacings: ground that bends is a little off the plane
    best = np.nan_to_num(_correlations(uv1, side_px, normal, scene, drifts), nan=1.0).max(axis=0)
    return np.asarray(best < TUNE.same_ground_score)


def confirmed_cells(uv1: FloatArray, side_px: float, normal: FloatArray, scene: Scene) -> BoolArray:
    """(k,) cells of image 1 that are on a plane: they correlate with image 2 under it, and less so a few spacings along
    the epipolar line.

    uv1, side_px, normal : as in `contradicting_cells`.
    """
    drifts = (-1, 0, 1, -5, -4, 4, 5)  # spacings: on the plane, and far enough off it
    score = _correlations(uv1, side_px, normal, scene, drifts)
    near, far = score[:3].max(axis=0), score[3:].max(axis=0)
    with np.errstate(invalid="ignore"):  # of cells that cannot be compared
        return np.asarray((near > TUNE.good_score) & (near - far > TUNE.good_score - TUNE.same_ground_score))


def _correlations(
    uv1: FloatArray, side_px: float, normal: FloatArray, scene: Scene, drifts: tuple[int, ...]
) -> FloatArray:
    """(len(drifts), k) correlation of cells of image 1 with image 2 under a plane, displaced along the epipolar line.

    NaN for cells without texture or out of view.

    uv1, side_px, normal : as in `contradicting_cells`.  drifts : displacements, in spacings of the points compared.
    """
    found = np.full((len(drifts), len(uv1)), np.nan)
    asked = np.flatnonzero(covered(imaged(uv1, normal, scene), scene.shape2))
    if not len(asked):
        return found
    spacing = side_px / TUNE.samples
    steps = (np.arange(TUNE.samples) - 0.5 * (TUNE.samples - 1)) * spacing
    points = uv1[asked, None] + np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    ours = sample_layer(scene.pyramid1.at(spacing), points.astype(np.float32))
    near = imaged(points, normal, scene)
    kept = covered(near, scene.shape2).all(1) & (ours.std(axis=1) > 2 * NOISE_GREY)
    if kept.any():
        drifted = imaged(points[kept], 0.99 * normal, scene)  # 1 % farther: any small step along the epipolar line
        found[:, asked[kept]] = _compared(ours[kept], near[kept], drifted - near[kept], scene, drifts)
    return found


def _compared(
    ours: FloatImage, near: FloatArray, along: FloatArray, scene: Scene, drifts: tuple[int, ...]
) -> FloatArray:
    """(len(drifts), k) correlation of cells of grey values (k, n) with image 2, at px near (k, n, 2) and displaced
    `along`; NaN for a cell that is out of view at any of them."""
    apart = median(np.linalg.norm(np.diff(near, axis=1)[:, : TUNE.samples - 1], axis=2))
    along = along * (apart / np.maximum(np.linalg.norm(along, axis=2, keepdims=True), 1e-9))
    layer = scene.pyramid2.at(apart)
    seen, found = np.ones(len(near), bool), np.empty((len(drifts), len(near)))
    for row, drift in zip(found, drifts, strict=True):
        mapping = (near + drift * along).astype(np.float32)
        seen &= covered(mapping, scene.shape2).all(1)
        a, b = (grey - grey.mean(axis=1, keepdims=True) for grey in (ours, sample_layer(layer, mapping)))
        row[:] = (a * b).sum(axis=1) / np.maximum(np.sqrt((a * a).sum(axis=1) * (b * b).sum(axis=1)), 1e-9)
    found[:, ~seen] = np.nan
    return found


def imaged(uv1: FloatArray, normal: FloatArray, scene: Scene) -> FloatArray:
    """Pixels (..., 2) of image 2 of points (..., 2) of image 1 on a plane; far outside it where there are none."""
    rays = homogeneous(scene.rays1(uv1.reshape(-1, 2)))
    return plane_transfer(rays @ scene.R.T, rays @ normal, scene.R @ scene.T, scene.pixels2).reshape(uv1.shape)


# ---- ground as it is elsewhere: its relief, and how much it bends ----


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

    height_px : RMS height of the ground off the plane, in pixels of image 1 at its distance.
    """
    if gaps.seen.all():
        return 0.0
    bend = lever(gaps.at, gaps.seen) * bend_rad(evidence, 0.5 * max(gaps.window[2:]))
    return float(np.hypot(bend, gaps.tilt_rad(np.where(gaps.off, height_px, 0.0))))
