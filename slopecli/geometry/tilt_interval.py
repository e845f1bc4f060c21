"""Where the tilt of a plane is more open than its linearised sigma says."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from slopecli.types import FloatArray

_LINEAR = 1.05  # growth of a sigma below which linearising it is good enough
_WELL_KNOWN = 0.05  # 1-sigma over length, in any direction, of a normal whose tilt grows by far less than that


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
    values, vectors = np.linalg.eigh(covariance)
    growth = np.ones(len(normals))
    vague = np.sqrt(np.maximum(values[:, 2], 0.0)) > _WELL_KNOWN * np.linalg.norm(normals, axis=1)
    if vague.any():
        factor = vectors[vague] * np.sqrt(np.maximum(values[vague], 0.0))[:, None, :]
        growth[vague] = _mean_growth(normals[vague], factor)
    return np.where(growth > _LINEAR, growth, 1.0)


@lru_cache(maxsize=1)
def _nodes() -> tuple[FloatArray, FloatArray]:
    """Gauss-Hermite in three dimensions, (729, 3) and weights (729,): 9 nodes reach 4.5 standard deviations."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(9)
    z = np.stack(np.meshgrid(nodes, nodes, nodes, indexing="ij"), axis=-1).reshape(-1, 3)
    return z, np.einsum("i,j,k->ijk", weights, weights, weights).ravel() / (2.0 * np.pi) ** 1.5


def _mean_growth(normals: FloatArray, factor: FloatArray) -> FloatArray:
    """(m,) growth of tilts; factor (m, 3, 3) times its transpose is the covariance of the scaled normals (m, 3)."""
    z, weight = _nodes()
    length = np.linalg.norm(normals, axis=1)[:, None]
    unit = normals / length
    possible = (normals[:, None] + z @ factor.swapaxes(1, 2)) / length[:, None]
    ahead = (possible * unit[:, None]).sum(axis=2)
    aside = np.linalg.norm(possible - ahead[:, :, None] * unit[:, None], axis=2)
    turned = np.arctan2(aside, ahead) ** 2 @ weight
    across = factor - unit[:, :, None] * (unit[:, None] @ factor)
    linear = (across**2).sum(axis=(1, 2)) / length[:, 0] ** 2
    return np.asarray(np.sqrt(turned / np.maximum(linear, np.finfo(float).tiny)))
