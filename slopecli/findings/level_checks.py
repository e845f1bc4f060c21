"""Whether what slopes are measured against is level."""

from __future__ import annotations

from slopecli.findings.facts import AnswerFacts
from slopecli.findings.wording import finding
from slopecli.types import Diagnostic


def level_assumed(facts: AnswerFacts) -> list[Diagnostic]:
    """Up was assumed, and evidence speaks against it or, of a plane taken as level, too little speaks for it."""
    level = facts.level
    if level is None or not level.doubted:
        return []
    patches = {patch.id: patch.finder.noun for patch in facts.joined.patches}
    taken = next((plane for plane in facts.planes if plane.taken_as_level), None)
    assumed = (
        "camera 1 is taken to look straight down"
        if taken is None
        else f"{patches[taken.id]} {taken.id} is taken as level"
    )
    why = f"but {'; '.join(level.against)}" if level.against else "and too little in the images tells that it is"
    up = ",".join(f"{value:.4f}" for value in level.upright + 0.0)
    remedy = f"give up if you know it; if the camera was held upright it is about --up {up}"
    return [finding("level-assumed", f"{assumed}, {why}", level.probability, remedy)]
