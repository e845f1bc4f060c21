"""Checks of the planes: relief, steps, ground without matches, changes between the images, and the epipole in them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from slopecli.findings.codes import LIMITS
from slopecli.findings.facts import AnswerFacts
from slopecli.findings.wording import finding, listed
from slopecli.look.changes import Change
from slopecli.patches import FINDER_OF
from slopecli.patches.given import MOST_LEFT_OUT
from slopecli.types import Diagnostic, Plane

NON_PLANAR = "non-planar-patch"  # as a diagnostic, and as the reason of a plane
ROUGH = LIMITS["non-planar-patch"]
WALL_DEG = 60.0  # few roofs are steeper, and few walls lean as far, or beyond the vertical
TOUCHED = 0.02  # share of a plane that changed from which on it is named
CHANGED = {
    "brightness": "became brighter or darker than the rest, as where a shadow moves",
    "motion": "moves differently from the rest, as vehicles do",
}


def on_no_plane(facts: AnswerFacts) -> list[Diagnostic]:
    """The share of image 1 that lies on no plane, where planes were sought in all of it."""
    if not facts.planes[0].found:
        return []
    share = float((facts.labels == 0).mean())
    return [finding("unexplained", f"{100 * share:.0f} % of image 1 lies on no plane found, or outside image 2", share)]


def changed_areas(facts: AnswerFacts) -> list[Diagnostic]:
    """Every kind of change in the scene, with the planes it touches, most touched first."""
    return [_changed(change, facts) for change in facts.changes]


def _changed(change: Change, facts: AnswerFacts) -> Diagnostic:
    shares = [(_share_of(plane, change, facts), plane) for plane in facts.planes]
    touched = sorted(((share, plane) for share, plane in shares if share >= TOUCHED), key=lambda pair: -pair[0])
    named = [f"{plane.noun} {plane.id} ({100 * share:.0f} %)" for share, plane in touched]
    where = f": {listed(named)}" if named else f", in no {facts.planes[0].noun}"
    message = f"{100 * change.share:.1f} % of image 1 {CHANGED[change.kind]}{where}"
    return finding("dense-shadow-or-motion", message, change.share)


def _share_of(plane: Plane, change: Change, facts: AnswerFacts) -> float:
    """Share of a plane's pixels that changed."""
    labels = facts.labels
    area = float((labels == plane.id).sum()) if plane.found else float(np.ptp(plane.polygon_px, axis=0).prod())
    cell = change.cell_share * labels.size
    return min(float(facts.holds(plane, change.uv1).sum()) * cell / max(area, 1.0), 1.0)


def upside_down(facts: AnswerFacts) -> list[Diagnostic]:
    """Up given the wrong way round: every plane of known slope is a ceiling, not just a wall that leans over."""
    known = [plane for plane in facts.planes if plane.slope_known]
    if isinstance(facts.options.up, str) or min((plane.slope_deg for plane in known), default=0.0) <= 180.0 - WALL_DEG:
        return []
    message = f"every {known[0].noun} of known slope faces away from up, as if the ground hung over the camera"
    return [finding("upside-down", message, float(len(known)))]


def partly_matched(facts: AnswerFacts) -> list[Diagnostic]:
    """Planes more than half of whose variance is due to parts without matches, which are off the plane, or hidden."""
    off: list[Plane] = []
    hidden: list[Plane] = []
    for plane in facts.planes:
        patch = facts.patch_of[plane.id]
        sigma = plane.slope_sigma_deg
        if sigma is not None and np.degrees(patch.unmatched_sigma_rad) ** 2 > 0.5 * sigma**2:
            (off if patch.off_plane_sigma_rad >= patch.unmatched_sigma_rad else hidden).append(plane)
    return [*_steps_and_objects(off), *_hidden_parts(hidden, facts)]


def _steps_and_objects(planes: Sequence[Plane]) -> list[Diagnostic]:
    if not planes:
        return []
    message = (
        f"parts of {_named(planes)} are not on {'its plane' if len(planes) == 1 else 'their planes'}: there is a step, "
        f"or something stands or moves there; most of the sigma, {_largest_sigma(planes)}, is due to them"
    )
    return [finding("step-or-object", message, float(len(planes)))]


def _hidden_parts(planes: Sequence[Plane], facts: AnswerFacts) -> list[Diagnostic]:
    if not planes:
        return []
    shares = sorted(100 * min(facts.patch_of[plane.id].share, 1.0) for plane in planes)
    low, high = f"{shares[0]:.0f}", f"{shares[-1]:.0f}"
    part = "not all" if high == "100" else f"only {low} %" if low == high else f"only {low} to {high} %"
    message = (
        f"{part} of {_named(planes)} could be matched: most of the sigma, {_largest_sigma(planes)}, is due to ground "
        "without matches"
    )
    remedy = "choose windows in what both images show, or give the image that shows less of the ground first"
    return [finding("partly-seen", message, float(len(planes)), remedy)]


def _named(planes: Sequence[Plane]) -> str:
    return f"{planes[0].noun}{'s' if len(planes) > 1 else ''} {', '.join(str(plane.id) for plane in planes)}"


def _largest_sigma(planes: Sequence[Plane]) -> str:
    return f"{'up to ' if len(planes) > 1 else ''}{max(plane.slope_sigma_deg or 0.0 for plane in planes):.2g}°"


def focus_of_expansion_in_plane(facts: AnswerFacts) -> list[Diagnostic]:
    """Planes that the camera moves towards or away from, in whose middle there is no parallax."""
    if facts.epipole1_px is None:
        return []
    found, point = [], np.array([facts.epipole1_px])
    for plane in facts.planes:
        if facts.holds(plane, point)[0]:
            where = f"{plane.noun} {plane.id}"
            message = f"the camera moves along a line of sight through {where}: it shows least parallax there"
            remedy = None if plane.source == "window" else "move sideways as well"
            found.append(finding("foe-in-window", message, float(plane.id), remedy))
    return found


def not_planar(facts: AnswerFacts) -> list[Diagnostic]:
    """Patches that are not one plane, as their reason says."""
    found = []
    for plane in facts.planes:
        if NON_PLANAR in (plane.reason or ""):
            message, remedy = f"{plane.noun} {plane.id} is not one plane: {_why_not(plane, facts)}", None
            if plane.source == "given" and facts.options.planes == "found":
                remedy = "leave out rows that lie off it, or say in a column patch which rows lie on one plane"
            found.append(finding(NON_PLANAR, message, float(plane.id), remedy or FINDER_OF[plane.source].flatter))
    return found


def _why_not(plane: Plane, facts: AnswerFacts) -> str:
    """What shows that a patch is not one plane: as its reason says, or its relief, or the matches off it."""
    reason = next(part for part in (plane.reason or "").split("; ") if NON_PLANAR in part)
    words, relief = reason.partition(": ")[2], facts.relief[plane.id]
    if relief > ROUGH:
        return f"its relief is {100 * relief:.1f} % of its distance"
    return words or f"more than {100 * MOST_LEFT_OUT:.0f} % of its matches lie off it, across a step or an edge"
