"""`slopemap estimate` and `slopemap segment`: slopes of windows, or of planes found, from one pair of images."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from slopecli.cli import shared_options as shared
from slopecli.cli.checks import CAMERA_FLAGS, camera_choice, check_estimate, check_planes, given, options_from, refuse
from slopecli.cli.parameter_types import PATH
from slopecli.cli.report_table import print_report
from slopecli.cli.talk import Talk

if TYPE_CHECKING:
    from slopecli.types import Camera, Image


@click.command(
    cls=shared.Command,
    params=[
        *shared.camera_options,
        *shared.output_options,
        *shared.window_options,
        *shared.finder_options,
        *shared.region_options,
        *shared.frame_options(),
        *shared.solving_options,
        *shared.matching_options,
        *shared.talk_options(),
    ],
)
@click.argument("image1", type=PATH)
@click.argument("image2", type=PATH)
@click.pass_context
def estimate(ctx: click.Context, image1: str, image2: str, **parameters: Any) -> None:
    """Slopes of windows of IMAGE1 from two overlapping images.

    Prints a table; -o DIR also writes slopes.json, labels.png, overlay.png and patches.ply. Vectors are in camera-1
    axes: x right, y down, z forward.

    \b
    Example:
      slopemap estimate first.png second.png --camera camera.json -o out
    """
    _answer_pair(ctx, image1, image2, parameters)


@click.command(
    cls=shared.Command,
    params=[
        *shared.camera_options,
        *shared.output_options,
        *shared.region_options,
        *shared.frame_options("dominant-plane"),
        *shared.solving_options,
        *shared.matching_options,
        *shared.talk_options(),
    ],
)
@click.argument("image1", type=PATH)
@click.argument("image2", type=PATH)
@click.pass_context
def segment(ctx: click.Context, image1: str, image2: str, **parameters: Any) -> None:
    """Ground, walls and roofs, found in IMAGE1 itself.

    Prints a table, the largest plane first; -o DIR also writes slopes.json, overlay.png, the planes as coloured and as
    textured meshes (patches.ply, patches.glb) and labels.png. The largest plane is taken as level; if it is a wall,
    give --up X,Y,Z.

    \b
    Example:
      slopemap segment first.png second.png --camera camera.json -o out
    """
    _answer_pair(ctx, image1, image2, {**parameters, "planes": "regions"})


def _answer_pair(ctx: click.Context, image1: str, image2: str, parameters: dict[str, Any]) -> None:
    """Estimate one pair: files in, files out, a table or JSON on stdout."""
    check_estimate(ctx)
    no_camera = "No camera: give --camera FILE, --intrinsics FX,FY,CX,CY or --fov DEG."
    refuse(ctx, (not given(ctx, *CAMERA_FLAGS), no_camera))
    check_planes(ctx, parameters["planes"])
    no_output = "Nowhere to put the answer: give -o DIR, or --json to print it."
    refuse(ctx, (not given(ctx, "output", "as_json"), no_output))
    talk = ctx.ensure_object(Talk)
    output = parameters["output"]
    if output:
        from slopecli.io.outputs import check_directory

        files = (parameters[name] for name in ("camera", "camera2", "pose_file"))
        check_directory(output, inputs=(image1, image2, *files))
    with talk.timed("load"):
        from slopecli.io.images import load_image

        images = load_image(image1), load_image(image2)
    camera1, camera2 = _load_cameras(images, parameters, talk)

    from slopecli import pipeline

    report = pipeline.estimate(*images, camera1, camera2, options_from(parameters), on_stage=talk.stage)
    written: list[Path] = []
    if output:
        from slopecli.io.outputs import write_outputs
        from slopecli.products import kept_choices

        with talk.timed("write"):
            written = write_outputs(report, images[0], output, kept_choices(parameters))
    print_report(report, written, talk, as_json=parameters["as_json"])


def _load_cameras(images: tuple[Image, Image], parameters: dict[str, Any], talk: Talk) -> tuple[Camera, Camera]:
    """The cameras of both images; how they were read is said once."""
    from slopecli.io.cameras.reading import camera_for

    choices = (parameters, {**parameters, "camera": parameters["camera2"] or parameters["camera"]})
    (camera1, notes1), (camera2, notes2) = (
        camera_for(image, camera_choice(choice)) for image, choice in zip(images, choices, strict=True)
    )
    for note in dict.fromkeys((*notes1, *notes2)):
        talk.say(f"info: {note}")
    return camera1, camera2
