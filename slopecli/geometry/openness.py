"""Where the tilt of a plane is more open than its linearised sigma says."""

from __future__ import annotations

import numpy as np

from slopecli.types import FloatArray

# Gauss-Hermite in three dimensions: 9 nodes reach 4.5 standard deviations
_NODES, _WEIGHTS = np.polynomial.hermite_e.hermegauss(9)
_Z = np.stack(np.meshgrid(_NODES, _NODES, _NODES, indexing="ij"), axis=-1).reshape(-1, 3)
_WEIGHT = np.einsum("i,j,k->ijk", _WEIGHTS, _WEIGHTS, _WEIGHTS).ravel() / (2.0 * np.pi) ** 1.5
_LINEAR = 1.05  # growth of a sigma below which linearising it is good enough


def tilt_growth(normals: FloatArray, covariance: FloatArray) -> FloatArray:
    """How many times larger the RMS error of each tilt is than its derivative by the scaled normal says, at least 1.

    Points tell the scaled normal, and its error is Gaussian. The tilt is the direction of that normal alone. Points
    that lie nearly on a line leave the normal so open along one direction that it may be several times too long; seen
    from there, what leaves it open hardly turns it. The mean over the error itself knows better.

    Parameters
    ----------
    normals : (m, 3) scaled.  covariance : (m, 3, 3) of them.

    Returns
    -------
    growth : (m,), exactly 1 where linearising is good to 5 %.
    """
    length = np.linalg.norm(normals, axis=1)[:, None]
    unit = normals / length
    values, vectors = np.linalg.eigh(covariance)
    factor = vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]
    possible = (normals[:, None] + _Z @ factor.swapaxes(1, 2)) / length[:, None]
    ahead = (possible * unit[:, None]).sum(axis=2)
    aside = np.linalg.norm(possible - ahead[:, :, None] * unit[:, None], axis=2)
    turned = np.arctan2(aside, ahead) ** 2 @ _WEIGHT
    across = factor - unit[:, :, None] * (unit[:, None] @ factor)
    linear = (across**2).sum(axis=(1, 2)) / length[:, 0] ** 2
    growth = np.sqrt(turned / np.maximum(linear, np.finfo(float).tiny))
    return np.where(growth > _LINEAR, growth, 1.0)
