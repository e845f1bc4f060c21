"""Whether a third view and more have decided between two roots of many views, or both lie in one broad minimum."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from slopecli.geometry.epipolar import nearest_rotation, rotation_vector
from slopecli.geometry.solver.many_views import Root, ViewsSolution, solution_of
from slopecli.geometry.solver.uncertainty import by_chance
from slopecli.geometry.solver.views import (
    Reduced,
    ViewPoints,
    ViewState,
    motion_basis,
    normal_equations_of_views,
    take_step,
    view_terms,
)
from slopecli.geometry.statistics import CHI2
from slopecli.types import FloatArray, IntArray


@dataclass(frozen=True)
class SampleSizes:
    """Of a sample of planes, and of points on each, that subspaces are compared on: more change nothing."""

    planes: int = 12
    points: int = 40


SAMPLE = SampleSizes()


def judged(points: ViewPoints, roots: list[Root], unit: float, gain: float) -> ViewsSolution:
    """The best root as a solution, with the second one and whether it is ruled out.

    roots : one or two, best first.  unit : square root of the unit of chi-square.
    """
    solutions = [solution_of(points, root, unit, gain) for root in roots[:2]]
    if len(roots) == 1:
        return solutions[0]
    worse_by = (roots[1].cost - roots[0].cost) / unit**2
    ruled_out = worse_by > by_chance(separate_freedom_of_views(points, roots[0], roots[1]))
    joined = not ruled_out and are_joined(points, roots[0], roots[1], unit)
    if joined:
        solutions = [_widened_to(solutions[0], solutions[1]), _widened_to(solutions[1], solutions[0])]
    status = "resolved" if ruled_out else "unresolved"
    return replace(solutions[0], alternative=solutions[1], status=status, delta_chi2=worse_by, joined=joined)


def separate_freedom_of_views(points: ViewPoints, first: Root, second: Root) -> float:
    """Sum of squared sines of the angles between the subspaces of residuals that two roots can fit, see `by_chance`.

    It is computed on a sample of planes and points, as angles depend on neither number, and grows with the planes.
    Points off their plane fit one direction of their own each.
    """
    sample, scale = _sample(points)
    a, b = (_fitted(points, root, sample) for root in (first, second))
    shared = float(((a.T @ b) ** 2).sum())
    total = max(min(a.shape[1], b.shape[1]) - shared, 0.0) * scale
    weight = points.weight[:, None]
    both = (weight * first.terms.slide * second.terms.slide).sum(axis=(0, 1)) ** 2
    lengths = (weight * first.terms.slide**2).sum(axis=(0, 1)) * (weight * second.terms.slide**2).sum(axis=(0, 1))
    crossed = 1.0 - both / np.maximum(lengths, np.finfo(float).tiny)
    own = first.terms.V.sum(axis=0) * first.system.t
    return total + float((np.clip(crossed, 0.0, 1.0) * own * (lengths > 0.0)).sum())


def _sample(points: ViewPoints) -> tuple[IntArray, float]:
    """Indices of points on a sample of planes, and planes in all over those of the sample."""
    m = points.n_planes
    planes = np.unique(np.linspace(0, m - 1, min(m, SAMPLE.planes)).astype(np.int64))
    chosen = [
        points.first[i]
        + np.unique(np.linspace(0, points.count[i] - 1, min(points.count[i], SAMPLE.points)).astype(int))
        for i in planes
    ]
    return np.concatenate(chosen), m / len(planes)


def _fitted(points: ViewPoints, root: Root, sample: IntArray) -> FloatArray:
    """Orthonormal columns that span the changes of the predictions of a sample of points by motions and normals."""
    k, state = points.n_views, root.state
    root_weight = np.sqrt(points.weight[:, None, sample])
    slide, x = root.terms.slide[:, :, sample] * root_weight, (root.terms.residual + points.x)[:, :, sample]
    planes = points.plane_of_point()[sample]
    labels, inverse = np.unique(planes, return_inverse=True)
    rows = np.zeros((k, 2, len(sample), 6 * k + 3 * len(labels)))
    at = np.arange(len(sample))
    for view in range(k):
        u, v = x[view]
        turn = np.array([[-u * v, 1.0 + u * u, -v], [-1.0 - v * v, u * v, u]])
        R, scale = state.R[view], (state.u / root.terms.ahead[view])[sample]
        move = np.stack([(x[view] * R[2, c] - R[:2, c, None]) * scale for c in range(3)], axis=1)
        own = np.concatenate([turn, move], axis=1) * root_weight[view][:, None]
        rows[view, :, :, 6 * view : 6 * view + 6] = own.transpose(0, 2, 1)
    for c in range(3):
        rows[:, :, at, 6 * k + 3 * inverse + c] = slide * points.p[c, sample]
    J = rows.reshape(-1, rows.shape[-1])
    basis = motion_basis(points, state.T)
    J = np.concatenate([J[:, : 6 * k] @ basis, J[:, 6 * k :]], axis=1)
    J = J / np.maximum(np.linalg.norm(J, axis=0), 1e-150)
    values, vectors = np.linalg.eigh(J.T @ J)
    kept = values > 1e-10 * values[-1]
    return np.asarray(J @ (vectors[:, kept] / np.sqrt(values[kept])))


def are_joined(points: ViewPoints, first: Root, second: Root, unit: float) -> bool:
    """Whether a state half way between two roots fits nearly as well as the better one.

    Half way lie the normals, for which the motions are solved, or the motions, for which the normals are.
    """
    if (np.einsum("ka,ka->k", first.state.T, second.state.T) < 0.0).any():
        return False
    a, b = first.state, second.state
    R = np.stack([nearest_rotation(one + other) for one, other in zip(a.R, b.R, strict=True)])
    middle = ViewState(R, 0.5 * (a.T + b.T), 0.5 * (a.N + b.N), 0.5 * (a.u + b.u), 0.5 * (a.z + b.z))
    ridge = min(_left(points, middle, first.q, held) for held in ("normals", "motions"))
    return bool(ridge - first.system.chi2 < CHI2[1, 0.99] * unit**2)


def _left(points: ViewPoints, state: ViewState, q: FloatArray, held: str, rounds: int = 4) -> float:
    """Chi-square left after a few steps in which either the normals or the motions are held."""
    least = np.inf
    for _ in range(rounds):
        system = normal_equations_of_views(points, state, q, view_terms(points, state.R, state.T, state.u))
        least = min(least, system.chi2)
        state = take_step(points, state, _without(system, held), 0.0).state
    return least


def _without(system: Reduced, held: str) -> Reduced:
    """The system with a large information on what is held, so that a step does not change it."""
    if held == "normals":
        firm = 1e9 * np.trace(system.plane, axis1=1, axis2=2)[:, None, None] * np.eye(3)
        return system._replace(plane=system.plane + firm)
    return system._replace(S=system.S + 1e9 * np.diag(np.diag(system.S)))


def _widened_to(own: ViewsSolution, other: ViewsSolution) -> ViewsSolution:
    """A root with a covariance so wide that two sigmas span the distance to the other one."""
    half = 0.5 * (other.scaled_normals - own.scaled_normals)
    d = own.motion_covariance.shape[0]
    # one more direction that all normals and motions share
    gain = np.concatenate([own.normal_gain, half[:, :, None]], axis=2)
    covariance = np.zeros((d + 1, d + 1))
    covariance[:d, :d], covariance[d, d] = own.motion_covariance, 1.0
    turn = 0.5 * _between(own, other)
    basis = np.concatenate([own.basis, turn[:, None]], axis=1)
    return replace(own, normal_gain=gain, motion_covariance=covariance, basis=basis)


def _between(own: ViewsSolution, other: ViewsSolution) -> FloatArray:
    """(6k,) motions (w, T) from one root to another."""
    turned = other.R @ own.R.swapaxes(1, 2)
    w = np.stack([rotation_vector(one) for one in turned])
    return np.concatenate([w, other.T - own.T], axis=1).ravel()
