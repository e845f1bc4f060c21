"""`slopemap solve`: slopes from correspondences of the user's own."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from slopecli.cli.pair import CAMERA_FLAGS
from slopecli.cli.parameter_types import INTRINSICS, PATH, POSITIVE, SIZE, Between
from slopecli.cli.shared_options import (
    at_most_one,
    check_known_motion,
    frame_options,
    given,
    options_from,
    prior_options,
    scale_options,
    solver_options,
    talk_options,
    verdict_options,
)
from slopecli.cli.table import result_table, talk_lines
from slopecli.cli.talk import Talk, print_result

if TYPE_CHECKING:
    from slopecli.types import Camera, Report


@click.command()
@click.argument("matches", metavar="MATCHES.csv", type=PATH)
@click.option("--camera", metavar="FILE", type=PATH, help="Camera file of both images; then the columns are px.")
@click.option("--camera2", metavar="FILE", type=PATH, help="Camera file of image 2 where it differs.")
@click.option(
    "--intrinsics", metavar="FX,FY,CX,CY", type=INTRINSICS, help="Instead of a camera file, px; no distortion."
)
@click.option(
    "--fov",
    metavar="DEG",
    type=Between(0, 180, min_open=True, max_open=True),
    help="Instead of a camera file, with --size: horizontal field of view, principal point in the centre.",
)
@click.option("--size", metavar="WxH", type=SIZE, help="Of the images, px, for --fov.")
@click.option("-o", "--output", metavar="DIR", type=PATH, help="Where slopes.json goes, made if need be.")
@click.option("--json", "as_json", is_flag=True, help="Print slopes.json on stdout instead of the table.")
@click.option(
    "--noise",
    type=POSITIVE,
    metavar="PX",
    help="1-sigma of a coordinate in image 2, px; without a camera mrad.  [default: what the residuals say]",
)
@frame_options
@scale_options
@prior_options
@verdict_options
@solver_options
@talk_options
@click.pass_context
def solve(ctx: click.Context, matches: str, **parameters: Any) -> None:
    """Slopes of planes from your own correspondences.

    MATCHES.csv has a header and the columns x1,y1,x2,y2: a point in image 1 and in image 2, px (pixel centres at
    integers), or without a camera rays, that is normalised coordinates. A column patch says which plane a row lies on,
    -1 for none; without it all rows lie on one. A column sigma is the row's own 1-sigma in place of --noise. A - in
    place of the file's name reads it from stdin.

    Prints one line per plane; -o DIR also keeps the answer as slopes.json.

    \b
    Example:
      slopemap solve matches.csv --camera camera.json --noise 0.3
    """
    from slopecli.io.correspondences import read_correspondences
    from slopecli.io.outputs import check_directory
    from slopecli.pipeline import solve as solve_given

    _check_usage(ctx)
    talk = ctx.ensure_object(Talk)
    if parameters["output"]:
        check_directory(parameters["output"])
    with talk.timed("load"):
        correspondences = read_correspondences(matches)
    if correspondences.sigma is not None and parameters["noise"] is not None:
        raise click.UsageError(f"--noise contradicts the column sigma of {matches}; leave one out.", ctx)
    cameras, options = _cameras(parameters), options_from(parameters)
    with talk.timed("solve"):
        report = solve_given(correspondences, cameras, options, parameters["noise"])
    _deliver(report, parameters, talk)


def _check_usage(ctx: click.Context) -> None:
    at_most_one(ctx, *CAMERA_FLAGS)
    check_known_motion(ctx)
    if given(ctx, "camera2") and not given(ctx, *CAMERA_FLAGS):
        raise click.UsageError("--camera2 is without --camera; give both.", ctx)
    if bool(given(ctx, "fov")) != bool(given(ctx, "size")):
        raise click.UsageError(
            "--fov and --size belong together, for example --fov 60 --size 1024x768; give both.", ctx
        )


def _cameras(parameters: dict[str, Any]) -> tuple[Camera, Camera] | None:
    from slopecli.io.cameras.reading import camera_from_fov, load_camera
    from slopecli.types import Camera

    if parameters["intrinsics"]:
        first = Camera(0, 0, *parameters["intrinsics"])
    elif parameters["fov"]:
        first = camera_from_fov(parameters["fov"], *parameters["size"])
    elif parameters["camera"]:
        first = load_camera(parameters["camera"])
    else:
        return None
    return first, load_camera(parameters["camera2"]) if parameters["camera2"] else first


def _deliver(report: Report, parameters: dict[str, Any], talk: Talk) -> None:
    from slopecli.io.outputs import store_outputs
    from slopecli.products import RESULT
    from slopecli.products.slopes_json import report_to_json

    text = report_to_json(report)
    written = []
    if parameters["output"]:
        written = store_outputs({RESULT: (text + "\n").encode("ascii")}, parameters["output"])
    print_result(text if parameters["as_json"] else result_table(report))
    for line in talk_lines(report):
        talk.say(line)
    for path in written:
        talk.say(f"wrote {path}")
