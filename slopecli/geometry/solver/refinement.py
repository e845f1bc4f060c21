"""Levenberg-Marquardt over one motion and all planes, several starts at once.

The normals are eliminated patch by patch (Schur complement over the 3x3 plane blocks), so the system of the motion is
6x6 for any number of patches. Its sixth parameter, the length of T, is a gauge and held fixed.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, TypeVar

import numpy as np

from slopecli.errors import DegenerateConfiguration
from slopecli.geometry.epipolar import LEVI_CIVITA, skew
from slopecli.geometry.solver.observations import QuadraticForm
from slopecli.types import BoolArray, FloatArray, IntArray

# (9, 27): vec(M) -> vec([e_k]x M) for k = 0, 1, 2
_ROTATE = np.einsum("kij,ab->jakib", LEVI_CIVITA, np.eye(3)).reshape(9, 27)
# (3, 27): K -> vec(K e_c^T) for c = 0, 1, 2
_SPREAD = np.einsum("ij,ca->icja", np.eye(3), np.eye(3)).reshape(3, 27)


NEAR = 1e-4  # of a residual variance: within about 0.01 standard errors of a minimum, where chi-square is a quadratic
MOST_STRETCH = 50.0  # of a step; by more, its components across the valley would matter


class State(NamedTuple):
    """s motions with their planes: R (s, 3, 3), T (s, 3) unit, N (s, m, 3) scaled normals."""

    R: FloatArray
    T: FloatArray
    N: FloatArray

    def pick(self, index: list[int] | IntArray | slice) -> State:
        """The motions with these indices."""
        return State(self.R[index], self.T[index], self.N[index])

    def distinct(self, order: list[int]) -> list[int]:
        """Of motions in the given order, those that repeat no earlier one to 2e-3 rad."""
        # the Frobenius norm of a difference of rotations is sqrt(2) times the small angle between them
        turned = np.sqrt(0.5 * ((self.R[:, None] - self.R) ** 2).sum(axis=(2, 3)))
        apart = np.maximum(turned, np.linalg.norm(self.T[:, None] - self.T, axis=2))
        kept: list[int] = []
        for i in order:
            if (apart[i, kept] > 2e-3).all():
                kept.append(i)
        return kept

    def homographies(self) -> FloatArray:
        """(s, m, 3, 3) H_i = R (I - T N_i^T), eq. (3)."""
        K = (self.R @ self.T[:, :, None])[:, None]
        return self.R[:, None] - K * self.N[:, :, None, :]


class System(NamedTuple):
    """Normal equations with the normals eliminated.

    chi2 (s,): value of the quadratic form here.  plane_block (s, m, 3, 3): V_i, information of N_i alone.
    response (s, m, 3, 7): V_i^-1 times the cross information with the motion (columns 0..5) and the gradient (6).
    reduced (s, 7, 7): information of the motion (w, T), its gradient in row and column 6, and in the corner the
    chi-square left (less constants) once the normals are optimal.
    by_normals (s,): decrease of chi-square by the best normals for the same motion.
    """

    chi2: FloatArray
    plane_block: FloatArray
    response: FloatArray
    reduced: FloatArray
    by_normals: FloatArray


def normal_equations(state: State, form: QuadraticForm) -> System:
    """Gauss-Newton normal equations of a quadratic form in the homographies and the essential matrix.

    Motion perturbations: R <- exp([w]x) R, T <- T + dT; planes: N_i <- N_i + dN_i.
    """
    R, T, N = state
    s, m = N.shape[:2]
    H = state.homographies().reshape(s, m, 9)
    G = np.empty((s, m, 10, 9))  # rows: d vec(H) / d (w, T), vec(H) itself, d vec(H) / d N
    G[:, :, :3] = (H @ _ROTATE).reshape(s, m, 3, 9)
    G[:, :, 3:6] = (R.swapaxes(1, 2)[:, None, :, :, None] * -N[:, :, None, None, :]).reshape(s, m, 3, 9)
    G[:, :, 6] = 0.0 if form.centred else H
    K = (R @ T[:, :, None])[:, None, :, 0]
    G[:, :, 7:] = -(K @ _SPREAD).reshape(s, 1, 3, 9)
    AG = G @ form.A
    AG[:, :, 6] += form.g
    F = AG @ G.swapaxes(2, 3)
    V, X = F[:, :, 7:, 7:], F[:, :, 7:, :7]
    X[:, :, :, 6] = F[:, :, 6, 7:]  # the gradient carries g, which only row 6 of F holds
    response = _solve_blocks(V, X)
    motion = np.add.reduce(F[:, :, :7, :7], axis=1)
    motion[:, :6, 6] = motion[:, 6, :6]
    motion[:, 6, 6] += form.constant
    if not form.centred:
        motion[:, 6, 6] += (form.g * H).sum(axis=(1, 2))
    if form.AE is not None and form.gE is not None:
        motion += _free_part(R, T, form.AE, form.gE, form.centred)
    if form.motion is not None:
        motion += form.motion
    eliminated = np.add.reduce(X.swapaxes(2, 3) @ response, axis=1)
    return System(motion[:, 6, 6], V, response, motion - eliminated, eliminated[:, 6, 6])


def _free_part(R: FloatArray, T: FloatArray, AE: FloatArray, gE: FloatArray, centred: bool) -> FloatArray:
    """Contribution of points on no patch to the motion's 7x7 block."""
    s = len(R)
    E = (R @ skew(T)).reshape(s, 9)
    G = np.empty((s, 7, 9))
    G[:, :3] = (E @ _ROTATE).reshape(s, 3, 9)
    G[:, 3:6] = (R[:, None] @ LEVI_CIVITA).reshape(s, 3, 9)
    G[:, 6] = 0.0 if centred else E
    AG = G @ AE
    AG[:, 6] += gE
    F = AG @ G.swapaxes(1, 2)
    F[:, :6, 6] = F[:, 6, :6]
    if not centred:
        F[:, 6, 6] += (gE * E).sum(axis=1)
    return F


