"""`slopemap plan`: expected slope uncertainty of a pair, or the baseline it needs, before the flight."""

from __future__ import annotations

from dataclasses import fields
from typing import TYPE_CHECKING, Any

import click

from slopecli.cli import shared_options as shared
from slopecli.cli.checks import CAMERA_FLAGS, at_most_one, given, refuse
from slopecli.cli.groups import Command, Flag, Option
from slopecli.cli.parameter_types import PATH, POSITIVE, UP, VECTOR, Between
from slopecli.cli.report_table import diagnostic_line
from slopecli.cli.table import print_table
from slopecli.cli.talk import Talk, print_result
from slopecli.plan.plan_options import PlanOptions

if TYPE_CHECKING:
    from slopecli.plan import Plan, Window
    from slopecli.types import Camera

FLIGHT, GROUND, MATCHES = "Flight", "Ground", "Matches"

flight_options = (
    Option(FLIGHT, "--direction", "X,Y,Z", VECTOR, "From camera 1 to camera 2, in camera-1 axes"),
    Option(
        FLIGHT,
        "--trajectory trajectory_deg",
        "DEG",
        Between(0, 180),
        "Instead: angle from the vertical; 0 descends, 90 flies level towards the image's right",
    ),
    Option(FLIGHT, "--height", "M", POSITIVE, "Of camera 1 above ground, m or in baselines"),
    Option(FLIGHT, "--baseline", "M", POSITIVE, "Distance between the cameras"),
    Option(
        FLIGHT,
        "--sigma sigma_deg",
        "DEG",
        Between(0, 60, min_open=True),
        "Instead: the shortest baseline for this 1-sigma of slopes; a share of the height without --height",
    ),
    Option(FLIGHT, "--of", None, click.Choice(["worst", "median"]), "Window that --sigma is for", "worst"),
)
ground_options = (
    Option(GROUND, "--ground-slope slope_deg", "DEG", Between(0, 80), "Slope of the ground as a whole", 0.0),
    Option(GROUND, "--aspect aspect_deg", "DEG", Between(0, 360), "Its way down, clockwise from north", 0.0),
    Option(GROUND, "--uneven uneven_deg", "DEG", Between(0, 60), "Tilt of each window's plane against it", 0.0),
    Option(
        GROUND,
        "--roughness",
        "SHARE",
        Between(0, 0.2),
        "RMS height off a plane over its distance",
        PlanOptions.roughness,
    ),
)
match_options = (
    Option(
        MATCHES,
        "--points",
        "N",
        click.IntRange(6, 1_000_000),
        "Independent matches in a window: a quarter of those that estimate counts",
        PlanOptions.points,
    ),
    Option(MATCHES, "--noise noise_px", "PX", POSITIVE, "1-sigma of a match in image 2", PlanOptions.noise_px),
)
frame_options = (
    Option(
        shared.FRAME,
        "--up",
        "VERTICAL",
        UP,
        "What is up: camera (looks straight down), or a vector X,Y,Z",
        "camera",
    ),
    *shared.frame_options()[1:],
)
output_options = (
    Option(shared.OUTPUT, "-o --output", "DIR", PATH, "Folder for plan.json and a map, plan.png"),
    Flag(shared.OUTPUT, "--json as_json", "Print plan.json instead of the table"),
)


