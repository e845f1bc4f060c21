"""Sentences of the page: the verdict, why a sigma is what it is and the cheapest remedy, what an answer cannot say."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

from slopecli.findings.codes import CODES
from slopecli.findings.wording import forbidding
from slopecli.ground.slope_map import SlopeMap
from slopecli.report.kinds import many_windows
from slopecli.report.sigma_parts import CAUSES
from slopecli.report.slope_units import SlopeUnit, slope_unit_of
from slopecli.types import AlternativePlane, Plane, Report

# by cause: what it is, and what reduces it; in the order of how little that costs
MEANING = {
    "up": ("the vertical", "give a better vertical: --up X,Y,Z with a smaller --up-sigma"),
    "camera": ("the focal length", "give a calibrated camera file instead of a field of view or a vague focal length"),
    "gaps": ("ground without matches", "choose windows that both images show and whose ground has texture"),
    "relief": (
        "height of the ground off its plane",
        "ask for larger windows or footprints, if their mean slope will do",
    ),
    "motion": ("the motion between the images", "give what a sensor knows of it: --rotation-prior, --direction-prior"),
    "matches": ("noise of the matches", "take the images farther apart, or sharper and larger ones"),
}
LIMITS = (
    "A slope is that of the plane of a whole window, region or disc. What is smaller than that does not show in it.",
    "Slopes are measured against what is called up. If up is assumed, as for a camera that is taken to look straight "
    "down, an error of it is an error of every slope.",
    "A sigma covers what the images can tell: noise, relief, ground without matches, motion, the stated uncertainty "
    "of up and of the focal length. A calibration that is wrong beyond that, or ground that moved, is not in it.",
    "Without a known length (a baseline, an altitude, a pose) all lengths are in baselines; slopes do not need one.",
)


class Verdict(NamedTuple):
    """One answer in a sentence, and counts of its verdicts; kind: "safe", "unsafe" or "undecided", its colour."""

    headline: str
    sentence: str
    kind: str


def slope_text(value: float | None, sigma: float | None, unit: SlopeUnit) -> str:
    """Return a slope with its 1-sigma as people read it."""
    if value is None or not math.isfinite(value):
        return "-"
    if unit.has(value):
        return unit.text(value, sigma)
    if sigma is None or not math.isfinite(sigma):
        return f"{value:.1f}°"
    decimals = 2 if sigma < 0.2 else 1
    return f"{value:.{decimals}f} ± {'<0.01' if 0 < sigma < 0.005 else f'{sigma:.{decimals}f}'}°"


def verdict_of(report: Report) -> list[Verdict]:
    """Return the verdict on the planes, or two where two answers are left."""
    others = report.ambiguity.others
    if others:
        return [
            _one_of_two("First answer", report.planes, report),
            _one_of_two("Second answer", [others[plane.id] for plane in report.planes if plane.id in others], report),
        ]
    noun, tolerance = report.noun, _tolerance(report)
    counts = Counter(plane.verdict for plane in report.planes if plane.verdict)
    total = sum(counts.values())
    if not total:
        return [Verdict("No verdict", f"No {noun} could be judged against {tolerance}.", "undecided")]
    confidence = 100 * float(report.options["confidence"])
    told = [f"{counts[name]} {name}" for name in ("safe", "unsafe", "undecided") if counts[name]]
    steepest = _steepest(report.planes, report)
    headline = f"{counts['safe']} of {total} {noun}{'s' * (total != 1)} safe"
    sentence = f"Against a tolerance of {tolerance}, with {confidence:g} % confidence: {', '.join(told)}"
    sentence += f"; the steepest known slope is {steepest}." if steepest else "."
    kind = "unsafe" if counts["unsafe"] else "undecided" if counts["undecided"] else "safe"
    return [Verdict(headline, sentence + _withheld(report), kind)]


def _one_of_two(name: str, planes: Sequence[Plane | AlternativePlane], report: Report) -> Verdict:
    tolerance_deg = float(report.options["tolerance_deg"])
    known = [plane for plane in planes if plane.slope_known and not plane.taken_as_level]
    below = sum(plane.slope_deg < tolerance_deg for plane in known)
    steepest = _steepest(known, report)
    sentence = f"If this is true, {below} of {len(known)} known slopes are below {_tolerance(report)}"
    sentence += f"; the steepest is {steepest}." if steepest else "."
    return Verdict(name, sentence, "undecided")


def _tolerance(report: Report) -> str:
    return slope_unit_of(report.options).limit(float(report.options["tolerance_deg"]))


def _steepest(planes: Sequence[Plane | AlternativePlane], report: Report) -> str:
    known = [plane for plane in planes if plane.slope_known and not plane.taken_as_level]
    one = max(known, key=lambda plane: plane.slope_deg, default=None)
    unit = slope_unit_of(report.options)
    return "" if one is None else f"{slope_text(one.slope_deg, one.slope_sigma_deg, unit)} ({one.id})"


def _withheld(report: Report) -> str:
    codes = forbidding(report.diagnostics)
    doubt = " Which direction is up is in doubt." if report.up.otherwise_cam1 is not None else ""
    return (f" Nothing is called safe while there is the warning {', '.join(codes)}." if codes else "") + doubt


def verdict_of_map(slope_map: SlopeMap) -> list[Verdict]:
    """Return the verdict on a map: where to land, and how much is safe."""
    share, report = slope_map.area_share, slope_map.report
    parts = [f"{100 * share[name]:.1f} % {name}" for name in ("safe", "unsafe", "undecided") if share[name]]
    parts.append(f"{100 * share['unknown']:.1f} % not known")
    unit = "m" if report.scale.unit == "m" else "baselines"
    sites = slope_map.sites
    if sites:
        best = sites[0]
        size = f"{best.radius:.3g} {unit}" if report.scale.unit == "m" else f"{best.radius_px:.0f} px"
        headline = f"{len(sites)} landing site{'s' * (len(sites) != 1)}"
        slope = slope_text(best.slope_deg, best.slope_sigma_deg, slope_unit_of(report.options))
        sentence = f"The best has a radius of {size} and a slope of {slope}. Of image 1, "
    else:
        headline, sentence = "No landing site", f"{slope_map.no_site[:1].upper()}{slope_map.no_site[1:]}. Of image 1, "
    sentence += f"against a tolerance of {_tolerance(report)}: {', '.join(parts)}."
    kind = "safe" if sites else "unsafe" if share["unsafe"] > share["undecided"] else "undecided"
    verdict = Verdict(headline, sentence + _withheld(report), kind)
    return [verdict, *verdict_of(report)] if report.ambiguity.others else [verdict]


# ---- why a sigma is what it is ----


class Why(NamedTuple):
    """A 1-sigma by cause: (name, share of its variance in percent) each that is not nothing, largest first; the cause
    to reduce first, what that is, and what it would leave."""

    label: str
    sigma: str
    parts: list[tuple[str, float]]
    cause: str
    remedy: str
    left: str


def why(label: str, sigma_deg: float, causes: dict[str, float]) -> Why:
    """Return why a 1-sigma is what it is."""
    total = max(sum(value**2 for value in causes.values()), 1e-300)
    parts = [(name, 100 * causes[name] ** 2 / total) for name in CAUSES if causes[name] ** 2 > 5e-4 * total]
    cause = cheapest_remedy(causes)
    left = math.sqrt(max(total - causes[cause] ** 2, 0.0))
    return Why(label, f"{sigma_deg:.2f}°", parts, cause, MEANING[cause][1], f"{left:.2f}°")


def cheapest_remedy(causes: dict[str, float]) -> str:
    """Return the cause to reduce first: of those that are at least half as large as the largest, the cheapest."""
    largest = max(causes.values())
    return next(name for name in MEANING if causes[name] >= 0.5 * largest)  # a smaller one is no remedy's aim


def whys_of(report: Report, most: int) -> list[Why]:
    """Return why the sigmas of the planes are what they are, at most so many, of the largest sigmas."""
    known = [plane for plane in report.planes if plane.slope_sigma_deg and plane.slope_sigma_causes_deg]
    if len(known) > most or many_windows(report):
        known = sorted(known, key=lambda plane: -(plane.slope_sigma_deg or 0.0))[:most]
    return [why(str(plane.id), plane.slope_sigma_deg or 0.0, plane.slope_sigma_causes_deg or {}) for plane in known]


# ---- diagnostics ----


def plain(markdown: str) -> str:
    """Return text without the marks of Markdown."""
    return re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", markdown).replace("`", "")


def meaning_of(code: str, severity: str) -> str:
    """Return what a diagnostic means and why it matters."""
    return next((plain(row.meaning) for row in CODES if (row.code, row.severity) == (code, severity)), "")
