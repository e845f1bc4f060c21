"""`slopemap demo`: a first answer from the pair of images that the package carries."""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import Any

import click

from slopecli.cli import shared_options as shared
from slopecli.cli.map_table import print_map
from slopecli.cli.parameter_types import PATH
from slopecli.cli.talk import Talk

NEXT = (
    "next: look at {picture}: blue ground is at most 15° steep, orange ground is steeper, hatched ground is not known",
    "your own pair needs its camera: slopemap map first.jpg second.jpg --camera camera.json -o out",
)


@click.command(
    cls=shared.Command,
    params=[
        shared.Option(shared.OUTPUT, "-o --output", "DIR", PATH, "Folder for the results", "slopemap_demo"),
        *shared.talk_options(),
    ],
)
@click.pass_context
def demo(ctx: click.Context, **parameters: Any) -> None:
    """A slope map of a pair of images that comes with the program.

    Needs nothing else. Prints landing sites and writes the images, their camera, and the files of `slopemap map`, so
    that the same can be done again by hand.
    """
    from slopecli import pipeline
    from slopecli.io.cameras.reading import load_camera
    from slopecli.io.images import load_image
    from slopecli.io.outputs import check_directory, write_map
    from slopecli.io.sample_files import copy_sample
    from slopecli.options import MapOptions, Options

    talk, folder = ctx.ensure_object(Talk), Path(parameters["output"])
    check_directory(folder)
    with talk.timed("load"):
        first, second, camera_file = copy_sample(resources.files("slopecli") / "sample", folder)
        images, camera = (load_image(first), load_image(second)), load_camera(camera_file)
    options = Options(baseline_m=2.175)  # the distance between the cameras of the sample
    answer = pipeline.slope_map(*images, camera, camera, options, MapOptions(), on_stage=talk.stage)
    with talk.timed("write"):
        written = write_map(answer, images[0], folder)
    print_map(answer, written, talk, as_json=False)
    for line in NEXT:
        talk.say(line.format(picture=folder / "map.png"))
