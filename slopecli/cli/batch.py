"""`slopemap batch`: every pair of images in a folder, in worker processes or on a cluster."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from slopecli.cli.pair import CAMERA_FLAGS, camera_choice, check_planes
from slopecli.cli.parameter_types import PATH, POSITIVE, Pairing
from slopecli.cli.progress import ProgressLine
from slopecli.cli.shared_options import (
    at_most_one,
    camera_options,
    check_known_motion,
    file_options,
    finder_options,
    frame_options_with,
    given,
    options_from,
    prior_options,
    region_options,
    scale_options,
    solving_options,
    talk_options_with,
    verdict_options,
    window_options,
)
from slopecli.cli.talk import Talk, print_result
from slopecli.orders import CameraChoice

if TYPE_CHECKING:
    from slopecli.batch.jobs import Outcome
    from slopecli.batch.pairs import FoundPairs

SOME_WITHOUT_ANSWER = 4
SEGMENT = {"planes": "regions", "up": "dominant-plane"}  # what `slopemap segment` does differently


@click.command()
@click.argument("folder", type=PATH)
@click.option(
    "-o", "--output", metavar="DIR", type=PATH, help="Where the files go, made if need be. Required but for --dry-run."
)
@click.option(
    "--pairing",
    metavar="consecutive|stride|folders|FILE.csv",
    type=Pairing(),
    default="consecutive",
    show_default=True,
    help="Each image with the next one, in natural order; with the N-th after it, see --stride; every folder in FOLDER "
    "one pair; or a list: two images a row, relative to FOLDER, and if need be camera1,camera2.",
)
@click.option("--stride", metavar="N", type=click.IntRange(1), help="For --pairing stride: how many images further.")
@click.option(
    "--command",
    type=click.Choice(["estimate", "segment"]),
    default="estimate",
    show_default=True,
    help="What is done with each pair. All options below are those of that command.",
)
@click.option("--dry-run", is_flag=True, help="List the pairs and their cameras, and write nothing.")
@click.option("--jobs", metavar="N", type=click.IntRange(1), help="Worker processes.  [default: one per core]")
@click.option(
    "--timeout",
    "timeout_s",
    metavar="SECONDS",
    type=POSITIVE,
    help="Give a pair up that takes longer; none by default.",
)
@click.option(
    "--memory", "memory_gb", metavar="GB", type=POSITIVE, help="Give a pair up that needs more; no bound by default."
)
@click.option("--cluster", metavar="ADDRESS", help="Work on this Dask cluster instead, for example tcp://head:8786.")
@click.option(
    "--ship", is_flag=True, help="For --cluster: send images and fetch files, where it does not see the disk."
)
@camera_options
@file_options
@finder_options
@window_options
@region_options
@frame_options_with("camera", "camera; with --command segment dominant-plane")
@scale_options
@prior_options
@verdict_options
@solving_options
@talk_options_with("Every pair as it is done.")
@click.pass_context
def batch(ctx: click.Context, folder: str, **parameters: Any) -> None:
    """Every pair of images in FOLDER, each answered as by estimate or segment.

    Prints one line per pair. DIR gets a folder per pair with the files of that command, a table of all (summary.csv),
    the same for programs (results.jsonl) and a page to look at (index.html). Without a camera option a camera file is
    looked for beside the images. Stop it when you like: the same command again goes on where it stopped.

    \b
    Example:
      slopemap batch flight --camera camera.json -o out
    """
    _check_usage(ctx)
    if parameters["command"] == "segment":
        parameters |= {name: value for name, value in SEGMENT.items() if not given(ctx, name)}
    talk = ctx.ensure_object(Talk)
    found = _find_pairs(folder, parameters)
    for note in found.notes:
        talk.say(note)
    if parameters["dry_run"]:
        from slopecli.cli.batch_table import dry_table

        print_result(dry_table(found.pairs))
        return
    outcomes = _run(found, parameters, talk)
    _deliver(outcomes, parameters["output"], talk)
    if any(outcome.exit_status for outcome in outcomes):
        ctx.exit(SOME_WITHOUT_ANSWER)


def _check_usage(ctx: click.Context) -> None:
    at_most_one(ctx, *CAMERA_FLAGS)
    at_most_one(ctx, "grid", "windows")
    check_known_motion(ctx)
    at_most_one(ctx, "jobs", "cluster")
    segment = ctx.params["command"] == "segment"
    check_planes(ctx, SEGMENT["planes"] if segment else ctx.params["planes"])
    for wrong, complaint in (
        (segment and given(ctx, "planes"), "--planes is for --command estimate; leave one out."),
        (given(ctx, "camera2") and not given(ctx, *CAMERA_FLAGS), "--camera2 is without --camera; give both."),
        (given(ctx, "ship") and not given(ctx, "cluster"), "--ship is for --cluster ADDRESS; leave it out."),
        (ctx.params["pairing"] == "stride" and not given(ctx, "stride"), "--pairing stride needs --stride N."),
        (
            ctx.params["pairing"] != "stride" and given(ctx, "stride"),
            "--stride is for --pairing stride; leave one out.",
        ),
        (
            not given(ctx, "output", "dry_run"),
            "Nowhere to put the answers: give -o DIR, or --dry-run to list the pairs.",
        ),
    ):
        if wrong:
            raise click.UsageError(complaint, ctx)


def _find_pairs(folder: str, parameters: dict[str, Any]) -> FoundPairs:
    from slopecli.batch.pairs import find_pairs
    from slopecli.batch.running import FILES
    from slopecli.io.outputs import check_directory

    if parameters["output"] and not parameters["dry_run"]:
        check_directory(parameters["output"], FILES)
    return find_pairs(
        folder,
        parameters["pairing"],
        stride=parameters["stride"] or 1,
        cameras=_cameras(parameters),
        output=parameters["output"],
    )


def _cameras(parameters: dict[str, Any]) -> tuple[CameraChoice, CameraChoice] | None:
    """The cameras that the command line names for all pairs, None where it names none."""
    if not any(parameters[flag] for flag in CAMERA_FLAGS):
        return None
    first = camera_choice(parameters)
    return first, CameraChoice(file=parameters["camera2"]) if parameters["camera2"] else first


def _run(found: FoundPairs, parameters: dict[str, Any], talk: Talk) -> list[Outcome]:
    from slopecli.batch import run
    from slopecli.products import kept_choices

    keep = kept_choices(parameters)
    how = {name: parameters[name] for name in ("jobs", "timeout_s", "memory_gb", "cluster", "ship")}
    progress = ProgressLine(talk)
    try:
        return run(found.pairs, options_from(parameters), keep, parameters["output"], **how, on_progress=progress)
    except KeyboardInterrupt:
        progress.say(f"{progress.so_far} done and kept; the same command again goes on with the rest")
        raise
    finally:
        progress.erase()


def _deliver(outcomes: list[Outcome], output: str, talk: Talk) -> None:
    from pathlib import Path

    from slopecli.cli.batch_table import batch_table

    print_result(batch_table(outcomes))
    failed = sum(outcome.exit_status != 0 for outcome in outcomes)
    pairs = "1 pair" if len(outcomes) == 1 else f"{len(outcomes)} pairs"
    talk.say(f"{pairs}: {len(outcomes) - failed} answered, {failed} without an answer")
    talk.say(f"wrote {Path(output, 'index.html')}, summary.csv and results.jsonl beside it, and a folder for each pair")