def _solve_blocks(V: FloatArray, X: FloatArray) -> FloatArray:
    """V^-1 X for every plane; the least-squares solution if a block is exactly singular (a patch at the epipole).

    Raises
    ------
    DegenerateConfiguration : a block is beyond the numbers of a computer, as of points a million images away.
    """
    try:
        return np.asarray(np.linalg.solve(V, X), dtype=np.float64)
    except np.linalg.LinAlgError:
        try:
            return np.asarray(np.linalg.pinv(V, hermitian=True) @ X, dtype=np.float64)
        except np.linalg.LinAlgError as error:
            message = "the points of a plane lie too far apart, or at infinity; check the correspondences"
            raise DegenerateConfiguration(message) from error


def optimal_normals(R: FloatArray, T: FloatArray, form: QuadraticForm) -> tuple[State, FloatArray]:
    """The best normals for fixed motions R (s, 3, 3), T (s, 3), in closed form, and their chi-square (s,).

    H_i = R - K N_i^T is linear in N_i, so each normal is a 3x3 system of its own.
    """
    s, m = len(R), form.A.shape[1]
    B = np.empty((s, 1, 4, 9))  # rows: d vec(H) / d N, and vec(H) at N = 0
    B[:, 0, :3] = -((R @ T[:, :, None])[:, :, 0] @ _SPREAD).reshape(s, 3, 9)
    B[:, 0, 3] = R.reshape(s, 9)
    F = (B @ form.A) @ B.swapaxes(2, 3)
    linear = (B @ form.g[..., None])[..., 0]
    gradient = F[:, :, :3, 3] + linear[:, :, :3]
    N = -_solve_blocks(F[:, :, :3, :3], gradient[..., None])[..., 0]
    left = F[:, :, 3, 3] + 2.0 * linear[:, :, 3] + (N * gradient).sum(axis=2)
    chi2 = form.constant + left.sum(axis=1)
    if form.AE is not None and form.gE is not None:
        E = (R @ skew(T)).reshape(s, 1, 9)
        chi2 = chi2 + (E @ form.AE @ E.swapaxes(1, 2))[:, 0, 0] + 2.0 * (form.gE * E[:, 0]).sum(axis=1)
    if form.motion is not None:
        chi2 = chi2 + form.motion[:, 6, 6]
    return State(R, T, N.reshape(s, m, 3)), chi2


