"""Take a view out of the solution and keep what it tells of inverse depths: the cost of a view does not grow with time.

The motion of the view is eliminated, exactly to first order: what is left is the information of every point on its own
inverse depth, and six variables z for the errors of the motion, which all points share. Of the variables of several
views those of least effect are eliminated too (`compressed`). Letters are those of `views.Terms`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from slopecli.geometry.epipolar import tangent_basis
from slopecli.geometry.solver.views import Summed, Terms, ViewPoints, ViewState
from slopecli.types import FloatArray


def sum_up(points: ViewPoints, state: ViewState, terms: Terms, view: int, most: int) -> tuple[ViewPoints, ViewState]:
    """The points and the state without one view, its information summed.

    terms : at the state.  most : variables z that are kept.
    """
    summed = points.summed
    basis = np.eye(6)
    if view == 0 and not summed.scaled:
        basis = np.zeros((6, 5))
        basis[:3, :3], basis[3:, 3:] = np.eye(3), tangent_basis(state.T[0] / np.linalg.norm(state.T[0]))
    U = basis.T @ terms.U[view] @ basis
    L = np.linalg.cholesky(U + 1e-12 * np.trace(U) * np.eye(len(U)))
    modes = np.linalg.solve(L, basis.T @ terms.X[view])  # (6, n)
    start = np.linalg.solve(L, basis.T @ terms.g[view])
    added = replace(
        summed,
        u_information=summed.u_information + terms.V[view],
        u_vector=summed.u_vector + terms.V[view] * state.u - terms.h[view],
        u_modes=np.concatenate([summed.u_modes, modes.T], axis=1),
        n_modes=np.concatenate([summed.n_modes, np.zeros((points.n_planes, 3, len(start)))], axis=2),
        z_vector=np.concatenate([summed.z_vector, start - modes @ state.u]),
        scaled=summed.scaled or view == 0,
    )
    z = np.concatenate([state.z, np.zeros(len(start))])
    kept, z = compressed(added, z, most)
    left = [k for k in range(points.n_views) if k != view]
    left_points = replace(points, x=points.x[left], weight=points.weight[left], summed=kept)
    return left_points, state._replace(R=state.R[left], T=state.T[left], z=z)


def compressed(summed: Summed, z: FloatArray, most: int) -> tuple[Summed, FloatArray]:
    """At most `most` variables z: those combinations that reduce the information on inverse depths least are left out.

    What errors of points share through the variables left out counts as independent from then on.
    """
    if len(z) <= most:
        return summed, z
    whitened = summed.u_modes / np.sqrt(np.maximum(summed.u_information, 1e-150))[:, None]
    gram = whitened.T @ whitened
    normal_scale = np.maximum(np.trace(summed.n_information, axis1=1, axis2=2), 1e-150)[:, None, None]
    parts = (summed.n_modes / np.sqrt(normal_scale)).reshape(-1, len(z))
    W = np.linalg.eigh(gram + parts.T @ parts)[1][:, -most:]
    return replace(
        summed, u_modes=summed.u_modes @ W, n_modes=summed.n_modes @ W, z_vector=W.T @ summed.z_vector
    ), W.T @ z
