"""Homography alignment (HA) as printed in the paper, and the averaged Longuet-Higgins motion it is compared with."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from slopecli.errors import DegenerateConfiguration
from slopecli.geometry.epipolar import direction_angle, nearest_rotation, rotation_angle
from slopecli.geometry.homography import PlaneMotion, decompose_homography, fit_homography, homography_rows, is_visible
from slopecli.geometry.solver.joint import Fit, ranked
from slopecli.geometry.solver.observations import (
    Observations,
    QuadraticForm,
    isotropic,
    observe,
    patch_moments,
    predict,
)
from slopecli.geometry.solver.refinement import Refined, State, optimal_normals
from slopecli.geometry.solver.uncertainty import information_system
from slopecli.types import FloatArray, IntArray, Solution


class Alignment(NamedTuple):
    """One root of homography alignment: motion, scaled normals (m, 3), mean reprojection error, sweeps taken."""

    R: FloatArray
    T: FloatArray
    normals: FloatArray
    error: float
    sweeps: int
    converged: bool


def align_homographies(
    x1: FloatArray, x2: FloatArray, patch: IntArray, tolerance: float = 1e-4, max_sweeps: int = 100
) -> list[Alignment]:
    """Homography alignment: one homography a patch, all consistent with one epipolar geometry.

    Source: Cheng, section III, steps 1-8. Departs from the paper: the sweeps stop when the mean reprojection error
    changes by less than `tolerance` of itself, because no absolute error suits every camera; K keeps its value when
    all patches are exactly coplanar, where eq. (17) does not determine it. Points on no patch have no place in it.

    Parameters
    ----------
    x1, x2 : (n, 2) normalised coordinates; patch : (n,) labels 0..m-1, -1 = on no plane (ignored).

    Returns
    -------
    roots : one alignment for each visible motion of the base patch, smaller reprojection error first.

    Raises
    ------
    InputError, DegenerateConfiguration : as `solve_planes`; also when the base patch has fewer than four points.
    """
    return _align(observe(x1, x2, patch), tolerance, max_sweeps)


def _align(observations: Observations, tolerance: float = 1e-4, max_sweeps: int = 100) -> list[Alignment]:
    base = int(observations.largest_first()[0])  # step 1: largest in scene
    x1, x2 = _points(observations, base)
    H1 = fit_homography(x1, x2)
    roots = decompose_homography(H1, x1)  # step 2
    # both roots are run, and the one with the smaller reprojection error is the answer
    aligned = [_align_root(observations, base, H1, root, tolerance, max_sweeps) for root in roots]
    return sorted(aligned, key=lambda alignment: alignment.error)


def _points(observations: Observations, patch: int) -> tuple[FloatArray, FloatArray]:
    inside = slice(observations.first[patch], observations.first[patch] + observations.count[patch])
    return observations.p[:2, inside].T, observations.x2[:, inside].T


def _align_root(
    observations: Observations, base: int, H1: FloatArray, root: PlaneMotion, tolerance: float, max_sweeps: int
) -> Alignment:
    H1 = H1 / H1[2, 2]  # eq. (5): the last entry is 1
    K = root.R @ root.T  # step 2
    error, settled, sweeps = np.inf, False, 0
    while not settled and sweeps < max_sweeps:
        sweeps += 1
        delta_normals = solve_delta_normals(observations, base, H1, K)  # step 3
        H1, K = solve_base_homography(observations, delta_normals, K)  # step 4
        previous, error = error, reprojection_error(observations, H1, K, delta_normals)  # steps 5 and 6
        settled = abs(previous - error) <= tolerance * error or error < 1e-12
    motion = _nearest_root(H1, root, _points(observations, base)[0])  # step 7
    K, s1 = motion.R @ motion.T, _scale(H1, motion)
    delta_normals = solve_delta_normals(observations, base, H1, K)  # step 8
    normals = motion.N - delta_normals / s1  # eq. (10): delta N_i = s1 (N1 - N_i)
    error = reprojection_error(observations, H1, K, delta_normals)
    return Alignment(motion.R, motion.T, normals, error, sweeps, settled)


def solve_delta_normals(
    observations: Observations, base: int, base_homography: FloatArray, epipole2: FloatArray
) -> FloatArray:
    """Fit every patch's normal offset (m, 3), the paper's s1 (N1 - N_i), for a given base homography and epipole K.

    Source: Cheng, eqs. (12)-(13). Minimises ||V dN - b|| patch by patch; the offset of the base is 0 by definition.
    DegenerateConfiguration if all points of a patch lie at the epipole, where no plane can be seen.
    """
    y = base_homography @ observations.p
    a = epipole2[:2, None] - epipole2[2] * observations.x2  # eq. (12): V1 = a1 P, V2 = a2 P
    b = observations.x2 * y[2] - y[:2]  # eq. (13), right-hand side
    squared, mixed = (a * a).sum(axis=0), (a * b).sum(axis=0)
    sums = observations.sum_patches(observations.products * squared)
    normal_matrix = sums[[0, 1, 2, 1, 3, 4, 2, 4, 5]].T.reshape(-1, 3, 3)
    right = observations.sum_patches(observations.p * mixed).T
    try:
        delta_normals = np.linalg.solve(normal_matrix, right[:, :, None])[:, :, 0]
    except np.linalg.LinAlgError as error:
        raise DegenerateConfiguration("a patch lies at the epipole, where its plane cannot be seen") from error
    delta_normals[base] = 0.0
    return np.asarray(delta_normals, dtype=np.float64)


def solve_base_homography(
    observations: Observations, delta_normals: FloatArray, epipole2: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The base homography, last entry 1, and the epipole K that fit given normal offsets (m, 3) best.

    Source: Cheng, eqs. (14)-(17): 11 unknowns, linear. If all offsets are 0, K is undetermined and left as it is.
    """
    rows = homography_rows(observations.p.T, observations.x2.T)  # eq. (14), eq. (15): the part of H1
    M, B = rows[:, :8], -rows[:, 8]  # eq. (16)
    offset = (observations.per_point(delta_normals.T) * observations.p).sum(axis=0)
    if np.abs(offset).max() > 1e-12:
        u, v = observations.x2
        zero = np.zeros_like(offset)
        # eq. (14), eq. (15): the part of K
        M = np.hstack([M, np.block([[offset, zero], [zero, offset], [-u * offset, -v * offset]]).T])
    G = np.linalg.lstsq(M, B, rcond=None)[0]  # eq. (17)
    H1 = np.append(G[:8], 1.0).reshape(3, 3)
    return np.asarray(H1), np.asarray(G[8:] if len(G) == 11 else epipole2)


