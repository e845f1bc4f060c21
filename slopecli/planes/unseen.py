"""What is not seen of a window may tilt otherwise than what is: by how much that leaves the tilt of the whole open."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from slopecli.geometry.epipolar import homogeneous
from slopecli.geometry.motion import inverse_depth
from slopecli.planes.evidence import Evidence
from slopecli.planes.scene import Scene
from slopecli.planes.window_match import WindowMatch
from slopecli.planes.windows import Window
from slopecli.types import BoolArray, FloatArray

ACROSS = 16  # cells a window is divided into along its longer side, to count what is seen
LEAST_CELL_PX = 3.0  # and not smaller than this
STEP_PX, STEP_SHARE, LEAST_STEP = 1.0, 0.05, 6  # off the plane; of the window; matches of the overview
STEP_FILLED = 0.5  # of the matches that might be around, from which on the window is matched there
MOST_STEP_RAD = np.radians(30.0)  # in more doubt than this is nobody who has seen the larger part
MIN_IN_BLOCK = 6  # matches that give a block of ground its plane
BLOCK_CELLS = 4.0  # a block is at least so many spacings of matches wide
# what is believed of the ground before it is seen, and worth how many pairs of blocks
BEND_RAD, BEND_COUNT = np.radians(10.0), 3.0


def with_doubt_of_gaps(match: WindowMatch, window: Window, scene: Scene) -> WindowMatch:
    """The match, its doubt grown by what its window's parts without matches leave open; a borrowed one as it is."""
    if match.origin != "own":
        return match
    w, _ = inverse_depth(scene.R, scene.T, match.x1, match.x2)
    unseen = unseen_rad(window, match.uv1, _height_px(match.x1, w, scene.camera1.focal_px), scene.evidence)
    unseen = max(unseen, stepped_rad(window, match, w, scene.evidence))
    return replace(match, doubt_rad=match.doubt_rad + unseen, unseen_rad=unseen)


def stepped_rad(window: Window, match: WindowMatch, inverse: FloatArray, evidence: Evidence) -> float:
    """How much the plane of a window's matches tilts when what stands off it by a step is counted in.

    The overview has matched what lies across a step; the window's own matches are those on one side of it. Where they
    lie, too, the overview has been mistaken.

    inverse : (n,) inverse depths of the matches, 1/baseline.
    """
    inside = evidence.near(window, 0.0)
    if inside.sum() < LEAST_STEP:
        return 0.0
    normal = np.linalg.lstsq(homogeneous(match.x1), inverse, rcond=None)[0]
    rays, w = homogeneous(evidence.x1[inside]), evidence.w[inside]
    off = np.abs(rays @ normal - w) * evidence.leverage[inside] * evidence.focal_px > STEP_PX
    kept = ~off
    kept[off] = _filled(evidence.uv1[inside][off], window, match) < STEP_FILLED
    rays, w, off = rays[kept], w[kept], off[kept]
    if np.count_nonzero(off) < max(LEAST_STEP, STEP_SHARE * len(w)):
        return 0.0
    points = rays / w[:, None]
    points -= points.mean(axis=0)
    whole = np.linalg.svd(points, full_matrices=False)[2][2]
    return min(float(np.arccos(min(abs(whole @ normal) / float(np.linalg.norm(normal)), 1.0))), MOST_STEP_RAD)


def _filled(at: FloatArray, window: Window, match: WindowMatch) -> FloatArray:
    """(k,) matches around points `at` (k, 2) of a window over what there are where it is matched without gaps."""
    reach = 1.5 * _cell_px(window, match.uv1)
    around = (((at[:, None] - match.uv1[None]) ** 2).sum(axis=2) < reach**2).sum(axis=1)
    densest = len(match.uv1) / max(match.share, 0.01) / (window[2] * window[3])
    return np.asarray(around / (densest * np.pi * reach**2))


def _height_px(x1: FloatArray, w: FloatArray, focal_px: float) -> float:
    """RMS height of the matches off the plane nearest to them, in pixels of image 1 at their distance."""
    points = homogeneous(x1) / w[:, None]
    normal = np.linalg.lstsq(points, np.ones(len(points)), rcond=None)[0]
    off = (points @ normal - 1) / np.linalg.norm(normal) * w
    return float(np.sqrt(np.mean(off**2))) * focal_px


def unseen_rad(window: Window, uv1: FloatArray, height_px: float, evidence: Evidence) -> float:
    """1-sigma of the tilt of a window's best-fit plane that is owed to its parts without matches.

    The plane through the matches goes on beyond them. Out there the ground stands off it as it does among the matches,
    and bends away from it as it does from one place to the next all over the image; what either does to the least
    squares over the whole window follows from where the gaps are.

    Parameters
    ----------
    uv1 : (n, 2) px of image 1, matches the plane rests on.
    height_px : RMS height of the ground off the plane, in pixels of image 1 at its distance.
    """
    at, seen = _gaps(window, uv1)
    if seen.all():
        return 0.0
    bend = _lever(at, seen) * bend_rad(evidence, 0.5 * max(window[2:]))
    # neighbouring cells are equally high; the worst is that all in a gap are
    stand = np.linalg.norm(np.linalg.lstsq(at.T @ at, at[~seen].sum(axis=0), rcond=None)[0])
    return float(np.hypot(bend, np.arctan(height_px * stand)))


