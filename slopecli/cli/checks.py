"""Checks of a command line as a whole: options that exclude or need each other. All raise `click.UsageError`."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import fields
from typing import Any

import click
from click.core import ParameterSource

from slopecli.options import CameraChoice, MapOptions, Options, Position
from slopecli.patches import FINDERS

CAMERA_FLAGS, WINDOW_FLAGS = ("camera", "intrinsics", "fov"), ("grid", "windows")
NO_CAMERA = (
    "No camera: give --camera FILE, --intrinsics FX,FY,CX,CY or --fov DEG; or --metadata, for images that state how "
    "they were taken, as those of drones and telephones do."
)


def given(ctx: click.Context, *names: str) -> list[str]:
    """Flags, as the user writes them, of those of the named parameters that are on the command line."""
    return [
        parameter.opts[-1]
        for parameter in ctx.command.params
        if parameter.name in names and ctx.get_parameter_source(parameter.name) is not ParameterSource.DEFAULT
    ]


def at_most_one(ctx: click.Context, *groups: Iterable[str]) -> None:
    """Refuse a command line that has more than one of the named parameters of a group."""
    for names in groups:
        flags = given(ctx, *names)
        if len(flags) > 1:
            raise click.UsageError(f"{' and '.join(flags)} contradict each other; give one.", ctx)


def refuse(ctx: click.Context, *complaints: tuple[object, str]) -> None:
    """Refuse with the first complaint whose condition is true; each is (condition, message)."""
    for wrong, message in complaints:
        if wrong:
            raise click.UsageError(message, ctx)


def check_estimate(ctx: click.Context) -> None:
    """Refuse contradicting ways to give cameras, windows, motion or scale, and what only the solver mle can use."""
    at_most_one(ctx, CAMERA_FLAGS, WINDOW_FLAGS, ("baseline_m", "altitude_m", "pose_file"))
    at_most_one(ctx, ("pose_file", "rotation_prior"), ("pose_file", "direction_prior"))
    known = given(ctx, "rotation_prior", "direction_prior", "pose_file")
    sigma_alone = given(ctx, "pose_sigma_deg") and not given(ctx, "pose_file")
    sigma_of_none = given(ctx, "scale_sigma_percent") and not given(
        ctx, "baseline_m", "altitude_m", "pose_file", "metadata"
    )
    other_solver = ctx.params["solver"] != "mle"
    refuse(
        ctx,
        (
            given(ctx, "position_sigma_m") and not given(ctx, "position"),
            "--position-sigma is of a --position; give both.",
        ),
        (
            given(ctx, "north_sigma_deg") and not given(ctx, "north", "yaw_deg", "metadata"),
            "--north-sigma is of --north, --yaw or --metadata; give both.",
        ),
        (sigma_of_none, "--scale-sigma is of a --baseline, --altitude or --pose; give both."),
        (sigma_alone, "--pose-sigma is of a --pose; give both."),
        (ctx.params["merge_coplanar"] and other_solver, "--merge-coplanar is for --solver mle; leave one out."),
        (known and other_solver, f"{known[0] if known else ''} is for --solver mle; leave one out."),
    )


def check_planes(ctx: click.Context, finder: str) -> None:
    """Refuse options of one finder of planes together with another finder."""
    for name in dict.fromkeys(name for row in FINDERS for name in row.options):
        finders = [row.choice for row in FINDERS if name in row.options]
        flags = given(ctx, name)
        if flags and finder not in finders:
            wanted = " or ".join(finders)
            raise click.UsageError(f"{flags[0]} is for --planes {wanted}, not for {finder}; leave one out.", ctx)


def camera_choice(parameters: dict[str, Any]) -> CameraChoice:
    """The camera that the options of a command name; an empty choice if they name none."""
    if parameters["camera"] == "exif":
        return CameraChoice(exif=True)
    return CameraChoice(parameters["camera"] or None, parameters["intrinsics"], parameters["fov"])


def camera_choices(parameters: dict[str, Any]) -> tuple[CameraChoice, CameraChoice]:
    """The cameras of both images: that of the second is the first's, unless it has a file of its own."""
    first = camera_choice(parameters)
    second = {"camera": parameters["camera2"], "intrinsics": None, "fov": None}
    return first, camera_choice(second) if parameters["camera2"] else first


def options_from(parameters: dict[str, Any]) -> Options:
    """The library's options out of a command's parameters of the same names; the pose is read from its file."""
    if parameters.get("pose_file"):
        from slopecli.io.poses import load_pose

        parameters = {**parameters, "pose": load_pose(parameters["pose_file"])}
    if parameters.get("position"):
        (latitude, longitude, altitude), sigma = parameters["position"], parameters["position_sigma_m"]
        # satellites tell height half as well as place; against another place of the user's own, no better than each
        parameters = {**parameters, "position": Position(latitude, longitude, altitude, sigma, 2.0 * sigma, sigma)}
    return Options(**{field.name: parameters[field.name] for field in fields(Options) if field.name in parameters})


def map_options_from(parameters: dict[str, Any]) -> MapOptions:
    """The library's options of a map out of a command's parameters of the same names."""
    return MapOptions(**{field.name: parameters[field.name] for field in fields(MapOptions)})