@click.command(
    cls=Command,
    params=[
        shared.camera,
        *shared.intrinsics_options,
        shared.size,
        *output_options,
        *flight_options,
        *shared.window_options,
        *ground_options,
        *match_options,
        *frame_options,
        *shared.talk_options("Time taken"),
    ],
)
@click.pass_context
def plan(ctx: click.Context, **parameters: Any) -> None:
    """How well two images will tell slopes, before they are taken.

    Prints the expected 1-sigma of the slope in every window, and whether two motions would explain the images. With
    --sigma it finds the distance between the cameras. Camera 2 keeps the attitude of camera 1. Axes: x right, y down,
    z forward.

    \b
    Examples:
      slopemap plan --fov 60 --size 1024x1024 --trajectory 45 --height 80 --baseline 16
      slopemap plan --camera camera.json --direction 1,0,0 --height 80 --sigma 0.5
    """
    _check_usage(ctx)
    talk = ctx.ensure_object(Talk)
    if parameters["output"]:
        from slopecli.io.outputs import check_plan_directory

        check_plan_directory(parameters["output"])
    with talk.timed("plan"):
        from slopecli.plan import make_plan

        camera = _camera(parameters, talk)
        found = make_plan(camera, _windows(parameters, camera), _options(parameters))
    _deliver(found, parameters, talk)


def _check_usage(ctx: click.Context) -> None:
    for names in (CAMERA_FLAGS, ("direction", "trajectory_deg"), ("baseline", "sigma_deg"), ("grid", "windows")):
        at_most_one(ctx, *names)
    refuse(
        ctx,
        [
            (
                not given(ctx, *CAMERA_FLAGS),
                "No camera: give --camera FILE, or --fov DEG or --intrinsics with --size WxH.",
            ),
            (
                given(ctx, "fov", "intrinsics") and not given(ctx, "size"),
                "No image size: --fov and --intrinsics need --size WxH, for example --size 1024x768.",
            ),
            (
                not given(ctx, "direction", "trajectory_deg"),
                "No direction of motion: give --direction X,Y,Z, or --trajectory DEG (0 descends, 90 flies level).",
            ),
            (
                not given(ctx, "height", "sigma_deg"),
                "No height: give --height M with --baseline M, --height alone in baselines, or --sigma DEG.",
            ),
            (given(ctx, "of") and not given(ctx, "sigma_deg"), "--of is for --sigma DEG; leave it out."),
            (
                given(ctx, "aspect_deg") and not ctx.params["slope_deg"],
                "--aspect is for --ground-slope DEG; give both.",
            ),
            (
                ctx.params["up"] == "dominant-plane",
                "--up dominant-plane needs images: no plane is known before the flight; give camera or X,Y,Z.",
            ),
        ],
    )


def _camera(parameters: dict[str, Any], talk: Talk) -> Camera:
    from slopecli.io.cameras.reading import camera_from_fov, camera_from_intrinsics, fit_camera_to_image, load_camera

    size = parameters["size"]
    if parameters["intrinsics"] is not None:
        return camera_from_intrinsics(parameters["intrinsics"], *size)
    if parameters["fov"] is not None:
        return camera_from_fov(parameters["fov"], *size)
    camera = load_camera(parameters["camera"], size=size)
    if size is None:
        return camera
    camera, note = fit_camera_to_image(camera, *size)
    if note:
        talk.say(f"info: {parameters['camera']}: {note}")
    return camera


def _windows(parameters: dict[str, Any], camera: Camera) -> list[Window]:
    from slopecli.windows import check_windows, grid_windows

    columns, rows = parameters["grid"]
    windows = list(parameters["windows"]) or grid_windows(columns, rows, camera.width, camera.height)
    check_windows(windows, camera.width, camera.height)
    return windows


def _options(parameters: dict[str, Any]) -> PlanOptions:
    return PlanOptions(**{field.name: parameters[field.name] for field in fields(PlanOptions)})


def _deliver(found: Plan, parameters: dict[str, Any], talk: Talk) -> None:
    from slopecli.cli.plan_table import plan_summary, plan_table
    from slopecli.io.outputs import plan_to_json, write_plan

    written = write_plan(found, parameters["output"]) if parameters["output"] else []
    if parameters["as_json"]:
        print_result(plan_to_json(found))
    else:
        print_table(plan_table(found), *plan_summary(found))
    for diagnostic in found.diagnostics:
        talk.say(diagnostic_line(diagnostic))
    if written:
        talk.say(f"wrote {', '.join(map(str, written))}")
