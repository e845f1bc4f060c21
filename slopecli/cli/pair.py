"""The body of `slopemap estimate` and `slopemap segment`: load a pair, solve it, write and print the report."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from slopecli.cli.checks import (
    CAMERA_FLAGS,
    at_most_one,
    camera_choice,
    check_known_motion,
    check_planes,
    given,
    options_from,
    refuse,
)
from slopecli.cli.report_table import print_report
from slopecli.cli.talk import Talk

if TYPE_CHECKING:
    from slopecli.types import Camera, Image, Report


def answer_pair(ctx: click.Context, image1: str, image2: str, parameters: dict[str, Any]) -> None:
    """Estimate one pair: files in, files out, a table or JSON on stdout."""
    _check_usage(ctx)
    talk = ctx.ensure_object(Talk)
    if parameters["output"]:
        from slopecli.io.outputs import check_directory

        check_directory(parameters["output"])
    images = _load_images(image1, image2, talk)
    cameras = _load_cameras(images, parameters, talk)

    from slopecli.pipeline import estimate

    report = estimate(*images, *cameras, options_from(parameters), on_stage=talk.stage)
    written = _write(report, images[0], parameters, talk)
    print_report(report, written, talk, as_json=parameters["as_json"])


def _check_usage(ctx: click.Context) -> None:
    at_most_one(ctx, *CAMERA_FLAGS)
    at_most_one(ctx, "grid", "windows")
    check_known_motion(ctx)
    no_camera = "No camera: give --camera FILE, --intrinsics FX,FY,CX,CY or --fov DEG."
    refuse(ctx, [(not given(ctx, *CAMERA_FLAGS), no_camera)])
    check_planes(ctx, ctx.params.get("planes", "regions"))
    no_output = "Nowhere to put the answer: give -o DIR, or --json to print it."
    refuse(ctx, [(not given(ctx, "output", "as_json"), no_output)])


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


def _write(report: Report, image1: Image, parameters: dict[str, Any], talk: Talk) -> list[Path]:
    """Paths of the files written, none without -o."""
    from slopecli.io.outputs import write_outputs
    from slopecli.products import kept_choices

    if not parameters["output"]:
        return []
    with talk.timed("write"):
        return write_outputs(report, image1, parameters["output"], kept_choices(parameters))
