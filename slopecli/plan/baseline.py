"""How far apart two images must be taken for a wanted sigma."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np

from slopecli.diagnosis import check_parallax, parallax_px
from slopecli.errors import NoAnswer
from slopecli.plan.flight import Flight, Seen, see, shares
from slopecli.plan.prediction import UNKNOWN_DEG, slope_sigmas
from slopecli.types import FloatArray

Of = Literal["worst", "median"]

HALF_SEEN = 0.5  # share of a window in image 2 below which estimate calls its answer poor
SHORTEST, LONGEST = 1e-3, 10.0  # baselines tried, in heights
TRIED = 60  # how many between them: what they miss is found by halving
BISECTIONS = 20  # to a millionth


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
    longest = _longest(flight)
    tried = np.geomspace(SHORTEST, longest, TRIED) if longest >= SHORTEST else np.empty(0)
    too_short, best = 0.0, (np.inf, 0.0)
    for baseline in map(float, tried):
        seen = see(flight, baseline)
        if _reaches(flight, seen, sigma_rad, of, ample):
            return _bisected(too_short, baseline, lambda b: _reaches(flight, see(flight, b), sigma_rad, of, ample))[1]
        best = min(best, (sigma_of(slope_sigmas(flight, seen), of), baseline))
        too_short = baseline
    raise _unreachable(flight, sigma_rad, of, best)


def _longest(flight: Flight) -> float:
    """The baseline, in heights, from which on some window has less than half of it in image 2."""

    def lost(baseline: float) -> bool:
        return bool((shares(flight, baseline) < HALF_SEEN).any())

    kept = 0.0
    for baseline in map(float, np.geomspace(SHORTEST, LONGEST, TRIED)):
        if lost(baseline):
            return _bisected(kept, baseline, lost)[0]
        kept = baseline
    return kept


def _reaches(flight: Flight, seen: Seen, sigma_rad: float, of: Of, ample: bool) -> bool:
    if sigma_of(slope_sigmas(flight, seen), of) > sigma_rad:
        return False
    try:
        warnings = check_parallax(parallax_px(seen.x1, seen.x2, flight.camera.focal_px), flight.noise_px)
    except NoAnswer:
        return False
    return not (ample and warnings)


def _bisected(low: float, high: float, holds: Callable[[float], bool]) -> tuple[float, float]:
    """Where something begins to hold: a length at which it does not yet, like `low`, and one at which it does."""
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if holds(middle) else (middle, high)
    return low, high


def _unreachable(flight: Flight, sigma_rad: float, of: Of, best: tuple[float, float]) -> NoAnswer:
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
    if best[0] > np.radians(UNKNOWN_DEG):
        return NoAnswer(
            "single-plane",
            f"no baseline reaches {wanted}: straight at ground that is one plane, two answers run into each other",
            "move sideways as well, or give --uneven DEG if the windows are not one plane",
        )
    return NoAnswer(
        "low-parallax",
        f"no baseline reaches {wanted}: at {best[1]:.3g} of the height it is {np.degrees(best[0]):.2g} deg at best, "
        "and beyond some window leaves image 2 by half",
        "ask for a larger sigma, give larger windows or a camera with more pixels, or fly in another direction",
    )