def _cell_px(window: Window, uv1: FloatArray) -> float:
    """Side of the cells in which matches are counted: where a window is matched, none of them is empty."""
    _, _, w, h = window
    return max(max(w, h) / ACROSS, LEAST_CELL_PX, 1.5 * float(np.sqrt(w * h / max(len(uv1), 1))))


def _gaps(window: Window, uv1: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Centres (k, 2) of the cells of a window, px from its middle, and which of them (k,) hold a match."""
    x, y, w, h = window
    side = _cell_px(window, uv1)
    columns, rows = max(round(w / side), 1), max(round(h / side), 1)
    column = np.clip(((uv1[:, 0] + 0.5 - x) * columns / w).astype(int), 0, columns - 1)
    row = np.clip(((uv1[:, 1] + 0.5 - y) * rows / h).astype(int), 0, rows - 1)
    seen = np.zeros((rows, columns), bool)
    seen[row, column] = True
    v, u = np.mgrid[:rows, :columns]
    at = np.stack([(u + 0.5) / columns * w - 0.5 * w, (v + 0.5) / rows * h - 0.5 * h], axis=-1)
    return at.reshape(-1, 2), seen.ravel()


def _lever(at: FloatArray, seen: BoolArray) -> float:
    """Tilt of the whole over the tilt that sets in where what is seen ends, along the direction it matters most in."""
    if not seen.any():
        return 1.0
    gap, known = at[~seen], at[seen]
    nearest = known[((gap[:, None] - known[None]) ** 2).sum(axis=2).argmin(axis=1)]
    gain = np.linalg.lstsq(at.T @ at, gap.T @ (gap - nearest), rcond=None)[0]
    return min(float(np.linalg.norm(gain, 2)), 1.0)


@lru_cache(maxsize=4)  # windows of a grid are all of one size
def bend_rad(evidence: Evidence, side_px: float) -> float:
    """RMS change of tilt, about either axis, from one block of ground to the next, `side_px` on in image 1."""
    extent = np.ptp(evidence.uv1, axis=0) if len(evidence) else np.zeros(2)
    spacing = float(np.sqrt(extent.prod() / max(len(evidence), 1)))
    normals = _block_normals(evidence, max(side_px, BLOCK_CELLS * spacing))
    angles = np.concatenate([_change(normals[1:], normals[:-1]), _change(normals[:, 1:], normals[:, :-1])])
    squares = BEND_COUNT * BEND_RAD**2 + 0.5 * float((angles**2).sum())
    return float(np.sqrt(squares / (BEND_COUNT + len(angles))))


def _block_normals(evidence: Evidence, side_px: float) -> FloatArray:
    """(rows, columns, 3) unit normals of the ground in square blocks of image 1; NaN where too little is known."""
    if len(evidence) < MIN_IN_BLOCK:
        return np.full((1, 1, 3), np.nan)
    column, row = ((evidence.uv1 - evidence.uv1.min(0)) / side_px).astype(int).T
    columns, rows = column.max() + 1, row.max() + 1
    block = row * columns + column
    design = homogeneous(evidence.x1) * evidence.leverage[:, None]
    terms = np.concatenate([design, (evidence.w * evidence.leverage)[:, None]], axis=1)
    products = (terms[:, :3, None] * terms[:, None, :]).reshape(len(terms), 12)
    sums = np.array([np.bincount(block, column, rows * columns) for column in products.T]).T.reshape(-1, 3, 4)
    enough = np.bincount(block, minlength=rows * columns) >= MIN_IN_BLOCK
    normals = np.full((rows * columns, 3), np.nan)
    lift = 1e-12 * np.trace(sums[enough][:, :, :3], axis1=1, axis2=2)[:, None, None] * np.eye(3)
    normals[enough] = np.linalg.solve(sums[enough][:, :, :3] + lift, sums[enough][:, :, 3:])[..., 0]
    return np.asarray(normals / np.linalg.norm(normals, axis=1, keepdims=True)).reshape(rows, columns, 3)


def _change(one: FloatArray, other: FloatArray) -> FloatArray:
    """(k,) angles between unit normals of neighbouring blocks, where both are known."""
    half = 0.5 * np.linalg.norm(one - other, axis=-1).ravel()
    return 2.0 * np.arcsin(np.clip(half[np.isfinite(half)], 0.0, 1.0))
