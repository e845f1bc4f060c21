"""`slopemap batch`: every pair of images in a folder, in worker processes or on a cluster."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from slopecli.cli import shared_options as shared
from slopecli.cli.batch_table import batch_table, dry_table
from slopecli.cli.checks import (
    CAMERA_FLAGS,
    at_most_one,
    camera_choice,
    check_known_motion,
    check_planes,
    given,
    options_from,
    refuse,
)
from slopecli.cli.groups import Command, Flag, Option
from slopecli.cli.parameter_types import PATH, POSITIVE, Pairing
from slopecli.cli.progress import BatchProgress
from slopecli.cli.table import print_table
from slopecli.cli.talk import Talk
from slopecli.options import CameraChoice

if TYPE_CHECKING:
    from slopecli.batch.jobs import Outcome
    from slopecli.batch.pairs import FoundPairs

SOME_WITHOUT_ANSWER = 4
SEGMENT = {"planes": "regions", "up": "dominant-plane"}  # what `slopemap segment` does differently
PAIRS, WORKERS = "Pairs", "Workers"

pair_options = (
    Option(
        PAIRS,
        "--pairing",
        "HOW|FILE.csv",
        Pairing(),
        "Each image with the next (consecutive) or the N-th after it (stride); a pair a folder (folders); or a list of "
        "rows image1,image2[,camera1,camera2]",
        "consecutive",
    ),
    Option(PAIRS, "--stride", "N", click.IntRange(1), "For stride: how many images further"),
    Option(PAIRS, "--command", None, click.Choice(["estimate", "segment"]), "What is done with each pair", "estimate"),
    Flag(PAIRS, "--dry-run", "List pairs and cameras; write nothing"),
)
worker_options = (
    Option(WORKERS, "--jobs", "N", click.IntRange(1), "Worker processes", shown="one per core"),
    Option(WORKERS, "--timeout timeout_s", "SECONDS", POSITIVE, "Give up a pair that takes longer", shown="none"),
    Option(WORKERS, "--memory memory_gb", "GB", POSITIVE, "Give up a pair that needs more memory", shown="no limit"),
    Option(WORKERS, "--cluster", "ADDRESS", None, "A Dask cluster instead, say tcp://head:8786"),
    Flag(WORKERS, "--ship", "Send images to the cluster, fetch its files"),
)


@click.command(
    cls=Command,
    params=[
        *pair_options,
        *shared.camera_options,
        Option(shared.OUTPUT, "-o --output", "DIR", PATH, "Folder for the results; optional with --dry-run"),
        *shared.file_options,
        *worker_options,
        *shared.window_options,
        *shared.finder_options,
        *shared.region_options,
        *shared.frame_options("camera", "camera; segment: dominant-plane"),
        *shared.scale_options,
        *shared.prior_options,
        *shared.decision_options,
        *shared.solver_options,
        *shared.matching_options,
        *shared.talk_options("A line for every pair"),
    ],
)
@click.argument("folder", type=PATH)
@click.pass_context
def batch(ctx: click.Context, folder: str, **parameters: Any) -> None:
    """Every pair of images in FOLDER, each answered as by estimate or segment.

    Prints a table. DIR gets a folder for each pair, a table of all (summary.csv, results.jsonl) and a page to look at
    (index.html). Without a camera option, a camera file beside the images is used. After a stop, the same command
    continues with the pairs that are left.

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
        print_table(dry_table(found.pairs))
        return
    outcomes = _run(found, parameters, talk)
    _print(outcomes, parameters["output"], talk)
    if any(outcome.exit_status for outcome in outcomes):
        ctx.exit(SOME_WITHOUT_ANSWER)


def _check_usage(ctx: click.Context) -> None:
    at_most_one(ctx, *CAMERA_FLAGS)
    at_most_one(ctx, "grid", "windows")
    check_known_motion(ctx)
    at_most_one(ctx, "jobs", "cluster")
    segment, stride = ctx.params["command"] == "segment", ctx.params["pairing"] == "stride"
    check_planes(ctx, SEGMENT["planes"] if segment else ctx.params["planes"])
    refuse(
        ctx,
        [
            (segment and given(ctx, "planes"), "--planes is for --command estimate; leave one out."),
            (
                given(ctx, "camera2") and not given(ctx, *CAMERA_FLAGS),
                "--camera2 is without --camera; give both.",
            ),
            (given(ctx, "ship") and not given(ctx, "cluster"), "--ship is for --cluster ADDRESS; leave it out."),
            (stride and not given(ctx, "stride"), "--pairing stride needs --stride N."),
            (not stride and given(ctx, "stride"), "--stride is for --pairing stride; leave one out."),
            (
                not given(ctx, "output", "dry_run"),
                "Nowhere to put the answers: give -o DIR, or --dry-run to list the pairs.",
            ),
        ],
    )


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
    progress = BatchProgress(talk)
    try:
        return run(found.pairs, options_from(parameters), keep, parameters["output"], **how, on_progress=progress)
    except KeyboardInterrupt:
        progress.interrupted()
        raise
    finally:
        progress.close()


def _print(outcomes: list[Outcome], output: str, talk: Talk) -> None:
    from pathlib import Path

    print_table(batch_table(outcomes))
    failed = sum(outcome.exit_status != 0 for outcome in outcomes)
    pairs = "1 pair" if len(outcomes) == 1 else f"{len(outcomes)} pairs"
    talk.say(f"{pairs}: {len(outcomes) - failed} answered, {failed} without an answer")
    talk.say(f"wrote {Path(output, 'index.html')}, summary.csv and results.jsonl beside it, and a folder for each pair")
