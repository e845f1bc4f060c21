"""The plane nearest to all points of a window, by perpendicular distance, from inverse depths of all views."""

from __future__ import annotations

import numpy as np

from slopecli.geometry.solver.many_views import Root
from slopecli.geometry.solver.views import ViewPoints
from slopecli.types import BoolArray, FloatArray


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
