"""Whether the matches agree with the intrinsics: one Gauss-Newton step of the joint solution with these free as well.

A wrong focal length, principal point or radial term bends the epipolar lines and the planes, and motion and normals
absorb only part of it. The step says what the rest asks for, and with which 1-sigma. Each parameter is free alone,
beside the 5 + 3m of the joint solution; both cameras change alike. Residuals are split across the epipolar line, where
there is noise only, and along it, where there is relief too; a point on no plane has only the first. The normals are
eliminated patch by patch (Schur complement), as in `refinement`.

Matches of neighbouring pixels err alike, and lenses and planes are never exactly as modelled, so the 1-sigma is the
largest of three: that of independent residuals times their measured correlation gain, and those by the scatter of
what blocks of the image, and patches, ask for (White, "Maximum likelihood estimation of misspecified models", 1982).
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from slopecli.errors import DegenerateConfiguration
from slopecli.geometry.camera import pixels_from_rays
from slopecli.geometry.epipolar import homogeneous, skew, tangent_basis
from slopecli.geometry.solver.observations import FINEST_RESIDUAL, Observations, observe, predict, spans_plane
from slopecli.geometry.solver.one_thread import one_blas_thread
from slopecli.geometry.solver.priors import MotionPrior
from slopecli.geometry.solver.seen_points import Sightings, changed
from slopecli.geometry.statistics import median
from slopecli.types import Camera, FloatArray, IntArray, Solution

PARAMETERS = ("f", "cx", "cy", "k1")
BLOCK_PX = 64.0  # side of the blocks of image 1 whose errors count as independent; within 16 px they are not


class Settled(NamedTuple):
    """A solution, as far as the score needs it; fields as of `types.Solution`."""

    R: FloatArray
    T: FloatArray
    scaled_normals: FloatArray
    noise: float
    relief: FloatArray

    @classmethod
    def of(cls, solution: Solution) -> Settled:
        """That part of a solution."""
        return cls(solution.R, solution.T, solution.scaled_normals, solution.noise, solution.relief)


def with_planes(sightings: Sightings, settled: Settled) -> tuple[Sightings, Settled]:
    """The same without the planes that fewer than three of the points are on, or points on one line.

    These points are then on none.
    """
    x, y = sightings.rays()[0].T
    number = sightings.patch + 1
    sums = np.array([np.bincount(number, row, len(settled.scaled_normals) + 1)[1:] for row in _products(x, y)])
    with np.errstate(invalid="ignore", divide="ignore"):  # of planes without points
        enough = (sums[5] >= 3) & spans_plane(sums)
    number = np.append(np.where(enough, np.cumsum(enough) - 1, -1), -1)
    planes = settled._replace(scaled_normals=settled.scaled_normals[enough], relief=settled.relief[enough])
    return replace(sightings, patch=number[sightings.patch]), planes


def _products(x: FloatArray, y: FloatArray) -> FloatArray:
    """(6, n) products of points that `spans_plane` sums."""
    return np.array([x * x, x * y, x, y * y, y, np.ones_like(x)])


class CameraScore(NamedTuple):
    """What the matches ask for of each of `PARAMETERS` (4,), free alone, and how motion and normals follow the first.

    step : change of the parameter, as of `changed`.  sigma : 1-sigma of it.  px : RMS change of residuals, px of
    image 2, for a unit change, after motion and normals have followed.  noise_px : 1-sigma of the median match across
    its epipolar line.
    motion (5,), normals (m, 3) : derivatives by log f of the motion (w, T along its tangent) and the scaled normals.
    """

    step: FloatArray
    sigma: FloatArray
    px: FloatArray
    noise_px: float
    motion: FloatArray
    normals: FloatArray


class Rows(NamedTuple):
    """Whitened rows: patch points along their epipolar lines, then all across; columns (..., rows) of the motion (5),
    of q other parameters and of the residual (1). normal (3, n): derivatives along by the own normal."""

    along: FloatArray
    across: FloatArray
    normal: FloatArray


@one_blas_thread()
def score_camera(sightings: Sightings, settled: Settled, prior: MotionPrior | None = None) -> CameraScore:
    """Score the cameras of sightings at a solution of them; the points that it left out count for nothing here.

    prior : on the motion, which then follows the focal length less; the step is that of the images alone.

    Raises
    ------
    DegenerateConfiguration : a patch has fewer than three points, or collinear ones.
    """
    x1, x2 = sightings.rays()
    d1, d2 = (_by_parameters(camera, x) for camera, x in zip(sightings.cameras, (x1, x2), strict=True))
    seen = observe(x1, x2, sightings.patch, sightings.weight)
    if seen.n_patches != len(settled.scaled_normals):
        raise DegenerateConfiguration("no point of the last patch was kept; nothing to test the cameras with")
    rows = whitened_rows(seen, settled, d1[:, :, seen.order], d2[:, :, seen.order])
    for part in (rows.along, rows.across):
        part[5] += part[-1]  # residuals are those of pixels, which are as many more as f is longer

    left, response = eliminated(seen, rows)
    on_plane = rows.along.shape[1]

    # motion eliminated
    G = left @ left.T
    moved = np.linalg.solve(lifted(G[:5, :5]), G[:5, 5:])
    left = left[5:] - moved.T @ left[:5]
    g, r = left[:4], left[4]
    information = np.maximum((g * g).sum(axis=1), np.finfo(float).tiny)
    step = -(g @ r) / information

    place = sightings.uv1[seen.order]
    sigma = _sigma(g, r, step, information, seen, place, sightings)
    held = G[:5, :5] if prior is None else G[:5, :5] + _held(prior, settled)
    motion = np.asarray(-np.linalg.solve(lifted(held), G[:5, 5]))
    normals = -response[:, :, 5] - response[:, :, :5] @ motion
    unit = max(settled.noise, FINEST_RESIDUAL) * sightings.cameras[1].focal_px / np.sqrt(median(sightings.weight))
    across = r[on_plane:]
    noise_px = float(np.sqrt(across @ across / max(len(across) - 6, 1)) * unit)
    return CameraScore(step, sigma, np.sqrt(information / left.shape[1]) * unit, noise_px, motion, normals)


def eliminated(seen: Observations, rows: Rows) -> tuple[FloatArray, FloatArray]:
    """Rows (6 + q, along and then across) once the normals have followed, and their response (m, 3, 6 + q)."""
    V = seen.sum_patches(rows.normal[:, None] * rows.normal)
    X = seen.sum_patches(rows.normal[:, None] * rows.along)
    response = np.asarray(np.linalg.solve(lifted(V.transpose(2, 0, 1)), X.transpose(2, 0, 1)), float)
    along = rows.along - (rows.normal[:, None] * seen.per_point(response.transpose(1, 2, 0))).sum(axis=0)
    return np.concatenate([along, rows.across], axis=1), response


def _by_parameters(camera: Camera, x: FloatArray) -> FloatArray:
    """(4, 2, n) derivatives of the normalised coordinates (n, 2) of fixed pixels by each of `PARAMETERS`."""
    u, v = x.T
    square = u * u + v * v
    moved = np.zeros((4, 2, len(x)))
    if camera.model == "pinhole":
        moved[0] = -x.T
        moved[1, 0] = -camera.focal_px / camera.fx
        moved[2, 1] = -camera.focal_px / camera.fy
        moved[3] = -x.T * square
        return moved
    # the pixel of a fixed ray moves, and the lens takes that move back to the ray
    step = 1e-6
    pixels = pixels_from_rays(camera, x)
    columns = [(pixels_from_rays(camera, x + step * axis) - pixels) / step for axis in np.eye(2)]
    by_k1 = (pixels_from_rays(changed(camera, "k1", step), x) - pixels) / step
    shift = np.array([[camera.focal_px, 0.0], [0.0, camera.focal_px]])
    by = np.stack([pixels - (camera.cx, camera.cy), *np.broadcast_to(shift[:, None], (2, len(x), 2)), by_k1])
    (a, c), (b, d) = columns[0].T, columns[1].T
    determinant = a * d - b * c
    moved[:, 0] = -(d * by[:, :, 0] - b * by[:, :, 1]) / determinant
    moved[:, 1] = -(a * by[:, :, 1] - c * by[:, :, 0]) / determinant
    return moved


def whitened_rows(seen: Observations, settled: Settled, d1: FloatArray, d2: FloatArray) -> Rows:
    """Rows of the linearised problem; d1, d2 (q, 2, k + n): as of `_by_parameters`, points on no patch first."""
    R, T, N = settled.R, settled.T, settled.scaled_normals
    noise = max(settled.noise, FINEST_RESIDUAL)
    prediction = predict(seen, R[None], T[None], N[None])
    slide = prediction.slide[0]
    gain = np.maximum(np.hypot(*slide), np.finfo(float).tiny)
    e = slide / gain
    k = seen.n_free

    moves = np.empty((6 + len(d2), 2, len(seen.weight)))
    moves[:-1] = _image2_moves(seen, settled, prediction.x2[0], prediction.depth_ratio[0], d1[:, :, k:])
    moves[-1] = prediction.residual[0]
    moves[5:-1] -= d2[:, :, k:]
    lever = gain * prediction.inverse_depth[0]
    weight = np.maximum(seen.weight, np.finfo(float).tiny)
    by_along = 1.0 / np.sqrt(noise**2 / weight + (lever * seen.per_point(settled.relief)) ** 2)
    along = (moves * e).sum(axis=1) * by_along
    across = (moves[:, 1] * e[0] - moves[:, 0] * e[1]) * np.sqrt(seen.weight) / noise
    if k:
        free = _free_rows(seen, R, T, d1[:, :, :k], d2[:, :, :k], prediction.distance[0], prediction.length[0])
        across = np.concatenate([across, free * np.sqrt(seen.free_weight) / noise], axis=1)
    return Rows(along, across, seen.p * (gain * by_along))


def _image2_moves(seen: Observations, settled: Settled, x2: FloatArray, z: FloatArray, d1: FloatArray) -> FloatArray:
    """(5 + q, 2, n) how predictions x2 (2, n) move with the motion and, through the points of image 1, d1 (q, 2, n)."""
    R, T, N = settled.R, settled.T, settled.scaled_normals
    K = R @ T
    y = np.concatenate([x2 * z, z[None]])
    w = (seen.per_point(N.T) * seen.p).sum(axis=0)
    by_point = R[:, :2, None] - K[:, None, None] * seen.per_point(N.T)[None, :2]
    moves = np.empty((5 + len(d1), 3, len(z)))
    moves[:3] = skew(np.eye(3)) @ y
    moves[3:5] = -(R @ tangent_basis(T)).T[:, :, None] * w
    moves[5:] = (by_point[None] * d1[:, None]).sum(axis=2)
    return np.asarray((moves[:, :2] - x2 * moves[:, 2:]) / z)


def _free_rows(
    seen: Observations,
    R: FloatArray,
    T: FloatArray,
    d1: FloatArray,
    d2: FloatArray,
    distance: FloatArray,
    length: FloatArray,
) -> FloatArray:
    """(6 + q, k) derivatives of distances from epipolar lines by the motion and q parameters, and these distances."""
    E = R @ skew(T)
    p2 = homogeneous(seen.free2.T).T
    line2, line1 = E @ seen.free1, E.T @ p2
    rows = np.empty((6 + len(d2), seen.n_free))
    rows[:3] = np.cross(line2, p2, axis=0)
    rows[3:5] = tangent_basis(T).T @ np.cross(seen.free1, R.T @ p2, axis=0)
    rows[5:-1] = (line1[:2] * d1).sum(axis=1) + (line2[:2] * d2).sum(axis=1)
    rows[:-1] /= length
    rows[-1] = distance
    return rows


def _held(prior: MotionPrior, settled: Settled) -> FloatArray:
    """(5, 5) information of a prior on the motion (w, T along its tangent)."""
    P = np.zeros((6, 5))
    P[:3, :3], P[3:, 3:] = np.eye(3), tangent_basis(settled.T)
    return np.asarray(P.T @ prior.terms(settled.R[None], settled.T[None], 1.0)[0, :6, :6] @ P)


def with_focal_sigma(solution: Solution, score: CameraScore, sigma: float) -> Solution:
    """The solution, its covariances larger by what a 1-sigma of the focal length's logarithm does to it."""
    motion, normals = sigma * score.motion, sigma * score.normals
    return replace(
        solution,
        normal_covariance=solution.normal_covariance + normals[:, :, None] * normals[:, None, :],
        motion_covariance=solution.motion_covariance + np.outer(motion, motion),
        focal_shift=np.concatenate([normals.ravel(), motion]),
    )


