"""The plane nearest to all points of a window, by perpendicular distance, from inverse depths of all views."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slopecli.geometry.solver.many_views import Root
from slopecli.geometry.solver.views import ViewPoints
from slopecli.types import BoolArray, FloatArray, IntArray


def fused_normals(points: ViewPoints, root: Root, usable: BoolArray) -> FloatArray:
    """(m, 3) scaled normals of the perpendicular planes through the points; the root's own where ground is flat.

    The joint solution minimises along the rays, which on rough ground seen at an angle is another plane. Where relief
    is below the noise of a point there is no difference but for noise, and the joint solution is the surer one.

    usable : (n,) points that belong to their planes.
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
        normals[i] = _perpendicular(points.p[:, own][:, kept], depth, noise, float(root.relief[i]), state.N[i])
    return normals


def _perpendicular(p: FloatArray, u: FloatArray, sigma: FloatArray, relief: float, otherwise: FloatArray) -> FloatArray:
    """(3,) scaled normal of the points p / u, whose noise along the rays is subtracted from their scatter."""
    weight = 1.0 / (relief**2 + (sigma / u) ** 2)
    P, along = p / u, p * (sigma / u**2)
    centre = (P * weight).sum(axis=1) / weight.sum()
    off = P - centre[:, None]
    scatter = (off * weight) @ off.T - (along * weight) @ along.T
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
