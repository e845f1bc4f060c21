"""How far apart two images must be taken for a wanted sigma."""

from __future__ import annotations

from typing import Literal

import numpy as np

from slopecli.diagnosis import check_parallax, parallax_px
from slopecli.errors import NoAnswer
from slopecli.plan.flight import Flight, Seen, see
from slopecli.plan.prediction import UNKNOWN_DEG, slope_sigmas
from slopecli.types import FloatArray

Of = Literal["worst", "median"]

HALF_SEEN = 0.5  # share of a window in image 2 below which estimate calls its answer poor
SHORTEST, LONGEST, STEP = 1e-3, 10.0, 1.04  # baselines tried, in heights, and their ratio
BISECTIONS = 30


def sigma_of(sigma_rad: FloatArray, of: Of) -> float:
    """The worst or median 1-sigma of windows, infinite where a window that counts has no answer."""
    known = np.where(np.isnan(sigma_rad), np.inf, sigma_rad)
    return float(known.max() if of == "worst" else np.median(known))


def needed_baseline(flight: Flight, sigma_rad: float, of: Of = "worst") -> float:
    """The shortest baseline, in heights, that gives a 1-sigma in the worst or median window.

    Every window must keep at least half of it in image 2.

    Raises
    ------
    NoAnswer : none does; says what the longest baseline allowed gives.
    """
    too_short, best = 0.0, (np.inf, 0.0)
    for baseline in SHORTEST * STEP ** np.arange(np.log(LONGEST / SHORTEST) / np.log(STEP)):
        seen = see(flight, baseline)
        if (seen.share < HALF_SEEN).any():
            break
        if _reaches(flight, seen, sigma_rad, of):
            return _bisected(flight, sigma_rad, of, too_short, float(baseline))
        best = min(best, (sigma_of(slope_sigmas(flight, seen), of), float(baseline)))
        too_short = float(baseline)
    raise _unreachable(flight, sigma_rad, of, best)


def _reaches(flight: Flight, seen: Seen, sigma_rad: float, of: Of) -> bool:
    if sigma_of(slope_sigmas(flight, seen), of) > sigma_rad:
        return False
    try:
        check_parallax(parallax_px(seen.x1, seen.x2, flight.camera.focal_px), flight.noise_px)
    except NoAnswer:
        return False
    return True


def _bisected(flight: Flight, sigma_rad: float, of: Of, low: float, high: float) -> float:
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if _reaches(flight, see(flight, middle), sigma_rad, of) else (middle, high)
    return high


def _unreachable(flight: Flight, sigma_rad: float, of: Of, best: tuple[float, float]) -> NoAnswer:
    wanted = f"{np.degrees(sigma_rad):.3g} deg in the {of} window"
    if not np.isfinite(best[0]):
        lost = 1 + int(np.argmin(see(flight, SHORTEST).share))
        return NoAnswer(
            "no-overlap",
            f"no baseline reaches {wanted}: window {lost} does not see the ground, or not from both places",
            "leave that window out with --window, or turn the camera to the ground with --up",
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
