"""What a user should know of an answer: each finding with its number, its cause and its remedy."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from slopecli.findings.changes import Change
from slopecli.findings.pair_checks import Apart
from slopecli.findings.partly_matched import unmatched_parts
from slopecli.geometry.camera import pixels_from_rays
from slopecli.geometry.epipolar import focus_of_expansion, homogeneous
from slopecli.geometry.motion import inverse_depth
from slopecli.geometry.statistics import median
from slopecli.options import Options
from slopecli.patches.given.given_solution import MOST_LEFT_OUT
from slopecli.patches.join import Joined
from slopecli.patches.patch import Patch
from slopecli.types import BoolArray, Camera, Diagnostic, FloatArray, IntArray, Plane, Solution, Source

POOR_FIT_PX = 0.5  # noise of matches beyond which the cameras are in doubt, or the images
UPRIGHT_DEG = 90.0
WORTH = 1.1  # times as far: a move longer by less is not worth a word
ALONG_DEG, FLAT_DEG = 15.0, 5.0  # motion off the normal of the ground, and RMS of its slopes, of a straight descent
FLAT_PX, NOISE_OFF = 0.2, 4.0  # off one plane, px and sigmas: within either, relief tells nothing of the motion
MOST_OF_IT, PLANE_ROUNDS = 0.9, 5
MOST_APART = 0.25  # of the distance to the scene: images taken farther apart show too little of the same
TOUCHED, MOST_NAMED = 0.02, 5  # share of a patch that changed from which on it is named, and how many are at most
NON_PLANAR = "non-planar-patch"  # as a diagnostic, and as the reason of a plane
ROUGH = 0.025  # RMS height off the plane over distance beyond which a window is not one plane
# what to do about it
FLATTER: dict[Source, str] = {
    "window": "use smaller windows",
    "ransac": "look at it with slopemap estimate --window, or lower --merge-px",
    "region": "look at it with slopemap estimate --window, or lower --merge-px",
    "given": "leave out rows that lie off it, or give them another patch",
}


def epipole1_px(solution: Solution, camera1: Camera) -> tuple[float, float] | None:
    """Pixel of image 1 the camera moves towards or away from, None when it is not inside the image."""
    focus = focus_of_expansion(solution.T)
    if focus is None:
        return None
    u, v = pixels_from_rays(camera1, focus[None])[0]
    inside = -0.5 <= u < camera1.width - 0.5 and -0.5 <= v < camera1.height - 0.5  # False for NaN, too
    return (float(u), float(v)) if inside else None


def diagnose(
    planes: tuple[Plane, ...],
    relief: dict[int, float],
    solution: Solution,
    epipole: tuple[float, float] | None,
    noise_px: float,
    labels: NDArray[np.uint16],
) -> list[Diagnostic]:
    """What a user should know of an answer: weak windows, a second motion, a solution that did not settle.

    relief : RMS height off the plane over its distance, by plane id.  epipole : px of image 1, None when outside.
    noise_px : 1-sigma of the median match, as measured.  labels : (h, w) plane id per pixel of image 1, 0 for none.
    """
    found = [
        _focus_in(plane) for plane in planes if epipole is not None and _inside(plane, np.array([epipole]), labels)[0]
    ]
    found += [_not_flat(plane, relief[plane.id]) for plane in planes if NON_PLANAR in (plane.reason or "")]
    if solution.ambiguity.status == "unresolved":
        found.append(_second_motion(solution))
    if noise_px > POOR_FIT_PX:
        found.append(_poor_fit(noise_px, solution))
    if not solution.converged:
        remedy = of_solver(solution) or "check the camera file, and that nothing in view moved"
        found.append(Diagnostic("poor-fit", "warning", "the joint solution did not settle", None, remedy))
    return found


def of_geometry(
    planes: Sequence[Plane],
    solution: Solution,
    joined: Joined,
    length_m: float | None,
    focal_px: float | None,
    options: Options,
    patches: dict[int, Patch],
    noise: float,
) -> list[Diagnostic]:
    """What the shape of the ground and the way of the camera over it make hard, or would make easier.

    length_m : between the cameras, where it is known.  focal_px : of camera 2, None for rays without a camera.
    patches : of the planes, by id.  noise : 1-sigma of a match of weight one as measured, normalised.
    """
    apart = apart_of(solution, joined, length_m)
    found = on_one_plane(solution, joined, focal_px, noise) + towards_flat_ground(planes, solution, apart)
    doubts = {number: float(np.degrees(patch.tilt_sigma_rad)) for number, patch in patches.items()}
    found += upside_down(planes, options)
    return found + unmatched_parts(planes, patches) + short_of_tolerance(planes, doubts, solution, apart, options)


def apart_of(solution: Solution, joined: Joined, length_m: float | None) -> Apart:
    """How far apart the images were taken, by the distances of what lies on planes."""
    on = joined.plane >= 0
    inverse_depth = (homogeneous(joined.matches.x1[on]) * solution.scaled_normals[joined.plane[on]]).sum(1)
    return Apart(abs(median(inverse_depth)), length_m)


def upside_down(planes: Sequence[Plane], options: Options) -> list[Diagnostic]:
    """Up given the wrong way round: all that image 1 shows would hang over."""
    if isinstance(options.up, str) or not planes or min(plane.slope_deg for plane in planes) <= UPRIGHT_DEG:
        return []
    return [
        Diagnostic(
            "upside-down",
            "warning",
            f"every {planes[0].noun} faces away from up, as if the ground hung over the camera",
            float(len(planes)),
            "turn the sign of --up: it points against gravity, in camera-1 axes (x right, y down, z forward)",
        )
    ]


def short_of_tolerance(
    planes: Sequence[Plane], doubts: dict[int, float], solution: Solution, apart: Apart, options: Options
) -> list[Diagnostic]:
    """Planes that are undecided, or not known to `max_sigma`, and would not be after a longer move that can be made.

    Sigmas go down as the move grows, but for what is in doubt whatever the parallax: `doubts`, deg, by plane id.
    Nothing is said where two answers are left: those are what is undecided.
    """
    if solution.ambiguity.status == "unresolved":
        return []
    wanted = {plane.id: _wanted_sigma(plane, options) for plane in planes}
    factors = {p.id: _times_as_far(p.slope_sigma_deg, wanted[p.id], doubts[p.id]) for p in planes}
    helped = [plane for plane in planes if WORTH < factors[plane.id] <= MOST_APART / apart.share]
    if not helped:
        return []
    shown = sorted(helped, key=lambda plane: factors[plane.id])
    named = [
        f"{plane.noun} {plane.id} has a sigma of {plane.slope_sigma_deg:.2g}°, and {wanted[plane.id]:.2g}° would decide"
        for plane in shown[:MOST_NAMED]
    ]
    more = [f"and {len(shown) - MOST_NAMED} more"] if len(shown) > MOST_NAMED else []
    factor = factors[shown[-1].id]
    message = f"too little parallax for the tolerance: {', '.join(named + more)}"
    return [Diagnostic("low-parallax", "info", message, factor, apart.farther(factor))]


def _times_as_far(sigma: float, wanted: float, doubt: float) -> float:
    """How many times the parallax makes the wanted sigma of a given one, where a part of both does not change."""
    changing, left = sigma**2 - doubt**2, wanted**2 - doubt**2
    return float(np.sqrt(max(changing, 0.0) / left)) if left > 0.0 else np.inf


def _wanted_sigma(plane: Plane, options: Options) -> float:
    """1-sigma of the slope, deg, that would decide about a plane; infinite where parallax is not what is wanting."""
    if not plane.slope_known:
        return options.max_sigma_deg if ";" not in (plane.reason or "") else np.inf
    if plane.verdict != "undecided" or plane.status != "ok":
        return np.inf
    return abs(plane.slope_deg - options.tolerance_deg) / NormalDist().inv_cdf(options.confidence)


def towards_flat_ground(planes: Sequence[Plane], solution: Solution, apart: Apart) -> list[Diagnostic]:
    """A straight descent over level ground, motion along the one normal there is, tells slopes least of all."""
    normals = np.array([plane.normal_cam1 for plane in planes])
    mean = normals.sum(0) / max(float(np.linalg.norm(normals.sum(0))), np.finfo(float).tiny)
    spread = float(np.degrees(np.sqrt(np.mean(np.arccos(np.clip(normals @ mean, -1.0, 1.0)) ** 2))))
    off = float(np.degrees(np.arccos(min(abs(float(mean @ solution.T)), 1.0))))
    if off > ALONG_DEG or spread > FLAT_DEG:
        return []
    return [
        Diagnostic(
            "weak-geometry",
            "info",
            f"the camera moved {off:.1f}° off the normal of flat ground, whose slopes differ by {spread:.1f}° (RMS): "
            "of all motions this tells its slope least",
            off,
            f"{apart.sideways}; or give --rotation-prior, or --merge-coplanar where windows lie on one plane",
        )
    ]


def on_one_plane(solution: Solution, joined: Joined, focal_px: float | None, noise: float) -> list[Diagnostic]:
    """Say that the motion rests on a single plane, where the images leave no second answer for all that.

    focal_px : of camera 2; None for rays, of which only their noise says what is flat.  noise : as measured.
    """
    if solution.ambiguity.status == "unresolved" or not solution.inlier.any():
        return []
    kept = joined.matches.take(solution.inlier)
    off = _off_one_plane(solution, kept.x1, kept.x2)
    seen = 0.0 if of_solver(solution) else noise  # residuals of the solver's own making hide how flat the scene is
    if off > max(NOISE_OFF * seen, 0.0 if focal_px is None else FLAT_PX / focal_px):
        return []
    unit, size = ("mrad", 1e3 * off) if focal_px is None else ("px", off * focal_px)
    return [
        Diagnostic(
            "single-plane",
            "info",
            f"nine tenths of what is seen lie within {size:.2f} {unit} of one plane: the motion rests on it alone",
            size,
            "ground with more relief, or what else is known of the motion, makes it surer",
        )
    ]


def _off_one_plane(solution: Solution, x1: FloatArray, x2: FloatArray) -> float:
    """What nine tenths of the matches stay within of where the plane that fits them all sends them, normalised."""
    w, leverage = inverse_depth(solution.R, solution.T, x1, x2)
    rows, target, weight = homogeneous(x1) * leverage[:, None], w * leverage, np.ones(len(w))
    off = np.zeros(len(w))
    for _ in range(PLANE_ROUNDS):
        normal = np.linalg.lstsq(rows * weight[:, None], target * weight, rcond=None)[0]
        off = np.abs(target - rows @ normal)
        weight = 1.0 / np.sqrt(np.maximum(off, 0.1 * median(off) + 1e-12))  # least absolute values
    return float(np.quantile(off, MOST_OF_IT))


def changed(changes: Sequence[Change], planes: tuple[Plane, ...], labels: NDArray[np.uint16]) -> list[Diagnostic]:
    """A warning for every kind of change in the scene, with the planes it touches, most touched first."""
    return [_changed(change, planes, labels) for change in changes]


def _changed(change: Change, planes: tuple[Plane, ...], labels: NDArray[np.uint16]) -> Diagnostic:
    what = {
        "brightness": "became brighter or darker than the rest, as where a shadow moves",
        "motion": "moves otherwise than the rest, as vehicles do",
    }[change.kind]
    shares = [(_share_of(plane, change, labels), plane) for plane in planes]
    touched = sorted(((share, plane) for share, plane in shares if share >= TOUCHED), key=lambda pair: -pair[0])
    named = [f"{plane.noun} {plane.id} ({100 * share:.0f} %)" for share, plane in touched[:MOST_NAMED]]
    more = [f"{len(touched) - MOST_NAMED} more"] if len(touched) > MOST_NAMED else []
    where = f": {', '.join(named + more)}" if named else f", in no {planes[0].noun}"
    return Diagnostic(
        "dense-shadow-or-motion",
        "warning",
        f"{100 * change.share:.1f} % of image 1 {what}{where}",
        change.share,
        "distrust what is touched, or take both images in quick succession",
    )


def _share_of(plane: Plane, change: Change, labels: NDArray[np.uint16]) -> float:
    """How much of a plane's pixels changed."""
    area = float((labels == plane.id).sum()) if plane.found else float(np.ptp(plane.polygon_px, axis=0).prod())
    cell = change.cell_share * labels.size
    return min(float(_inside(plane, change.uv1, labels).sum()) * cell / max(area, 1.0), 1.0)


