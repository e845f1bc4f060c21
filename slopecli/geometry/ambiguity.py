"""Two roots that run into each other: one broad minimum with two dents, where each dent's curvature says too little.

Vertical descent over nearly level ground is such a case. The bound on the slope then grows without limit at the true
root, while each estimated root looks sharp by itself. What the data leave open is the whole stretch between the two.
"""

from __future__ import annotations

import numpy as np

from slopecli.geometry.epipolar import nearest_rotation, rotation_vector
from slopecli.geometry.fitting import Fit
from slopecli.geometry.refinement import State, optimal_normals
from slopecli.geometry.uncertainty import Covariance
from slopecli.types import FloatArray

# chi-square with 1 degree of freedom at 0.99: a lower ridge between two roots does not separate them
_RIDGE = 6.63
_SURELY = 10.0  # dents are not equal and curvature is local, so the cheap test leaves a wide margin


def roots_are_joined(fit: Fit, noise: float) -> bool:
    """Whether the motion half way between the first two roots fits nearly as well as the better one."""
    if _clearly_apart(fit, noise):
        return False
    R = nearest_rotation(fit.state.R[0] + fit.state.R[1])
    T = fit.state.T[0] + fit.state.T[1]
    if np.linalg.norm(T) < 1.0:
        return False  # directions more than 120 degrees apart are not neighbours
    midway = State(R[None], (T / np.linalg.norm(T))[None], 0.5 * (fit.state.N[:1] + fit.state.N[1:2]))
    W = fit.relief[0].W[None] if fit.relief else None
    cost = np.inf
    for _ in range(2):  # the second round has the right depths in its weights
        form = fit.form(midway, W)
        midway, chi2 = optimal_normals(midway.R, midway.T, form)
        cost = float(chi2[0])
    return cost - float(fit.system.chi2[0]) < _RIDGE * noise**2


def _clearly_apart(fit: Fit, noise: float) -> bool:
    """Cheap test. Of two equal dents a distance D apart, in sigmas by curvature, the ridge rises to D^2 / 16."""
    apart = np.concatenate([rotation_vector(fit.state.R[1] @ fit.state.R[0].T), fit.state.T[1] - fit.state.T[0]])
    squared = apart @ fit.system.reduced[0, :6, :6] @ apart
    return bool(squared > _SURELY * 16.0 * _RIDGE * noise**2)


def reaching_across(covariance: Covariance, state: State, index: int) -> Covariance:
    """Widen the covariance of root `index` (0 or 1): two standard deviations then span the stretch to the other one."""
    other = 1 - index
    half_way = 0.5 * np.concatenate(
        [
            rotation_vector(state.R[other] @ state.R[index].T),
            covariance.tangent.T @ (state.T[other] - state.T[index]),
        ]
    )
    half_normals = 0.5 * (state.N[other] - state.N[index])
    return covariance._replace(
        normal_covariance=covariance.normal_covariance + _outer(half_normals),
        motion_covariance=covariance.motion_covariance + _outer(half_way),
    )


def _outer(v: FloatArray) -> FloatArray:
    return np.asarray(v[..., :, None] * v[..., None, :])
