"""What speaks against planes that a user's own correspondences were said to lie on, and against the noise he gave."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from slopecli.errors import NoAnswer
from slopecli.findings.answer_checks import NON_PLANAR, of_solver
from slopecli.geometry.epipolar import homogeneous
from slopecli.geometry.tilt_interval import tilt_growth
from slopecli.patches.given.given_solution import GivenSolution
from slopecli.patches.given.rows import FEWEST, RAYS
from slopecli.patches.join import Joined
from slopecli.types import Camera, Diagnostic, Solution

OPEN = 2.0  # times the sigma that derivatives say: beyond it no sigma describes the tilt
FAR = 2.0  # times the noise, beyond which residuals are not what was said of them
MOST_UNLIKE = 0.5  # share of the scatter of points in image 2 beyond which nothing says where its left and right are
UNRELATED = 0.1  # of the spread of the points in image 2: larger residuals are no noise
NOISY_PX = 2.0  # no matcher is worse, and who marks points by hand can say that he is


def alike(joined: Joined) -> bool:
    """Whether image 2 looks like image 1, moved, turned, stretched or mirrored: an affine map explains most of it."""
    points = joined.matches
    design = homogeneous(points.x1)
    left = points.x2 - design @ np.linalg.lstsq(design, points.x2, rcond=None)[0]
    return float(left.var()) < MOST_UNLIKE * float(points.x2.var(axis=0).mean())


def refuse_strangers(solution: Solution, joined: Joined, camera2: Camera) -> None:
    """Raise NoAnswer where rows agree on no motion: those of two pairs, or of no pair at all."""
    spread = float(np.sqrt(joined.matches.x2.var(axis=0).mean()))
    if solution.noise <= UNRELATED * spread:
        return
    unit, per = _unit(camera2)
    raise NoAnswer(
        "no-overlap",
        f"the rows agree on no motion of the camera: residuals are {solution.noise * per:.3g} {unit}, and "
        f"the points are spread over {spread * per:.3g} {unit} (1-sigma)",
        of_solver(solution)
        or "check that x1,y1 and x2,y2 are the same point in either image, of one pair, and the camera",
        value=solution.noise / spread,
    )


def _unit(camera2: Camera) -> tuple[str, float]:
    """The unit of residuals, and how many of it a normalised coordinate is."""
    return ("mrad", 1e3) if camera2 is RAYS else ("px", camera2.focal_px)


def review(
    solved: GivenSolution, joined: Joined, noise: float | None, camera2: Camera
) -> tuple[Joined, list[Diagnostic]]:
    """The matches with what speaks against their planes, as their `reason`, and what a user should know of it.

    noise : as said beforehand, see `solve_given`; None where nothing was.
    """
    unit, per = _unit(camera2)
    seen, measured = solved.flatness, solved.solution.noise
    m = len(joined.patches)
    growth = tilt_growth(solved.solution.scaled_normals, solved.solution.normal_covariance)
    modelled = solved.solution.relief.any()
    reasons, notes = [""] * m, list[Diagnostic]()
    for k in range(m):
        if solved.emptied[k]:
            reasons[k] = f"{NON_PLANAR}: too many of its rows lie off it"
        elif growth[k] > OPEN:
            reasons[k] = "its rows lie nearly on a line, so its tilt is open"
        elif solved.unchecked[k]:
            reasons[k] = (
                f"{NON_PLANAR}: the {FEWEST} rows kept fit any plane, so another may be the one that lies off it"
            )
        elif seen.off[k] and seen.along[k] > FAR * seen.across and (seen.shaped[k] or not modelled):
            reasons[k] = f"{NON_PLANAR}: its rows do not lie on one plane"
        if seen.off[k] and noise is not None and seen.both[k] > FAR * noise:
            reasons[k] = f"{NON_PLANAR}: residuals are {seen.both[k] / noise:.2g} times the noise given"
    blamed = of_solver(solved.solution)
    if blamed and any(reason.startswith(NON_PLANAR) for reason in reasons):
        reasons = [reason and f"residuals of {solved.solution.solver}" for reason in reasons]
        message = "residuals along the epipolar lines are more than those across, which may be the solver's doing"
        notes.append(Diagnostic("poor-fit", "warning", message, measured * per, blamed))
    if noise is not None and measured > FAR * noise:
        reasons = [f"residuals are {measured / noise:.3g} times the noise given"] * m
    elif noise is None and unit == "px" and measured * per > NOISY_PX:
        reasons = [f"residuals of {measured * per:.3g} px"] * m
    if noise is not None:
        worst = max(measured, *(float(seen.both[k]) for k in range(m) if seen.off[k]), 0.0)
        notes += _beyond_the_given(worst * per, noise * per, unit, blamed)
    elif any(reason.endswith(" px") for reason in reasons):
        notes.append(_noisy(measured * per, blamed))
    rough = [joined.patches[k].id for k in range(m) if seen.off[k] and not reasons[k]]
    if rough and modelled:
        notes.append(_rough(rough))
    patches = [replace(patch, reason=reason) for patch, reason in zip(joined.patches, reasons, strict=True)]
    return joined.with_patches(patches), notes


def _beyond_the_given(measured: float, noise: float, unit: str, remedy: str) -> list[Diagnostic]:
    """That residuals are larger than the noise given, if they are.  remedy : where the solver is to blame, else ""."""
    if measured <= noise * (1 + 1e-9):
        return []
    times = measured / noise
    if times <= FAR:
        message = (
            f"residuals show {measured:.3g} {unit}, more than the noise given, {noise:.3g} {unit}; sigmas rest on them"
        )
        return [Diagnostic("noise-exceeded", "info", message, measured)]
    return [
        Diagnostic(
            "poor-fit",
            "warning",
            f"residuals are {times:.3g} times the noise given: {measured:.3g} {unit}, given {noise:.3g} {unit}",
            times,
            remedy or "check the camera, the column patch and the noise; on rough ground leave the noise out",
        )
    ]


def _noisy(measured_px: float, remedy: str) -> Diagnostic:
    return Diagnostic(
        "poor-fit",
        "warning",
        f"residuals are {measured_px:.3g} px, those of matches below {NOISY_PX:g} px, so no plane is called safe",
        measured_px,
        remedy or "check the camera and the rows; if the points are no better, say so with --noise",
    )


def _rough(ids: list[int]) -> Diagnostic:
    shown = ", ".join(map(str, ids[:9])) + (", ..." if len(ids) > 9 else "")
    return Diagnostic(
        "relief",
        "info",
        f"rows of plane{'s' if len(ids) > 1 else ''} {shown} stand off along their epipolar lines by more than their "
        "noise: solved as rough ground, whose relief is in the sigmas and stands under roughness",
        float(len(ids)),
    )