def _inside(plane: Plane, points: FloatArray, labels: NDArray[np.uint16]) -> BoolArray:
    """(n,) whether points (n, 2) of image 1 lie in a window, or on a pixel of a plane of any shape."""
    if plane.found:
        columns, rows = np.floor(points + 0.5).astype(int).T
        return np.asarray(labels[rows, columns] == plane.id)
    low, high = plane.polygon_px.min(0), plane.polygon_px.max(0)
    return np.asarray(((low < points) & (points < high)).all(1))


def _focus_in(plane: Plane) -> Diagnostic:
    return Diagnostic(
        "foe-in-window",
        "info",
        f"the camera moves along a line of sight through {plane.noun} {plane.id}: it shows least parallax there",
        float(plane.id),
        "move sideways as well" + (", or choose another window" if plane.source == "window" else ""),
    )


def _not_flat(plane: Plane, relief: float) -> Diagnostic:
    found = (
        f"its relief is {100 * relief:.1f} % of its distance"
        if relief > ROUGH
        else f"more than {100 * MOST_LEFT_OUT:.0f} % of its matches lie off it, across a step or an edge"
    )
    return Diagnostic(
        NON_PLANAR,
        "warning",
        f"{plane.noun} {plane.id} is not one plane: {found}",
        float(plane.id),
        FLATTER[plane.source],
    )


