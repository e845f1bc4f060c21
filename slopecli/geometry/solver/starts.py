"""Starting motions of the joint refinement: closed form, from homographies and the essential matrix."""

from __future__ import annotations

import numpy as np

from slopecli.errors import DegenerateConfiguration
from slopecli.geometry.epipolar import decompose_essential, fit_rotation, skew
from slopecli.geometry.homography import longuet_higgins
from slopecli.geometry.solver.observations import Observations, QuadraticForm, isotropic, patch_moments
from slopecli.geometry.solver.refinement import State, levenberg_marquardt, optimal_normals
from slopecli.types import FloatArray, IntArray

START_ROUNDING = 1e-15  # of chi-square per residual, where it is a difference of sums of order one
FEW_FREEDOM = 120  # degrees of freedom below which noise hides minima from closed forms: then every start is refined


def starting_states(observations: Observations, initial: list[tuple[FloatArray, FloatArray]]) -> State:
    """Refined, distinct motions with their normals, best chi-square first.

    Every start is a motion; its normals follow in closed form, which also gives its chi-square, so all starts are
    scored at once. The promising ones are refined on fixed quadratic forms, whose cost does not depend on the points.
    The planes of those returned lie in front of both cameras at the patch centres, if there are any such.

    initial : further motions (R, T) to start from.
    """
    few = observations.freedom() < FEW_FREEDOM
    if few:
        initial = [*initial, *_scattered_motions(observations)]
    moments = patch_moments(observations, observations.x2[None], isotropic(observations.weight[None]))[0]
    homographies, essential = _null_vectors(observations, moments, observations.n_patches if few else 2)
    weighted = patch_moments(observations, observations.x2[None], _depth_weights(observations, homographies[0]))
    R, T = _candidate_motions(homographies, essential, initial)
    n_closed = len(R) - len(initial)
    sample = _sample(observations)
    form = _form(observations, weighted[:, sample], R, T)
    state, chi2 = _scored(observations, R, T, form, sample)
    dof = observations.residual_count()
    if not np.isfinite(chi2).any():
        raise DegenerateConfiguration("no motion maps the correspondences; check that their points are in two images")
    if few:
        keep = [i for i in range(len(chi2)) if np.isfinite(chi2[i])]
    else:
        keep = _promising(chi2, 2 * len(homographies), n_closed, dof)
    form = _form(observations, weighted[:, sample], R[keep], T[keep])
    # chi-square is a difference of sums of order dof here, exact only to their rounding
    refined = levenberg_marquardt(
        state.pick(keep),
        lambda _: form,
        dof,
        tolerance=1.0,
        rounding=START_ROUNDING,
        max_iterations=1 if few else 2,
    )
    state = refined.state
    order = state.distinct(_plausible(refined.system.chi2, dof))
    if isinstance(sample, slice):
        return state.pick(order)
    R, T = state.R[order], state.T[order]
    return _scored(observations, R, T, _form(observations, weighted, R, T))[0]


def states_of(observations: Observations, motions: list[tuple[FloatArray, FloatArray]]) -> State:
    """Motions (R, T) that are known, with the normals that fit the points best under each.

    Raises
    ------
    DegenerateConfiguration : no normals fit under any of them.
    """
    R = np.stack([rotation for rotation, _ in motions])
    T = np.stack([direction / np.linalg.norm(direction) for _, direction in motions])
    moments = patch_moments(observations, observations.x2[None], isotropic(observations.weight[None]))
    state, chi2 = _scored(observations, R, T, _form(observations, moments, R, T))
    if not np.isfinite(chi2).any():
        raise DegenerateConfiguration(
            "no motion given maps the correspondences; check that their points are in two images"
        )
    return state.pick(np.flatnonzero(np.isfinite(chi2)).tolist())


def largest_worth_trying(best: float, n_residuals: int) -> float:
    """Chi-square beyond which a start or root is left out: ten times the best one and by more than 1000."""
    return (10.0 + 1000.0 / n_residuals) * _least([best], n_residuals)


def _plausible(chi2: FloatArray, dof: int) -> list[int]:
    """Starts by chi-square, best first, without those beyond `largest_worth_trying`."""
    values = chi2.tolist()
    limit = largest_worth_trying(min(values), dof)
    return [i for i in sorted(range(len(values)), key=values.__getitem__) if values[i] <= limit]


