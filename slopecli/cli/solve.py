"""`slopemap solve`: slopes from correspondences of the user's own."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from slopecli.cli import shared_options as shared
from slopecli.cli.checks import CAMERA_FLAGS, at_most_one, check_estimate, given, options_from, refuse
from slopecli.cli.parameter_types import GRID, PATH, POSITIVE, WINDOW
from slopecli.cli.report_table import print_report
from slopecli.cli.talk import Talk, origin_of

if TYPE_CHECKING:
    from slopecli.patches.given import Given
    from slopecli.types import Camera, Report

NOISE_HELP = "1-sigma in image 2"
PLANES_HELP = "All on one, or found among them"
WAYS = ("planes", "grid", "windows", "labels")

row_plane_options = (
    shared.Option(shared.PLANES, "--planes", None, click.Choice(["one", "found"]), PLANES_HELP, shown="column patch"),
    shared.Option(shared.PLANES, "--grid", "COLSxROWS", GRID, "A plane in each equal part of image 1"),
    shared.Option(shared.PLANES, "--window windows", "X,Y,W,H", WINDOW, "A plane in a part, px; repeat", multiple=True),
    shared.Option(shared.PLANES, "--labels", "FILE", PATH, "Image of the plane of every pixel, 0 for none"),
)


@click.command(
    cls=shared.Command,
    params=[
        *shared.camera_options,
        shared.size,
        shared.Option(shared.INPUT, "--pair", "NAME1 NAME2", PATH, "Images, of a file with several", nargs=2),
        shared.Option(shared.INPUT, "--keypoints", "FILE", PATH, "HDF5 file of the points that MATCHES indexes"),
        shared.Option(shared.INPUT, "--noise", "PX", POSITIVE, NOISE_HELP, shown="from the residuals"),
        shared.Option(shared.OUTPUT, "-o --output", "DIR", PATH, "Folder for slopes.json"),
        shared.json_flag,
        shared.slope_unit,
        shared.report_flag,
        *row_plane_options,
        *shared.frame_options(),
        *shared.solving_options,
        shared.seed,
        *shared.talk_options(),
    ],
)
@click.argument("matches", metavar="MATCHES", type=PATH)
@click.pass_context
def solve(ctx: click.Context, matches: str, **parameters: Any) -> None:
    """Slopes of planes from your own correspondences.

    MATCHES is a table (- for stdin), a NumPy file, a COLMAP database or an HDF5
    file. A table has the columns x1,y1,x2,y2: points of both images, px with
    pixel centres at integers, or without a camera normalised coordinates; perhaps
    patch (of the row, -1 for none) and sigma (instead of --noise).

    Prints a table; -o DIR also writes slopes.json.

    \b
    Example:
      slopemap solve matches.csv --camera camera.json --noise 0.3
    """
    from slopecli.io.correspondences.match_formats import read_correspondences
    from slopecli.pipeline import solve as solve_given

    _check(ctx)
    talk = ctx.ensure_object(Talk)
    if parameters["output"]:
        from slopecli.io.outputs import check_directory

        files = (parameters[name] for name in ("camera", "camera2", "pose_file", "keypoints", "labels"))
        check_directory(parameters["output"], inputs=(matches, *files))
    with talk.timed("load"):
        correspondences = read_correspondences(matches, parameters["pair"], parameters["keypoints"])
    two_noises = correspondences.sigma is not None and parameters["noise"] is not None
    two_planes = given(ctx, *WAYS) if correspondences.has_patch else []
    refuse(
        ctx,
        (two_noises, f"--noise contradicts the column sigma of {matches}; leave one out."),
        (two_planes, f"{''.join(two_planes[:1])} contradicts the column patch of {matches}; leave one out."),
    )
    cameras = _cameras(parameters) or correspondences.cameras
    of_camera = given(ctx, "free_focal", "focal_sigma_percent") and cameras is None
    refuse(ctx, (of_camera, "--free-focal and --focal-sigma are of a camera; give --camera, --intrinsics or --fov."))
    options = options_from({name: value for name, value in parameters.items() if name not in WAYS})
    with talk.timed("planes"):
        correspondences = _on_planes(ctx, correspondences, cameras, parameters)
    notes = [correspondences.note, *(f"camera: {camera.note}" for camera in cameras or () if camera.note)]
    for note in dict.fromkeys(filter(None, notes)):
        talk.note(note)
    with talk.timed("solve"):
        report = solve_given(correspondences, cameras, options, parameters["noise"])
    print_report(report, _write(report, parameters, talk), talk, as_json=parameters["as_json"])


def _check(ctx: click.Context) -> None:
    """Refuse options that contradict or need each other."""
    check_estimate(ctx)
    at_most_one(ctx, WAYS)
    refuse(
        ctx,
        (given(ctx, "camera2") and not given(ctx, *CAMERA_FLAGS), "--camera2 is without --camera; give both."),
        (
            given(ctx, "fov", "size") and not (given(ctx, "size") and given(ctx, "fov", "intrinsics")),
            "--fov and --size belong together, for example --fov 60 --size 1024x768; give both.",
        ),
        (
            given(ctx, "seed") and ctx.params["planes"] != "found",
            "--seed is of --planes found; leave it out, or give both.",
        ),
        (
            ctx.params["intrinsics"] and ctx.params["grid"] and not ctx.params["size"],
            "--grid divides image 1, whose size --intrinsics does not have; add --size, for example --size 1024x768.",
        ),
    )


def _on_planes(
    ctx: click.Context, rows: Given, cameras: tuple[Camera, Camera] | None, parameters: dict[str, Any]
) -> Given:
    """The rows with the planes that the options say; as they are where none says anything."""
    from slopecli.patches import row_planes

    in_image = given(ctx, "grid", "windows", "labels")
    if in_image and cameras is None:
        raise click.UsageError(f"{in_image[0]} is in px of image 1, and there is no camera; give --camera.", ctx)
    if parameters["planes"] == "found":
        return row_planes.rows_by_label_planes(rows, cameras, parameters["seed"])
    if cameras is None or not in_image:
        return row_planes.rows_on_one_plane(rows) if parameters["planes"] else rows
    width, height = cameras[0].width, cameras[0].height
    if parameters["labels"]:
        from slopecli.io.correspondences.label_image import read_label_image

        labels = read_label_image(parameters["labels"], (width, height) if width else None)
        return row_planes.rows_by_label_image(rows, labels, parameters["labels"])
    from slopecli.windows import check_windows, grid_windows

    windows = list(parameters["windows"])
    if parameters["grid"]:
        columns, rows_of_cells = parameters["grid"]
        windows = grid_windows(columns, rows_of_cells, width, height)
    elif width:
        check_windows(windows, width, height)
    name = "grid" if parameters["grid"] else "windows"
    return row_planes.rows_in_windows(rows, windows, {"planes": "windows", name: parameters[name]})


def _cameras(parameters: dict[str, Any]) -> tuple[Camera, Camera] | None:
    """Cameras of both images, None without a camera option: the columns are normalised coordinates then."""
    from slopecli.io.cameras.reading import camera_from_fov, load_camera
    from slopecli.types import Camera

    if parameters["intrinsics"]:
        width, height = parameters["size"] or (0, 0)
        first = Camera(width, height, *parameters["intrinsics"])
    elif parameters["fov"]:
        first = camera_from_fov(parameters["fov"], *parameters["size"])
    elif parameters["camera"]:
        first = load_camera(parameters["camera"])
    else:
        return None
    return first, load_camera(parameters["camera2"]) if parameters["camera2"] else first


def _write(report: Report, parameters: dict[str, Any], talk: Talk) -> list[Path]:
    """Paths of the files written, none without -o."""
    if not parameters["output"]:
        return []
    from slopecli.io.outputs import store_outputs
    from slopecli.products import encode_rows, keep_files

    keep = keep_files(report=parameters["report"])
    return store_outputs(encode_rows(report, keep, origin_of(talk)), parameters["output"])
