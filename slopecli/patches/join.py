"""The joint problem: the matches of all patches stacked, and one motion with one plane per patch solved from them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from slopecli.errors import NoAnswer
from slopecli.geometry.motion import MotionEstimate, epipolar_residual
from slopecli.geometry.solver.priors import MotionPrior
from slopecli.geometry.solver.solve import solve_planes
from slopecli.geometry.solver.uncertainty import rules_out
from slopecli.look.matches import Matches, thin
from slopecli.look.noise import OVERVIEW_CELL_PX, SYSTEMATIC_PX, correlation_gain
from slopecli.look.scene import Scene
from slopecli.patches.patch import Found, Patch, weight_of
from slopecli.types import BoolArray, FloatArray, IntArray, Segmentation, Solution

OUTSIDE_POINTS = 1500  # matches outside the patches that join the solution: more add time, not accuracy


@dataclass(frozen=True, eq=False)
class Joined:
    """Patches with their matches stacked for one joint solution: patch k is plane k of the `Solution`.

    patches : those with matches.  unanswered : those without.
    matches : (n) of the patches, one after the other, then those on no patch.
    plane : (n,) index of the patch that a match is on, -1 for none (it then constrains the motion only).
    weight : (n,) inverse variances, relative to `patch.REFERENCE_PX`.
    """

    patches: tuple[Patch, ...]
    unanswered: tuple[Patch, ...]
    matches: Matches
    plane: IntArray
    weight: FloatArray
    segmentation: Segmentation | None = None

    @classmethod
    def of(
        cls,
        patches: Sequence[Patch],
        outside: Matches,
        outside_weight: FloatArray,
        segmentation: Segmentation | None = None,
    ) -> Joined:
        """Stack the matches of the patches that have some, and those `outside` all of them."""
        chosen = tuple(patch for patch in patches if patch.origin != "none")
        return cls(
            patches=chosen,
            unanswered=tuple(patch for patch in patches if patch.origin == "none"),
            matches=Matches.none().joined(*(patch.matches for patch in chosen), outside),
            plane=np.repeat([*range(len(chosen)), -1], [*(len(patch.matches) for patch in chosen), len(outside)]),
            weight=np.concatenate([*(patch.weight for patch in chosen), outside_weight]),
            segmentation=segmentation,
        )

    def on(self, k: int) -> BoolArray:
        """(n,) the matches on plane k."""
        return self.plane == k

    def with_patches(self, patches: Sequence[Patch]) -> Joined:
        """The same with more known of the patches, whose matches stay."""
        return replace(self, patches=tuple(patches))


def join_patches(found: Found, scene: Scene) -> Joined:
    """Stack the patches' matches, and for the motion some of those outside all patches.

    Raises
    ------
    NoAnswer : no patch has matches.
    """
    answered = [patch for patch in found.patches if patch.origin != "none"]
    if not answered:
        first, noun = found.patches[0], found.patches[0].finder.noun
        raise NoAnswer(
            "low-texture",
            f"none of the {len(found.patches)} {noun}s can be matched: {first.reason}",
            f"choose {noun}s with texture that both images show",
        )
    outside = _outside(scene, answered)
    sigma_px = OVERVIEW_CELL_PX / float(scene.pyramid1.overview_scale.mean())
    return Joined.of(found.patches, outside, weight_of(np.full(len(outside), sigma_px**2)), found.segmentation)


def _outside(scene: Scene, patches: Sequence[Patch]) -> Matches:
    """Matches of the overview that lie on none of the patches, spread evenly."""
    free = np.ones(len(scene.evidence), bool)
    for patch in patches:
        free &= ~patch.footprint.covers(scene.evidence.uv1)
    return scene.evidence.take(thin(scene.evidence.uv1, np.flatnonzero(free), OUTSIDE_POINTS))


def solve_jointly(
    joined: Joined,
    scene: Scene,
    motions: list[MotionEstimate],
    solver: Literal["mle", "ha", "lh"],
    prior: MotionPrior | None = None,
    noise_factor: float = 1.0,
) -> Solution:
    """One motion and one plane per patch, started from every motion that may be the right one.

    prior : what is known of the motion besides.  noise_factor : by how much all sigmas of matches are too small.
    """
    matches = joined.matches
    across = [(p.cell, epipolar_residual(scene.R, scene.T, p.matches.x1, p.matches.x2)) for p in joined.patches]
    solution = solve_planes(
        matches.x1,
        matches.x2,
        joined.plane,
        solver,
        weights=joined.weight,
        relief=solver == "mle",
        initial=[(m.R, m.T) for m in motions],
        prior=prior,
        noise_gain=noise_factor * correlation_gain(across),
    )
    return _beyond_systematics(_facing(solution, scene.T), scene.camera2.focal_px)


def _facing(solution: Solution, T: FloatArray) -> Solution:
    """The solution on the side of the motion that puts the scene in front of the camera.

    (T, N) and (-T, -N) are one homography; with few patches, a mismatched one may decide the solver's choice.
    """
    if solution.T @ T >= 0:
        return solution
    return replace(
        solution,
        T=-solution.T,
        scaled_normals=-solution.scaled_normals,
        tangent=-solution.tangent,
        normal_gain=-solution.normal_gain,
    )


def excess_px(solution: Solution, delta_chi2: float, focal_px: float) -> float:
    """RMS misfit of a match, px, that corresponds to a growth of chi-square."""
    return float(solution.noise * np.sqrt(max(delta_chi2, 0.0) / max(int(solution.inlier.sum()), 1)) * focal_px)


def _beyond_systematics(solution: Solution, focal_px: float) -> Solution:
    """Reject the second root only if its misfit is larger by more than the floor of systematic errors.

    The part of the misfit that is due to a prior has no such floor.
    """
    found = solution.ambiguity
    if found.status != "resolved" or found.delta_chi2 is None:
        return solution
    floor = int(solution.inlier.sum()) * (SYSTEMATIC_PX / (solution.noise * focal_px)) ** 2
    if rules_out(found.delta_chi2, found.delta_chi2_prior or 0.0, floor):
        return solution
    return replace(solution, ambiguity=replace(found, status="unresolved"))
