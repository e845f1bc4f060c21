"""What a user should know of an answer: each finding with its number, its cause and its remedy."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from slopecli.diagnosis import Apart
from slopecli.geometry.camera import pixels_from_rays
from slopecli.geometry.epipolar import focus_of_expansion, homogeneous
from slopecli.options import Options
from slopecli.planes.changes import Change
from slopecli.types import BoolArray, Camera, Correspondences, Diagnostic, FloatArray, Plane, Solution, Source

POOR_FIT_PX = 0.5  # noise of matches beyond which the cameras are in doubt, or the images
WORTH = 1.1  # times as far: a move longer by less is not worth a word
MOST_APART = 0.25  # of the distance to the scene: images taken farther apart show too little of the same
TOUCHED, MOST_NAMED = 0.02, 5  # share of a patch that changed from which on it is named, and how many are at most
NON_PLANAR = "non-planar-patch"  # as a diagnostic, and as the reason of a plane
# what to do about it
FLATTER: dict[Source, str] = {
    "window": "use smaller windows",
    "ransac": "look at it with --window, or lower --merge-px",
    "region": "look at it with --window, or lower --merge-px",
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
        found.append(_poor_fit(noise_px))
    if not solution.converged:
        remedy = "check the camera file, and that nothing in view moved"
        found.append(Diagnostic("poor-fit", "warning", "the joint solution did not settle", None, remedy))
    return found


def apart_of(solution: Solution, matches: Correspondences, length_m: float | None) -> Apart:
    """How far apart the images were taken, by the distances of what lies on planes."""
    on = matches.patch >= 0
    inverse_depth = (homogeneous(matches.x1[on]) * solution.scaled_normals[matches.patch[on]]).sum(1)
    return Apart(abs(float(np.median(inverse_depth))), length_m)


def short_of_tolerance(planes: Sequence[Plane], solution: Solution, apart: Apart, options: Options) -> list[Diagnostic]:
    """Planes that are undecided, or not known to `max_sigma`, and would not be after a longer move that can be made.

    Sigmas go down as the move grows. Nothing is said where two answers are left: those are what is undecided.
    """
    if solution.ambiguity.status == "unresolved":
        return []
    wanted = {plane.id: _wanted_sigma(plane, options) for plane in planes}
    factors = {plane.id: plane.slope_sigma_deg / max(wanted[plane.id], 1e-9) for plane in planes}
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


def _wanted_sigma(plane: Plane, options: Options) -> float:
    """1-sigma of the slope, deg, that would decide about a plane; infinite where parallax is not what is wanting."""
    if not plane.slope_known:
        return options.max_sigma_deg if ";" not in (plane.reason or "") else np.inf
    if plane.verdict != "undecided" or plane.status != "ok":
        return np.inf
    return abs(plane.slope_deg - options.tolerance_deg) / NormalDist().inv_cdf(options.confidence)


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
    return Diagnostic(
        NON_PLANAR,
        "warning",
        f"{plane.noun} {plane.id} is not one plane: relief {100 * relief:.1f} % of its distance, or a step in it",
        float(plane.id),
        FLATTER[plane.source],
    )


def _poor_fit(noise_px: float) -> Diagnostic:
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
