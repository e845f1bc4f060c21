"""Checks of single planes: the focus of expansion in them, relief, steps, and up given the wrong way round."""

from __future__ import annotations

import numpy as np

from slopecli.findings.facts import AnswerFacts
from slopecli.findings.wording import finding
from slopecli.patches import FINDER_OF
from slopecli.patches.given.given_solution import MOST_LEFT_OUT
from slopecli.types import Diagnostic, Plane

NON_PLANAR = "non-planar-patch"  # as a diagnostic, and as the reason of a plane
ROUGH = 0.025  # RMS height off the plane over distance beyond which a patch is not one plane


def upside_down(facts: AnswerFacts) -> list[Diagnostic]:
    """Up given the wrong way round: every plane of image 1 faces away from it."""
    planes = facts.planes
    if isinstance(facts.options.up, str) or min(plane.slope_deg for plane in planes) <= 90.0:
        return []
    message = f"every {planes[0].noun} faces away from up, as if the ground hung over the camera"
    return [finding("upside-down", message, float(len(planes)))]


def focus_of_expansion_in_plane(facts: AnswerFacts) -> list[Diagnostic]:
    """Planes that the camera moves towards or away from, in whose middle there is no parallax."""
    if facts.epipole1_px is None:
        return []
    point = np.array([facts.epipole1_px])
    return [_focus_in(plane) for plane in facts.planes if facts.holds(plane, point)[0]]


def _focus_in(plane: Plane) -> Diagnostic:
    message = f"the camera moves along a line of sight through {plane.noun} {plane.id}: it shows least parallax there"
    remedy = None if plane.source == "window" else "move sideways as well"
    return finding("foe-in-window", message, float(plane.id), remedy)


def not_planar(facts: AnswerFacts) -> list[Diagnostic]:
    """Patches that are not one plane, as their reason says."""
    return [_not_planar(plane, facts.relief[plane.id]) for plane in facts.planes if NON_PLANAR in (plane.reason or "")]


def _not_planar(plane: Plane, relief: float) -> Diagnostic:
    why = (
        f"its relief is {100 * relief:.1f} % of its distance"
        if relief > ROUGH
        else f"more than {100 * MOST_LEFT_OUT:.0f} % of its matches lie off it, across a step or an edge"
    )
    remedy = FINDER_OF[plane.source].flatter
    return finding(NON_PLANAR, f"{plane.noun} {plane.id} is not one plane: {why}", float(plane.id), remedy)
