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
    known = [plane for plane in planes if _is_known(plane)]
    causes = _causes(planes, main, options)
    if not known:
        raise _no_slope_known(list(causes.values()), joined)
    bare = [Rejected(patch.id, patch.footprint.polygon_px, patch.code, patch.reason) for patch in joined.unanswered]
    unknown = [
        Rejected(plane.id, plane.polygon_px, causes[plane.id].code, causes[plane.id].message)
        for plane in planes
        if plane.id in causes
    ]
    return known, tuple(sorted(bare + unknown, key=lambda one: one.id))


def _is_known(plane: Plane) -> bool:
    """Whether a plane is reported: its slope is known, and it lies in front of the camera (NaN compares false).

    A window, which was asked for, is reported up to a sigma of 60 degrees; a plane that was found up to `max_sigma`.
    """
    return plane.slope_sigma_deg <= MOST_SIGMA_DEG and plane.distance > 0 and (plane.slope_known or not plane.found)


def _causes(planes: list[Plane], main: Measured, options: Options) -> dict[int, Cause]:
    """Why planes are not reported, by id."""
    up_sigma = np.radians(options.up_sigma_deg)
    spread = main.slopes.tilt_covariance - up_sigma**2 * np.eye(2)
    # the larger 1-sigma of the tilt, deg, without that of up, which is the same in both directions
    alone = np.degrees(np.sqrt(np.maximum(np.linalg.eigvalsh(spread)[:, -1], 0.0)))
    return {
        plane.id: _cause(plane, float(sigma), options)
        for plane, sigma in zip(planes, alone, strict=True)
        if not _is_known(plane)
    }


def _cause(plane: Plane, alone_deg: float, options: Options) -> Cause:
    most = options.max_sigma_deg if plane.found else MOST_SIGMA_DEG
    sigma = plane.slope_sigma_deg
    if plane.distance > 0 and options.up_sigma_deg > 0 and alone_deg <= most:
        return Cause(
            "up-unknown",
            f"1-sigma {sigma:.0f}°, nearly all of it that of up, {options.up_sigma_deg:g}°",
            "give up with a smaller --up-sigma",
        )
    vague = "" if plane.slope_known else f": 1-sigma {sigma:.0f}°"
    if plane.source == "given":
        behind = not plane.distance > 0
        return Cause(
            "slope-open",
            "its rows put it behind the camera" if behind else f"its rows do not determine the slope{vague}",
            "give more rows, spread wider, of a longer baseline or known better",
        )
    if plane.distance > 0 and sigma <= Options().max_sigma_deg:  # --max-sigma is smaller than usual
        return Cause(
            "slope-open",
            f"sigma {beside(sigma, options.max_sigma_deg)}° is above --max-sigma {options.max_sigma_deg:g}°",
            "raise --max-sigma, or take the images farther apart",
        )
    return Cause(
        "low-texture",
        f"too little texture: its matches do not determine the slope{vague}",
        f"choose larger {plane.noun}s, or such with texture that both images show",
    )


def _no_slope_known(causes: list[Cause], joined: Joined) -> NoAnswer:
    """The refusal where no plane is reported, with the commonest cause."""
    codes = [cause.code for cause in causes]
    cause = max(causes, key=lambda cause: codes.count(cause.code))
    asked = [*joined.patches, *joined.unanswered]
    whose = f"all {len(asked)} {asked[0].finder.noun}s"
    reason = f"the matches of {whose} do not determine their slopes: {cause.message}"
    return NoAnswer(cause.code, reason, cause.remedy)
