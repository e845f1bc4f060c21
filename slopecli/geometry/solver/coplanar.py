"""Merge patches that share a plane or a normal: chi-square tests on their joint covariance, constrained solution."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np

from slopecli.geometry.epipolar import rotation_from_vector, tangent_basis
from slopecli.geometry.solver.mismatches import chi2_quantile
from slopecli.geometry.solver.observations import parameter_count
from slopecli.types import FloatArray, IntArray, Solution

# standard normal quantiles of the chi-square tests. 0.999 for a shared plane: patches of one plane are rarely split.
# 0.95 for a shared normal: a stronger claim, which poorly determined normals must not pass easily
AT: dict[str, float] = {"plane": 3.090, "normal": 1.645}

Shared = Literal["plane", "normal"]


class Group(NamedTuple):
    """Patches that share a plane or only a normal; chi2 of that constraint with `dof` degrees of freedom."""

    members: tuple[int, ...]
    shares: Shared
    chi2: float
    dof: int


def merge_coplanar(
    solution: Solution, candidates: IntArray, tilt_sigma_rad: FloatArray | None = None
) -> tuple[Solution, list[Group]]:
    """Solve every group of coplanar or parallel patches as one, in both roots; return the solution and the groups.

    Nothing is merged if the two roots are joined (straight down over level ground).

    candidates : patches that may be grouped.
    tilt_sigma_rad : (m,) 1-sigma of tilt of each plane beyond what residuals show; added to the covariance.
    """
    found = solution.ambiguity
    if found.joined:
        return solution, []
    merged, groups = _merged(solution, candidates, tilt_sigma_rad)
    if not groups:
        return solution, []
    if found.alternative is not None:
        alternative, _ = _merged(found.alternative, candidates, tilt_sigma_rad)
        merged = replace(merged, ambiguity=replace(found, alternative=alternative))
    return merged, groups


def _merged(
    solution: Solution, candidates: IntArray, tilt_sigma_rad: FloatArray | None
) -> tuple[Solution, list[Group]]:
    """One root with its groups solved as one, if there are any; `tilt_sigma_rad` is in its covariance either way."""
    joint = joint_covariance(solution, tilt_sigma_rad)
    groups = coplanar_groups(solution.scaled_normals, joint, candidates)
    if not groups:
        return replace(solution, normal_covariance=_blocks(joint, len(solution.scaled_normals))), []
    return constrained(solution, joint, groups), groups


def joint_covariance(solution: Solution, tilt_sigma_rad: FloatArray | None = None) -> FloatArray:
    """(3m + 5, 3m + 5) covariance of all scaled normals and the motion.

    tilt_sigma_rad : (m,) 1-sigma of tilt to add to each plane, beyond what residuals show.
    """
    m, C = len(solution.scaled_normals), solution.motion_covariance
    gain, shift = solution.normal_gain.reshape(3 * m, 5), solution.focal_shift
    if shift is not None:
        C = C - np.outer(shift[-5:], shift[-5:])
    joint = np.empty((parameter_count(m), parameter_count(m)))
    joint[: 3 * m, : 3 * m] = gain @ C @ gain.T
    joint[: 3 * m, 3 * m :] = gain @ C
    joint[3 * m :, : 3 * m] = joint[: 3 * m, 3 * m :].T
    joint[3 * m :, 3 * m :] = C
    if shift is not None:
        joint += np.outer(shift, shift)
    N = solution.scaled_normals
    across = np.linalg.norm(N, axis=1)[:, None, None] ** 2 * np.eye(3) - N[:, :, None] * N[:, None, :]
    tilt = np.zeros(m) if tilt_sigma_rad is None else tilt_sigma_rad
    for i in range(m):
        block = slice(3 * i, 3 * i + 3)
        joint[block, block] = solution.normal_covariance[i] + tilt[i] ** 2 * across[i]
    return joint


def _blocks(joint: FloatArray, m: int) -> FloatArray:
    """(m, 3, 3) covariance of each scaled normal, of a joint one."""
    return np.einsum("ijik->ijk", joint[: 3 * m, : 3 * m].reshape(m, 3, m, 3)).copy()


def coplanar_groups(normals: FloatArray, joint: FloatArray, candidates: IntArray) -> list[Group]:
    """Groups of at least two patches that share a plane, and of such and single ones that share a normal.

    Agglomerative: the two groups that differ least are joined as long as the chi-square test accepts it.

    normals : (m, 3) scaled.  joint : as `joint_covariance`.  candidates : patches that may be grouped.
    """
    planes = _agglomerated([(int(k),) for k in candidates], normals, joint, "plane")
    facing = _agglomerated(planes, normals, joint, "normal")
    shared: list[tuple[tuple[int, ...], Shared]] = [(members, "plane") for members in planes if len(members) > 1]
    shared += [(members, "normal") for members in facing if members not in planes]
    return [Group(members, shares, *_misfit(members, normals, joint, shares)) for members, shares in shared]


def _agglomerated(
    groups: list[tuple[int, ...]], normals: FloatArray, joint: FloatArray, shares: Shared
) -> list[tuple[int, ...]]:
    """Groups joined while the test accepts the pair with the smallest chi-square."""
    groups = list(groups)
    cost = np.full((len(groups), len(groups)), np.inf)
    for i in range(len(groups)):
        for j in range(i + 1, len(groups)):
            cost[i, j] = _excess(groups[i] + groups[j], normals, joint, shares)
    while len(groups) > 1 and cost.min() <= 0.0:
        i, j = (int(k) for k in np.unravel_index(cost.argmin(), cost.shape))
        groups[i], groups[j] = tuple(sorted(groups[i] + groups[j])), ()
        cost[j, :] = cost[:, j] = np.inf
        for k, other in enumerate(groups):
            if other and k != i:
                cost[min(i, k), max(i, k)] = _excess(groups[i] + other, normals, joint, shares)
    return [group for group in groups if group]


def _excess(members: tuple[int, ...], normals: FloatArray, joint: FloatArray, shares: Shared) -> float:
    """Chi-square of a shared plane (or normal) less its quantile, per degree of freedom; accepted if not positive."""
    chi2, dof = _misfit(members, normals, joint, shares)
    return (chi2 - chi2_quantile(dof, AT[shares])) / dof


def _misfit(members: tuple[int, ...], normals: FloatArray, joint: FloatArray, shares: Shared) -> tuple[float, int]:
    """Chi-square of the constraint among members, linearised at their estimates, and its degrees of freedom."""
    J, off = _constraint(members, normals, shares)
    index = _columns(members)
    spread = J @ joint[np.ix_(index, index)] @ J.T
    return float(off @ _inverse(spread) @ off), len(off)


def _constraint(members: tuple[int, ...], normals: FloatArray, shares: Shared) -> tuple[FloatArray, FloatArray]:
    """Jacobian (d, 3k), by the normals of k members, of d differences that must vanish, and their values (d,)."""
    own = normals[list(members)]
    if shares == "plane":
        value, slope = own, np.repeat(np.eye(3)[None], len(own), axis=0)
    else:
        length = np.linalg.norm(own, axis=1)
        facing = own / length[:, None]
        basis = tangent_basis(facing.mean(0)).T
        value = facing @ basis.T
        slope = basis @ (np.eye(3) - facing[:, :, None] * facing[:, None, :]) / length[:, None, None]
    d = value.shape[1]
    J = np.zeros((d * (len(own) - 1), 3 * len(own)))
    for row in range(len(own) - 1):
        rows = slice(d * row, d * row + d)
        J[rows, :3] = slope[0]
        J[rows, 3 * row + 3 : 3 * row + 6] = -slope[row + 1]
    return J, (value[0] - value[1:]).ravel()


def _inverse(spread: FloatArray) -> FloatArray:
    """Inverse of a covariance whose eigenvalues below rounding are lifted to it."""
    values, vectors = np.linalg.eigh(spread)
    values = np.maximum(values, max(1e-12 * float(values[-1]), np.finfo(float).tiny))
    return np.asarray((vectors / values) @ vectors.T)


def constrained(solution: Solution, joint: FloatArray, groups: list[Group]) -> Solution:
    """The solution nearest to this one, in its covariance, under the constraints of every group.

    To first order in the noise this is the constrained maximum likelihood: the motion changes with the normals, and the
    covariances are those of the remaining parameters.
    """
    m = len(solution.scaled_normals)
    normals, change = solution.scaled_normals, np.zeros(parameter_count(m))
    start = np.concatenate([normals.ravel(), np.zeros(5)])
    for _ in range(6):  # it settles in two or three
        J, off = _all_constraints(groups, normals, len(change))
        gain = joint @ J.T @ _inverse(J @ joint @ J.T)
        now = start + change
        before, change = change, -gain @ (off + J @ (start - now))
        normals = (start + change)[: 3 * m].reshape(m, 3)
        if np.abs(change - before).max() <= 1e-10 * np.abs(start).max():
            break
    left = joint - gain @ J @ joint
    left = 0.5 * (left + left.T)
    turn, move = change[3 * m : 3 * m + 3], solution.tangent @ change[3 * m + 3 :]
    T = solution.T + move
    return replace(
        solution,
        R=rotation_from_vector(turn) @ solution.R,
        T=T / np.linalg.norm(T),
        scaled_normals=normals,
        normal_covariance=_blocks(left, m),
        motion_covariance=left[3 * m :, 3 * m :],
        joint_normals=left[: 3 * m, : 3 * m],
    )


def _all_constraints(groups: list[Group], normals: FloatArray, size: int) -> tuple[FloatArray, FloatArray]:
    rows, values = [], []
    for group in groups:
        J, off = _constraint(group.members, normals, group.shares)
        rows.append(np.zeros((len(off), size)))
        rows[-1][:, _columns(group.members)] = J
        values.append(off)
    return np.concatenate(rows), np.concatenate(values)


def _columns(members: tuple[int, ...]) -> IntArray:
    return np.concatenate([np.arange(3 * k, 3 * k + 3) for k in members])
