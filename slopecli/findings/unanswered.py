"""Planes whose slopes the matches do not tell: which they are, why, and what to do about it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

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


def answered(plane: Plane) -> bool:
    """Whether the matches say where the plane faces, and that it lies before the camera (NaN compares false).

    A window was asked about, so it keeps what little is known of it; a plane that is only claimed must be known.
    """
    return plane.slope_sigma_deg <= MOST_SIGMA_DEG and plane.distance > 0 and (plane.slope_known or not plane.found)


def causes(planes: list[Plane], main: Measured, options: Options) -> dict[int, Cause]:
    """Why planes, in the solver's order, have no answer; by id."""
    up_sigma = np.radians(options.up_sigma_deg)
    spread = main.slopes.tilt_covariance - up_sigma**2 * np.eye(2)
    # the larger of both ways to tilt, without the doubt about up: that adds the same to either
    alone = np.degrees(np.sqrt(np.maximum(np.linalg.eigvalsh(spread)[:, -1], 0.0)))
    return {
        plane.id: _cause(plane, float(sigma), options)
        for plane, sigma in zip(planes, alone, strict=True)
        if not answered(plane)
    }


def _cause(plane: Plane, alone_deg: float, options: Options) -> Cause:
    most = options.max_sigma_deg if plane.found else MOST_SIGMA_DEG
    if plane.distance > 0 and options.up_sigma_deg > 0 and alone_deg <= most:
        return Cause(
            "up-unknown",
            f"1-sigma {plane.slope_sigma_deg:.0f}°, nearly all of it that of up, {options.up_sigma_deg:g}°",
            "give up with a smaller --up-sigma",
        )
    vague = "" if plane.slope_known else f": 1-sigma {plane.slope_sigma_deg:.0f}°"
    if plane.source == "given":
        behind = not plane.distance > 0
        return Cause(
            "slope-open",
            "its rows put it behind the camera" if behind else f"its rows leave the slope open{vague}",
            "give more rows, spread wider, of a longer baseline or known better",
        )
    if plane.distance > 0 and plane.slope_sigma_deg <= Options().max_sigma_deg:  # more was asked than usual
        return Cause(
            "slope-open",
            f"sigma {beside(plane.slope_sigma_deg, options.max_sigma_deg)}° is above --max-sigma "
            f"{options.max_sigma_deg:g}°",
            "raise --max-sigma, or take the images farther apart",
        )
    return Cause(
        "low-texture",
        f"too little texture: its matches leave the slope open{vague}",
        f"choose larger {plane.noun}s, or such with texture that both images show",
    )


def commonest(found: dict[int, Cause]) -> Cause:
    """The cause of most planes."""
    codes = [cause.code for cause in found.values()]
    return next(cause for cause in found.values() if codes.count(cause.code) == max(map(codes.count, codes)))


def rejected(joined: Joined, planes: list[Plane], found: dict[int, Cause]) -> tuple[Rejected, ...]:
    """Patches without matches, and those whose matches leave the slope open, by id."""
    bare = [Rejected(patch.id, patch.footprint.polygon_px, patch.code, patch.reason) for patch in joined.unanswered]
    vague = [
        Rejected(plane.id, plane.polygon_px, found[plane.id].code, found[plane.id].message)
        for plane in planes
        if plane.id in found
    ]
    return tuple(sorted(bare + vague, key=lambda one: one.id))