def lifted(information: FloatArray) -> FloatArray:
    """Matrices (..., q, q) whose diagonal is lifted by rounding, so that singular ones can be solved."""
    trace = np.trace(information, axis1=-2, axis2=-1)[..., None, None]
    return np.asarray(information + (1e-13 * trace + np.finfo(float).tiny) * np.eye(information.shape[-1]))


def _sigma(
    g: FloatArray,
    r: FloatArray,
    step: FloatArray,
    information: FloatArray,
    seen: Observations,
    place: FloatArray,
    sightings: Sightings,
) -> FloatArray:
    """(4,) the largest of three 1-sigmas of the steps.

    g (4, rows), r (rows,): whitened derivatives and residuals; place (k + n, 2): pixels, points on no patch first.
    """
    k, n = seen.n_free, len(seen.weight)
    after = r + step[:, None] * g  # residuals once the step is taken
    asked = g * after
    by_point = np.concatenate([asked[:, 2 * n :], asked[:, :n] + asked[:, n : 2 * n]], axis=1)
    noise = np.sqrt((after**2).mean(axis=1))
    plain = noise * sightings.gain / np.sqrt(information)
    block = np.floor((place - place.min(axis=0)) / BLOCK_PX).astype(np.int64)
    coarse = np.floor(3.0 * (place - place.min(axis=0)) / (np.ptp(place, axis=0) + 1e-9)).astype(np.int64)
    windows = np.concatenate([3 * coarse[:k, 0] + coarse[:k, 1], 9 + np.repeat(np.arange(seen.n_patches), seen.count)])
    blocks = block[:, 0] * (block[:, 1].max() + 1) + block[:, 1]
    return np.maximum.reduce([plain, *(_scatter(by_point, c) / information for c in (blocks, windows))])


def _scatter(asked: FloatArray, cluster: IntArray) -> FloatArray:
    """(4,) 1-sigma of sums of `asked` (4, points), from the sums of clusters of points, which are independent."""
    _, cluster = np.unique(cluster, return_inverse=True)  # of points far outside any image, numbers are huge
    sums = np.array([np.bincount(cluster, row) for row in asked])
    count = sums.shape[1]
    return np.asarray(np.sqrt((sums**2).sum(axis=1) * count / max(count - 1, 1)))
