"""Whether what slopes are measured against is level."""

from __future__ import annotations

import numpy as np

from slopecli.findings.facts import AnswerFacts
from slopecli.findings.plane_checks import WALL_DEG
from slopecli.findings.wording import finding
from slopecli.geometry.epipolar import checked_direction
from slopecli.geometry.statistics import median
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
    remedy = f"give up if you know it; if the camera was held before a facade or a wall it is about --up {up}"
    return [finding("level-assumed", f"{assumed}, {why}", level.probability, remedy)]


def pitch_mirrored(facts: AnswerFacts) -> list[Diagnostic]:
    """Up was given, all is steep against it, and would be far nearer to level with the opposite sign of the pitch."""
    up, stated = facts.options.up, facts.options.stated
    known = [plane for plane in facts.planes if plane.slope_known and plane.status == "ok"]
    if isinstance(up, str) or (stated is not None and stated.up) or not known:
        return []
    x, y, z = checked_direction("up", up)
    mirrored = np.array([plane.normal_cam1 for plane in known]) @ [x, y, -z]
    steep = median(np.array([plane.slope_deg for plane in known]))
    gentle = median(np.degrees(np.arccos(np.clip(mirrored, -1.0, 1.0))))
    # level ground that is seen at a wrong angle is steep by twice that; ceilings are for `upside_down`
    if not facts.options.tolerance_deg < steep < 180.0 - WALL_DEG or 4.0 * gentle > steep:
        return []
    message = f"the median slope is {steep:.0f}°, and would be {gentle:.0f}° with the opposite sign of the pitch"
    return [finding("pitch-sign", message, gentle)]
