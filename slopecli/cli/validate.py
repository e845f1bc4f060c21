"""`slopemap validate`: a finished answer against known ground."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from slopecli.cli import shared_options as shared
from slopecli.cli.checks import at_most_one, given, refuse
from slopecli.cli.parameter_types import PATH, POSITIVE
from slopecli.cli.shared_options import Flag, Option
from slopecli.cli.table import Table, print_table
from slopecli.cli.talk import Talk, check_stdout, print_result

if TYPE_CHECKING:
    from slopecli.validate import Comparison, Result, Truth

TRUTH = "Truth"
LABELS_HELP = "Image of the true surface of every pixel, 0 for none: compare with whole surfaces"
KINDS = ("depth", "disparity", "points")
HEADER = ("id", "slope", "true slope", "difference", "sigmas", "normal off", "distance", "points", "verdict", "note")


@click.command(
    cls=shared.Command,
    short_help="A finished answer against known ground.",
    params=[
        Option(
            TRUTH, "--depth", "FILE", PATH, "Depth along camera 1's axis, one a pixel: NPY, NPZ, PFM, EXR, PNG, TIFF"
        ),
        Option(TRUTH, "--disparity", "FILE", PATH, "Instead: disparity, px, of a rectified pair whose left is image 1"),
        Option(TRUTH, "--points", "FILE", PATH, "Instead: point cloud: PLY, LAS, LAZ, NPY"),
        Option(TRUTH, "--baseline", "M", POSITIVE, "Of --disparity"),
        Option(
            TRUTH, "--offset offset_px", "PX", click.FLOAT, "Of --disparity: cx right less left", shown="of the answer"
        ),
        Option(
            TRUTH,
            "--factor",
            "F",
            POSITIVE,
            "Values of the file times this: 0.001 for mm, 1/256 for KITTI's",
            shown="1",
        ),
        Option(TRUTH, "--labels", "FILE", PATH, LABELS_HELP),
        Option(TRUTH, "--key", "NAME", click.STRING, "Array of an NPZ with several"),
        Option(TRUTH, "--pose pose_file", "FILE", PATH, "Of --points: R and T of camera 1, P1 = R (P - T)"),
        Option(
            shared.OUTPUT, "-o --output", "DIR", PATH, "Folder for validation.csv, validation.png and validation.json"
        ),
        Flag(shared.OUTPUT, "--json as_json", "Print validation.json instead of the table"),
        *shared.talk_options("Time taken"),
    ],
)
@click.argument("answer", metavar="RESULT", type=PATH)
@click.pass_context
def validate(ctx: click.Context, answer: str, **parameters: Any) -> None:
    """A finished answer against known ground, as the paper's Figures 8 and 9.

    RESULT is the folder of an answer of estimate, segment or map. A plane is fitted to the true ground under every
    patch, one scale to all; slopes and normals are compared.

    \b
    Examples:
      slopemap validate out --depth depth.npy
      slopemap validate out --disparity disp.pfm --baseline 0.19 -o check
      slopemap validate out --points scan.las --pose pose.json
    """
    at_most_one(ctx, KINDS)
    refuse(
        ctx,
        (not given(ctx, *KINDS), "no truth was given; give --depth, --disparity or --points."),
        (bool(parameters["disparity"]) != bool(parameters["baseline"]), "--disparity and --baseline belong together."),
        (given(ctx, "offset_px") and not parameters["disparity"], "--offset is of --disparity; leave it out."),
        (given(ctx, "pose_file") and not parameters["points"], "--pose is of --points; leave it out."),
        (given(ctx, "key") and parameters["points"], "--key is of --depth and --disparity; leave it out."),
    )
    talk = ctx.ensure_object(Talk)
    files = [parameters[name] for name in (*KINDS, "pose_file", "labels")]
    if parameters["output"]:
        from slopecli.io.outputs import check_directory
        from slopecli.io.validation_files import VALIDATION_NAMES

        check_directory(parameters["output"], VALIDATION_NAMES, files)
    with talk.timed("load"):
        from slopecli.io.results import read_result

        result = read_result(answer)
        truth = _truth(result, parameters)
        surfaces = _surfaces(parameters["labels"], result)
    with talk.timed("compare"):
        from slopecli.validate import compare

        comparison = compare(result, truth, surfaces)
    _deliver(result, truth, comparison, talk, parameters)


def _truth(result: Result, parameters: dict[str, Any]) -> Truth:
    """The known ground, in camera-1 axes."""
    from slopecli.io.poses import load_attitude
    from slopecli.io.truth_files import read_grid, read_points
    from slopecli.validate import from_depth, from_disparity, from_points

    factor = parameters["factor"] or 1.0
    if parameters["points"]:
        points = factor * read_points(parameters["points"])
        if parameters["pose_file"]:
            R, T = load_attitude(parameters["pose_file"])
            points = (points - T) @ R.T
        return from_points(points, result.cameras[0])
    grid = factor * read_grid(parameters["depth"] or parameters["disparity"], parameters["key"])
    if parameters["depth"]:
        return from_depth(grid, result.cameras[0])
    return from_disparity(grid, result.cameras, parameters["baseline"], parameters["offset_px"])


def _surfaces(path: str | None, result: Result) -> Any:
    """The numbers of the true surfaces; None where none are given."""
    if path is None:
        return None
    from slopecli.io.correspondences.label_image import read_label_image

    return read_label_image(path, (result.cameras[0].width, result.cameras[0].height))


def _deliver(result: Result, truth: Truth, comparison: Comparison, talk: Talk, parameters: dict[str, Any]) -> None:
    """Write the files, print the table or JSON, and say what it comes to."""
    from slopecli.io.validation_files import comparison_json, write_validation
    from slopecli.validate import summary_lines

    written = []
    if parameters["output"]:
        with talk.timed("write"):
            written = write_validation(result, truth, comparison, parameters["output"])
    else:
        check_stdout()
    if parameters["as_json"]:
        print_result(comparison_json(comparison))
    else:
        print_table(comparison_table(comparison), talk)
    for line in summary_lines(comparison, result.unit):
        talk.say(line)
    if written:
        talk.say(f"wrote {', '.join(map(str, written))}")


def comparison_table(comparison: Comparison) -> Table:
    """A row for each patch; angles in degrees."""
    rows = []
    for one in comparison.patches:
        sigma = "-" if one.sigma_deg is None else f"{one.sigma_deg:.2f}"
        rows.append(
            (
                str(one.id),
                f"{one.slope_deg:.2f} ± {sigma}°",
                f"{one.true_slope_deg:.2f}°",
                f"{one.difference_deg:+.2f}°",
                "-" if one.sigmas is None else f"{one.sigmas:+.1f}",
                f"{one.normal_error_deg:.2f}°",
                f"{100 * (one.distance_ratio - 1):+.2f} %",
                str(one.n_points),
                one.verdict or "-",
                "" if one.status == "ok" else one.status,
            )
        )
    return Table(HEADER, rows)
