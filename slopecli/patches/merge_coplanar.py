"""Patches that lie on one plane or face one way, solved as such, and a diagnostic for each group of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from slopecli.geometry.solver.coplanar import Group, merge_coplanar
from slopecli.geometry.statistics import median
from slopecli.patches.join import Joined
from slopecli.patches.patch import Patch
from slopecli.types import FloatArray, Solution

MOST_TILT_SIGMA_DEG = 5.0  # of a patch that takes part: one less certain agrees with any plane


class MergedGroup(NamedTuple):
    """Patches, by id, that were given one plane or one normal: the chi-square of the test over its degrees of freedom,
    and the median 1-sigma of their tilts before and after."""

    ids: tuple[int, ...]
    shares: str
    chi2: float
    dof: int
    before_deg: float
    after_deg: float


def merge_patches(joined: Joined, solution: Solution) -> tuple[Joined, Solution, list[MergedGroup]]:
    """The solution with coplanar and parallel patches solved as one, and every group of them.

    Only patches with matches of their own and no reason against them take part. The tilt variance of their matches
    goes into the covariance here, so the patches returned keep only that of their unmatched parts, of which other
    patches tell nothing.
    """
    own = np.array([patch.origin == "own" and not patch.reason for patch in joined.patches])
    extra = np.where(own, [patch.tilt_sigma_rad for patch in joined.patches], 0.0)
    own &= _tilt_sigma_deg(solution, extra) < MOST_TILT_SIGMA_DEG
    extra *= own
    merged, groups = merge_coplanar(solution, np.flatnonzero(own), extra)
    if not groups:
        return joined, solution, []
    patches = [
        replace(patch, tilt_sigma_rad=patch.unmatched_sigma_rad) if takes_part else patch
        for patch, takes_part in zip(joined.patches, own, strict=True)
    ]
    left = np.where(own, [patch.tilt_sigma_rad for patch in patches], 0.0)
    before, after = _tilt_sigma_deg(solution, extra), _tilt_sigma_deg(merged, left)
    return joined.with_patches(patches), merged, [_merged(group, patches, before, after) for group in groups]


def _tilt_sigma_deg(solution: Solution, extra_rad: FloatArray) -> FloatArray:
    """(m,) 1-sigma of each plane's tilt, the mean over all directions; extra_rad (m,) is added in quadrature."""
    N = solution.scaled_normals
    length = np.linalg.norm(N, axis=1)
    unit = N / length[:, None]
    along = np.einsum("mi,mij,mj->m", unit, solution.normal_covariance, unit)
    across = np.einsum("mii->m", solution.normal_covariance) - along
    return np.degrees(np.sqrt(np.maximum(across, 0.0) / 2 / length**2 + extra_rad**2))


def _merged(group: Group, patches: Sequence[Patch], before: FloatArray, after: FloatArray) -> MergedGroup:
    members = list(group.members)
    ids = tuple(patches[k].id for k in members)
    return MergedGroup(ids, group.shares, group.chi2, group.dof, median(before[members]), median(after[members]))
