"""What is said of windows that are matched in part only, and why."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from slopecli.patches.patch import Patch
from slopecli.types import Diagnostic, Plane

MOSTLY_UNSEEN = 0.5  # share of the variance of a slope


def unmatched_parts(planes: Sequence[Plane], patches: dict[int, Patch]) -> list[Diagnostic]:
    """Windows whose sigma is mostly owed to their parts without matches, by what is there."""
    unmatched_deg = {p.id: float(np.degrees(patches[p.id].unmatched_sigma_rad)) for p in planes}
    mostly = [p for p in planes if unmatched_deg[p.id] ** 2 > MOSTLY_UNSEEN * p.slope_sigma_deg**2]
    stepped = [p for p in mostly if patches[p.id].off_plane_sigma_rad == patches[p.id].unmatched_sigma_rad]
    hidden = [p for p in mostly if patches[p.id].off_plane_sigma_rad < patches[p.id].unmatched_sigma_rad]
    return [*_across_steps(stepped), *_hidden_in_part(hidden, patches)]


def _across_steps(planes: Sequence[Plane]) -> list[Diagnostic]:
    if not planes:
        return []
    return [
        Diagnostic(
            "step-or-object",
            "info",
            f"parts of {_named(planes)} are not on {'its plane' if len(planes) == 1 else 'their planes'}: there is a "
            f"step, or something stands or moves there; most of the sigma, {_most_sigma(planes)}, is for that",
            float(len(planes)),
            "choose windows clear of it, or smaller ones",
        )
    ]


def _hidden_in_part(planes: Sequence[Plane], patches: dict[int, Patch]) -> list[Diagnostic]:
    if not planes:
        return []
    shares = sorted(100 * min(patches[plane.id].share, 1.0) for plane in planes)
    low, high = f"{shares[0]:.0f}", f"{shares[-1]:.0f}"
    part = "not all" if high == "100" else f"only {low} %" if low == high else f"only {low} to {high} %"
    return [
        Diagnostic(
            "partly-seen",
            "info",
            f"{part} of {_named(planes)} could be matched: most of the sigma, {_most_sigma(planes)}, is for ground "
            "that is not seen",
            float(len(planes)),
            "choose windows in what both images show, or give the image that shows less of the ground first",
        )
    ]


def _named(planes: Sequence[Plane]) -> str:
    return f"{planes[0].noun}{'s' if len(planes) > 1 else ''} {', '.join(str(plane.id) for plane in planes)}"


def _most_sigma(planes: Sequence[Plane]) -> str:
    return f"{'up to ' if len(planes) > 1 else ''}{max(plane.slope_sigma_deg for plane in planes):.2g}°"
