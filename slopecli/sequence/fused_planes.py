"""The plane nearest to all points of a window, by perpendicular distance, from inverse depths of all views."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slopecli.geometry.solver.many_views import Root
from slopecli.geometry.solver.views import ViewPoints
from slopecli.sequence.tracks import Tracks
from slopecli.types import BoolArray, FloatArray, IntArray

SHARED = 3  # cells along the side of a square whose points err alike: windows are 15 cells wide


class Ground:
    """The ground of every window between its points: their heights off the plane, spread by a Gaussian of half a cell.

    The plane of a window over rough ground is a mean over its area, and points are denser here than there: some cells
    have no texture, some are not seen. Ground farther than a cell from all points is left out.
    """

    def __init__(self, tracks: Tracks) -> None:
        self._tracks = tracks
        self._near: dict[int, NDArray[np.float32]] = {}  # weights of points at places, and their squares
        self._square: dict[int, NDArray[np.float32]] = {}

    def between(self, i: int, kept: BoolArray, height: FloatArray, sigma: FloatArray) -> Spread:
        """Places of window i near the points kept (n,) of it, and the height and its sigma there, from theirs (n,)."""
        lattice = self._tracks.lattices[i]
        if i not in self._near:
            uv = self._tracks.uv[self._tracks.patch == i]
            away = (lattice.uv**2).sum(axis=1)[:, None] - 2.0 * lattice.uv @ uv.T + (uv**2).sum(axis=1)
            self._near[i] = np.exp(-2.0 * away / lattice.apart**2).astype(np.float32)
            self._square[i] = self._near[i] ** 2
        near, square = self._near[i], self._square[i]
        total = near @ kept.astype(np.float32)
        shown = total > np.exp(-2.0)  # that of a point a cell away
        spread = near @ np.where(kept, height, 0.0).astype(np.float32)
        noise = square @ np.where(kept, sigma**2, 0.0).astype(np.float32)
        spread, noise = spread[shown] / total[shown], np.sqrt(noise[shown]) / total[shown]
        return Spread(lattice.rays[:, shown], spread.astype(float), noise.astype(float))


class Spread(NamedTuple):
    """Rays (3, k) of places, and heights (k,) off the plane over the distance, with 1-sigma (k,)."""

    rays: FloatArray
    height: FloatArray
    sigma: FloatArray


def fused_normals(points: ViewPoints, root: Root, usable: BoolArray, ground: Ground) -> FloatArray:
    """(m, 3) scaled normals of the perpendicular planes through the points; the root's own where ground is flat.

    The joint solution minimises along the rays, which on rough ground seen at an angle is another plane. Where relief
    is below the noise of a point there is no difference but for noise, and the joint solution is the surer one.

    usable : (n,) points that belong to their planes.  ground : between the points.
    """
    system, state = root.system, root.state
    V = np.maximum(system.V, np.finfo(float).tiny)
    u = state.u - system.h / V  # from the views alone
    sigma = root.noise / np.sqrt(V)
    normals = state.N.copy()
    for i in range(points.n_planes):
        own = slice(int(points.first[i]), int(points.first[i] + points.count[i]))
        kept = usable[own] & (system.V[own] > 0.0) & (u[own] > 0.0)
        depth, noise = u[own][kept], sigma[own][kept]
        if np.count_nonzero(kept) < 9 or root.relief[i] ** 2 < np.median((noise / depth) ** 2):
            continue
        plane = state.N[i] @ points.p[:, own]
        spread = ground.between(i, kept, u[own] / plane - 1.0, sigma[own] / np.abs(plane))
        plane = state.N[i] @ spread.rays
        if len(plane) >= 9 and plane.min() > 0.0:
            normals[i] = _perpendicular(spread.rays, plane * (1.0 + spread.height), plane * spread.sigma, state.N[i])
    return normals


def _perpendicular(p: FloatArray, u: FloatArray, sigma: FloatArray, otherwise: FloatArray) -> FloatArray:
    """(3,) scaled normal of the points p / u, whose noise along the rays is subtracted from their scatter."""
    P, along = p / u, p * (sigma / u**2)
    centre = P.mean(axis=1)
    off = P - centre[:, None]
    scatter = off @ off.T - along @ along.T
    n = np.linalg.eigh(scatter)[1][:, 0]
    distance = float(n @ centre)
    # edge-on to the camera: no scaled normal of use
    return np.asarray(n / distance) if abs(distance) > 1e-3 * float(np.linalg.norm(centre)) else otherwise


def halves_ratio(points: ViewPoints, root: Root, cell: IntArray) -> float:
    """Mean square difference of the planes of two halves of every window's points, over that of independent points.

    The halves alternate like the fields of a chess board. Two windows' worth of a ratio of 1 are counted in, so that a
    few windows do not promise more than they know.

    cell : (n, 2) row and column of the points in their window.
    """
    system, state = root.system, root.state
    V = np.maximum(system.V, np.finfo(float).tiny)
    off = state.u - system.h / V - (points.per_point(state.N.T) * points.p).sum(axis=0)
    information = V * system.s * (system.V > 0.0)
    even = cell.sum(axis=1) % 2 == 0
    total, count = 6.0, 6
    for first, number in zip(points.first.tolist(), points.count.tolist(), strict=True):
        own = slice(first, first + number)
        both = [_half_plane(points.p[:, own], off[own], information[own] * half) for half in (even[own], ~even[own])]
        if min(one.kept for one in both) < 9:
            continue
        step = both[0].normal - both[1].normal
        spread = root.noise**2 * (np.linalg.inv(both[0].information) + np.linalg.inv(both[1].information))
        total, count = total + float(step @ np.linalg.solve(spread, step)), count + 3
    return total / count


def noise_alone(points: ViewPoints, root: Root) -> FloatArray:
    """(m, 3, 3) covariance of the normals by independent noise of their points, motions known and without relief."""
    V, p = root.system.V * (root.q > 0.0), points.p
    n = points.n_on_planes
    information = points.sum_planes((V * p)[:, None, :n] * p[None, :, :n]).transpose(2, 0, 1)
    lift = 1e-9 * np.trace(root.system.plane, axis1=1, axis2=2) + np.finfo(float).tiny
    return np.asarray(root.noise**2 * np.linalg.inv(information + lift[:, None, None] * np.eye(3)))


def neighbours_ratio(points: ViewPoints, root: Root, cell: IntArray) -> float:
    """Variance of planes by errors that neighbouring points share, over that of independent errors; at least 1.

    Heights of points off their plane are those of rocks and slopes between them, larger than a cell, and tracks err
    alike where they see the same edges. So the errors of squares of `SHARED` cells by as many are added up, and
    squares are taken as independent of each other (the cluster-robust covariance of Liang and Zeger). Two windows'
    worth of a ratio of 1 are counted in, so that a few windows do not say more than they know.

    cell : (n, 2) row and column of the points in their window.
    """
    system, state = root.system, root.state
    V = np.maximum(system.V, np.finfo(float).tiny)
    off = state.u - system.h / V - (points.per_point(state.N.T) * points.p).sum(axis=0)
    weight = V * system.s * (system.V > 0.0)
    row, column = (cell // SHARED).T
    square = row * (int(column.max(initial=0)) + 1) + column
    total, count = 6.0, 6
    for first, number in zip(points.first.tolist(), points.count.tolist(), strict=True):
        own = slice(first, first + number)
        p, w = points.p[:, own], weight[own]
        if np.count_nonzero(w) < 2 * SHARED**2:
            continue
        information = (p * w) @ p.T
        information += 1e-12 * (np.trace(information) + np.finfo(float).tiny) * np.eye(3)
        pulls = p * (w * off[own])
        sums = np.stack([np.bincount(square[own], pull) for pull in pulls])
        total += float((sums * np.linalg.solve(information, sums)).sum()) / root.noise**2
        count += 3
    return max(total / count, 1.0)


class _Half(NamedTuple):
    """Change of a scaled normal (3,) that half of the points asks for, its information (3, 3), number of points."""

    normal: FloatArray
    information: FloatArray
    kept: int


def _half_plane(p: FloatArray, off: FloatArray, weight: FloatArray) -> _Half:
    information = (p * weight) @ p.T
    information += 1e-12 * (np.trace(information) + np.finfo(float).tiny) * np.eye(3)
    normal = np.linalg.solve(information, (p * weight) @ off)
    return _Half(np.asarray(normal), np.asarray(information), int(np.count_nonzero(weight > 0.0)))
