"""The plane nearest to all points of a window, by perpendicular distance, from inverse depths of all views."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slopecli.geometry.solver.many_views import Root
from slopecli.geometry.solver.views import ViewPoints
from slopecli.sequence.tracks import Tracks
from slopecli.types import BoolArray, FloatArray


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
