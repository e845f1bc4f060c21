"""How much larger the tilt error of a poorly determined plane is than linear error propagation says."""

from __future__ import annotations

from functools import cache

import numpy as np

from slopecli.types import FloatArray


def tilt_growth(normals: FloatArray, covariance: FloatArray) -> FloatArray:
    """Ratio of the RMS tilt error of each plane to its first-order value, at least 1.

    The error of a scaled normal is Gaussian, the tilt depends on its direction alone. With nearly collinear points the
    normal's sigma in one direction exceeds its length, and linear error propagation fails. The RMS tilt is therefore
    integrated over the Gaussian error.

    Parameters
    ----------
    normals : (m, 3) scaled.  covariance : (m, 3, 3) of them.

    Returns
    -------
    growth : (m,), exactly 1 where first order is good to 5 %.
    """
    values, vectors = np.linalg.eigh(covariance)
    growth = np.ones(len(normals))
    # below a relative sigma of 0.05 the growth is far below 5 %
    vague = np.sqrt(np.maximum(values[:, 2], 0.0)) > 0.05 * np.linalg.norm(normals, axis=1)
    if vague.any():
        factor = vectors[vague] * np.sqrt(np.maximum(values[vague], 0.0))[:, None, :]
        growth[vague] = _mean_growth(normals[vague], factor)
    return np.where(growth > 1.05, growth, 1.0)


@cache
def _nodes() -> tuple[FloatArray, FloatArray]:
    """Gauss-Hermite nodes (729, 3) and weights (729,) in three dimensions; 9 a dimension reach 4.5 sigma."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(9)
    z = np.stack(np.meshgrid(nodes, nodes, nodes, indexing="ij"), axis=-1).reshape(-1, 3)
    return z, np.einsum("i,j,k->ijk", weights, weights, weights).ravel() / (2.0 * np.pi) ** 1.5


def _mean_growth(normals: FloatArray, factor: FloatArray) -> FloatArray:
    """(m,) RMS tilt over its first-order value; factor @ factor^T (m, 3, 3) is the covariance of the normals (m, 3)."""
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
