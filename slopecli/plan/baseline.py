"""The shortest baseline that gives a wanted slope sigma."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from slopecli.errors import NoAnswer
from slopecli.findings.parallax import parallax_px
from slopecli.findings.wording import beside
from slopecli.options import MOST_SIGMA_DEG
from slopecli.patches.patch import LEAST_MATCHED
from slopecli.plan.flight import Flight, Seen, in_image2, refuse_sky, see
from slopecli.plan.plan_options import Of
from slopecli.plan.prediction import planned_parallax, slope_sigmas
from slopecli.types import FloatArray

BASELINES = (1e-3, 10.0)  # shortest and longest tried, in heights
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
    onset = _onset(
        np.geomspace(*BASELINES, TRIED),
        lambda baseline: bool((in_image2(flight, baseline).mean(axis=1) < LEAST_MATCHED).any()),
    )
    longest = (
        BASELINES[1] if onset is None else onset[0]
    )  # from there on some window has less than half of it in image 2
    tried = np.geomspace(BASELINES[0], longest, TRIED) if longest >= BASELINES[0] else np.empty(0)
    sigmas = {0.0: float("inf")}  # at the baselines tried

    def reaches(baseline: float) -> bool:
        seen = see(flight, baseline)
        sigmas[baseline] = sigma_of(slope_sigmas(flight, seen), of)
        return sigmas[baseline] <= sigma_rad and _has_parallax(flight, seen, ample)

    found = _onset(tried, reaches)
    if found is None:
        found = _onset(_around(tried, min(sigmas, key=sigmas.__getitem__)), reaches)
    if found is not None:
        return found[1]
    best = min(sigmas, key=sigmas.__getitem__)
    raise _unreachable(flight, sigma_rad, of, (sigmas[best], best), longest)


def _onset(lengths: FloatArray, holds: Callable[[float], bool]) -> tuple[float, float] | None:
    """Where along rising lengths (k,) something begins to hold, to a millionth; None if nowhere.

    Returns a length at which it does not yet hold, and one at which it does.
    """
    low = 0.0
    for high in map(float, lengths):
        if holds(high):
            for _ in range(20):
                middle = 0.5 * (low + high)
                low, high = (low, middle) if holds(middle) else (middle, high)
            return low, high
        low = high
    return None


def _around(tried: FloatArray, best: float) -> FloatArray:
    """(k,) lengths between the neighbours of the best one tried, if any: a smaller sigma may lie between them."""
    if not best:
        return np.empty(0)
    place = int(np.flatnonzero(tried == best)[0])
    return np.linspace(tried[max(place - 1, 0)], tried[min(place + 1, len(tried) - 1)], 17)


def _has_parallax(flight: Flight, seen: Seen, ample: bool) -> bool:
    try:
        warnings = planned_parallax(parallax_px(seen.x1, seen.x2, flight.camera.focal_px), flight.noise_px)
    except NoAnswer:
        return False
    return not (ample and warnings)


def _unreachable(flight: Flight, sigma_rad: float, of: Of, best: tuple[float, float], longest: float) -> NoAnswer:
    failed = f"no baseline reaches {np.degrees(sigma_rad):.3g} deg in the {of} window"
    if not np.isfinite(best[0]):
        lost = 1 + int(np.argmin(in_image2(flight, BASELINES[0]).mean(axis=1)))
        said = f"window {lost} does not see the ground, or not from both places"
        remedy = "leave that window out with --window, or turn the camera to the ground with --up"
        return NoAnswer("no-overlap", f"{failed}: {said}", remedy)
    if flight.up_sigma_rad >= sigma_rad:
        said = f"up itself is known to {np.degrees(flight.up_sigma_rad):.3g} deg"
        remedy = "ask for a larger sigma than that of up, or give a smaller --up-sigma"
        return NoAnswer("up-unknown", f"{failed}: {said}", remedy)
    if best[0] > np.radians(MOST_SIGMA_DEG) and _is_straight(flight):
        said = "straight at ground that is one plane, two answers run into each other"
        remedy = "move sideways as well, or give --uneven DEG if the windows are not one plane"
        return NoAnswer("single-plane", f"{failed}: {said}", remedy)
    remedy = (
        "ask for a larger sigma, count on more points or less noise (--points, --noise), give larger windows or a "
        "camera with more pixels, or fly in another direction"
    )
    return NoAnswer("low-parallax", f"{failed}: {_smallest(sigma_rad, best, longest)}", remedy)


def _is_straight(flight: Flight) -> bool:
    """Whether the flight is straight at, or away from, ground that is one plane, to 1 deg."""
    outward = flight.normals / np.linalg.norm(flight.normals, axis=1, keepdims=True)
    return bool((np.abs(outward @ flight.T) > np.cos(np.radians(1.0))).all())


def _smallest(sigma_rad: float, best: tuple[float, float], longest: float) -> str:
    """What can be had, and why a longer baseline does not give less."""
    if best[0] > np.radians(MOST_SIGMA_DEG):
        return "slopes are left open at all of them"
    wanted_deg, best_deg = np.degrees(sigma_rad), np.degrees(best[0])
    text = f"{best_deg:.3g}"
    text = text if float(text) > wanted_deg else beside(best_deg, wanted_deg)
    found = f"the smallest sigma there is is {text} deg, at {best[1]:.3g} of the height"
    if best[1] < longest:
        return f"{found}; with a longer baseline it grows again"
    if longest < BASELINES[1]:
        return f"{found}, and with a longer baseline some window has less than half of it in image 2"
    return f"{found}, the longest baseline tried"
