"""A focal length and a motion by epipolar lines alone: a start to which no wrong focal length has led.

How pixels of one image lie on lines of the other does not depend on the focal length, and the matrix that says so has
seven parameters. Seen by a camera of the right focal length it is an essential matrix, whose larger two singular values
are equal (Hartley, "Estimation of relative camera positions for uncalibrated cameras", 1992). Through a lens with
distortion lines are straight with the right focal length only. Of one plane, and where views hardly turn, lines tell
nothing, so what is found is only where a search begins.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from slopecli.geometry.epipolar import decompose_essential, epipolar_distance, essential_matrix, homogeneous
from slopecli.geometry.motion import inverse_depth
from slopecli.geometry.solver.observations import FINEST_RESIDUAL
from slopecli.geometry.solver.seen_points import Sightings, changed
from slopecli.geometry.statistics import geman_mcclure, median, robust_sigma
from slopecli.types import BoolArray, Camera, FloatArray

Motion = tuple[FloatArray, FloatArray]  # R (3, 3) and the unit baseline T (3,)
Start = tuple[float, Motion]  # logarithm of a focal length over that of the cameras, and the motion under it


class _Search(NamedTuple):
    """How epipolar lines are fitted, and which focal lengths are tried."""

    rounds: int = 30  # of robust weights: they settle in 5, and in 20 where a quarter of the points is mismatched
    focal_lengths: int = 41  # that are compared: 4 % apart, and what begins within 10 % arrives
    through_lens: float = 0.175  # steps of the logarithm of the focal length; what begins within half of one arrives


_SEARCH = _Search()


def start_by_lines(sightings: Sightings, noise: float, most: float) -> Start | None:
    """Logarithm of the focal length over that of the cameras, at most `most`, and the motion (R, T) under it.

    noise : of the matches, normalised.  None where no focal length within reach is better than its neighbours.
    """
    if any(camera.distortion for camera in sightings.cameras):
        lines, step = _lines_through_lens(sightings, noise, most), 0.0
    else:
        lines = _fitted(sightings, 0.0, noise)
        step = _focal_of(lines.F, most) if lines else math.nan
    if lines is None or math.isnan(step):
        return None
    value = lines.value + step
    E = _scaled(lines.F, np.array([step]))[0]
    seen = lines.seen.seen_by(_with_focal(sightings.cameras, value)) if step else lines.seen
    finite = np.isfinite(np.column_stack(seen.rays())).all(axis=1)
    return value, _motion_of(E, seen.take(np.asarray(finite)), lines.weight[finite])


def gain_by_lines(sightings: Sightings, of: slice, motion: Motion, noise: float) -> float:
    """How much better epipolar lines fitted without any camera explain some points than those of a motion (R, T).

    sightings : all points, which the lines are fitted to.  of : those that are to be explained.  noise : of the
    matches, normalised.  The gain is the mean logarithm of the likelihood ratio of a point, distances having the
    distribution of Cauchy; mismatches gain nothing, as they are on no lines.
    """
    noise = max(noise, FINEST_RESIDUAL)
    rays = sightings.rays()
    F = _fundamental_matrix(*rays, sightings.weight, noise)[0]
    given, fitted = (
        np.log1p(sightings.weight * (epipolar_distance(matrix, *rays) / noise) ** 2)[of]
        for matrix in (essential_matrix(*motion), F)
    )
    return float((given - fitted).sum()) / max(len(given), 1)


class _Lines(NamedTuple):
    """Epipolar lines of points as seen with a logarithm of the focal length.

    F (3, 3), x2 . F x1 = 0.  weight (n,) of the points.  noise_px : their distance from the lines.
    """

    value: float
    seen: Sightings
    F: FloatArray
    weight: FloatArray
    noise_px: float


def _lines_through_lens(sightings: Sightings, noise: float, most: float) -> _Lines | None:
    """The lines of a lens with distortion, by steps of the focal length for as long as points come nearer to them."""
    best = _fitted(sightings, 0.0, noise)
    for step in (_SEARCH.through_lens, -_SEARCH.through_lens):
        while best and abs(best.value + step) <= most:
            tried = _fitted(sightings, best.value + step, noise, best)
            if tried is None or tried.noise_px >= best.noise_px:
                break
            best = tried
    return best


def _fitted(sightings: Sightings, value: float, noise: float, near: _Lines | None = None) -> _Lines | None:
    """The lines for a value; near : those for another one, whose mismatches are a start."""
    seen = (sightings.seen_by(_with_focal(sightings.cameras, value)) if value else sightings).with_rays()
    if len(seen.patch) < max(8, 0.9 * len(sightings.patch)):
        return None
    start = None if near is None else _scaled(near.F, np.array([value - near.value]))[0]
    F, weight, sigma = _fundamental_matrix(*seen.rays(), seen.weight, noise, start)
    return _Lines(value, seen, F, weight, sigma * seen.cameras[1].focal_px)


def _with_focal(cameras: tuple[Camera, Camera], value: float) -> tuple[Camera, Camera]:
    return changed(cameras[0], "f", value), changed(cameras[1], "f", value)


def _scaled(F: FloatArray, values: FloatArray) -> FloatArray:
    """(k, 3, 3) the matrix as seen with focal lengths whose logarithms differ by values (k,)."""
    scale = np.stack([np.exp(values), np.exp(values), np.ones_like(values)], axis=1)
    return np.asarray(scale[:, :, None] * F * scale[:, None, :])


def _focal_of(F: FloatArray, most: float) -> float:
    """Logarithm of the focal length under which the larger singular values are nearest to equal; NaN at the ends."""
    values = np.linspace(-most, most, _SEARCH.focal_lengths)
    singular = np.linalg.svd(_scaled(F, values), compute_uv=False)
    best = int((singular[:, 1] / singular[:, 0]).argmax())
    return math.nan if best in (0, len(values) - 1) else float(values[best])


def _motion_of(E: FloatArray, seen: Sightings, weight: FloatArray) -> Motion:
    """Of the four motions of an essential matrix that with the points in front of both cameras."""
    rotations, baseline = decompose_essential(E)
    motions = [(R, side * baseline) for R in rotations for side in (1.0, -1.0)]
    return max(motions, key=lambda motion: float(weight @ _in_front(motion, *seen.rays())))


def _in_front(motion: Motion, x1: FloatArray, x2: FloatArray) -> BoolArray:
    R, T = motion
    w = inverse_depth(R, T, x1, x2)[0]
    return np.asarray((w > 0.0) & (homogeneous(x1) @ R[2] - w * (R[2] @ T) > 0.0))


def _fundamental_matrix(
    x1: FloatArray, x2: FloatArray, weights: FloatArray, noise: float, start: FloatArray | None = None
) -> tuple[FloatArray, FloatArray, float]:
    """(3, 3) matrix F with x2 . F x1 = 0 of points (n, 2), robust weights (n,), and the 1-sigma of their distances.

    start : matrix near to it, whose mismatches are those of the first round.
    """
    first, second = _conditioner(x1), _conditioner(x2)
    p1, p2 = homogeneous(x1), homogeneous(x2)
    rows = ((p2 @ second.T)[:, :, None] * (p1 @ first.T)[:, None, :]).reshape(-1, 9)

    def missed(F: FloatArray) -> tuple[FloatArray, FloatArray, float]:
        """By how much more an entry of the products errs than a distance, (n,); the distances, and their 1-sigma."""
        lines2, lines1 = p1 @ F.T, p2 @ F
        square2 = np.maximum((lines2[:, :2] ** 2).sum(axis=1), np.finfo(float).tiny)
        length = square2 + (lines1[:, :2] ** 2).sum(axis=1)
        distance = (p2 * lines2).sum(axis=1) / np.sqrt(square2)
        return median(length) / length, distance, robust_sigma(distance)

    def robust(distance: FloatArray, sigma: float) -> FloatArray:
        return geman_mcclure(distance, 3.0 * max(sigma, noise, FINEST_RESIDUAL))

    by_line, weight, sigma = np.ones(len(x1)), np.ones(len(x1)), np.inf
    F = np.eye(3)
    if start is not None:
        by_line, distance, sigma = missed(start)
        weight = robust(distance, sigma)
    for _ in range(_SEARCH.rounds):
        weighted = rows * np.sqrt(weights * weight * by_line)[:, None]
        u, s, vt = np.linalg.svd(np.linalg.eigh(weighted.T @ weighted)[1][:, 0].reshape(3, 3))
        F = second.T @ ((u[:, :2] * s[:2]) @ vt[:2]) @ first
        before = sigma
        by_line, distance, sigma = missed(F)
        if abs(before - sigma) < 0.002 * sigma:
            break
        weight = robust(distance, sigma)
    return F, weights * weight, sigma


def _conditioner(x: FloatArray) -> FloatArray:
    """(3, 3) similarity that takes points (n, 2) to mean 0 and RMS distance sqrt(2) (Hartley)."""
    mean = x.mean(axis=0)
    size = np.sqrt(2.0) / max(float(np.sqrt(((x - mean) ** 2).sum(axis=1).mean())), np.finfo(float).tiny)
    return np.array([[size, 0.0, -size * mean[0]], [0.0, size, -size * mean[1]], [0.0, 0.0, 1.0]])
