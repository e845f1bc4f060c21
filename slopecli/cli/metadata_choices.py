"""What a command line asks of the metadata of the images: the word exif, --metadata, and angles in their place."""

from __future__ import annotations

from typing import Any

import click

from slopecli.cli.checks import CAMERA_FLAGS, given, refuse
from slopecli.cli.shared_options import EXIF
from slopecli.options import MetadataChoice, Options

# what is taken from metadata: the parameter that takes the word exif, and those that are given in its place
_OF = {"up": "up", "north": "north", "baseline": "baseline_m", "altitude": "altitude_m"}
_INSTEAD = {
    "up": ("up",),
    "north": ("north",),
    "baseline": ("baseline_m", "altitude_m", "pose_file", "positions_file"),
    "altitude": ("baseline_m", "altitude_m", "pose_file", "positions_file"),
}


def take_metadata(ctx: click.Context, parameters: dict[str, Any]) -> tuple[dict[str, Any], MetadataChoice | None]:
    """The parameters without the word exif, but for that of cameras, and what it stood for; None if for nothing.

    Raises
    ------
    click.UsageError : angles are given beside another up or north, or without a pitch.
    """
    angles = {name: parameters[name] for name in ("yaw_deg", "pitch_deg", "roll_deg")}
    must = tuple(name for name, parameter in _OF.items() if parameters[parameter] == EXIF)
    may = tuple(name for name in _OF if parameters["metadata"] and not given(ctx, *_INSTEAD[name]))
    _check_angles(ctx, parameters, stated="up" in (*must, *may))
    defaults = {"up": Options.up, "north": None, "baseline_m": None, "altitude_m": None}
    plain = {**parameters, **{_OF[name]: defaults[_OF[name]] for name in must}}
    if parameters["metadata"] and not given(ctx, *CAMERA_FLAGS):
        plain["camera"] = EXIF
    # an up and a position that are given are compared with those stated
    compared = isinstance(plain.get("up"), tuple) or plain.get("position") is not None
    asked = must or may or compared or EXIF in (plain["camera"], plain.get("camera2"))
    if not asked and all(angle is None for angle in angles.values()):
        return plain, None
    return plain, MetadataChoice(must, may, **angles)


def _check_angles(ctx: click.Context, parameters: dict[str, Any], *, stated: bool) -> None:
    """Refuse angles beside what they stand for. stated: whether the metadata give those that are left out."""
    tilt, heading = given(ctx, "pitch_deg", "roll_deg"), given(ctx, "yaw_deg")
    for flags, name in ((tilt, "up"), (heading, "north")):
        other = given(ctx, name) if parameters[name] != EXIF else []
        refuse(ctx, (flags and other, f"{(flags or [''])[0]} and --{name} contradict each other; give one."))
    alone = [*tilt, *heading]
    lacking = alone and not stated and not given(ctx, "pitch_deg")
    refuse(ctx, (lacking, f"{(alone or [''])[0]} needs --pitch DEG (-90 looks straight down), or --up exif."))
