"""The joint problem: the matches of all patches stacked, one motion and one plane per patch, coplanar ones as one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np

from slopecli.errors import NoAnswer
from slopecli.geometry.motion import MotionEstimate, epipolar_residual
from slopecli.geometry.solver.coplanar import merge_coplanar
from slopecli.geometry.solver.priors import MotionPrior
from slopecli.geometry.solver.solve import solve_planes
from slopecli.geometry.solver.uncertainty import rules_out
from slopecli.geometry.statistics import median
from slopecli.look.matches import Matches, thin
from slopecli.look.noise import OVERVIEW_CELL_PX, SYSTEMATIC_PX, correlation_gain
from slopecli.look.scene import Scene
from slopecli.patches.patch import IN_DOUBT_DEG, Found, Patch, weight_of
from slopecli.types import FloatArray, IntArray, Segmentation, Solution

OUTSIDE_POINTS = 1500  # matches outside the patches that join the solution: more add time, not accuracy


@dataclass(frozen=True, eq=False)
class Joined:
    """Patches with their matches stacked for one joint solution: patch k is plane k of the `Solution`.

    patches : those with matches.  unanswered : those without.
    matches : (n) of the patches, one after the other, then those on no patch.
    plane : (n,) index of the patch that a match is on, -1 for none (it then constrains the motion only).
    weight : (n,) inverse variances, 1 for a 1-sigma of `noise.LEAST_MATCH_PX`; of given rows, for their median sigma.
    segmentation : steps of the finder `regions`, for pictures.
    """

    patches: tuple[Patch, ...]
    unanswered: tuple[Patch, ...]
    matches: Matches
    plane: IntArray
    weight: FloatArray
    segmentation: Segmentation | None = None

    @classmethod
    def of(
        cls, patches: Sequence[Patch], outside: Matches, weight: FloatArray, segmentation: Segmentation | None = None
    ) -> Joined:
        """Stack the matches of the patches that have some, then those `outside` all patches, with `weight` (k,)."""
        chosen = tuple(patch for patch in patches if patch.origin != "none")
        return cls(
            patches=chosen,
            unanswered=tuple(patch for patch in patches if patch.origin == "none"),
            matches=Matches.none().joined(*(patch.matches for patch in chosen), outside),
            plane=np.repeat([*range(len(chosen)), -1], [*(len(patch.matches) for patch in chosen), len(outside)]),
            weight=np.concatenate([*(patch.weight for patch in chosen), weight]),
            segmentation=segmentation,
        )

    @cached_property
    def _starts(self) -> list[int]:
        return [0, *np.cumsum([len(patch.matches) for patch in self.patches]).tolist()]

    def rows(self, k: int) -> slice:
        """The matches on plane k."""
        return slice(self._starts[k], self._starts[k + 1])


def join_patches(found: Found, scene: Scene) -> Joined:
    """Stack the patches' matches, and for the motion some of those outside all patches; NoAnswer if none has any."""
    answered = [patch for patch in found.patches if patch.origin != "none"]
    if not answered:
        first, noun = found.patches[0], found.patches[0].finder.noun
        raise NoAnswer(
            "low-texture",
            f"none of the {len(found.patches)} {noun}s can be matched: {first.reason}",
            f"choose {noun}s with texture that both images show",
        )
    evidence = scene.evidence
    free = np.flatnonzero(~np.any([patch.footprint.covers(evidence.uv1) for patch in answered], axis=0))
    outside = evidence.take(thin(evidence.uv1, free, OUTSIDE_POINTS))
    return Joined.of(found.patches, outside, outside_weight(scene, len(outside)), found.segmentation)


def outside_weight(scene: Scene, n: int) -> FloatArray:
    """(n,) weights of matches of the overview."""
    sigma_px = OVERVIEW_CELL_PX / scene.cells.pixel_scale
    return weight_of(np.full(n, sigma_px**2))


def solve_jointly(
    joined: Joined,
    scene: Scene,
    motions: list[MotionEstimate],
    solver: Literal["mle", "ha", "lh"],
    prior: MotionPrior | None = None,
    noise_factor: float = 1.0,
) -> Solution:
    """One motion and one plane per patch, started from every motion that may be the right one.

    prior : motion measured by another sensor.  noise_factor : by which the 1-sigmas of all matches are enlarged.
    """
    across = [(p.cell, epipolar_residual(scene.R, scene.T, p.matches.x1, p.matches.x2)) for p in joined.patches]
    solution = solve_planes(
        *(joined.matches.x1, joined.matches.x2, joined.plane, solver),
        weights=joined.weight,
        relief=solver == "mle",
        initial=[(m.R, m.T) for m in motions],
        prior=prior,
        noise_gain=noise_factor * correlation_gain(across),
    )
    return _with_systematic_floor(_with_sign_of(solution, scene.T), scene.camera2.focal_px)


def _with_sign_of(solution: Solution, T: FloatArray) -> Solution:
    """The solution with the sign of T and normals for which T is on the side of the scene's motion T (3,).

    (T, N) and (-T, -N) give the same homography. Points must be in front of the camera, which decides the sign in the
    solver; where a patch is mismatched it may decide wrongly, while the scene's T is of matches all over image 1.
    """
    if solution.T @ T >= 0:
        return solution
    turned = ("T", "scaled_normals", "tangent", "normal_gain")
    return replace(solution, **{name: -getattr(solution, name) for name in turned})


def excess_px(solution: Solution, delta_chi2: float, focal_px: float) -> float:
    """RMS increase of the misfit of a kept match, px of image 2, that a growth of chi-square corresponds to."""
    return float(solution.noise * np.sqrt(max(delta_chi2, 0.0) / max(int(solution.inlier.sum()), 1)) * focal_px)


def _with_systematic_floor(solution: Solution, focal_px: float) -> Solution:
    """The solution, its second root "unresolved" if systematic errors of matches could explain its larger misfit.

    They are SYSTEMATIC_PX a match. They do not explain the part of the misfit that is due to a prior.
    """
    found = solution.ambiguity
    if found.status != "resolved" or found.delta_chi2 is None:
        return solution
    floor = int(solution.inlier.sum()) * (SYSTEMATIC_PX / (solution.noise * focal_px)) ** 2
    if rules_out(found.delta_chi2, found.delta_chi2_prior or 0.0, floor):
        return solution
    return replace(solution, ambiguity=replace(found, status="unresolved"))


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
    own &= _tilt_sigma_deg(solution, extra) < IN_DOUBT_DEG
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
    found = []
    for group in groups:
        members = list(group.members)
        ids = tuple(patches[k].id for k in members)
        sigmas = median(before[members]), median(after[members])
        found.append(MergedGroup(ids, group.shares, group.chi2, group.dof, *sigmas))
    return replace(joined, patches=tuple(patches)), merged, found


def _tilt_sigma_deg(solution: Solution, extra_rad: FloatArray) -> FloatArray:
    """(m,) 1-sigma of each plane's tilt, the mean over all directions; extra_rad (m,) is added in quadrature."""
    N = solution.scaled_normals
    length = np.linalg.norm(N, axis=1)
    unit = N / length[:, None]
    along = np.einsum("mi,mij,mj->m", unit, solution.normal_covariance, unit)
    across = np.einsum("mii->m", solution.normal_covariance) - along
    return np.degrees(np.sqrt(np.maximum(across, 0.0) / 2 / length**2 + extra_rad**2))