def reprojection_error(
    observations: Observations, base_homography: FloatArray, epipole2: FloatArray, delta_normals: FloatArray
) -> float:
    """Mean distance in image 2 between found and predicted points, normalised coordinates (steps 5 and 6)."""
    H = base_homography + epipole2[:, None] * delta_normals[:, None, :]  # eq. (11)
    y = (observations.per_point(H.transpose(1, 2, 0)) * observations.p).sum(axis=1)
    return float(np.linalg.norm(y[:2] / y[2] - observations.x2, axis=0).mean())


def _nearest_root(H1: FloatArray, root: PlaneMotion, x1: FloatArray) -> PlaneMotion:
    """The decomposition of the aligned base homography nearest to the root it started from, visible if any is."""
    candidates = decompose_homography(H1)
    candidates = [c for c in candidates if is_visible(c, x1)] or candidates
    return min(candidates, key=lambda c: motion_distance(c, root))


def motion_distance(a: PlaneMotion | Solution, b: PlaneMotion | Solution) -> float:
    """Angle between two motions, rotation and direction added up, rad."""
    return float(rotation_angle(a.R, b.R) + direction_angle(a.T, b.T))


def _scale(H: FloatArray, motion: PlaneMotion) -> float:
    """s in H = s R (I - T N^T), eq. (9), by least squares over the nine entries."""
    unit = motion.R - (motion.R @ motion.T)[:, None] * motion.N
    return float((H * unit).sum() / (unit * unit).sum())


