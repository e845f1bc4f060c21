"""Planes whose slopes the matches do not determine: which, why, and what to do about it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slopecli.errors import NoAnswer
from slopecli.findings.wording import beside
from slopecli.measure import Measured
from slopecli.options import MOST_SIGMA_DEG, Options
from slopecli.patches.join import Joined
from slopecli.types import Plane, Rejected


class Cause(NamedTuple):
    """A diagnostic code, what was found in words, and a remedy."""

    code: str
    message: str
    remedy: str


def divide(
    planes: list[Plane], main: Measured, joined: Joined, options: Options
) -> tuple[list[Plane], tuple[Rejected, ...]]:
    """The planes to report, and the patches without an answer: those without matches and those of unknown slope.

    planes : of all patches with matches, in the solver's order.

    Raises
    ------
    NoAnswer : no plane can be reported.
    """
    up_variance = np.radians(options.up_sigma_deg) ** 2
    spread = np.linalg.eigvalsh(main.slopes.tilt_covariance - up_variance * np.eye(2))[:, -1]
    # the larger 1-sigma of the tilt, deg, without that of up, which is the same in both directions
    alone = np.degrees(np.sqrt(np.maximum(spread, 0.0)))
    unknown = [
        (plane, _cause(plane, float(sigma), options))
        for plane, sigma in zip(planes, alone, strict=True)
        if not _is_known(plane)
    ]
    if len(unknown) == len(planes):
        raise _no_slope_known([cause for _, cause in unknown], joined)
    rejected = [
        *(Rejected(patch.id, patch.footprint.polygon_px, patch.code, patch.reason) for patch in joined.unanswered),
        *(Rejected(plane.id, plane.polygon_px, cause.code, cause.message) for plane, cause in unknown),
    ]
    known = [plane for plane in planes if _is_known(plane)]
    return known, tuple(sorted(rejected, key=lambda one: one.id))


def _is_known(plane: Plane) -> bool:
    """Whether a plane is reported: its slope is known, and it lies in front of the camera (NaN compares false).

    A window, which was asked for, is reported up to a sigma of 60 degrees; a plane that was found up to `max_sigma`.
    """
    return plane.slope_sigma_deg <= MOST_SIGMA_DEG and plane.distance > 0 and (plane.slope_known or not plane.found)


def _cause(plane: Plane, alone_deg: float, options: Options) -> Cause:
    most = options.max_sigma_deg if plane.found else MOST_SIGMA_DEG
    sigma = plane.slope_sigma_deg
    if plane.distance > 0 and options.up_sigma_deg > 0 and alone_deg <= most:
        found = f"1-sigma {sigma:.0f}°, nearly all of it that of up, {options.up_sigma_deg:g}°"
        return Cause("up-unknown", found, "give up with a smaller --up-sigma")
    vague = "" if plane.slope_known else f": 1-sigma {sigma:.0f}°"
    if plane.source == "given":
        behind = not plane.distance > 0
        found = "its rows put it behind the camera" if behind else f"its rows do not determine the slope{vague}"
        return Cause("slope-open", found, "give more rows, spread wider, of a longer baseline or known better")
    if plane.distance > 0 and sigma <= Options().max_sigma_deg:  # --max-sigma is smaller than usual
        found = f"sigma {beside(sigma, options.max_sigma_deg)}° is above --max-sigma {options.max_sigma_deg:g}°"
        return Cause("slope-open", found, "raise --max-sigma, or take the images farther apart")
    found = f"too little texture: its matches do not determine the slope{vague}"
    return Cause("low-texture", found, f"choose larger {plane.noun}s, or such with texture that both images show")


def _no_slope_known(causes: list[Cause], joined: Joined) -> NoAnswer:
    """The refusal where no plane is reported, with the commonest cause."""
    codes = [cause.code for cause in causes]
    cause = max(causes, key=lambda cause: codes.count(cause.code))
    asked = [*joined.patches, *joined.unanswered]
    reason = f"the matches of all {len(asked)} {asked[0].finder.noun}s do not determine their slopes: {cause.message}"
    return NoAnswer(cause.code, reason, cause.remedy)
