"""What the commands on one pair do, once their options are read: load, solve, write, print."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from slopecli.cli.memory import keep_freed_memory
from slopecli.cli.shared_options import at_most_one, check_known_motion, given, options_from
from slopecli.cli.table import result_table, talk_lines
from slopecli.cli.talk import Talk, print_result
from slopecli.orders import CameraChoice

if TYPE_CHECKING:
    from slopecli.types import Camera, Image, Report

CAMERA_FLAGS = ("camera", "intrinsics", "fov")
# options that only some finders of planes have a use for, and which
FINDERS_WITH = {
    ("windows",): ("grid", "windows"),
    ("ransac", "regions"): ("min_region_percent",),
    ("regions",): ("gradient_threshold", "merge_px", "debug_images"),
}


def answer_pair(ctx: click.Context, image1: str, image2: str, parameters: dict[str, Any]) -> None:
    """One pair from files to files, and a table or JSON on stdout."""
    _check_usage(ctx)
    keep_freed_memory()
    talk = ctx.ensure_object(Talk)
    if parameters["output"]:
        _check_output(parameters["output"])
    images = _load_images(image1, image2, talk)
    cameras = _load_cameras(images, parameters, talk)
    report = _solve(images, cameras, parameters, talk)
    _deliver(report, images[0], parameters, talk)


def _check_usage(ctx: click.Context) -> None:
    at_most_one(ctx, *CAMERA_FLAGS)
    at_most_one(ctx, "grid", "windows")
    check_known_motion(ctx)
    if not given(ctx, *CAMERA_FLAGS):
        raise click.UsageError("No camera: give --camera FILE, --intrinsics FX,FY,CX,CY or --fov DEG.", ctx)
    check_planes(ctx, ctx.params.get("planes", "regions"))
    if not given(ctx, "output", "as_json"):
        raise click.UsageError("Nowhere to put the answer: give -o DIR, or --json to print it.", ctx)


def check_planes(ctx: click.Context, finder: str) -> None:
    """Refuse options of one finder of planes together with another finder."""
    for finders, names in FINDERS_WITH.items():
        flags = given(ctx, *names)
        if flags and finder not in finders:
            wanted = " or ".join(finders)
            raise click.UsageError(f"{flags[0]} is for --planes {wanted}, not for {finder}; leave one out.", ctx)


def _check_output(folder: str) -> None:
    from slopecli.io.outputs import check_directory

    check_directory(folder)


def _load_images(image1: str, image2: str, talk: Talk) -> tuple[Image, Image]:
    with talk.timed("load"):
        from slopecli.io.images import load_image

        return load_image(image1), load_image(image2)


def _load_cameras(images: tuple[Image, Image], parameters: dict[str, Any], talk: Talk) -> tuple[Camera, Camera]:
    second = {**parameters, "camera": parameters["camera2"]} if parameters["camera2"] else parameters
    return _load_camera(images[0], parameters, talk), _load_camera(images[1], second, talk)


def _load_camera(image: Image, parameters: dict[str, Any], talk: Talk) -> Camera:
    from slopecli.io.cameras.reading import camera_for

    camera, note = camera_for(image, camera_choice(parameters))
    if note:
        talk.say(f"info: {note}")
    return camera


def camera_choice(parameters: dict[str, Any]) -> CameraChoice:
    """The camera that the options of a command name; without any, one that nothing stands for."""
    return CameraChoice(parameters["camera"] or None, parameters["intrinsics"], parameters["fov"])


def _solve(
    images: tuple[Image, Image], cameras: tuple[Camera, Camera], parameters: dict[str, Any], talk: Talk
) -> Report:
    from slopecli.pipeline import estimate as estimate_pair

    return estimate_pair(*images, *cameras, options_from(parameters), on_stage=talk.stage)


def _deliver(report: Report, image1: Image, parameters: dict[str, Any], talk: Talk) -> None:
    from slopecli.io.outputs import write_outputs
    from slopecli.products import kept_choices
    from slopecli.products.slopes_json import report_to_json

    written: list[Path] = []
    if parameters["output"]:
        with talk.timed("write"):
            written = write_outputs(report, image1, parameters["output"], kept_choices(parameters))
    print_result(report_to_json(report) if parameters["as_json"] else result_table(report))
    for line in talk_lines(report):
        talk.say(line)
    if written:
        talk.say(f"wrote {', '.join(map(str, written))}")
