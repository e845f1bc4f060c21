"""What a plan says of its windows and of the whole pair: status and reason, diagnostics."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from slopecli.findings.parallax import LOW_PARALLAX_PX
from slopecli.findings.wording import beside, finding
from slopecli.options import Options
from slopecli.plan.baseline import sigma_of
from slopecli.plan.flight import LEAST_SHARE, Window
from slopecli.plan.plan_options import Of, PlanOptions
from slopecli.plan.planned import PlannedWindow, sigma_text
from slopecli.plan.prediction import TRIALS, Forecast
from slopecli.report.answered_planes import LEAST_MATCHED
from slopecli.types import Diagnostic

LARGEST_ZOOM = 2.0  # scale between the images beyond which features are matched badly
VAGUE_DEG = Options().max_sigma_deg


def window_status(share: float, sigma: float | None) -> tuple[Literal["ok", "poor", "refused"], str | None]:
    """Return status and reason of a window; share: of it in image 2, sigma: of its slope, deg."""
    if sigma is None:
        lost = share < LEAST_SHARE
        return "refused", "image 2 does not show its ground" if lost else "its slope is left open"
    if sigma > VAGUE_DEG:
        return "poor", f"estimate tells no slope whose sigma is above {VAGUE_DEG:g}° (--max-sigma)"
    if share < LEAST_MATCHED:
        return "poor", f"image 2 shows only {beside(100 * share, 100 * LEAST_MATCHED)} % of it"
    return "ok", None


def diagnostics_of(
    cast: Forecast, windows: Sequence[PlannedWindow], focus: tuple[float, float] | None, options: PlanOptions
) -> list[Diagnostic]:
    """Return the diagnostics of a plan; focus: pixel of image 1 the camera moves towards, if it is in the image."""
    found = list(cast.diagnostics)
    found += [_focus_in(one) for one in windows if focus is not None and _holds(one.window, focus)]
    if cast.two_answers_likely:
        found.append(_second_answer(cast, options.sigma_deg))
    if options.sigma_deg is not None and _is_better(cast, options.sigma_deg, options.of):
        found.append(_for_parallax(cast, options.sigma_deg))
    if cast.source == "simulation":
        said = "two answers run into each other; sigmas are those of simulated pairs, not of a covariance"
        found.append(finding("single-plane", said, severity="info"))
    if cast.zoom > LARGEST_ZOOM:
        said = (
            f"one image shows the ground {cast.zoom:.1f} times as large as the other, matching bears {LARGEST_ZOOM:g}"
        )
        found.append(finding("no-overlap", said, cast.zoom))
    return found


def _holds(window: Window, point: tuple[float, float]) -> bool:
    x, y, w, h = window
    return x - 0.5 <= point[0] < x + w - 0.5 and y - 0.5 <= point[1] < y + h - 0.5


def _focus_in(one: PlannedWindow) -> Diagnostic:
    said = f"the camera moves along a line of sight through window {one.id}: it shows least parallax there"
    return finding("foe-in-window", said, float(one.id), "move sideways as well")


def _second_answer(cast: Forecast, wanted_deg: float | None) -> Diagnostic:
    off = sigma_text(float(np.degrees(cast.first_error_rad)))
    wanted = "" if wanted_deg is None else f", and this baseline gives {wanted_deg:g}° to no one else"
    return finding(
        "single-plane",
        f"two answers are likely: so it is in {round(cast.second_answer * TRIALS)} of {TRIALS} simulated pairs, as a "
        "second motion explains them as well; sigmas hold for who knows which is right, the first by itself is off by "
        f"{off} (RMS, median window){wanted}",
        cast.second_answer,
        "give estimate the motion (--direction-prior, --pose), fly level, or choose ground with more relief",
        severity="warning",
    )


def _is_better(cast: Forecast, wanted_deg: float, of: Of) -> bool:
    """Whether the sigma is clearly smaller than the one asked for: the parallax was what took the baseline."""
    return sigma_of(cast.sigma_rad, of) < 0.99 * float(np.radians(wanted_deg))


def _for_parallax(cast: Forecast, wanted_deg: float) -> Diagnostic:
    return finding(
        "low-parallax",
        f"a shorter baseline gives {wanted_deg:g}° as well, but less than the {LOW_PARALLAX_PX:g} px of parallax that "
        "slopes need; this is the shortest with both",
        cast.median_parallax_px,
        severity="info",
    )
