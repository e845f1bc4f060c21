"""Checks of a user's own correspondences: whether they agree on a motion, lie on their planes, and have their noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from slopecli.errors import NoAnswer
from slopecli.findings.camera_checks import implausible_cameras
from slopecli.findings.plane_checks import NON_PLANAR, ROUGH
from slopecli.findings.solution_checks import solver_remedy
from slopecli.findings.wording import finding, listed
from slopecli.geometry.camera import OFF_MIDDLE
from slopecli.geometry.slope import tilt_growth
from slopecli.patches.given import FEWEST, RAYS, GivenSolution, off_image
from slopecli.patches.join import Joined
from slopecli.patches.settling import CLEARLY
from slopecli.types import Camera, Diagnostic, FloatArray, Solution

NOISY_PX = 2.0  # residuals no matcher leaves; points marked by hand need --noise


def refuse_unrelated(solution: Solution, joined: Joined, camera2: Camera) -> None:
    """Raise NoAnswer where rows agree on no motion: their residuals are a tenth of the spread of the points or more."""
    spread = float(np.sqrt(joined.matches.x2.var(axis=0).mean()))
    if solution.noise <= 0.1 * spread:
        return
    unit, per = _unit(camera2)
    reason = (
        f"the rows agree on no motion of the camera: residuals are {solution.noise * per:.3g} {unit}, and "
        f"the points are spread over {spread * per:.3g} {unit} (1-sigma)"
    )
    remedy = "check that x1,y1 and x2,y2 are the same point in either image, of one pair, and the camera"
    raise NoAnswer("no-overlap", reason, solver_remedy(solution) or remedy, value=solution.noise / spread)


def _unit(camera2: Camera) -> tuple[str, float]:
    """The unit of residuals, and how many of it a normalised coordinate is."""
    return ("mrad", 1e3) if camera2 is RAYS else ("px", camera2.focal_px)


def cameras_of_rows(joined: Joined, camera1: Camera, camera2: Camera) -> list[Diagnostic]:
    """Warn of cameras as hardly any are made; where a camera has no image size, by where its points are."""
    found = implausible_cameras(camera1, camera2)
    matches = joined.matches
    for number, camera, rays, uv in ((1, camera1, matches.x1, matches.uv1), (2, camera2, matches.x2, matches.uv2)):
        if camera is RAYS or camera.width or found or not len(rays):
            continue
        if why := _wide(camera, rays) or _off_centre(camera, uv):
            found.append(finding("implausible-camera", why, float(number)))
    return found


def _wide(camera: Camera, rays: FloatArray) -> str:
    """Whether points have rays (n, 2) farther off the axis than lenses see."""
    tangent = float(np.quantile(np.hypot(*rays.T), 0.9))
    if tangent <= 3.0:  # lenses that are no fisheyes see up to 1.7
        return ""
    degrees = np.degrees(np.arctan(tangent))
    return (
        f"with fx = {camera.fx:.6g} px a tenth of the points are {degrees:.0f}° or more off the axis (is it in "
        "millimetres?)"
    )


def _off_centre(camera: Camera, uv: FloatArray) -> str:
    """Whether a principal point is off the middle of every image that holds the points (n, 2), px of the first pixel.

    An image is at least as large as its points are spread, and a larger one has its middle farther on.
    """
    if uv.min() < -0.5:  # measured from elsewhere
        return ""
    for name, place, far in zip(("cx", "cy"), (camera.cx, camera.cy), np.quantile(uv, 0.9, axis=0), strict=True):
        if far / 2.0 - place > OFF_MIDDLE * (far + 1.0):
            return (
                f"the principal point {name} = {place:.6g} is more than a quarter of the image off its middle, as "
                f"points lie at up to {far:.5g} px and none below 0 (are they pixels of the same image?)"
            )
    return ""


def rows_outside(joined: Joined, camera1: Camera, camera2: Camera) -> list[Diagnostic]:
    """Warn of points outside an image of known size, and say how many there are."""
    found = []
    for number, camera, uv in ((1, camera1, joined.matches.uv1), (2, camera2, joined.matches.uv2)):
        outside = off_image(camera, uv)
        if outside.any():
            u, v = uv[outside][0]
            message = (
                f"{int(outside.sum())} of {len(uv)} rows lie outside image {number} of {camera.width}x{camera.height} "
                f"px, the first at ({u:.6g}, {v:.6g})"
            )
            found.append(finding("outside-image", message, float(outside.mean())))
    return found


def review(
    solved: GivenSolution,
    joined: Joined,
    noise: float | None,
    camera1: Camera,
    camera2: Camera,
    *,
    planes_found: bool = False,
) -> tuple[Joined, list[Diagnostic]]:
    """The patches with what contradicts their planes as their `reason`, and what a user should know of them.

    noise : as given, see `solve_given`; None where none was.  planes_found : whether the patches are found planes.
    """
    unit, per = _unit(camera2)
    solver, measured, remedy = solved.solution.solver, solved.solution.noise, solver_remedy(solved.solution)
    reasons = _off_plane(solved, noise)
    found: list[Diagnostic] = []
    if remedy and any(reason.startswith(NON_PLANAR) for reason in reasons):
        reasons = [reason and f"residuals of {solver}" for reason in reasons]
        message = "residuals along the epipolar lines exceed those across, which may be due to the solver"
        found.append(finding("poor-fit", message, measured * per, remedy))
    if noise is not None:
        if measured > CLEARLY * noise:
            reasons = [f"residuals are {measured / noise:.3g} times the noise given"] * len(reasons)
        found += _beyond_the_noise(solved, noise, unit, per)
    elif unit == "px" and measured * per > NOISY_PX:
        residuals = f"{measured * per:.3g} px"
        reasons = [f"residuals of {residuals}"] * len(reasons)
        message = f"residuals are {residuals}, those of matches below {NOISY_PX:g} px, so no plane is called safe"
        remedy = remedy or noisy_remedy(several=planes_found or len(joined.patches) > 1)
        found.append(finding("poor-fit", message, measured * per, remedy))
    found += [*cameras_of_rows(joined, camera1, camera2), *rows_outside(joined, camera1, camera2)]
    patches = [replace(patch, reason=reason) for patch, reason in zip(joined.patches, reasons, strict=True)]
    return replace(joined, patches=tuple(patches)), [*found, *_rough(solved, joined, reasons)]


def noisy_remedy(*, several: bool) -> str:
    """What to try where residuals are larger than those of matches; several: whether planes were told apart."""
    apart = "" if several else "if the rows lie on several planes, --planes found tells them apart; "
    return f"{apart}check the camera and the rows; if the points are no better, say so with --noise"


def _off_plane(solved: GivenSolution, noise: float | None) -> list[str]:
    """(m,) why each patch is not one plane, "" where nothing contradicts it."""
    growth = tilt_growth(solved.solution.scaled_normals, solved.solution.normal_covariance)
    return [_off_plane_of(k, solved, noise, float(growth[k])) for k in range(len(growth))]


def _off_plane_of(k: int, solved: GivenSolution, noise: float | None, growth: float) -> str:
    seen = solved.flatness
    if seen.off[k] and noise is not None and seen.both[k] > CLEARLY * noise:
        return f"{NON_PLANAR}: residuals are {seen.both[k] / noise:.2g} times the noise given"
    if solved.emptied[k]:
        return f"{NON_PLANAR}: too many of its rows lie off it"
    if growth > 2.0:  # times the sigma by derivatives: the tilt has no normal distribution
        return "its rows lie nearly on a line, which does not determine its tilt"
    if solved.unchecked[k]:
        return f"{NON_PLANAR}: only {FEWEST} rows were kept, which fit any plane, so the mismatch may be among them"
    if seen.bent[k]:
        return f"{NON_PLANAR}: its rows follow a curved surface, or several planes"
    shaped = seen.shaped[k] or not solved.solution.relief.any()
    if seen.off[k] and seen.along[k] > CLEARLY * seen.across and shaped:
        return f"{NON_PLANAR}: residuals of its rows along the epipolar lines exceed those across"
    return ""


def _beyond_the_noise(solved: GivenSolution, noise: float, unit: str, per: float) -> list[Diagnostic]:
    """Residuals larger than the noise given."""
    seen = solved.flatness
    worst = max([solved.solution.noise, *seen.both[seen.off].tolist()])
    if worst <= noise * (1.0 + 1e-9):
        return []
    times = worst / noise
    measured, given = (f"{sigma * per:.3g} {unit}" for sigma in (worst, noise))
    if times <= CLEARLY:
        message = f"residuals are {measured}, more than the noise given, {given}; sigmas are based on the residuals"
        return [finding("noise-exceeded", message, worst * per)]
    message = f"residuals are {times:.3g} times the noise given: {measured}, given {given}"
    remedy = "check the camera, the column patch and the noise; on rough ground leave the noise out"
    return [finding("poor-fit", message, times, solver_remedy(solved.solution) or remedy)]


def _rough(solved: GivenSolution, joined: Joined, reasons: list[str]) -> list[Diagnostic]:
    """Planes solved as rough ground because their rows are off them."""
    rough = solved.flatness.off & (solved.solution.relief <= ROUGH)
    ids = [patch.id for k, patch in enumerate(joined.patches) if rough[k] and not reasons[k]]
    if not ids or not solved.solution.relief.any():
        return []
    message = (
        f"rows of plane{'s' if len(ids) > 1 else ''} {listed([str(number) for number in ids])} are off along their "
        "epipolar lines by more than their noise: solved as rough ground, whose relief is in the sigmas and is given "
        "as roughness"
    )
    return [finding("relief", message, float(len(ids)))]
