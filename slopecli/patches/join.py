"""All patches together: their matches stacked and weighed, and one motion with all their planes solved from them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from slopecli.errors import NoAnswer
from slopecli.geometry.camera import pixels_from_rays
from slopecli.geometry.motion import MotionEstimate, epipolar_residual
from slopecli.geometry.solver.ambiguity import rules_out
from slopecli.geometry.solver.priors import MotionPrior
from slopecli.geometry.solver.solve import solve_planes
from slopecli.look.evidence import Evidence
from slopecli.look.noise import OVERVIEW_CELL_PX, SYSTEMATIC_PX, correlation_gain
from slopecli.look.scene import Scene
from slopecli.look.sparse import thin
from slopecli.patches.footprint import Footprint
from slopecli.patches.match import WindowMatch
from slopecli.patches.patch_set import Patches
from slopecli.types import Correspondences, FloatArray, IntArray, Solution

OUTSIDE_POINTS = 1500  # matches outside the windows that join the solution: more add time, not accuracy
REFERENCE_PX = 0.05  # weights are relative to a match this good


@dataclass(frozen=True, eq=False)
class Matched:
    """All patches with their matches, and what of them the solver is given.

    answered : indices of the patches that have matches, in the solver's order.
    weights : (n,) of the correspondences, inverse variances relative to REFERENCE_PX.
    """

    patches: Patches
    answered: list[int]
    correspondences: Correspondences
    weights: FloatArray

    @property
    def footprints(self) -> list[Footprint]:
        """Of all patches, answered or not."""
        return self.patches.footprints

    @property
    def matches(self) -> list[WindowMatch]:
        """Of all patches, answered or not."""
        return self.patches.matches


def join_patches(patches: Patches, scene: Scene) -> Matched:
    """Stack the patches' matches, and for the motion some of those outside all of them (patch -1).

    Raises
    ------
    NoAnswer : no patch has matches.
    """
    matches = patches.matches
    answered = [i for i, match in enumerate(matches) if match.origin != "none"]
    if not answered:
        raise NoAnswer(
            "low-texture",
            f"none of the {len(matches)} {patches.noun}s can be matched: {matches[0].reason}",
            f"choose {patches.noun}s with texture that both images show",
        )
    parts, evidence = [matches[i] for i in answered], scene.evidence
    outside = _outside(evidence, [patches.footprints[i] for i in answered])
    correspondences = Correspondences(
        uv1=np.vstack([*(p.uv1 for p in parts), evidence.uv1[outside]]),
        uv2=np.vstack([*(p.uv2 for p in parts), pixels_from_rays(scene.camera2, evidence.x2[outside])]),
        x1=np.vstack([*(p.x1 for p in parts), evidence.x1[outside]]),
        x2=np.vstack([*(p.x2 for p in parts), evidence.x2[outside]]),
        patch=np.repeat([*range(len(parts)), -1], [*(len(p.x1) for p in parts), len(outside)]),
    )
    outside_sigma = OVERVIEW_CELL_PX / float(scene.pyramid1.overview_scale.mean())
    variance = np.concatenate([*(p.variance_px[:, 0] for p in parts), np.full(len(outside), outside_sigma**2)])
    return Matched(patches, answered, correspondences, REFERENCE_PX**2 / variance)


def _outside(evidence: Evidence, footprints: list[Footprint]) -> IntArray:
    free = np.ones(len(evidence), bool)
    for footprint in footprints:
        free &= ~footprint.covers(evidence.uv1)
    return thin(evidence.uv1, np.flatnonzero(free), OUTSIDE_POINTS)


def solve_jointly(
    matched: Matched,
    scene: Scene,
    motions: list[MotionEstimate],
    solver: Literal["mle", "ha", "lh"],
    prior: MotionPrior | None = None,
    doubt: float = 1.0,
) -> Solution:
    """One motion and one plane per answered patch, started from every motion still in question.

    prior : what is known of the motion besides.  doubt : by how much all sigmas of matches are too small.
    """
    parts = [matched.matches[i] for i in matched.answered]
    points = matched.correspondences
    residuals = [(p.index, epipolar_residual(scene.R, scene.T, p.x1, p.x2)) for p in parts]
    solution = solve_planes(
        points.x1,
        points.x2,
        points.patch,
        solver,
        weights=matched.weights,
        relief=solver == "mle",
        initial=[(m.R, m.T) for m in motions],
        prior=prior,
        noise_gain=doubt * correlation_gain(residuals),
    )
    return _beyond_systematics(_facing(solution, scene.T), scene.camera2.focal_px)


def _facing(solution: Solution, T: FloatArray) -> Solution:
    """The solution on the side of the motion that puts the scene in front of the camera.

    (T, N) and (-T, -N) are one homography; a solver that sees few patches may take a mismatched one for decisive.
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
    """RMS misfit of a match, px, that a growth of chi-square amounts to."""
    return float(solution.noise * np.sqrt(max(delta_chi2, 0.0) / max(int(solution.inlier.sum()), 1)) * focal_px)


def _beyond_systematics(solution: Solution, focal_px: float) -> Solution:
    """A second root is ruled out only if it fits worse by more than calibration and interpolation can feign.

    What is known of the motion besides owes nothing to either: what that says against the other root stands.
    """
    found = solution.ambiguity
    if found.status != "resolved" or found.delta_chi2 is None:
        return solution
    feigned = int(solution.inlier.sum()) * (SYSTEMATIC_PX / (solution.noise * focal_px)) ** 2
    if rules_out(found.delta_chi2, found.delta_chi2_prior or 0.0, feigned):
        return solution
    return replace(solution, ambiguity=replace(found, status="unresolved"))
