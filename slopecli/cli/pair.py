"""`slopemap estimate`, `segment` and `map`: slopes of windows, of planes found, or everywhere, from one pair."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from slopecli.cli import shared_options as shared
from slopecli.cli.checks import (
    CAMERA_FLAGS,
    NO_CAMERA,
    at_most_one,
    camera_choices,
    check_estimate,
    check_planes,
    given,
    map_options_from,
    options_from,
    refuse,
)
from slopecli.cli.map_table import print_map, say_lengths
from slopecli.cli.metadata_choices import take_metadata
from slopecli.cli.parameter_types import PATH
from slopecli.cli.report_table import print_report, say_place
from slopecli.cli.talk import Talk, origin_of

if TYPE_CHECKING:
    from slopecli.options import CameraChoice, Options
    from slopecli.products import Product
    from slopecli.types import Camera, Image


def _options(*own: shared.Option, up: str = "camera") -> list[click.Parameter]:
    """Options of a command that answers a pair: those of its own among those of all; `up` is its default vertical."""
    return [
        *shared.pair_camera_options,
        *own,
        *shared.pair_frame_options(up),
        *shared.place_options,
        *shared.pair_solving_options,
        *shared.matching_options,
        *shared.talk_options(),
    ]


@click.command(
    cls=shared.Command,
    params=_options(
        *shared.output_options,
        shared.all_flag,
        *shared.window_options,
        *shared.finder_options,
        *shared.region_options,
    ),
)
@click.argument("image1", type=PATH)
@click.argument("image2", type=PATH)
@click.pass_context
def estimate(ctx: click.Context, image1: str, image2: str, **parameters: Any) -> None:
    """Slopes of windows of IMAGE1 from two overlapping images.

    Prints a table; -o DIR also writes slopes.json, pictures and a 3-D model.

    \b
    Example:
      slopemap estimate first.png second.png --camera camera.json -o out
    """
    _answer_pair(ctx, image1, image2, parameters)


@click.command(
    cls=shared.Command,
    params=_options(*shared.output_options, shared.all_flag, *shared.region_options, up="dominant-plane"),
)
@click.argument("image1", type=PATH)
@click.argument("image2", type=PATH)
@click.pass_context
def segment(ctx: click.Context, image1: str, image2: str, **parameters: Any) -> None:
    """Ground, walls and roofs, found in IMAGE1 itself.

    Prints a table; -o DIR also writes slopes.json, pictures and textured models. The largest plane is taken as level;
    if it is a wall, give --up X,Y,Z.

    \b
    Example:
      slopemap segment first.png second.png --camera camera.json -o out
    """
    _answer_pair(ctx, image1, image2, {**parameters, "planes": "regions"})


@click.command(
    "map",
    cls=shared.Command,
    short_help="Slopes everywhere in IMAGE1, and where to land.",
    params=_options(*shared.map_output_options, *shared.map_options),
)
@click.argument("image1", type=PATH)
@click.argument("image2", type=PATH)
@click.pass_context
def slope_map(ctx: click.Context, image1: str, image2: str, **parameters: Any) -> None:
    """Slopes everywhere in IMAGE1, how sure they are, and where to land.

    Prints landing sites, best first; -o DIR also writes map.png, map_sigma.png, slope_map.tif and slopes.json.

    \b
    Example:
      slopemap map first.png second.png --camera camera.json -o out
    """
    at_most_one(ctx, ("footprint_px", "footprint_m"))
    images, cameras, options = _read_pair(ctx, image1, image2, parameters)
    talk = ctx.ensure_object(Talk)

    from slopecli import pipeline
    from slopecli.io.outputs import write_map
    from slopecli.products import MAP_PRODUCTS

    answer = pipeline.slope_map(*images, *cameras, options, map_options_from(parameters), on_stage=talk.stage)
    written = _written(partial(write_map, answer), MAP_PRODUCTS, images, parameters, talk)
    say_place(answer.report, talk)
    say_lengths(answer, parameters, talk)
    print_map(answer, written, talk, as_json=parameters["as_json"])


def _answer_pair(ctx: click.Context, image1: str, image2: str, parameters: dict[str, Any]) -> None:
    """Estimate one pair: files in, files out, a table or JSON on stdout."""
    check_planes(ctx, parameters["planes"])
    images, cameras, options = _read_pair(ctx, image1, image2, parameters)
    talk = ctx.ensure_object(Talk)

    from slopecli import pipeline
    from slopecli.io.outputs import write_outputs
    from slopecli.products import PRODUCTS

    report = pipeline.estimate(*images, *cameras, options, on_stage=talk.stage)
    written = _written(partial(write_outputs, report), PRODUCTS, images, parameters, talk)
    say_place(report, talk)
    every = parameters["every"] or talk.verbose
    print_report(report, written, talk, as_json=parameters["as_json"], every=every)


def _written(
    write: Callable[..., list[Path]],
    products: Sequence[Product],
    images: tuple[Image, Image],
    parameters: dict[str, Any],
    talk: Talk,
) -> list[Path]:
    """Paths of the files of an answer, which `write` writes; none without a folder for them."""
    from slopecli.products import kept_choices

    if not parameters["output"]:
        return []
    with talk.timed("write"):
        keep, origin = kept_choices(parameters, products), origin_of(talk, images[1])
        return write(images[0], parameters["output"], keep, origin)


def _read_pair(
    ctx: click.Context, image1: str, image2: str, parameters: dict[str, Any]
) -> tuple[tuple[Image, Image], tuple[Camera, Camera], Options]:
    """The images and cameras of a pair, and the options, after checks of the command line and of the output folder."""
    check_estimate(ctx)
    parameters, choice = take_metadata(ctx, parameters)
    no_output = "Nowhere to put the answer: give -o DIR, or --json to print it."
    refuse(
        ctx, (not given(ctx, *CAMERA_FLAGS, "metadata"), NO_CAMERA), (not given(ctx, "output", "as_json"), no_output)
    )
    talk, output = ctx.ensure_object(Talk), parameters["output"]
    if output:
        from slopecli.io.outputs import check_directory

        files = (parameters[name] for name in ("camera", "camera2", "pose_file"))
        check_directory(output, inputs=(image1, image2, *files))
    with talk.timed("load"):
        from slopecli.io.images import load_image

        images = load_image(image1), load_image(image2)
    choices, options = camera_choices(parameters), options_from(parameters)
    cameras = _load_cameras(images, choices, talk)
    if choice is not None:
        from slopecli.io.metadata.applied import apply_metadata
        from slopecli.io.metadata.metadata_reading import read_metadata

        options = apply_metadata((read_metadata(image1), read_metadata(image2)), choice, options, choices)
    return images, cameras, options


def _load_cameras(
    images: tuple[Image, Image], choices: tuple[CameraChoice, CameraChoice], talk: Talk
) -> tuple[Camera, Camera]:
    """The cameras of both images; how they were read is said once."""
    from slopecli.io.cameras.reading import camera_for

    (camera1, notes1), (camera2, notes2) = (
        camera_for(image, choice) for image, choice in zip(images, choices, strict=True)
    )
    for note in dict.fromkeys((*notes1, *notes2)):
        talk.note(note)
    return camera1, camera2
