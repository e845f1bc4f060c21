"""`slopemap solve`: slopes from correspondences of the user's own."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from slopecli.cli import shared_options as shared
from slopecli.cli.checks import CAMERA_FLAGS, check_estimate, given, options_from, refuse
from slopecli.cli.parameter_types import PATH, POSITIVE
from slopecli.cli.report_table import print_report
from slopecli.cli.talk import Talk

if TYPE_CHECKING:
    from slopecli.types import Camera, Report

NOISE_HELP = "1-sigma in image 2, mrad without a camera"


@click.command(
    cls=shared.Command,
    params=[
        *shared.camera_options,
        shared.size,
        shared.Option(shared.INPUT, "--noise", "PX", POSITIVE, NOISE_HELP, shown="from the residuals"),
        shared.Option(shared.OUTPUT, "-o --output", "DIR", PATH, "Folder for slopes.json"),
        shared.json_flag,
        *shared.frame_options(),
        *shared.solving_options,
        *shared.talk_options(),
    ],
)
@click.argument("matches", metavar="MATCHES.csv", type=PATH)
@click.pass_context
def solve(ctx: click.Context, matches: str, **parameters: Any) -> None:
    """Slopes of planes from your own correspondences.

    MATCHES.csv (- for stdin) has a header and the columns x1,y1,x2,y2: a point in image 1 and in image 2, px with pixel
    centres at integers, or without a camera option normalised coordinates. Column patch: which plane a row lies on, -1
    for none; without it all rows lie on one. Column sigma: the row's own 1-sigma, in place of --noise.

    Prints a table; -o DIR also writes slopes.json.

    \b
    Example:
      slopemap solve matches.csv --camera camera.json --noise 0.3
    """
    from slopecli.io.correspondences import read_correspondences
    from slopecli.pipeline import solve as solve_given

    check_estimate(ctx)
    fov_alone = bool(given(ctx, "fov")) != bool(given(ctx, "size"))
    refuse(
        ctx,
        (given(ctx, "camera2") and not given(ctx, *CAMERA_FLAGS), "--camera2 is without --camera; give both."),
        (
            given(ctx, "free_focal", "focal_sigma_percent") and not given(ctx, *CAMERA_FLAGS),
            "--free-focal and --focal-sigma are of a camera; give --camera, --intrinsics or --fov.",
        ),
        (fov_alone, "--fov and --size belong together, for example --fov 60 --size 1024x768; give both."),
    )
    talk = ctx.ensure_object(Talk)
    if parameters["output"]:
        from slopecli.io.outputs import check_directory

        files = (parameters[name] for name in ("camera", "camera2", "pose_file"))
        check_directory(parameters["output"], inputs=(matches, *files))
    with talk.timed("load"):
        correspondences = read_correspondences(matches)
    two_noises = correspondences.sigma is not None and parameters["noise"] is not None
    refuse(ctx, (two_noises, f"--noise contradicts the column sigma of {matches}; leave one out."))
    cameras, options = _cameras(parameters), options_from(parameters)
    for note in dict.fromkeys(camera.note for camera in cameras or () if camera.note):
        talk.say(f"info: camera: {note}")
    with talk.timed("solve"):
        report = solve_given(correspondences, cameras, options, parameters["noise"])
    print_report(report, _write(report, parameters["output"]), talk, as_json=parameters["as_json"])


def _cameras(parameters: dict[str, Any]) -> tuple[Camera, Camera] | None:
    """Cameras of both images, None without a camera option: the columns are normalised coordinates then."""
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


def _write(report: Report, output: str | None) -> list[Path]:
    """Paths of the files written, none without -o."""
    from slopecli.io.outputs import store_outputs
    from slopecli.products import RESULT
    from slopecli.products.slopes_json import report_to_json

    return store_outputs({RESULT: (report_to_json(report) + "\n").encode("ascii")}, output) if output else []