class Step(NamedTuple):
    """A step of s motions. state: after it; predicted (s,): decrease of chi-square it promises.

    motion (s, 6): change (w, T) before stretching; slope (s,): half the derivative of chi-square along it at its start.
    """

    state: State
    predicted: FloatArray
    motion: FloatArray
    slope: FloatArray


def step(state: State, system: System, damping: FloatArray, stretch: FloatArray | float = 1.0) -> Step:
    """One damped Gauss-Newton step of the motion, stretched by a factor (s,), and the best normals after it."""
    R, T, N = state
    U, b = system.reduced[:, :6, :6], system.reduced[:, :6, 6:]
    scale = np.einsum("sii->s", U)[:, None, None] + np.finfo(float).tiny
    U = U + (damping[:, None, None] * scale) * np.eye(6)
    U[:, 3:, 3:] += scale * (T[:, :, None] * T[:, None, :])  # the length of T is a gauge
    motion = -np.linalg.solve(U, b)
    slope = (b * motion).sum(axis=(1, 2))
    predicted = system.by_normals - slope
    moved = np.reshape(stretch, (-1, 1, 1)) * motion
    dN = (system.response[..., :6] @ moved[:, None])[..., 0] + system.response[..., 6]
    longer = T + moved[:, 3:, 0]
    length = np.sqrt((longer * longer).sum(axis=1))[:, None]
    after = State(_turned(R, moved[:, :3, 0]), longer / length, (N - dN) * length[:, None])
    return Step(after, predicted, motion[:, :, 0], slope)


def _realigned(state: State, system: System) -> State:
    """One Gauss-Newton step of rotation and normals, each T held fixed."""
    U, b = system.reduced[:, :3, :3], system.reduced[:, :3, 6:]
    lift = 1e-13 * np.einsum("sii->s", U)[:, None, None] + np.finfo(float).tiny
    turn = -np.linalg.solve(U + lift * np.eye(3), b)
    dN = (system.response[..., :3] @ turn[:, None])[..., 0] + system.response[..., 6]
    return State(_turned(state.R, turn[:, :, 0]), state.T, state.N - dN)


def _turned(R: FloatArray, w: FloatArray) -> FloatArray:
    """Cayley's map of w times R: a rotation to rounding, equal to exp([w]x) R to third order in w."""
    half = 0.5 * w
    W = skew(half)
    shrink = 2.0 / (1.0 + (half * half).sum(axis=1))
    return R + shrink[:, None, None] * ((W + W @ W) @ R)


_Tuple = TypeVar("_Tuple", State, System)


class Refined(NamedTuple):
    """Result of the iteration: state, its system, iterations taken, converged (s,)."""

    state: State
    system: System
    iterations: int
    converged: BoolArray


