"""Parts of image 1 that no plane explains: areas that changed between the images, and what lies on no plane."""

from __future__ import annotations

import numpy as np

from slopecli.findings.facts import AnswerFacts
from slopecli.findings.wording import finding, listed
from slopecli.look.changes import Change
from slopecli.types import Diagnostic, Plane

TOUCHED = 0.02  # share of a plane that changed from which on it is named
CHANGED = {
    "brightness": "became brighter or darker than the rest, as where a shadow moves",
    "motion": "moves differently from the rest, as vehicles do",
}


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


def on_no_plane(facts: AnswerFacts) -> list[Diagnostic]:
    """The share of image 1 that lies on no plane, where planes were sought in all of it."""
    if not facts.planes[0].found:
        return []
    share = float((facts.labels == 0).mean())
    return [finding("unexplained", f"{100 * share:.0f} % of image 1 lies on no plane found, or outside image 2", share)]
