"""Patches that lie on one plane, or face one way, found by chi-square on their joint covariance and solved as such.

Nine windows of a level field know its slope each by itself; as one plane, they know it together.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np

from slopecli.geometry.epipolar import rotation_from_vector, tangent_basis
from slopecli.geometry.solver.mismatches import chi2_quantile
from slopecli.types import FloatArray, IntArray, Solution

# standard normal quantiles. 0.999: of many patches of one plane, hardly one is taken for another. 0.95: that planes
# apart from each other face one way is a stronger claim, which vague normals must not pass too easily
AT: dict[str, float] = {"plane": 3.090, "normal": 1.645}
ROUNDS = 6  # of linearising what holds; it settles in two or three
SETTLED = 1e-10
LEAST_SHARE = 1e-12  # of the largest variance: a smaller one is rounding

Shared = Literal["plane", "normal"]


class Group(NamedTuple):
    """Patches that share a plane, or only the direction they face; chi2: what that costs over `dof` freedoms."""

    members: tuple[int, ...]
    shares: Shared
    chi2: float
    dof: int


def merge_coplanar(
    solution: Solution, candidates: IntArray, doubt_rad: FloatArray | None = None
) -> tuple[Solution, list[Group]]:
    """The solution with every group of coplanar or parallel patches solved as one, and the groups; both roots alike.

    Where two answers run into each other (straight down over level ground) nothing can be told apart, and nothing is
    merged.

    Parameters
    ----------
    candidates : patches that may be grouped.
    doubt_rad : (m,) 1-sigma of tilt of each plane that no residual shows; it weighs in, and is in the covariance after.
    """
    found = solution.ambiguity
    if found.joined:
        return solution, []
    merged, groups = _merged(solution, candidates, doubt_rad)
    if not groups:
        return solution, []
    if found.alternative is not None:
        alternative, _ = _merged(found.alternative, candidates, doubt_rad)
        merged = replace(merged, ambiguity=replace(found, alternative=alternative))
    return merged, groups


def _merged(solution: Solution, candidates: IntArray, doubt_rad: FloatArray | None) -> tuple[Solution, list[Group]]:
    """One root with its groups held together, if it has any; the doubt is in its covariance either way."""
    joint = joint_covariance(solution, doubt_rad)
    groups = coplanar_groups(solution.scaled_normals, joint, candidates)
    if not groups:
        return replace(solution, normal_covariance=_blocks(joint, len(solution.scaled_normals))), []
    return held_together(solution, joint, groups), groups


def joint_covariance(solution: Solution, doubt_rad: FloatArray | None = None) -> FloatArray:
    """(3m + 5, 3m + 5) covariance of all scaled normals and the motion.

    doubt_rad : (m,) 1-sigma of tilt to add to each plane, which no residual shows.
    """
    m, C = len(solution.scaled_normals), solution.motion_covariance
    gain = solution.normal_gain.reshape(3 * m, 5)
    joint = np.empty((3 * m + 5, 3 * m + 5))
    joint[: 3 * m, : 3 * m] = gain @ C @ gain.T
    joint[: 3 * m, 3 * m :] = gain @ C
    joint[3 * m :, : 3 * m] = joint[: 3 * m, 3 * m :].T
    joint[3 * m :, 3 * m :] = C
    N = solution.scaled_normals
    length = np.linalg.norm(N, axis=1)
    across = length[:, None, None] ** 2 * np.eye(3) - N[:, :, None] * N[:, None, :]
    doubt = np.zeros(m) if doubt_rad is None else doubt_rad
    for i in range(m):
        block = slice(3 * i, 3 * i + 3)
        joint[block, block] = solution.normal_covariance[i] + doubt[i] ** 2 * across[i]
    return joint


def _blocks(joint: FloatArray, m: int) -> FloatArray:
    """(m, 3, 3) covariance of each scaled normal, of a joint one."""
    return np.einsum("ijik->ijk", joint[: 3 * m, : 3 * m].reshape(m, 3, m, 3)).copy()


def coplanar_groups(normals: FloatArray, joint: FloatArray, candidates: IntArray) -> list[Group]:
    """Groups of at least two patches that share a plane, and of such and single ones that share a normal.

    Agglomerative: the two groups that differ least are joined, as long as chance explains what that costs.

    Parameters
    ----------
    normals : (m, 3) scaled.  joint : as `joint_covariance`.  candidates : patches that may be grouped.
    """
    planes = _agglomerated([(int(k),) for k in candidates], normals, joint, "plane")
    facing = _agglomerated(planes, normals, joint, "normal")
    found = [_group(members, normals, joint, "plane") for members in planes if len(members) > 1]
    return found + [_group(members, normals, joint, "normal") for members in facing if members not in planes]


def _agglomerated(
    groups: list[tuple[int, ...]], normals: FloatArray, joint: FloatArray, shares: Shared
) -> list[tuple[int, ...]]:
    """Groups joined while the cheapest pair of them costs no more than chance does."""
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
    """Chi-square of one plane (or normal) beyond what chance makes of it, per degree of freedom; it is one below 0."""
    chi2, dof = _misfit(members, normals, joint, shares)
    return (chi2 - chi2_quantile(dof, AT[shares])) / dof


def _group(members: tuple[int, ...], normals: FloatArray, joint: FloatArray, shares: Shared) -> Group:
    return Group(members, shares, *_misfit(members, normals, joint, shares))


def _misfit(members: tuple[int, ...], normals: FloatArray, joint: FloatArray, shares: Shared) -> tuple[float, int]:
    """Chi-square of the constraint among members, linearised at their estimates, and its degrees of freedom."""
    J, off = _constraint(members, normals, shares)
    index = np.concatenate([np.arange(3 * k, 3 * k + 3) for k in members])
    spread = J @ joint[np.ix_(index, index)] @ J.T
    return float(off @ _inverse(spread) @ off), len(off)


def _constraint(members: tuple[int, ...], normals: FloatArray, shares: Shared) -> tuple[FloatArray, FloatArray]:
    """Derivative (d, 3k) of what must vanish among k members, by their normals, and its values (d,)."""
    own = normals[list(members)]
    if shares == "plane":
        value = own
        slope = np.repeat(np.eye(3)[None], len(own), axis=0)
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
    """Inverse of a covariance; differences that cannot vary leave no say to rounding."""
    values, vectors = np.linalg.eigh(spread)
    values = np.maximum(values, max(LEAST_SHARE * float(values[-1]), np.finfo(float).tiny))
    return np.asarray((vectors / values) @ vectors.T)


def held_together(solution: Solution, joint: FloatArray, groups: list[Group]) -> Solution:
    """The solution nearest to this one, in its covariance, in which every group shares what it shares.

    To first order in the noise this is the maximum likelihood under those constraints: the motion moves with the
    normals, and the covariances are those of what is left free.
    """
    m = len(solution.scaled_normals)
    normals, change = solution.scaled_normals, np.zeros(3 * m + 5)
    start = np.concatenate([normals.ravel(), np.zeros(5)])
    for _ in range(ROUNDS):
        J, off = _all_constraints(groups, normals, 3 * m + 5)
        gain = joint @ J.T @ _inverse(J @ joint @ J.T)
        now = start + change
        before, change = change, -gain @ (off + J @ (start - now))
        normals = (start + change)[: 3 * m].reshape(m, 3)
        if np.abs(change - before).max() <= SETTLED * np.abs(start).max():
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
        wide = np.zeros((len(off), size))
        wide[:, np.concatenate([np.arange(3 * k, 3 * k + 3) for k in group.members])] = J
        rows.append(wide)
        values.append(off)
    return np.concatenate(rows), np.concatenate(values)
