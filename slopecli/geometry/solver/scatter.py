"""Covariance of the motion by errors that many matches share, which residuals of single matches do not show.

Matching noise is not all that moves a motion: lenses are never exactly as modelled, stereo images never exactly
rectified, shutters roll, flow errs alike over a whole surface. Such errors are shared by far more matches than
neighbours are correlated. They are told in two ways, and the larger covariance counts:

- The image is divided into blocks, and the steps that these ask of the motion, beside those of all the others, are
  compared with what noise alone would make of them. Source: White, "Maximum likelihood estimation of misspecified
  models", 1982; Liang and Zeger, "Longitudinal data analysis using generalized linear models", 1986.
- Image 2 is displaced by a smooth field of unknown amplitude. What the motion cannot absorb of such fields tells the
  amplitude, by the largest likelihood; what it does absorb is then its error. Source: Patterson and Thompson, "Recovery
  of inter-block information when block sizes are unequal", 1971.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from slopecli.errors import DegenerateConfiguration
from slopecli.geometry.epipolar import tangent_basis
from slopecli.geometry.solver.intrinsics import Settled, eliminated, lifted, whitened_rows, with_planes
from slopecli.geometry.solver.observations import observe
from slopecli.geometry.solver.one_thread import one_blas_thread
from slopecli.geometry.solver.seen_points import Sightings
from slopecli.types import FloatArray, IntArray, Solution


class ScatterTunables(NamedTuple):
    """How image 1 is divided, and which fields are smooth. Blocks of 64 px told nothing of images of 2 MP: lens errors
    and surfaces are larger."""

    blocks: tuple[float, float] = (8.0, 5.0)  # along the longer side, two divisions
    outside: float = 3.0  # along each side, for the points on no patch, where every patch is a part of its own
    fewest: int = 8  # parts with matches: fewer do not tell a scatter
    # degree of the polynomials that smooth fields are sums of: that of radial distortion
    degree: int = 3
    # px, least and most 1-sigma of their coefficients: nothing beside noise, and as large as errors of rectification
    # and rolling shutters are
    amplitude_px: tuple[float, float] = (1e-3, 1.0)
    amplitudes: int = 40  # compared between them, each a fifth more than the last: a sigma need not be known better


SCATTER = ScatterTunables()


class Linear(NamedTuple):
    """The joint problem linearised at a solution, planes eliminated, in units of the noise of matches and its gain.

    Rows are points of patches along their epipolar lines, then all across, those of patches first.

    motion (5, rows): derivatives by the motion (w, T along `tangent_basis(T)`).  residual (rows,).
    fields (q, rows): by the coefficients of smooth fields, px.  point (rows,): index in `place`.
    place (n, 2) px of image 1, the `n_free` points on no patch first.  patch (n - n_free,) of the others.
    """

    motion: FloatArray
    residual: FloatArray
    fields: FloatArray
    point: IntArray
    place: FloatArray
    n_free: int
    patch: IntArray


def with_scatter(solution: Solution, sightings: Sightings) -> Solution:
    """The solution, covariances of motion and normals larger by errors that many matches share.

    sightings : the points that the solution kept.  A motion with a prior keeps its covariance.
    """
    if solution.solver != "mle" or solution.prior_chi2 is not None:
        return solution
    linear = linearised(sightings, Settled.of(solution))
    if linear is None:
        return solution
    factor, amplitude = scatter_of(linear, sightings), amplitude_of(linear)
    other = solution.ambiguity.alternative
    if other is not None:
        there = linearised(sightings, Settled.of(other))
        other = other if there is None else _widened(other, there, factor, amplitude)
        solution = replace(solution, ambiguity=replace(solution.ambiguity, alternative=other))
    return _widened(solution, linear, factor, amplitude)


def _widened(root: Solution, linear: Linear, factor: float, amplitude: float) -> Solution:
    """One root, the variance of its motion times a factor or with that by smooth fields; normals follow the motion."""
    turn = np.eye(5)
    turn[3:, 3:] = root.tangent.T @ tangent_basis(root.T)
    absorbed, noise = absorbed_of(linear, amplitude)
    added, gain = (factor - 1.0) * root.motion_covariance, root.normal_gain
    if np.trace(np.linalg.solve(noise, absorbed)) > 5.0 * (factor - 1.0):
        added = turn @ absorbed @ turn.T
    return replace(
        root,
        motion_covariance=root.motion_covariance + added,
        normal_covariance=root.normal_covariance + gain @ added @ gain.swapaxes(1, 2),
    )


@one_blas_thread()
def linearised(sightings: Sightings, settled: Settled) -> Linear | None:
    """The joint problem at a solution; None if the points determine no motion."""
    sightings, settled = with_planes(sightings, settled)
    camera = sightings.cameras[1]
    place = sightings.uv1 / max(sightings.cameras[0].width, sightings.cameras[0].height)
    fields = _smooth_fields(2.0 * (place - place.mean(axis=0))) / camera.focal_px
    try:
        seen = observe(*sightings.rays(), sightings.patch, sightings.weight)
        rows = whitened_rows(seen, settled, np.zeros_like(fields), fields[:, :, seen.order])
        left = eliminated(seen, rows)[0] / sightings.gain
    except DegenerateConfiguration:
        return None
    k, n = seen.n_free, len(seen.weight)
    point = np.concatenate([np.arange(k, k + n), np.arange(k, k + n), np.arange(k)])
    patch = np.repeat(np.arange(seen.n_patches), seen.count)
    return Linear(left[:5], left[-1], left[5:-1], point, sightings.uv1[seen.order], k, patch)


# ---- smooth fields ----


def _smooth_fields(place: FloatArray) -> FloatArray:
    """(q, 2, n) displacements at places (n, 2), -1..1: products of Chebyshev polynomials along either axis."""
    u, v = np.polynomial.chebyshev.chebvander(place.T, SCATTER.degree)
    degrees = [(i, j) for i in range(SCATTER.degree + 1) for j in range(SCATTER.degree + 1 - i)]
    one = np.array([u[:, i] * v[:, j] for i, j in degrees])
    none = np.zeros_like(one)
    return np.concatenate([np.stack([one, none], axis=1), np.stack([none, one], axis=1)])


def amplitude_of(linear: Linear) -> float:
    """1-sigma of the coefficients of smooth fields, px, that is likeliest by what the motion leaves of them; 0 if none
    is likelier."""
    across = linear.fields.copy()
    across[:, : len(linear.patch)] = 0.0  # along the lines, ground that is not flat looks like a smooth field
    left, _, residual = _beside_motion(linear._replace(fields=across))
    values, vectors = np.linalg.eigh(left @ left.T)
    asked = vectors.T @ (left @ residual)
    told = values > 1e-6 * max(float(values[-1]), np.finfo(float).tiny)  # the rest is rounding
    values, asked = values[told], asked[told]
    amplitudes = np.append(0.0, np.geomspace(*SCATTER.amplitude_px, SCATTER.amplitudes))
    variance = values + values**2 * amplitudes[:, None] ** 2
    return float(amplitudes[np.argmin((np.log(variance) + asked**2 / variance).sum(axis=1))])


def absorbed_of(linear: Linear, amplitude: float) -> tuple[FloatArray, FloatArray]:
    """Covariances (5, 5) of the motion by smooth fields of this amplitude (px), as far as the residuals leave these
    open, and by noise."""
    left, response, _ = _beside_motion(linear)
    noise = np.asarray(np.linalg.inv(lifted(linear.motion @ linear.motion.T)))
    if amplitude == 0.0:
        return np.zeros((5, 5)), noise
    known = left @ left.T + np.eye(len(left)) / amplitude**2
    return np.asarray(response @ np.linalg.solve(known, response.T)), noise


def _beside_motion(linear: Linear) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Fields (q, rows) beside what the motion absorbs of them, how it does (5, q), and the residual (rows,) alike."""
    rows, both = linear.motion, np.vstack([linear.fields, linear.residual])
    response = np.asarray(np.linalg.solve(lifted(rows @ rows.T), rows @ both.T), float)
    left = both - response.T @ rows
    return left[:-1], response[:, :-1], left[-1]


