"""Verdicts where the direction taken as up is in doubt: they hold only if they do against the other direction too."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

from slopecli.findings.level_evidence import LevelOdds
from slopecli.measure import Measured, measure
from slopecli.options import Options
from slopecli.patches.join import Joined
from slopecli.types import AlternativePlane, AmbiguityReport, Plane, Up

_AnyPlane = TypeVar("_AnyPlane", Plane, AlternativePlane)


def against_both(
    planes: list[Plane], root: Measured, joined: Joined, options: Options, level: LevelOdds | None
) -> tuple[Up, list[Plane]]:
    """Where level is doubted: up with the other direction, and the planes with verdicts that hold against both.

    Their `p_safe` is the smaller of two; they are unsafe only where they are so against both, and never safe.
    """
    if level is None or not level.doubted:
        return root.up, planes
    x, y, z = level.upright.tolist()
    other = measure(root.solution, joined, replace(options, up=(x, y, z)))
    second = dict(zip((patch.id for patch in joined.patches), other.p_safe.tolist(), strict=True))
    up = replace(root.up, otherwise_cam1=(x, y, z))
    return up, [_in_doubt(plane, second[plane.id], options.confidence) for plane in planes]


def second_root_against_both(
    ambiguity: AmbiguityReport, root: Measured | None, joined: Joined, options: Options, level: LevelOdds | None
) -> AmbiguityReport:
    """The same where level is doubted: verdicts of the second root, if there is one, hold against both directions."""
    second = ambiguity.alternative
    if level is None or not level.doubted or root is None or second is None:
        return ambiguity
    x, y, z = level.upright.tolist()
    other = measure(root.solution, joined, replace(options, up=(x, y, z)))
    p_safe = dict(zip((patch.id for patch in joined.patches), other.p_safe.tolist(), strict=True))
    planes = tuple(_in_doubt(plane, p_safe[plane.id], options.confidence) for plane in second.planes)
    return replace(ambiguity, alternative=replace(second, planes=planes))


def _in_doubt(plane: _AnyPlane, second: float, confidence: float) -> _AnyPlane:
    if plane.p_safe is None:
        return plane
    unsafe = plane.verdict == "unsafe" and second <= 1.0 - confidence
    return replace(plane, p_safe=min(plane.p_safe, second), verdict="unsafe" if unsafe else "undecided")
