"""`slopemap plan`: what a pair will tell, or how far apart its images must be taken, before the flight."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from slopecli.cli.parameter_types import INTRINSICS, PATH, POSITIVE, SIZE, UP, VECTOR, Between
from slopecli.cli.shared_options import at_most_one, given, talk_options_with, window_options
from slopecli.cli.talk import Talk, print_result

if TYPE_CHECKING:
    from slopecli.plan import Plan, PlanOptions, Window
    from slopecli.types import Camera

CAMERA_FLAGS = ("camera", "intrinsics", "fov")
# these stand in `slopecli.plan`, too, which loads more than a help text may; a test holds them to be the same
POINTS, NOISE_PX, ROUGHNESS = 100, 0.1, 0.002


@click.command()
@click.option("--camera", metavar="FILE", type=PATH, help="Camera file; FILE#NAME takes one of several in it.")
@click.option("--intrinsics", metavar="FX,FY,CX,CY", type=INTRINSICS, help="Instead of a camera file, px, with --size.")
@click.option(
    "--fov",
    metavar="DEG",
    type=Between(0, 180, min_open=True, max_open=True),
    help="Instead of a camera file, with --size: horizontal field of view.",
)
@click.option("--size", metavar="WxH", type=SIZE, help="Of the images, px.  [default: that of the camera file]")
@click.option(
    "--direction",
    metavar="X,Y,Z",
    type=VECTOR,
    help="From camera 1 to camera 2, camera-1 axes (x right, y down, z forward).",
)
@click.option(
    "--trajectory",
    "trajectory_deg",
    metavar="DEG",
    type=Between(0, 180),
    help="Instead: angle of the motion from the vertical, as in the paper. 0 descends, 45 glides, 90 flies level, "
    "towards the image's right; 180 climbs.",
)
@click.option(
    "--height", metavar="M", type=POSITIVE, help="Of camera 1 above the ground; without --baseline in baselines."
)
@click.option("--baseline", metavar="M", type=POSITIVE, help="Distance between the cameras.")
@click.option(
    "--sigma",
    "sigma_deg",
    metavar="DEG",
    type=Between(0, 60, min_open=True),
    help="Instead of --baseline: the shortest that gives slopes this 1-sigma, and enough parallax; without --height as "
    "a share of it.",
)
@click.option(
    "--of",
    type=click.Choice(["worst", "median"]),
    default="worst",
    show_default=True,
    help="The window that --sigma is about.",
)
@click.option(
    "--ground-slope",
    "slope_deg",
    metavar="DEG",
    type=Between(0, 80),
    default=0.0,
    show_default=True,
    help="Slope of the ground as a whole.",
)
@click.option(
    "--aspect",
    "aspect_deg",
    metavar="DEG",
    type=Between(0, 360),
    default=0.0,
    show_default=True,
    help="Where it falls to, clockwise from north.",
)
@click.option(
    "--uneven",
    "uneven_deg",
    metavar="DEG",
    type=Between(0, 60),
    default=0.0,
    show_default=True,
    help="By how much the planes of windows tilt from it, each its own way; 0 is ground that is one plane.",
)
@click.option(
    "--roughness",
    metavar="SHARE",
    type=Between(0, 0.2),
    default=ROUGHNESS,
    show_default=True,
    help="RMS height of the ground off the plane of a window over its distance, as estimate reports it.",
)
@click.option(
    "--points",
    metavar="N",
    type=click.IntRange(6, 1_000_000),
    default=POINTS,
    show_default=True,
    help="Independent matches in a window. Of the 300 to 400 that estimate finds, about four share their errors.",
)
@click.option(
    "--noise",
    "noise_px",
    metavar="PX",
    type=POSITIVE,
    default=NOISE_PX,
    show_default=True,
    help="1-sigma of a match in image 2, as estimate reports it (fit.noise_px).",
)
@click.option(
    "--up",
    metavar="camera|X,Y,Z",
    type=UP,
    default="camera",
    show_default=True,
    help="What is level: camera 1 looks straight down; or a vector against gravity in camera-1 axes.",
)
@click.option(
    "--up-sigma",
    "up_sigma_deg",
    metavar="DEG",
    type=Between(0, 90, max_open=True),
    default=0.0,
    show_default=True,
    help="1-sigma uncertainty of that direction.",
)
@click.option(
    "--north",
    metavar="X,Y,Z",
    type=VECTOR,
    help="Where aspect is 0, in camera-1 axes.  [default: the image's up direction]",
)
@window_options
@click.option("-o", "--output", metavar="DIR", type=PATH, help="Keep the plan there: plan.json and a map, plan.png.")
@click.option("--json", "as_json", is_flag=True, help="Print plan.json on stdout instead of the table.")
@talk_options_with("How long it took.")
@click.pass_context
def plan(ctx: click.Context, **parameters: Any) -> None:
    """How well two images will tell slopes, before they are taken.

    Prints the 1-sigma of the slope expected in every window, and whether geometry would leave two answers. With
    --sigma it finds how far apart the images must be taken. Camera 2 keeps the attitude of camera 1.

    \b
    Examples:
      slopemap plan --fov 60 --size 1024x1024 --trajectory 45 --height 80 --baseline 16
      slopemap plan --camera camera.json --direction 1,0,0 --height 80 --sigma 0.5
    """
    _check_usage(ctx)
    talk = ctx.ensure_object(Talk)
    if parameters["output"]:
        from slopecli.io.plan_files import check_plan_directory

        check_plan_directory(parameters["output"])
    with talk.timed("plan"):
        from slopecli.plan import make_plan

        camera = _camera(parameters, talk)
        found = make_plan(camera, _windows(parameters, camera), _options(parameters))
    _deliver(found, parameters, talk)


def _check_usage(ctx: click.Context) -> None:
    for names in (CAMERA_FLAGS, ("direction", "trajectory_deg"), ("baseline", "sigma_deg"), ("grid", "windows")):
        at_most_one(ctx, *names)
    for wrong, complaint in (
        (not given(ctx, *CAMERA_FLAGS), "No camera: give --camera FILE, or --fov DEG or --intrinsics with --size WxH."),
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
        (given(ctx, "aspect_deg") and not ctx.params["slope_deg"], "--aspect is for --ground-slope DEG; give both."),
        (
            ctx.params["up"] == "dominant-plane",
            "--up dominant-plane needs images: no plane is known before the flight; give camera or X,Y,Z.",
        ),
    ):
        if wrong:
            raise click.UsageError(complaint, ctx)


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
    from dataclasses import fields

    from slopecli.plan import PlanOptions

    return PlanOptions(**{field.name: parameters[field.name] for field in fields(PlanOptions)})


def _deliver(found: Plan, parameters: dict[str, Any], talk: Talk) -> None:
    from slopecli.cli.plan_table import plan_table
    from slopecli.io.plan_files import plan_to_json, write_plan

    written = write_plan(found, parameters["output"]) if parameters["output"] else []
    print_result(plan_to_json(found) if parameters["as_json"] else plan_table(found))
    for diagnostic in found.diagnostics:
        remedy = f"; {diagnostic.remedy}" if diagnostic.remedy else ""
        talk.say(f"{diagnostic.severity}: {diagnostic.code}: {diagnostic.message}{remedy}")
    if written:
        talk.say(f"wrote {', '.join(map(str, written))}")