def average_motion(observations: Observations) -> State:
    """Mean of the patches' own Longuet-Higgins motions, the comparison of the paper's Figure 4.

    Rotations are averaged in the least-squares sense (nearest rotation to their sum), directions as unit vectors. Of a
    patch with two visible roots, the one nearest to the motion most patches agree on is used. Normals are the patches'
    own; a patch of three points, or without a visible root, gets the best normal under the mean motion.
    """
    roots_of = [_patch_roots(observations, i) for i in range(observations.n_patches)]
    if not any(roots_of):
        raise DegenerateConfiguration("no patch by itself has a plane in front of both cameras; use solver mle")
    agreed = _agreed(roots_of)
    chosen = [min(roots, key=lambda c: motion_distance(c, agreed)) if roots else None for roots in roots_of]
    R = nearest_rotation(np.sum([c.R for c in chosen if c], axis=0))
    T = np.sum([c.T for c in chosen if c], axis=0)
    state = _best_normals(observations, R, T / np.linalg.norm(T))
    for i, root in enumerate(chosen):
        if root:
            state.N[0, i] = root.N
    return state


def _agreed(roots_of: list[list[PlaneMotion]]) -> PlaneMotion:
    """The root of a patch with the least sum of distances to the nearest roots of all patches.

    Candidates come from at most 64 patches, so that the work grows linearly with their number.
    """
    present = [roots for roots in roots_of if roots]
    first, last = ([roots[i] for roots in present] for i in (0, -1))  # the same where there is one
    chosen = np.unique(np.linspace(0, len(present) - 1, 64).astype(int))
    references = [c for patch in chosen for c in present[patch]]
    least = np.minimum(_motion_distances(references, first), _motion_distances(references, last))
    return references[int(np.argmin(least.sum(axis=1)))]


def _motion_distances(a: list[PlaneMotion], b: list[PlaneMotion]) -> FloatArray:
    """(len(a), len(b)) angles between rotations and between directions, added up, rad."""
    R, T = (np.stack(v) for v in zip(*((c.R, c.T) for c in b), strict=True))
    return np.array([rotation_angle(c.R, R) + direction_angle(c.T, T) for c in a])


def _best_normals(observations: Observations, R: FloatArray, T: FloatArray) -> State:
    """Linear least-squares normals under a given motion, in two rounds: the second has the depths of the first."""
    R, T, m = R[None], T[None], observations.n_patches
    weight = observations.weight[None]
    state = State(R, T, np.zeros((1, m, 3)))
    for _ in range(2):
        z = predict(observations, *state).depth_ratio
        moments = patch_moments(observations, observations.x2[None], isotropic(weight / z**2))
        form = QuadraticForm(moments, np.zeros((1, m, 9)), None, None, np.zeros(1))
        state, _ = optimal_normals(R, T, form)
    return state


def _patch_roots(observations: Observations, patch: int) -> list[PlaneMotion]:
    x1, x2 = _points(observations, patch)
    if len(x1) < 4:
        return []
    try:
        return decompose_homography(fit_homography(x1, x2), x1)
    except DegenerateConfiguration:
        return []


def closed_form(observations: Observations, solver: Literal["ha", "lh"]) -> Fit:
    """HA or averaged Longuet-Higgins as a `Fit`, so that both are reported like the joint solution.

    The information is that of an efficient estimator at this solution, with the noise of its residuals. Neither method
    is efficient, so their true errors are larger.
    """
    if solver == "ha":
        roots = _align(observations)
        state = State(*(np.stack(a) for a in zip(*(root[:3] for root in roots), strict=True)))
        converged, sweeps = np.array([root.converged for root in roots]), max(root.sweeps for root in roots)
    else:
        state, converged, sweeps = average_motion(observations), np.array([True]), 1
    system = information_system(observations, state)
    return ranked(observations, Refined(state, system, sweeps, converged), system.chi2)
