"""The shortest baseline that gives a wanted slope sigma."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from slopecli.errors import NoAnswer
from slopecli.findings.parallax import parallax_px
from slopecli.findings.wording import beside
from slopecli.plan.flight import Flight, Seen, refuse_sky, see, shares
from slopecli.plan.plan_options import Of
from slopecli.plan.prediction import UNKNOWN_DEG, planned_parallax, slope_sigmas
from slopecli.report.answered_planes import LEAST_MATCHED
from slopecli.types import FloatArray

SHORTEST, LONGEST = 1e-3, 10.0  # baselines tried, in heights
TRIED = 60  # how many between them: what they miss is found by halving


def sigma_of(sigma_rad: FloatArray, of: Of) -> float:
    """The worst or median 1-sigma of windows, infinite where a window that counts has no answer."""
    known = np.where(np.isnan(sigma_rad), np.inf, sigma_rad)
    return float(known.max() if of == "worst" else np.median(known))


def needed_baseline(flight: Flight, sigma_rad: float, of: Of = "worst", *, ample: bool = False) -> float:
    """The shortest baseline, in heights, that gives a 1-sigma in the worst or median window.

    Every window must keep at least half of it in image 2.

    ample : it must give so much parallax, too, that `estimate` does not ask for a longer one.

    Raises
    ------
    NoAnswer : none does; says what the longest baseline allowed gives.
    """
    refuse_sky(flight)
    longest = _longest(flight)
    tried = np.geomspace(SHORTEST, longest, TRIED) if longest >= SHORTEST else np.empty(0)

    def look(baseline: float) -> tuple[float, bool]:
        seen = see(flight, baseline)
        sigma = sigma_of(slope_sigmas(flight, seen), of)
        return sigma, sigma <= sigma_rad and _has_parallax(flight, seen, ample)

    best = (np.inf, 0.0)
    for finer in (False, True):
        found, best = _first(_around(tried, best[1]) if finer else tried, look, best)
        if found is not None:
            return found
    raise _unreachable(flight, sigma_rad, of, best, longest)


Best = tuple[float, float]  # the smallest sigma seen, and its baseline


def _first(lengths: FloatArray, look: Callable[[float], tuple[float, bool]], best: Best) -> tuple[float | None, Best]:
    """The shortest baseline that reaches what is wanted, None where none of the lengths (k,), rising, does; the best.

    look : the sigma at a baseline, and whether it and the parallax are what is wanted.
    """
    too_short = 0.0
    for baseline in map(float, lengths):
        sigma, reached = look(baseline)
        if reached:
            return _bisected(too_short, baseline, lambda b: look(b)[1])[1], best
        best = min(best, (sigma, baseline))
        too_short = baseline
    return None, best


def _around(tried: FloatArray, best: float) -> FloatArray:
    """(k,) lengths between the neighbours of the best one tried: a smaller sigma may lie between them."""
    if not best:
        return np.empty(0)
    place = int(np.flatnonzero(tried == best)[0])
    return np.linspace(tried[max(place - 1, 0)], tried[min(place + 1, len(tried) - 1)], 17)


def _longest(flight: Flight) -> float:
    """The baseline, in heights, from which on some window has less than half of it in image 2."""

    def lost(baseline: float) -> bool:
        return bool((shares(flight, baseline) < LEAST_MATCHED).any())

    kept = 0.0
    for baseline in map(float, np.geomspace(SHORTEST, LONGEST, TRIED)):
        if lost(baseline):
            return _bisected(kept, baseline, lost)[0]
        kept = baseline
    return kept


def _has_parallax(flight: Flight, seen: Seen, ample: bool) -> bool:
    try:
        warnings = planned_parallax(parallax_px(seen.x1, seen.x2, flight.camera.focal_px), flight.noise_px)
    except NoAnswer:
        return False
    return not (ample and warnings)


def _bisected(low: float, high: float, holds: Callable[[float], bool]) -> tuple[float, float]:
    """Where something begins to hold, to a millionth: a length at which it does not yet, and one at which it does."""
    for _ in range(20):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if holds(middle) else (middle, high)
    return low, high


def _unreachable(flight: Flight, sigma_rad: float, of: Of, best: tuple[float, float], longest: float) -> NoAnswer:
    wanted = f"{np.degrees(sigma_rad):.3g} deg in the {of} window"
    if not np.isfinite(best[0]):
        lost = 1 + int(np.argmin(shares(flight, SHORTEST)))
        return NoAnswer(
            "no-overlap",
            f"no baseline reaches {wanted}: window {lost} does not see the ground, or not from both places",
            "leave that window out with --window, or turn the camera to the ground with --up",
        )
    if flight.up_sigma_rad >= sigma_rad:
        return NoAnswer(
            "up-unknown",
            f"no baseline reaches {wanted}: up itself is known to {np.degrees(flight.up_sigma_rad):.3g} deg",
            "ask for a larger sigma than that of up, or give a smaller --up-sigma",
        )
    if best[0] > np.radians(UNKNOWN_DEG) and _straight(flight):
        return NoAnswer(
            "single-plane",
            f"no baseline reaches {wanted}: straight at ground that is one plane, two answers run into each other",
            "move sideways as well, or give --uneven DEG if the windows are not one plane",
        )
    return NoAnswer(
        "low-parallax",
        f"no baseline reaches {wanted}: {_smallest(sigma_rad, best, longest)}",
        "ask for a larger sigma, count on more points or less noise (--points, --noise), give larger windows or a "
        "camera with more pixels, or fly in another direction",
    )


def _smallest(sigma_rad: float, best: tuple[float, float], longest: float) -> str:
    """What can be had, and why a longer baseline does not give less."""
    if best[0] > np.radians(UNKNOWN_DEG):
        return "slopes are left open at all of them"
    wanted_deg, best_deg = np.degrees(sigma_rad), np.degrees(best[0])
    text = f"{best_deg:.3g}"
    text = text if float(text) > wanted_deg else beside(best_deg, wanted_deg)
    found = f"the smallest sigma there is is {text} deg, at {best[1]:.3g} of the height"
    if best[1] < longest:
        return f"{found}; with a longer baseline it grows again"
    if longest < LONGEST:
        return f"{found}, and with a longer baseline some window has less than half of it in image 2"
    return f"{found}, the longest baseline tried"


def _straight(flight: Flight) -> bool:
    """Whether the flight is straight at, or away from, ground that is one plane, to 1 deg."""
    outward = flight.normals / np.linalg.norm(flight.normals, axis=1, keepdims=True)
    return bool((np.abs(outward @ flight.T) > np.cos(np.radians(1.0))).all())