def _scattered_motions(observations: Observations, number: int = 32) -> list[tuple[FloatArray, FloatArray]]:
    """Motions in directions over half a sphere, for few points, from which closed forms are too noisy.

    Half a sphere suffices, as the sign of T follows from the visibility. The rotation is the best one without baseline.
    The directions turn about the optical axis with the points.
    """
    R = fit_rotation(*observations.all_points())
    k = np.arange(number)  # 32 are about 25 degrees apart
    height = (k + 0.5) / number
    turn = np.pi * (3.0 - np.sqrt(5.0)) * k + _turn_of_points(observations)
    across = np.sqrt(1.0 - height**2)
    return [(R, T) for T in np.column_stack([across * np.cos(turn), across * np.sin(turn), height])]


def _turn_of_points(observations: Observations) -> float:
    """An angle, rad, that turns about the optical axis with the points of both images, whatever their order.

    That of the mean of the points as complex numbers, or of their squares, cubes, ... where they are symmetric.
    """
    p, x2, weight = observations.all_points()
    z = np.concatenate([p[0] + 1j * p[1], x2[0] + 1j * x2[1]])
    weight = np.concatenate([weight, weight])
    for fold in range(1, 7):
        power = z**fold
        mean = complex(power @ weight)
        if abs(mean) > 1e-3 * float(np.abs(power) @ weight):
            return float(np.angle(mean)) / fold
    return 0.0


def _least(chi2: list[float], n_residuals: int) -> float:
    """The best chi-square plus its rounding; that of exact fits may be below 0."""
    return max(min(chi2), 0.0) + n_residuals * START_ROUNDING


def _null_vectors(observations: Observations, moments: FloatArray, most: int) -> tuple[FloatArray, FloatArray | None]:
    """Linear homographies of all points and of the largest patches (k, 3, 3), and an essential matrix (3, 3).

    The essential matrix is None if several fit to rounding, as they do where all points lie on one plane exactly.
    Coordinates are shifted and scaled to unit spread first (Hartley, "In defense of the eight-point algorithm", PAMI
    1997), which matters most for a narrow field of view.

    most : number of patches; those of three points only, which have no homography of their own, come last.
    """
    largest = observations.largest_first()[:most]
    stacked = np.concatenate([moments.sum(axis=0)[None], moments[largest], _essential_moments(observations)[None]])
    C1, C2 = _conditioner(observations.p[:2]), _conditioner(observations.x2)
    # H = C2^-1 H' C1 and E = C2^T E' C1 for the conditioned H' and E', vec row by row
    back = np.stack([np.linalg.inv(C2)] * (len(stacked) - 1) + [C2.T])
    M = (back[:, :, None, :, None] * C1.T[:, None, :]).reshape(-1, 9, 9)
    values, conditioned = np.linalg.eigh(M.swapaxes(1, 2) @ stacked @ M)
    vectors = (M @ conditioned[:, :, :1]).reshape(-1, 3, 3)
    determined = values[-1, 1] > 1e-12 * values[-1, -1]
    return vectors[:-1], vectors[-1] if determined else None


def _conditioner(x: FloatArray) -> FloatArray:
    """(3, 3) shift and scale that bring points (2, n) to mean 0 and unit spread."""
    u, v = (x.sum(axis=1) / x.shape[1]).tolist()
    variance = float(np.vdot(x, x)) / x.shape[1] - u * u - v * v
    scale = max(0.5 * variance, 1e-18) ** -0.5
    return np.array([[scale, 0.0, -scale * u], [0.0, scale, -scale * v], [0.0, 0.0, 1.0]])


def _essential_moments(observations: Observations) -> FloatArray:
    """(9, 9) moments of x2~ (x) x1~ over every correspondence, on patches or not."""
    p1, x2, weight = observations.all_points()
    products = (np.concatenate([x2, np.ones((1, len(weight)))])[:, None] * p1).reshape(9, -1)
    return (products * weight) @ products.T


def _depth_weights(observations: Observations, H: FloatArray) -> FloatArray:
    """Weights over the squared depth ratio, which is approximated by one homography of all points."""
    z = (H[2] / np.linalg.svd(H, compute_uv=False)[1]) @ observations.p
    typical = z.mean()
    z = np.clip(z / typical, 0.3, 3.0) * abs(typical)
    return isotropic((observations.weight / (z * z))[None])


