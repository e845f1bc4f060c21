"""Parallax: whether there is any, whether it is enough for the slopes wanted, and how far to move for more."""

from __future__ import annotations

from statistics import NormalDist

import numpy as np

from slopecli.errors import NoAnswer
from slopecli.findings.codes import LIMITS
from slopecli.findings.facts import AnswerFacts, PairFacts
from slopecli.findings.known_motion import known_length_m
from slopecli.findings.wording import Separation, finding, listed
from slopecli.geometry.epipolar import fit_rotation, homogeneous
from slopecli.geometry.statistics import median
from slopecli.options import Options
from slopecli.types import Diagnostic, FloatArray, Plane

LOW_PARALLAX_PX = LIMITS["low-parallax"]
LEAST_FACTOR = 1.1  # times as far: a smaller change of the move is not recommended
MOST_APART = 0.25  # of the distance to the scene: images taken farther apart overlap too little


def parallax_px(x1: FloatArray, x2: FloatArray, focal_px: float) -> FloatArray:
    """(n,) distance in image 2 of each match from where the best rotation takes its point of image 1, px."""
    p, q = homogeneous(x1).T, np.ascontiguousarray(x2.T)
    weight = np.ones(len(x1))
    residual = weight
    for _ in range(4):  # again without the tenth that fits worst: mismatches
        y = fit_rotation(p, q, weight) @ p
        residual = np.asarray(np.linalg.norm(y[:2] / y[2] - q, axis=0))
        weight = (residual <= np.quantile(residual, 0.9)).astype(float)
    return residual * focal_px


def check_parallax(parallax: FloatArray, noise_px: float, separation: Separation | None = None) -> list[Diagnostic]:
    """Raise NoAnswer for a pure rotation; warn when the parallax is small.

    parallax : (n,) px.  noise_px : 1-sigma of the matches across their epipolar lines.
    separation : of the cameras, for a remedy in more than a factor.
    """
    typical, largest = median(parallax), float(np.quantile(parallax, 0.98))
    if largest < 2.0 * max(4 * noise_px, 0.1):
        reason = f"a rotation of the camera explains all matches to {largest:.2f} px, so there is no parallax"
        remedy = "move the camera between the images, by 5 to 20 % of the distance to the scene"
        raise NoAnswer("pure-rotation", reason, remedy, value=largest)
    if typical >= LOW_PARALLAX_PX:
        return []
    factor = max(LOW_PARALLAX_PX / max(typical, 1e-3), 1.5)
    farther = f"move {factor:.1f} times as far between the images" if separation is None else separation.farther(factor)
    message = f"median parallax {typical:.1f} px; slopes need about {LOW_PARALLAX_PX:.0f} px"
    return [finding("low-parallax", message, typical, farther, severity="warning")]


def low_parallax(pair: PairFacts) -> list[Diagnostic]:
    """Raise NoAnswer when a rotation explains the dense matches; warn when their parallax is small."""
    evidence = pair.scene.evidence
    parallax = parallax_px(evidence.x1, evidence.x2, pair.scene.camera2.focal_px)
    return check_parallax(parallax, pair.noise_px, Separation(median(evidence.w), known_length_m(pair.options)))


def parallax_for_tolerance(facts: AnswerFacts) -> list[Diagnostic]:
    """Planes that a longer move would decide about, or make known to `max_sigma`, if such a move can be made.

    Sigmas fall as the parallax grows, but for that of up and the tilt sigma of matches, which do not. Nothing is said
    where a second root is left: that is why planes are undecided then.
    """
    if facts.solution.ambiguity.status == "unresolved":
        return []
    options, separation = facts.options, facts.separation
    helped = []
    for plane in facts.planes:
        wanted = _wanted_sigma(plane, options)
        factor = _times_as_far(plane, wanted, facts)
        if LEAST_FACTOR < factor <= MOST_APART / separation.share:
            has = f"{plane.noun} {plane.id} has a sigma of {plane.slope_sigma_deg:.2g}°"
            helped.append((factor, f"{has}, and {wanted:.2g}° would decide"))
    if not helped:
        return []
    helped.sort(key=lambda pair: pair[0])
    factor = helped[-1][0]
    message = f"too little parallax for the tolerance: {listed([described for _, described in helped])}"
    return [finding("low-parallax", message, factor, separation.farther(factor), severity="info")]


def _times_as_far(plane: Plane, wanted_deg: float, facts: AnswerFacts) -> float:
    """Factor of the parallax that reduces the sigma of a plane to the one wanted; infinite where none does."""
    fixed = float(np.degrees(facts.patch_of[plane.id].tilt_sigma_rad)) ** 2 + facts.options.up_sigma_deg**2
    changing, left = (plane.slope_sigma_deg or 0.0) ** 2 - fixed, wanted_deg**2 - fixed
    return float(np.sqrt(max(changing, 0.0) / left)) if left > 0.0 else np.inf


def _wanted_sigma(plane: Plane, options: Options) -> float:
    """1-sigma of the slope, deg, that would decide about a plane; infinite where sigma is not why it is undecided."""
    if not plane.slope_known:
        return options.max_sigma_deg if ";" not in (plane.reason or "") else np.inf
    if plane.verdict != "undecided" or plane.status != "ok":
        return np.inf
    return abs(plane.slope_deg - options.tolerance_deg) / NormalDist().inv_cdf(options.confidence)
