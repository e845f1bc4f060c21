"""What the points of windows have in common in their errors, by how far off their planes they are."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from slopecli.findings.codes import LIMITS
from slopecli.geometry.solver.many_views import Root
from slopecli.geometry.solver.views import ViewPoints, predict_views
from slopecli.sequence.tracking_tunables import TRACKING
from slopecli.types import BoolArray, FloatArray, IntArray


class _OffPlane(NamedTuple):
    """Points of a window: rays p (3, k), inverse depths off the plane (k,), weights (k,), rows and columns (k, 2)."""

    p: FloatArray
    off: FloatArray
    weight: FloatArray
    cell: IntArray

    def weighted(self, share: FloatArray | float = 1.0) -> FloatArray:
        """Rays (3, k) times the weights, or a share (k,) of them."""
        return np.asarray(self.p * (self.weight * share))

    def information(self, share: FloatArray | float = 1.0) -> FloatArray:
        """(3, 3) of the change of the scaled normal that they ask for, by a share (k,) of each."""
        information = self.weighted(share) @ self.p.T
        return np.asarray(information + 1e-12 * (np.trace(information) + np.finfo(float).tiny) * np.eye(3))


def _windows(points: ViewPoints, root: Root, cell: IntArray) -> Iterator[_OffPlane]:
    """The points of every window, off its plane by the views alone."""
    system, state = root.system, root.state
    V = np.maximum(system.V, np.finfo(float).tiny)
    off = state.u - system.h / V - (points.per_point(state.N.T) * points.p).sum(axis=0)
    weight = V * system.s * (system.V > 0.0)
    for first, number in zip(points.first.tolist(), points.count.tolist(), strict=True):
        own = slice(first, first + number)
        yield _OffPlane(points.p[:, own], off[own], weight[own], cell[own])


def halves_ratio(points: ViewPoints, root: Root, cell: IntArray) -> float:
    """Mean square difference of the planes of two halves of every window's points, over that of independent points.

    The halves alternate like the fields of a chess board. Two windows' worth of a ratio of 1 are counted in, so that a
    few windows do not promise more than they know.

    cell : (n, 2) row and column of the points in their window.
    """
    total, count = 6.0, 6
    for window in _windows(points, root, cell):
        even = window.cell.sum(axis=1) % 2 == 0
        halves = even.astype(float), 1.0 - even
        if min(np.count_nonzero(window.weight * half) for half in halves) < 9:
            continue
        information = [window.information(half) for half in halves]
        asked = [
            np.linalg.solve(own, window.weighted(half) @ window.off)
            for own, half in zip(information, halves, strict=True)
        ]
        step = asked[0] - asked[1]
        spread = root.noise**2 * (np.linalg.inv(information[0]) + np.linalg.inv(information[1]))
        total, count = total + float(step @ np.linalg.solve(spread, step)), count + 3
    return total / count


def neighbours_ratio(points: ViewPoints, root: Root, cell: IntArray) -> float:
    """Variance of planes by errors that neighbouring points share, over that of independent errors; at least 1.

    Heights of points off their plane are those of rocks and slopes between them, larger than a cell, and tracks err
    alike where they see the same edges. So errors are added up over squares of `TRACKING.shared_cells` cells a side,
    which are taken as independent of each other (the cluster-robust covariance of Liang and Zeger, 1986). Two windows'
    worth of a ratio of 1 are counted in, as by `halves_ratio`.

    cell : (n, 2) row and column of the points in their window.
    """
    total, count = 6.0, 6
    for window in _windows(points, root, cell):
        if np.count_nonzero(window.weight) < 2 * TRACKING.shared_cells**2:
            continue
        row, column = (window.cell // TRACKING.shared_cells).T
        square = row * (int(column.max()) + 1) + column
        sums = np.stack([np.bincount(square, pull) for pull in window.weighted() * window.off])
        total += float((sums * np.linalg.solve(window.information(), sums)).sum()) / root.noise**2
        count += 3
    return max(total / count, 1.0)


def tracking_share(points: ViewPoints, root: Root) -> FloatArray:
    """(m,) share of the variance of a window's relief that errors of its tracks may explain, at most 1.

    The height of a point may be off by two of its sigmas. Relief beyond that is ground that the points show, as they
    lie all over the window; that of the ground between them is estimated by `halves_ratio`. The share is 1 where the
    relief exceeds the limit of `non-planar-patch`: the window is no plane then, and its halves do not tell.
    """
    V, u = root.system.V, np.abs((points.per_point(root.state.N.T) * points.p).sum(axis=0))
    told = (root.q > 0.0) & (V > 0.0) & (u > 0.0)
    sigma = root.noise / np.sqrt(np.where(told, V, 1.0)) / np.where(told, u, 1.0)
    share = np.ones(points.n_planes)
    for i, (first, number) in enumerate(zip(points.first.tolist(), points.count.tolist(), strict=True)):
        own = sigma[first : first + number][told[first : first + number]]
        if len(own) and 0.0 < root.relief[i] <= LIMITS["non-planar-patch"]:
            share[i] = min((2.0 * float(np.median(own)) / root.relief[i]) ** 2, 1.0)
    return share


def off_planes_shown(points: ViewPoints, root: Root) -> BoolArray:
    """(n,) points of windows that views show and that are not on their planes, such as rocks, or walls beside a roof.

    A view shows a point if the point lies within the rectangle around those that it is used for. A point whose inverse
    depth is unknown is taken to lie on the plane of its window for this.
    """
    state, V = root.state, root.system.V
    plane = (points.per_point(state.N.T) * points.p).sum(axis=0)
    x, ahead = predict_views(points.p, state.R, state.T, np.where(V > 0.0, state.u, plane))
    shown = np.zeros(len(V), bool)
    for view, used in enumerate(points.weight > 0.0):
        if used.any():
            low, high = (edge(points.x[view][:, used], axis=1)[:, None] for edge in (np.min, np.max))
            shown |= (ahead[view] > 0.0) & ((x[view] > low) & (x[view] < high)).all(axis=0)
    on = (root.q > 0.0) & (V > 0.0)
    return np.asarray(shown & ~on & (np.arange(len(V)) < points.n_on_planes))


def off_covariance(points: ViewPoints, root: Root) -> FloatArray:
    """(m, 3, 3) covariance of the normals due to the points of `off_planes_shown`, which the planes leave out.

    These are ground of their windows. Each counts by its height above the plane, or by four times the relief where its
    height is unknown: points that far off are left out of the relief (`geometry/solver/relief.py`). What no view shows
    is not counted here.
    """
    state, V, n = root.state, root.system.V, points.n_on_planes
    plane = (points.per_point(state.N.T) * points.p).sum(axis=0)
    height = np.where(V > 0.0, np.abs(state.u - plane), 4.0 * points.per_point(root.relief) * np.abs(plane))
    p, off = points.p[:, :n], np.where(off_planes_shown(points, root), height, 0.0)[:n]
    on = ((root.q > 0.0) & (V > 0.0))[:n]
    kept = points.sum_planes((p * on)[:, None] * p[None]).transpose(2, 0, 1)
    lift = 1e-9 * np.trace(kept, axis1=1, axis2=2) + np.finfo(float).tiny
    response = np.linalg.inv(kept + lift[:, None, None] * np.eye(3))
    return np.asarray(response @ points.sum_planes((p * off**2)[:, None] * p[None]).transpose(2, 0, 1) @ response)


def noise_alone(points: ViewPoints, root: Root) -> FloatArray:
    """(m, 3, 3) covariance of the normals by independent noise of their points, motions known and without relief."""
    V, p = root.system.V * (root.q > 0.0), points.p
    n = points.n_on_planes
    information = points.sum_planes((V * p)[:, None, :n] * p[None, :, :n]).transpose(2, 0, 1)
    lift = 1e-9 * np.trace(root.system.plane, axis1=1, axis2=2) + np.finfo(float).tiny
    return np.asarray(root.noise**2 * np.linalg.inv(information + lift[:, None, None] * np.eye(3)))
