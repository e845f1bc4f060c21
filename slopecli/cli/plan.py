"""`slopemap plan`: expected slope uncertainty of a pair, or the baseline it needs, before the flight."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields
from functools import partial
from typing import TYPE_CHECKING, Any

import click

from slopecli.cli import shared_options as shared
from slopecli.cli.checks import CAMERA_FLAGS, WINDOW_FLAGS, at_most_one, given, refuse
from slopecli.cli.parameter_types import PATH, POSITIVE, UP, VECTOR, Between, Whole
from slopecli.cli.report_table import diagnostic_line
from slopecli.cli.shared_options import Flag, Option
from slopecli.cli.table import Table, print_table
from slopecli.cli.talk import Talk, check_stdout, print_result
from slopecli.plan.plan_options import PlanOptions

if TYPE_CHECKING:
    from slopecli.plan import Plan, PlannedWindow
    from slopecli.types import Camera

FLIGHT, GROUND, MATCHES = "Flight", "Ground", "Matches"
HEADER = ("id", "sigma", "parallax", "in image 2", "note")
TRAJECTORY_HELP = "Instead: angle from the vertical; 0 descends, 90 flies level towards the image's right"
SIGMA_HELP = "Instead: the shortest baseline for this 1-sigma of slopes; a share of the height without --height"
POINTS_HELP = "Independent matches in a window: a quarter of those that estimate counts"
FOOTPRINT_HELP = "Diameter of a disc of `slopemap map`"
_option = partial(Option, of=PlanOptions)

flight_options = (
    _option(FLIGHT, "--direction", "X,Y,Z", VECTOR, "From camera 1 to camera 2, in camera-1 axes"),
    _option(FLIGHT, "--trajectory trajectory_deg", "DEG", Between(0, 180), TRAJECTORY_HELP),
    _option(FLIGHT, "--height", "M", POSITIVE, "Of camera 1 above ground, m or in baselines"),
    _option(FLIGHT, "--baseline", "M", POSITIVE, "Distance between the cameras"),
    _option(FLIGHT, "--sigma sigma_deg", "DEG", Between(0, 60, min_open=True), SIGMA_HELP),
    _option(FLIGHT, "--of", None, click.Choice(["worst", "median"]), "Window that --sigma is for"),
)
ground_options = (
    _option(GROUND, "--ground-slope slope_deg", "DEG", Between(0, 80), "Slope of the ground as a whole"),
    _option(GROUND, "--aspect aspect_deg", "DEG", Between(0, 360), "Its way down, clockwise from north"),
    _option(GROUND, "--uneven uneven_deg", "DEG", Between(0, 60), "Tilt of each window's plane against it"),
    _option(GROUND, "--roughness", "SHARE", Between(0, 0.2), "RMS height off a plane over its distance"),
)
match_options = (
    _option(MATCHES, "--points", "N", Whole(6, 1_000_000), POINTS_HELP),
    _option(MATCHES, "--noise noise_px", "PX", POSITIVE, "1-sigma of a match in image 2"),
)
map_options = (
    _option(MATCHES, "--footprint footprint_px", "PX", POSITIVE, FOOTPRINT_HELP, shown="1/16 of short side"),
)
frame_options = (
    _option(shared.FRAME, "--up", "VERTICAL", UP, "What is up: camera (looks straight down), or a vector X,Y,Z"),
    *shared.frame_options()[1:],
)


@click.command(
    cls=shared.Command,
    params=[
        shared.camera,
        *shared.intrinsics_options,
        shared.size,
        Option(shared.OUTPUT, "-o --output", "DIR", PATH, "Folder for plan.json and a map, plan.png"),
        Flag(shared.OUTPUT, "--json as_json", "Print plan.json instead of the table"),
        *flight_options,
        *shared.window_options,
        *ground_options,
        *match_options,
        *map_options,
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
      slopemap plan --fov 60 --size 800x800 --trajectory 90 --height 80 --sigma 1
      slopemap plan --camera camera.json --trajectory 45 --height 80 --baseline 16
    """
    _check_usage(ctx)
    talk = ctx.ensure_object(Talk)
    if parameters["output"]:
        from slopecli.io.outputs import PLAN_NAMES, check_directory

        check_directory(parameters["output"], PLAN_NAMES, [parameters["camera"]])
    with talk.timed("plan"):
        from slopecli.plan import make_plan
        from slopecli.windows import check_windows, grid_windows

        camera = _camera(parameters, talk)
        columns, rows = parameters["grid"]
        windows = list(parameters["windows"]) or grid_windows(columns, rows, camera.width, camera.height)
        check_windows(windows, camera.width, camera.height)
        options = PlanOptions(**{field.name: parameters[field.name] for field in fields(PlanOptions)})
        found = make_plan(camera, windows, options)
    _deliver(found, parameters, talk)


