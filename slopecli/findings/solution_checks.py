"""Checks of the joint solution: residuals, convergence, single plane, second root, straight descent; merged patches."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from slopecli.findings.codes import LIMITS
from slopecli.findings.facts import AnswerFacts
from slopecli.findings.wording import finding
from slopecli.geometry.epipolar import homogeneous
from slopecli.geometry.motion import inverse_depth
from slopecli.geometry.statistics import median
from slopecli.patches.join import MergedGroup
from slopecli.patches.settling import much_less_alone
from slopecli.types import Diagnostic, FloatArray, Solution

POOR_FIT_PX = LIMITS["poor-fit"]
ALONG_DEG, FLAT_DEG = 15.0, 5.0  # a straight descent: motion off the planes' mean normal, and their RMS off it
FLAT_PX = 0.2  # of image 2; points nearer to one plane than this do not help to tell the motion by their relief


def solver_remedy(solution: Solution) -> str:
    """What to do about large residuals that are due to the solver; "" where they are those of the matches."""
    if solution.solver == "lh" or (solution.solver == "ha" and not solution.converged):
        return f"--solver {solution.solver} does not minimise residuals; use mle"
    return ""


def large_residuals(facts: AnswerFacts) -> list[Diagnostic]:
    """Residuals larger than matching noise."""
    noise_px = facts.noise_px
    if not noise_px > POOR_FIT_PX:  # NaN without a camera
        return []
    if remedy := solver_remedy(facts.solution):
        message = f"residuals of the matches are {noise_px:.2f} px, due to the solver or to the matches"
    elif alone := much_less_alone(facts.joined, facts.solution.noise):
        alone_px = alone / facts.solution.noise * noise_px
        message = (
            f"the patches contradict one another, and no single one is to blame: each alone fits a plane to "
            f"{alone_px:.2g} px, together they miss their epipolar lines by {noise_px:.2g} px"
        )
        return [finding("planes-contradict", message, noise_px)]
    else:
        message = f"matches miss their epipolar lines by {noise_px:.2f} px, good pairs by less than {POOR_FIT_PX:g} px"
        remedy = "check the camera file and its distortion; blur, a rolling shutter and moving things do the same"
    return [finding("poor-fit", message, noise_px, remedy)]


def not_converged(facts: AnswerFacts) -> list[Diagnostic]:
    """A joint solution that did not converge."""
    if facts.solution.converged:
        return []
    return [finding("poor-fit", "the joint solution did not converge", remedy=solver_remedy(facts.solution))]


def one_plane(facts: AnswerFacts) -> list[Diagnostic]:
    """The motion is estimated from a single plane, and no second root is left."""
    solution, focal_px = facts.solution, facts.focal_px
    if solution.ambiguity.status == "unresolved" or not solution.inlier.any():
        return []
    kept = facts.joined.matches.take(solution.inlier)
    off = _off_one_plane(solution, kept.x1, kept.x2)
    # residuals that are due to the solver hide how flat the scene is
    noise = 0.0 if solver_remedy(solution) else facts.noise
    if off > max(4.0 * noise, 0.0 if focal_px is None else FLAT_PX / focal_px):
        return []
    unit, size = ("mrad", 1e3 * off) if focal_px is None else ("px", off * focal_px)
    message = f"90 % of the matches lie within {size:.2f} {unit} of one plane, from which alone the motion is estimated"
    return [finding("single-plane", message, size, severity="info")]


def _off_one_plane(solution: Solution, x1: FloatArray, x2: FloatArray) -> float:
    """90 % quantile of the distance in image 2, normalised, of matches from the prediction of one plane fitted to all.

    x1, x2 : (n, 2) normalised coordinates.
    """
    w, leverage = inverse_depth(solution.R, solution.T, x1, x2)
    rows, target, weight = homogeneous(x1) * leverage[:, None], w * leverage, np.ones(len(w))
    off = np.zeros(len(w))
    for _ in range(5):  # least absolute deviations, by reweighted least squares
        normal = np.linalg.lstsq(rows * weight[:, None], target * weight, rcond=None)[0]
        off = np.abs(target - rows @ normal)
        weight = 1.0 / np.sqrt(np.maximum(off, 0.1 * median(off) + 1e-12))
    return float(np.quantile(off, 0.9))


def second_root(facts: AnswerFacts) -> list[Diagnostic]:
    """A second root that is not ruled out."""
    ambiguity = facts.solution.ambiguity
    if ambiguity.status != "unresolved":
        return []
    message = "all matches lie nearly on one plane, and a second motion explains them as well"
    return [finding("single-plane", message, ambiguity.delta_chi2, severity="warning")]


def straight_descent(facts: AnswerFacts) -> list[Diagnostic]:
    """Motion along the common normal of all planes, which determines slopes least of all motions."""
    normals = np.array([plane.normal_cam1 for plane in facts.planes])
    mean = normals.sum(0) / max(float(np.linalg.norm(normals.sum(0))), np.finfo(float).tiny)
    spread = float(np.degrees(np.sqrt(np.mean(np.arccos(np.clip(normals @ mean, -1.0, 1.0)) ** 2))))
    off = float(np.degrees(np.arccos(min(abs(float(mean @ facts.solution.T)), 1.0))))
    if off > ALONG_DEG or spread > FLAT_DEG:
        return []
    along = "of the only plane" if len(normals) == 1 else f"that all planes share to {spread:.1f}° (RMS)"
    message = f"the camera moved {off:.1f}° off the normal {along}: of all motions this one determines slopes least"
    sideways = facts.separation.sideways()
    remedy = f"{sideways}; or give --rotation-prior, or --merge-coplanar where windows lie on one plane"
    return [finding("weak-geometry", message, off, remedy)]


def merged_groups(groups: Sequence[MergedGroup]) -> list[Diagnostic]:
    """Patches that `--merge-coplanar` solved as one plane, or with one normal."""
    found = []
    for group in groups:
        what = "lie on one plane" if group.shares == "plane" else "face one way"
        message = (
            f"{', '.join(map(str, group.ids))} {what}, and are solved so (chi-square {group.chi2:.1f} over "
            f"{group.dof}): 1-sigma of the tilt {group.before_deg:.2g} -> {group.after_deg:.2g} deg"
        )
        found.append(finding("coplanar", message, group.before_deg / max(group.after_deg, 1e-9)))
    return found
