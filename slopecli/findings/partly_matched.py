"""Checks of windows whose sigma is mostly due to parts without matches: hidden ground, or steps and objects."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from slopecli.findings.facts import AnswerFacts
from slopecli.findings.wording import finding
from slopecli.types import Diagnostic, Plane


def _mostly_unmatched(facts: AnswerFacts, off_plane: bool) -> list[Plane]:
    """Planes more than half of whose variance is due to parts without matches, which are on the plane or are not."""
    return [
        plane
        for plane in facts.planes
        for patch in [facts.patch_of[plane.id]]
        if np.degrees(patch.unmatched_sigma_rad) ** 2 > 0.5 * plane.slope_sigma_deg**2
        and (patch.off_plane_sigma_rad >= patch.unmatched_sigma_rad) == off_plane
    ]


def steps_and_objects(facts: AnswerFacts) -> list[Diagnostic]:
    """Windows whose unmatched parts are not on their planes."""
    planes = _mostly_unmatched(facts, off_plane=True)
    if not planes:
        return []
    message = (
        f"parts of {_named(planes)} are not on {'its plane' if len(planes) == 1 else 'their planes'}: there is a step, "
        f"or something stands or moves there; most of the sigma, {_largest_sigma(planes)}, is due to them"
    )
    return [finding("step-or-object", message, float(len(planes)))]


def hidden_parts(facts: AnswerFacts) -> list[Diagnostic]:
    """Windows whose unmatched parts may be on their planes."""
    planes = _mostly_unmatched(facts, off_plane=False)
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
    return f"{'up to ' if len(planes) > 1 else ''}{max(plane.slope_sigma_deg for plane in planes):.2g}°"