def levenberg_marquardt(
    state: State,
    linearise: Callable[[State], QuadraticForm],
    degrees_of_freedom: int,
    *,
    tolerance: float = 1e-3,
    rounding: float = 1e-32,
    max_iterations: int = 100,
    grace: int = 4,
) -> Refined:
    """Minimise chi-square from s starts together.

    linearise : gives the quadratic form at a state; it may ignore the state when the form is fixed.
    degrees_of_freedom : residuals less parameters, for the stopping rule.
    tolerance : stop when the predicted decrease is below this part of one residual variance. The parameters are then
        within about sqrt(tolerance) standard errors before the last step, and far closer after it.
    rounding : chi-square per residual that is rounding, (1e-16)^2; a predicted decrease below it ends the iteration.
    grace : iterations after which a start with ten times the chi-square of the best is no longer waited for.
    """
    system = normal_equations(state, linearise(state))
    dof, count = max(degrees_of_freedom, 1), len(state.T)
    damping, stretch, settled = np.full(count, 1e-9), np.ones(count), np.zeros(count, dtype=bool)
    for iteration in range(1, max_iterations + 1):
        trial, predicted, *_ = taken = step(state, system, damping, stretch)
        floor = np.maximum(system.chi2 / dof, rounding)
        worthwhile, small = predicted > dof * rounding, predicted <= tolerance * floor
        settled |= ~worthwhile | small
        if _finished(settled, damping, system.chi2, iteration > grace):
            # a step this small needs no check and changes the system no further
            last = small & worthwhile
            chi2 = np.maximum(system.chi2 - np.where(last, predicted, 0.0), 0.0)
            return Refined(_accept(last, trial, state), system._replace(chi2=chi2), iteration, settled)
        trial_system = normal_equations(trial, linearise(trial))
        hidden = predicted <= 1e-15 * np.sqrt(np.maximum(system.chi2, 0.0))  # by rounding of chi2
        near = hidden | (predicted <= NEAR * floor)
        if iteration > 2 and not near.all():
            trial, trial_system = _followed(trial, trial_system, near, linearise)
        better = trial_system.chi2 <= system.chi2 + 1e-6 * tolerance * floor
        closer = hidden & ~settled
        if closer.any():  # the gradient, and the decrease it promises, are more exact
            closer &= step(trial, trial_system, damping).predicted < predicted
        better = np.where(hidden, closer, better) & worthwhile
        damping = np.where(better, np.maximum(0.2 * damping, 1e-14), np.clip(5.0 * damping, 1e-9, 1e7))
        if near.any():
            secant = _secant(taken, stretch, trial_system)
            settled |= hidden & ~better & (stretch <= 1.0) & (secant > 0.9 * stretch)
            stretch = np.where(near, np.where(better, secant, np.minimum(secant, 1.0)), 1.0)
        state, system = _accept(better, trial, state), _accept(better, trial_system, system)
    return Refined(state, system, max_iterations, settled | near)


def _secant(taken: Step, stretch: FloatArray, after: System) -> FloatArray:
    """The stretch (s,) at which the derivative of chi-square along the step taken would have vanished.

    Along a flat valley a Gauss-Newton step is many times too short or too long, so that it converges slowly or never.
    As the next step goes much the same way, it is stretched by this factor. Source: Barzilai and Borwein, "Two-point
    step size gradient methods", 1988, here in the metric of the normal equations.
    """
    slope = (after.reduced[:, :6, 6] * taken.motion).sum(axis=1)
    with np.errstate(over="ignore"):  # where chi-square is zero to rounding; the stretch is bounded
        left = slope / np.minimum(taken.slope, -np.finfo(float).tiny)
    return np.clip(stretch / np.maximum(1.0 - left, 1e-9), 1.0 / MOST_STRETCH, MOST_STRETCH)


def _followed(
    trial: State, system: System, near: BoolArray, linearise: Callable[[State], QuadraticForm]
) -> tuple[State, System]:
    """States of less chi-square for the motions not `near` (s,) their minimum, with their system.

    With a narrow field of view, rotation, baseline and normals trade off along a curved valley. It is followed by
    solving rotation and normals again for the new T; most starts converge before the third step, without this.
    """
    other = _realigned(trial, system)
    other_system = normal_equations(other, linearise(other))
    less = ~near & (other_system.chi2 < system.chi2)
    return _accept(less, other, trial), _accept(less, other_system, system)


def _finished(settled: BoolArray, damping: FloatArray, chi2: FloatArray, late: bool) -> bool:
    """Whether every start is settled, stuck, or, late, fits far worse than the best."""
    done = settled | (damping > 1e6)
    if late:
        done = done | (chi2 > 10.0 * chi2.min())
    return bool(done.all())


def _accept(better: BoolArray, new: _Tuple, old: _Tuple) -> _Tuple:
    if better.all():
        return new
    return type(new)._make(
        np.where(better.reshape(-1, *[1] * (a.ndim - 1)), a, b) for a, b in zip(new, old, strict=True)
    )
