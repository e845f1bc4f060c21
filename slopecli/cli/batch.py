"""`slopemap batch`: every pair of images in a folder, in worker processes or on a cluster."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from slopecli.cli import shared_options as shared
from slopecli.cli.checks import (
    CAMERA_FLAGS,
    at_most_one,
    camera_choices,
    check_estimate,
    check_planes,
    given,
    map_options_from,
    options_from,
    refuse,
)
from slopecli.cli.metadata_choices import take_metadata
from slopecli.cli.parameter_types import PAIRING, PAIRINGS, PATH, POSITIVE, Whole
from slopecli.cli.progress import BatchProgress
from slopecli.cli.shared_options import Flag, Option
from slopecli.cli.table import Table, print_table
from slopecli.cli.talk import Talk
from slopecli.errors import ExitStatus
from slopecli.report.slope_units import SLOPE_UNITS, SlopeUnit, slope_unit_of

if TYPE_CHECKING:
    from slopecli.batch.jobs import Outcome, Pair
    from slopecli.batch.pairs import FoundPairs
    from slopecli.options import CameraChoice, MetadataChoice

SEGMENT = {"planes": "regions", "up": "dominant-plane"}  # what `slopemap segment` does differently
PAIRS, WORKERS = "Pairs", "Workers"
MAP_HEADER = ("pair", "result", "safe", "unsafe", "undecided", "unknown", "sites", "radius", "slope", "note")
HEADER = ("pair", "result", "steepest", "safe", "unsafe", "undecided", "poor", "refused", "note")

COMMANDS = click.Choice(["estimate", "segment", "map", "sequence"])
PAIRING_HELP = (
    "Each image with the next (consecutive) or the N-th after it (stride); a pair a folder (folders); or a list of "
    "rows image1,image2[,camera1,camera2]"
)
pair_options = (
    Option(PAIRS, "--pairing", "HOW|FILE.csv", PAIRING, PAIRING_HELP, "consecutive"),
    Option(PAIRS, "--stride", "N", Whole(1), "For stride: how many images further"),
    Option(PAIRS, "--glob pattern", "PATTERN", str, "Of the images in a folder", "", shown="all"),
    Option(
        PAIRS, "--command", "NAME", COMMANDS, "estimate, segment, map; sequence: all images of each folder", "estimate"
    ),
    Flag(PAIRS, "--dry-run", "List pairs and cameras; write nothing"),
)
# `slopemap map --help` lists them: two more lists in this help, which is long, would serve nobody
map_options = tuple(map(shared.unlisted, (*shared.map_options, *shared.map_file_options)))
worker_options = (
    Option(WORKERS, "--jobs", "N", Whole(1), "Worker processes", shown="one per core"),
    Option(WORKERS, "--timeout timeout_s", "SECONDS", POSITIVE, "Give up a pair that takes longer", shown="none"),
    Option(WORKERS, "--memory memory_gb", "GB", POSITIVE, "Give up a pair that needs more memory", shown="none"),
    Option(WORKERS, "--cluster", "ADDRESS", None, "A Dask cluster instead, say tcp://head:8786"),
    Flag(WORKERS, "--ship", "Send images to the cluster, fetch its files"),
)


@click.command(
    cls=shared.Command,
    short_help="Every pair of images of a folder.",
    params=[
        *pair_options,
        *shared.pair_camera_options,
        Option(shared.OUTPUT, "-o --output", "DIR", PATH, "Folder for the results; optional with --dry-run"),
        shared.slope_unit,
        shared.report_flag,
        *shared.file_options,
        shared.ply_frame,
        *worker_options,
        *shared.window_options,
        *shared.finder_options,
        *shared.region_options,
        *map_options,
        *shared.pair_frame_options("camera", "camera; segment: dominant-plane"),
        *shared.pair_solving_options,
        *shared.matching_options,
        *shared.talk_options("A line for every pair"),
    ],
)
@click.argument("folder", type=PATH)
@click.pass_context
def batch(ctx: click.Context, folder: str, **parameters: Any) -> None:
    """Every pair of images in FOLDER, or by sequence every folder in it.

    Prints a table. DIR gets a folder for each pair, a table of all (summary.csv, results.jsonl) and a page
    (index.html). Without a camera option, a camera file beside the images is used. After a stop, the same command
    goes on.

    \b
    Example:
      slopemap batch flight --camera camera.json -o out
    """
    _check_usage(ctx)
    if parameters["command"] == "segment":
        parameters |= {name: value for name, value in SEGMENT.items() if not given(ctx, name)}
    parameters, metadata = take_metadata(ctx, parameters)
    talk = ctx.ensure_object(Talk)
    found = _find_pairs(folder, parameters)
    for note in found.notes:
        talk.say(note)
    if parameters["dry_run"]:
        print_table(Table(("pair", "image 1", "image 2", "camera", "note"), list(map(_dry_cells, found.pairs))), talk)
        return
    outcomes = _run(found, parameters, metadata, talk)
    unit = slope_unit_of(parameters)
    print_table(maps_table(outcomes, unit) if parameters["command"] == "map" else batch_table(outcomes, unit), talk)
    failed = sum(outcome.exit_status != 0 for outcome in outcomes)
    pairs = "1 pair" if len(outcomes) == 1 else f"{len(outcomes)} pairs"
    talk.say(f"{pairs}: {len(outcomes) - failed} answered, {failed} without an answer")
    page = Path(parameters["output"], "index.html")
    talk.say(f"wrote {page}, summary.csv and results.jsonl beside it, and a folder for each pair")
    if failed:
        ctx.exit(ExitStatus.SOME_WITHOUT_ANSWER)


def _check_usage(ctx: click.Context) -> None:
    check_estimate(ctx)
    at_most_one(ctx, ("jobs", "cluster"), ("footprint_px", "footprint_m"))
    sequence = ctx.params["command"] == "sequence"
    segment, stride = ctx.params["command"] == "segment", ctx.params["pairing"] == "stride"
    listed = ctx.params["pairing"] not in PAIRINGS
    _check_command(ctx, is_map=ctx.params["command"] == "map")
    check_planes(ctx, SEGMENT["planes"] if segment else ctx.params["planes"])
    nowhere = "Nowhere to put the answers: give -o DIR, or --dry-run to list the pairs."
    refuse(
        ctx,
        (segment and given(ctx, "planes"), "--planes is for --command estimate; leave one out."),
        (sequence and given(ctx, "pairing"), "--pairing is not for --command sequence: a folder is one; leave it out."),
        (sequence and given(ctx, "ship"), "--ship is not for --command sequence; leave it out."),
        (given(ctx, "camera2") and not given(ctx, *CAMERA_FLAGS), "--camera2 is without --camera; give both."),
        (given(ctx, "ship") and not given(ctx, "cluster"), "--ship is for --cluster ADDRESS; leave it out."),
        (given(ctx, "pattern") and listed, "--glob is not for a list of pairs, which names its images; leave it out."),
        (stride and not given(ctx, "stride"), "--pairing stride needs --stride N."),
        (not stride and given(ctx, "stride"), "--stride is for --pairing stride; leave one out."),
        (not given(ctx, "output", "dry_run"), nowhere),
    )


def _check_command(ctx: click.Context, *, is_map: bool) -> None:
    """Refuse options of maps with another command, and those of other commands with map."""
    of_planes = (*shared.window_options, *shared.finder_options, *shared.region_options, *shared.file_options)
    wrong = given(ctx, *(str(option.name) for option in (of_planes if is_map else map_options)))
    where = "estimate or segment" if is_map else "map"
    refuse(ctx, (wrong, f"{wrong[0] if wrong else ''} is for --command {where}; leave one out."))


def _find_pairs(folder: str, parameters: dict[str, Any]) -> FoundPairs:
    from slopecli.batch.pairs import find_pairs
    from slopecli.batch.running import FILES
    from slopecli.io.outputs import check_directory

    output, cameras = parameters["output"], None
    if output and not parameters["dry_run"]:
        check_directory(output, FILES, [parameters[name] for name in ("pairing", "camera", "camera2", "pose_file")])
    if any(parameters[flag] for flag in CAMERA_FLAGS):
        cameras = camera_choices(parameters)
    stride = parameters["stride"] or 1
    pairing = "sequences" if parameters["command"] == "sequence" else parameters["pairing"]
    pattern = parameters["pattern"]
    return find_pairs(folder, pairing, stride=stride, pattern=pattern, cameras=cameras, output=output)


def _run(found: FoundPairs, parameters: dict[str, Any], metadata: MetadataChoice | None, talk: Talk) -> list[Outcome]:
    from slopecli.batch import run
    from slopecli.products import MAP_PRODUCTS, PRODUCTS, SEQUENCE_PRODUCTS, kept_choices

    is_map = parameters["command"] == "map"
    products = {"map": MAP_PRODUCTS, "sequence": SEQUENCE_PRODUCTS}.get(parameters["command"], PRODUCTS)
    keep = kept_choices(parameters, products)
    wanted = map_options_from(parameters) if is_map else None
    options, output = options_from(parameters), parameters["output"]
    how = {name: parameters[name] for name in ("jobs", "timeout_s", "memory_gb", "cluster", "ship")}
    how |= {"wanted": wanted, "metadata": metadata}
    with BatchProgress(talk) as progress:
        try:
            return run(found.pairs, options, keep, output, **how, on_progress=progress)
        except KeyboardInterrupt:
            progress.interrupted()
            raise


def batch_table(outcomes: Sequence[Outcome], unit: SlopeUnit = SLOPE_UNITS["deg"]) -> Table:
    """A row for each pair in their order; counts are of windows or planes."""
    return Table(HEADER, [_cells(outcome, unit) for outcome in outcomes])


def maps_table(outcomes: Sequence[Outcome], unit: SlopeUnit = SLOPE_UNITS["deg"]) -> Table:
    """A row for each pair of a batch of maps; shares are of image 1, the largest site has its radius in px."""
    return Table(MAP_HEADER, [_map_cells(outcome, unit) for outcome in outcomes])


def _map_cells(outcome: Outcome, unit: SlopeUnit) -> tuple[str, ...]:
    if outcome.exit_status:
        return _without_answer(outcome, MAP_HEADER)
    shares = ("-" if share is None else f"{100 * share:.1f} %" for share in outcome.shares)
    largest, slope = "-", "-"
    if outcome.site_radius_px is not None and outcome.site_slope_deg is not None:
        largest = f"{outcome.site_radius_px:.0f} px"
        slope = unit.text(outcome.site_slope_deg, outcome.site_slope_sigma_deg)
    return outcome.name, "answered", *shares, str(outcome.n_sites), largest, slope, _note(outcome)


def _without_answer(outcome: Outcome, header: Sequence[str]) -> tuple[str, ...]:
    result = "no answer" if outcome.exit_status == ExitStatus.NO_ANSWER else "failed"
    return outcome.name, result, *"-" * (len(header) - 3), outcome.code or ""


def _note(outcome: Outcome) -> str:
    ambiguous = ["two answers"] if outcome.ambiguity == "unresolved" else []
    return ", ".join([*ambiguous, *dict.fromkeys(outcome.diagnostics)])


def _cells(outcome: Outcome, unit: SlopeUnit) -> tuple[str, ...]:
    if outcome.exit_status:
        return _without_answer(outcome, HEADER)
    verdicts = outcome.n_safe, outcome.n_unsafe, outcome.n_undecided
    counts = map(str, (*verdicts, outcome.n_planes - outcome.n_ok, outcome.n_rejected))
    # the steepest slope for each of the motions that remain
    steepest = [unit.text(slope, sigma) for slope, sigma in outcome.steepest]
    return outcome.name, "answered", " or ".join(steepest) or "-", *counts, _note(outcome)


def _dry_cells(pair: Pair) -> tuple[str, ...]:
    """A row for a pair that would be compared."""
    if pair.problem is not None:
        return pair.name, pair.image1 or "-", pair.image2 or "-", "-", f"cannot be tried: {pair.problem}"
    cameras = dict.fromkeys(_camera(choice) for choice in (pair.camera1, pair.camera2))
    return pair.name, pair.image1, pair.image2, ", ".join(cameras), ""


def _camera(choice: CameraChoice | None) -> str:
    if choice is None:
        return "-"
    if choice.file is not None:
        return choice.file
    if choice.exif:
        return "of the image (exif)"
    return ",".join(f"{value:g}" for value in choice.intrinsics) if choice.intrinsics else f"{choice.fov_deg:g}°"
