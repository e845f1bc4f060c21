"""`slopemap demo`: a first answer from the pairs of images that the package carries."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from slopecli.cli import shared_options as shared
from slopecli.cli.map_table import print_map
from slopecli.cli.parameter_types import PATH
from slopecli.cli.report_table import print_report
from slopecli.cli.talk import Talk, origin_of

NEXT = (
    "next: look at {folder}/map.png: blue ground is at most 15° steep, orange ground is steeper, hatched ground is not "
    "known",
    "against the true ground: slopemap validate {folder} --depth {folder}/depth.png --factor 0.001 -o check",
    "your own pair needs its camera: slopemap map first.jpg second.jpg --camera camera.json -o out",
)
NEXT_IN_TOWN = (
    "next: look at {folder}/overlay.png, or open {folder}/report.html, which has the model of the planes to turn",
    "your own pair needs its camera: slopemap segment first.jpg second.jpg --camera camera.json -o out",
)


@click.command(
    cls=shared.Command,
    short_help="A first answer from images that come with the program.",
    params=[
        shared.Flag(shared.INPUT, "--town", "Ground, walls and roofs instead, as by segment"),
        shared.Option(
            shared.OUTPUT, "-o --output", "DIR", PATH, "Folder for the results", shown="slopemap_demo, slopemap_town"
        ),
        *shared.talk_options(),
    ],
)
@click.pass_context
def demo(ctx: click.Context, **parameters: Any) -> None:
    """A slope map of a pair of images that comes with the program.

    Needs nothing else. Prints landing sites and writes the images, their camera, and the files of `slopemap map`, so
    that the same can be done again by hand. With --town: planes of a town, the files of `slopemap segment`, and
    report.html.
    """
    from slopecli import pipeline
    from slopecli.io.cameras.reading import load_camera
    from slopecli.io.images import load_image
    from slopecli.io.outputs import check_directory, write_map, write_outputs
    from slopecli.io.sample_files import copy_sample
    from slopecli.options import MapOptions, Options
    from slopecli.products import keep_files

    town, talk = parameters["town"], ctx.ensure_object(Talk)
    folder = Path(parameters["output"] or ("slopemap_town" if town else "slopemap_demo"))
    check_directory(folder)
    with talk.timed("load"):
        copied = copy_sample("town" if town else "descent", folder)
        first, second, camera_file = copied[:3]
        images, camera = (load_image(first), load_image(second)), load_camera(camera_file)
    # the distances between the cameras of the samples
    if town:
        options = Options(baseline_m=6.142, planes="regions", up="dominant-plane")
        report = pipeline.estimate(*images, camera, camera, options, on_stage=talk.stage)
        with talk.timed("write"):
            written = write_outputs(report, images[0], folder, keep_files(report=True), origin_of(talk, images[1]))
        print_report(report, [*copied, *written], talk, as_json=False, every=False)
    else:
        options = Options(baseline_m=2.175)
        answer = pipeline.slope_map(*images, camera, camera, options, MapOptions(), on_stage=talk.stage)
        with talk.timed("write"):
            written = write_map(answer, images[0], folder)
        print_map(answer, [*copied, *written], talk, as_json=False)
    for line in NEXT_IN_TOWN if town else NEXT:
        talk.say(line.format(folder=folder))
