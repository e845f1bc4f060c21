"""Checks of a user's own correspondences: whether they agree on a motion, lie on their planes, and have their noise."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from slopecli.errors import NoAnswer
from slopecli.findings.fit_checks import solver_remedy
from slopecli.findings.plane_checks import NON_PLANAR
from slopecli.findings.wording import finding, listed
from slopecli.geometry.epipolar import homogeneous
from slopecli.geometry.tilt_error import tilt_growth
from slopecli.patches.given.given_solution import GivenSolution
from slopecli.patches.given.rows import FEWEST, RAYS
from slopecli.patches.join import Joined
from slopecli.types import Camera, Diagnostic, Solution

TIMES_NOISE = 2.0  # times the noise given, beyond which residuals contradict it
NOISY_PX = 2.0  # residuals no matcher leaves; points marked by hand need --noise


def alike(joined: Joined) -> bool:
    """Whether an affine map explains half the scatter of the points in image 2: it has a left and a right then."""
    points = joined.matches
    design = homogeneous(points.x1)
    residual = points.x2 - design @ np.linalg.lstsq(design, points.x2, rcond=None)[0]
    return float(residual.var()) < 0.5 * float(points.x2.var(axis=0).mean())


def refuse_unrelated(solution: Solution, joined: Joined, camera2: Camera) -> None:
    """Raise NoAnswer where rows agree on no motion: their residuals are a tenth of the spread of the points or more."""
    spread = float(np.sqrt(joined.matches.x2.var(axis=0).mean()))
    if solution.noise <= 0.1 * spread:
        return
    unit, per = _unit(camera2)
    raise NoAnswer(
        "no-overlap",
        f"the rows agree on no motion of the camera: residuals are {solution.noise * per:.3g} {unit}, and "
        f"the points are spread over {spread * per:.3g} {unit} (1-sigma)",
        solver_remedy(solution)
        or "check that x1,y1 and x2,y2 are the same point in either image, of one pair, and the camera",
        value=solution.noise / spread,
    )


def _unit(camera2: Camera) -> tuple[str, float]:
    """The unit of residuals, and how many of it a normalised coordinate is."""
    return ("mrad", 1e3) if camera2 is RAYS else ("px", camera2.focal_px)


@dataclass(frozen=True, eq=False)
class GivenFacts:
    """A solution of given correspondences; noise: 1-sigma as given, None where none was; unit, per: of residuals.

    off_plane : (m,) why each patch is not one plane, "" where nothing contradicts it.
    """

    solved: GivenSolution
    joined: Joined
    noise: float | None
    unit: str
    per: float
    off_plane: list[str]

    @property
    def measured(self) -> float:
        """1-sigma of a coordinate as measured, normalised."""
        return self.solved.solution.noise

    @property
    def remedy(self) -> str:
        """What to do where residuals are due to the solver, else ""."""
        return solver_remedy(self.solved.solution)

    @property
    def solver_leaves_residuals(self) -> bool:
        """Whether residuals that look like relief are due to the solver."""
        return bool(self.remedy) and any(reason.startswith(NON_PLANAR) for reason in self.off_plane)


def review(
    solved: GivenSolution, joined: Joined, noise: float | None, camera2: Camera
) -> tuple[Joined, list[Diagnostic]]:
    """The patches with what contradicts their planes as their `reason`, and what a user should know of them.

    noise : as given, see `solve_given`; None where none was.
    """
    unit, per = _unit(camera2)
    facts = GivenFacts(solved, joined, noise, unit, per, _off_plane(solved, noise))
    reasons = _reasons(facts)
    diagnostics = [*_due_to_solver(facts), *_beyond_the_noise(facts), *_rough(facts, reasons)]
    patches = [replace(patch, reason=reason) for patch, reason in zip(joined.patches, reasons, strict=True)]
    return joined.with_patches(patches), diagnostics


def _off_plane(solved: GivenSolution, noise: float | None) -> list[str]:
    """(m,) why each patch is not one plane, "" where nothing contradicts it."""
    growth = tilt_growth(solved.solution.scaled_normals, solved.solution.normal_covariance)
    return [_off_plane_of(k, solved, noise, float(growth[k])) for k in range(len(growth))]


def _off_plane_of(k: int, solved: GivenSolution, noise: float | None, growth: float) -> str:
    seen = solved.flatness
    if seen.off[k] and noise is not None and seen.both[k] > TIMES_NOISE * noise:
        return f"{NON_PLANAR}: residuals are {seen.both[k] / noise:.2g} times the noise given"
    if solved.emptied[k]:
        return f"{NON_PLANAR}: too many of its rows lie off it"
    if growth > 2.0:  # times the sigma by derivatives: the tilt has no normal distribution
        return "its rows lie nearly on a line, which does not determine its tilt"
    if solved.unchecked[k]:
        return f"{NON_PLANAR}: only {FEWEST} rows were kept, which fit any plane, so the mismatch may be among them"
    bent = seen.shaped[k] or not solved.solution.relief.any()
    if seen.off[k] and seen.along[k] > TIMES_NOISE * seen.across and bent:
        return f"{NON_PLANAR}: its rows do not lie on one plane"
    return ""


def _reasons(facts: GivenFacts) -> list[str]:
    """(m,) why each plane is poor, "" where it is not."""
    m = len(facts.off_plane)
    if facts.noise is not None and facts.measured > TIMES_NOISE * facts.noise:
        return [f"residuals are {facts.measured / facts.noise:.3g} times the noise given"] * m
    if _is_noisy(facts):
        return [f"residuals of {facts.measured * facts.per:.3g} px"] * m
    if facts.solver_leaves_residuals:
        return [reason and f"residuals of {facts.solved.solution.solver}" for reason in facts.off_plane]
    return facts.off_plane


def _is_noisy(facts: GivenFacts) -> bool:
    return facts.noise is None and facts.unit == "px" and facts.measured * facts.per > NOISY_PX


def _due_to_solver(facts: GivenFacts) -> list[Diagnostic]:
    """Residuals like those of relief that are due to the solver."""
    if not facts.solver_leaves_residuals:
        return []
    message = "residuals along the epipolar lines exceed those across, which may be due to the solver"
    return [finding("poor-fit", message, facts.measured * facts.per, facts.remedy)]


def _beyond_the_noise(facts: GivenFacts) -> list[Diagnostic]:
    """Residuals larger than the noise given or, where none was given, than those of any matcher."""
    if facts.noise is None:
        return [_noisy(facts)] if _is_noisy(facts) else []
    seen = facts.solved.flatness
    worst = max([facts.measured, *seen.both[seen.off].tolist()])
    if worst <= facts.noise * (1.0 + 1e-9):
        return []
    times = worst / facts.noise
    measured, given = (f"{sigma * facts.per:.3g} {facts.unit}" for sigma in (worst, facts.noise))
    if times <= TIMES_NOISE:
        message = f"residuals are {measured}, more than the noise given, {given}; sigmas are based on the residuals"
        return [finding("noise-exceeded", message, worst * facts.per)]
    message = f"residuals are {times:.3g} times the noise given: {measured}, given {given}"
    remedy = facts.remedy or "check the camera, the column patch and the noise; on rough ground leave the noise out"
    return [finding("poor-fit", message, times, remedy)]


def _noisy(facts: GivenFacts) -> Diagnostic:
    residual = facts.measured * facts.per
    message = f"residuals are {residual:.3g} px, those of matches below {NOISY_PX:g} px, so no plane is called safe"
    remedy = facts.remedy or "check the camera and the rows; if the points are no better, say so with --noise"
    return finding("poor-fit", message, residual, remedy)


def _rough(facts: GivenFacts, reasons: list[str]) -> list[Diagnostic]:
    """Planes solved as rough ground because their rows are off them."""
    off = facts.solved.flatness.off
    ids = [patch.id for k, patch in enumerate(facts.joined.patches) if off[k] and not reasons[k]]
    if not ids or not facts.solved.solution.relief.any():
        return []
    message = (
        f"rows of plane{'s' if len(ids) > 1 else ''} {listed([str(number) for number in ids])} are off along their "
        "epipolar lines by more than their noise: solved as rough ground, whose relief is in the sigmas and is given "
        "as roughness"
    )
    return [finding("relief", message, float(len(ids)))]