def of_solver(solution: Solution) -> str:
    """What to do about large residuals that are the solver's own; "" where they are those of the matches."""
    if solution.solver == "lh" or (solution.solver == "ha" and not solution.converged):
        return f"--solver {solution.solver} does not fit noise away; use mle"
    return ""


def measured_noise(solution: Solution, plane: IntArray) -> float:
    """1-sigma of a match of weight one by its residuals, where the solution's own may have been given.

    plane : (n,) of the matches.
    """
    on_none = int((plane[solution.inlier] < 0).sum())
    residuals = 2 * int(solution.inlier.sum()) - on_none
    freedom = residuals - 5 - 3 * len(solution.scaled_normals)
    return float(solution.noise * min(np.sqrt(solution.chi2 / max(freedom, 1)), 1.0))


def _poor_fit(noise_px: float, solution: Solution) -> Diagnostic:
    if remedy := of_solver(solution):
        message = f"the solution misses the matches by {noise_px:.2f} px, which is the solver's doing or theirs"
        return Diagnostic("poor-fit", "warning", message, noise_px, remedy)
    return Diagnostic(
        "poor-fit",
        "warning",
        f"matches miss their epipolar lines by {noise_px:.2f} px, good pairs by less than {POOR_FIT_PX:g} px",
        noise_px,
        "check the camera file and its distortion; blur, a rolling shutter and moving things do the same",
    )


def unexplained(labels: NDArray[np.uint16]) -> Diagnostic:
    """The share of image 1 (h, w) that lies on no plane reported, where planes were sought in all of it."""
    share = float((labels == 0).mean())
    message = f"{100 * share:.0f} % of image 1 lies on no plane found, or outside image 2"
    return Diagnostic("unexplained", "info", message, share)


def _second_motion(solution: Solution) -> Diagnostic:
    return Diagnostic(
        "single-plane",
        "warning",
        "all that is seen lies on nearly one plane, and a second motion explains it as well",
        solution.ambiguity.delta_chi2,
        "use a third image, a known direction of motion, or ground with more relief",
    )