# ---- scatter of parts ----


def scatter_of(linear: Linear, sightings: Sightings) -> float:
    """Variance of the motion by the scatter of parts of the image over that by noise, mean over its five coordinates.

    The largest of three divisions; 1 where it is less, or the parts are too few.
    """
    rows, place, camera = linear.motion, linear.place, sightings.cameras[0]
    covariance = np.asarray(np.linalg.inv(lifted(rows @ rows.T)))
    asked = rows * (linear.residual - rows.T @ (covariance @ (rows @ linear.residual)))
    divisions = [_numbers(place / max(camera.width, camera.height) * blocks) for blocks in SCATTER.blocks]
    outside = _numbers(place[: linear.n_free] / (camera.width, camera.height) * SCATTER.outside)
    divisions.append(np.concatenate([outside, linear.patch + outside.max(initial=-1) + 1]))
    return max(*(_excess(asked, covariance, parts[linear.point]) for parts in divisions), 1.0)


def _excess(asked: FloatArray, covariance: FloatArray, part: IntArray) -> float:
    """Trace of the scatter of the motion by parts of the image times the inverse of the covariance by noise, over 5.

    asked (5, rows): gradient of each row.  covariance (5, 5): of independent noise.  part (rows,): number of its part.
    """
    sums = np.array([np.bincount(part, one) for one in asked])
    count = int(np.count_nonzero(np.bincount(part)))
    if count < SCATTER.fewest:
        return 1.0
    return float(np.einsum("ib,ij,jb->", sums, covariance, sums)) / 5.0 * count / (count - 1)


def _numbers(place: FloatArray) -> IntArray:
    """(n,) number of the unit square that each place (n, 2) lies in, 0 upward."""
    if not len(place):
        return np.zeros(0, np.int64)
    column, line = np.floor(place - place.min(axis=0)).astype(np.int64).T
    return np.asarray(line * (column.max() + 1) + column)