def _check_usage(ctx: click.Context) -> None:
    at_most_one(ctx, CAMERA_FLAGS, ("direction", "trajectory_deg"), ("baseline", "sigma_deg"), WINDOW_FLAGS)
    no_camera = "No camera: give --camera FILE, or --fov DEG or --intrinsics with --size WxH."
    no_size = "No image size: --fov and --intrinsics need --size WxH, for example --size 1024x768."
    no_direction = "No direction of motion: give --direction X,Y,Z, or --trajectory DEG (0 descends, 90 flies level)."
    no_height = "No height: give --height M with --baseline M, --height alone in baselines, or --sigma DEG."
    no_images = "--up dominant-plane needs images: no plane is known before the flight; give camera or X,Y,Z."
    refuse(
        ctx,
        (not given(ctx, *CAMERA_FLAGS), no_camera),
        (given(ctx, "fov", "intrinsics") and not given(ctx, "size"), no_size),
        (not given(ctx, "direction", "trajectory_deg"), no_direction),
        (not given(ctx, "height", "sigma_deg"), no_height),
        (given(ctx, "of") and not given(ctx, "sigma_deg"), "--of is for --sigma DEG; leave it out."),
        (given(ctx, "aspect_deg") and not ctx.params["slope_deg"], "--aspect is for --ground-slope DEG; give both."),
        (ctx.params["up"] == "dominant-plane", no_images),
    )


def _camera(parameters: dict[str, Any], talk: Talk) -> Camera:
    from slopecli.io.cameras.reading import camera_from_fov, camera_from_intrinsics, fit_camera_to_image, load_camera

    size = parameters["size"]
    if parameters["intrinsics"] is not None:
        return camera_from_intrinsics(parameters["intrinsics"], *size)
    if parameters["fov"] is not None:
        return camera_from_fov(parameters["fov"], *size)
    camera, note = load_camera(parameters["camera"], size=size), None
    if camera.note:
        talk.say(f"info: {parameters['camera']}: {camera.note}")
    if size is not None:
        camera, note = fit_camera_to_image(camera, *size)
    if note:
        talk.say(f"info: {parameters['camera']}: {note}")
    return camera


def _deliver(found: Plan, parameters: dict[str, Any], talk: Talk) -> None:
    from slopecli.io.outputs import plan_to_json, write_plan

    written = write_plan(found, parameters["output"]) if parameters["output"] else []
    if not written:
        check_stdout()
    if parameters["as_json"]:
        print_result(plan_to_json(found))
    else:
        print_table(Table(HEADER, list(map(_cells, found.windows))), talk, *_summary(found))
    for diagnostic in found.diagnostics:
        talk.say(diagnostic_line(diagnostic))
    if written:
        talk.say(f"wrote {', '.join(map(str, written))}")


def _cells(one: PlannedWindow) -> tuple[str, ...]:
    """A row for a window; angles in degrees."""
    from slopecli.plan import sigma_text

    sigma, parallax = sigma_text(one.slope_sigma_deg), "-" if one.parallax_px is None else f"{one.parallax_px:.1f} px"
    notes = [f"{'no answer' if one.status == 'refused' else one.status}: {one.reason}"] if one.reason else []
    notes += [f"± {sigma_text(one.unseen_deg)} for the rest of it"] if one.in_part else []
    return str(one.id), sigma, parallax, f"{100 * one.share_in_image2:.0f} %", "; ".join(notes)


def _summary(plan: Plan) -> Iterator[str]:
    """Lines below the table: what holds for all windows."""
    from slopecli.plan import sigma_text

    yield f"baseline: {_baseline(plan)}"
    worst, median = sigma_text(plan.worst_sigma_deg), sigma_text(plan.median_sigma_deg)
    second = plan.second_answer
    of_two = ", if it is known which of two answers is right" if second.share else ""
    yield f"sigma: {worst} in the worst window, {median} in the median{of_two}"
    yield f"parallax: {plan.parallax_px:.1f} px in the median"
    said = "likely" if second.likely else "possible" if second.share else "unlikely"
    alone = f"; the first by itself is off by {sigma_text(second.first_error_deg)}" if second.share else ""
    yield f"two answers: {said} ({100 * second.share:.0f} % of simulated pairs){alone}"
    worst, median = sigma_text(plan.map.worst_sigma_deg), sigma_text(plan.map.median_sigma_deg)
    yield f"map: {median} in the median window, {worst} in the worst, for discs of {plan.map.footprint_px:.4g} px"
    if any(one.in_part for one in plan.windows):
        yield "the rest: sigma is for the part of a window that image 2 shows; estimate adds uncertainty for the rest"


def _baseline(plan: Plan) -> str:
    share = f"{plan.baseline / plan.height:.3g} of the height"
    if plan.unit == "height":
        return share
    if plan.unit == "baseline":
        return f"{share}, which is {plan.height:.4g} baselines"
    return f"{plan.baseline:.4g} m, {share} of {plan.height:.4g} m"
