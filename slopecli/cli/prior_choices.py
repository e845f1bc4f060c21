"""The frames of a sequence with what a file of priors tells of them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from slopecli.cli.checks import given, refuse

if TYPE_CHECKING:
    from slopecli.cli.talk import Talk
    from slopecli.io.frame_sources import FrameSource


def with_priors_file(ctx: click.Context, source: FrameSource, parameters: dict[str, Any], talk: Talk) -> FrameSource:
    """The frames with what a file tells of them, where one is given; refuse what is given otherwise as well."""
    from slopecli.io.prior_files import read_priors, with_frame_priors

    if not (path := parameters["priors_file"]):
        return source
    priors = read_priors(path)
    told = list(priors.values())
    lengths = any(one.position_m is not None or one.altitude_m is not None for one in told)
    angles, up = any(one.ned is not None for one in told), parameters["up"]
    other = given(ctx, "baseline_m", "altitude_m", "positions_file", "metadata")
    tilt = given(ctx, "up", "pitch_deg", "roll_deg", "metadata")
    heading = given(ctx, "north", "yaw_deg", "metadata")
    refuse(
        ctx,
        (lengths and other, f"{(other or [''])[0]} and the lengths in --priors contradict each other; give one."),
        (angles and tilt, f"{(tilt or [''])[0]} and the angles in --priors contradict each other; give one."),
        (
            any(one.heading for one in told) and heading,
            f"{(heading or [''])[0]} and yaw_deg in --priors contradict each other; give one.",
        ),
        (
            any(one.altitude_m is not None for one in told) and up == "dominant-plane",
            "Altitudes in --priors need an up that is known: give --up X,Y,Z, or angles in the file.",
        ),
    )
    return with_frame_priors(source, path, priors, talk.say)