def _candidate_motions(
    homographies: FloatArray, essential: FloatArray | None, initial: list[tuple[FloatArray, FloatArray]]
) -> tuple[FloatArray, FloatArray]:
    """R (s, 3, 3), T (s, 3): both roots of each homography in turn, both rotations of E, then the caller's motions."""
    R, T, _ = longuet_higgins(homographies, rounding=1e-11)
    rotations, directions = [R.reshape(-1, 3, 3)], [T.reshape(-1, 3)]
    if essential is not None:
        R_essential, T_essential = decompose_essential(essential)
        rotations.append(R_essential)
        directions.append(np.stack([T_essential, T_essential]))
    for R_given, T_given in initial:
        rotations.append(R_given[None])
        directions.append(T_given[None] / np.linalg.norm(T_given))
    return np.concatenate(rotations), np.concatenate(directions)


def _sample(observations: Observations, most: int = 64) -> IntArray | slice:
    """Patches that determine the motion of a start: all, or the largest and as many evenly spread over the others."""
    m = observations.n_patches
    if m <= most:
        return slice(None)
    order = observations.largest_first()
    return np.union1d(order[: most // 2], order[np.linspace(0, m - 1, most // 2).astype(np.int64)])


def _form(observations: Observations, moments: FloatArray, R: FloatArray, T: FloatArray) -> QuadraticForm:
    """Fixed form: moments (1, m, 9, 9) for patch points, epipolar distances at the given motions for the rest."""
    s = len(R)
    zero = np.zeros((1, moments.shape[1], 9))
    if not observations.n_free:
        return QuadraticForm(moments, zero, None, None, np.zeros(s))
    lines = (R @ skew(T)) @ observations.free1
    squared = (lines[:, :2] ** 2).sum(axis=1)
    squared = np.maximum(squared, 0.01 * squared.mean(axis=1, keepdims=True))
    found = np.concatenate([observations.free2, np.ones((1, observations.n_free))])
    rows = (found[:, None] * observations.free1).reshape(9, -1)
    AE = (rows * (observations.free_weight / squared)[:, None]) @ rows.T
    return QuadraticForm(moments, zero, AE, np.zeros((s, 9)), np.zeros(s))


def _scored(
    observations: Observations,
    R: FloatArray,
    T: FloatArray,
    form: QuadraticForm,
    sample: IntArray | slice = slice(None),
) -> tuple[State, FloatArray]:
    """Motions with their best normals, T signed so that planes lie in front, and chi-square, inf where they do not.

    It is inf, too, for motions of a singular homography, which are no numbers.
    """
    state, chi2 = optimal_normals(R, T, form)
    count = observations.count[sample]
    centres = observations.sum_patches(observations.p)[:, sample] / count
    inverse_depth = (state.N * centres.T).sum(axis=2)
    sign = np.where(np.sign(inverse_depth) @ count < 0.0, -1.0, 1.0)
    T, N, inverse_depth = T * sign[:, None], state.N * sign[:, None, None], inverse_depth * sign[:, None]
    depth_ratio = R[:, 2] @ centres - (R[:, 2] * T).sum(axis=1)[:, None] * inverse_depth
    in_front = ((inverse_depth > 0.0) & (depth_ratio > 0.0)) @ count
    possible = in_front >= 0.5 * count.sum()
    return State(R, T, N), np.where((possible | ~possible.any()) & np.isfinite(chi2), chi2, np.inf)


def _promising(chi2: FloatArray, n_homographies: int, n_closed: int, n_residuals: int) -> list[int]:
    """Which starts to refine: those of the homographies, then those of E up to n_closed, then the caller's.

    Both roots of the homography of all points, the best of E and the best of another homography (both of its roots if
    it is the best of all), unless their chi-square is 30 times that of the best; and all of the caller's. Roots are
    kept in pairs, because two noisy versions of one root may score better than the other root.
    """
    values = chi2.tolist()
    best = min(range(2, n_homographies), key=values.__getitem__)
    candidates = [0, 1, *sorted(range(n_homographies, n_closed), key=values.__getitem__)[:1], best]
    if values[best] <= min(values[i] for i in candidates):
        candidates.append(best ^ 1)
    limit = 30.0 * _least(values, n_residuals)
    keep = [i for i in candidates if values[i] <= limit]
    keep += [i for i in range(n_closed, len(values)) if np.isfinite(values[i])]
    return keep or [min(range(len(values)), key=values.__getitem__)]
