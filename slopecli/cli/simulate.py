"""`slopemap simulate`: the paper's simulation study, its figures, and whether its claims hold."""

from __future__ import annotations

import os
from contextlib import ExitStack
from dataclasses import fields
from functools import partial
from typing import TYPE_CHECKING, Any

import click

from slopecli.cli.checks import at_most_one
from slopecli.cli.parameter_types import GRID, PATH, POSITIVE, SEED, Between, Whole, name_list, number_list, two_sides
from slopecli.cli.progress import StageProgress
from slopecli.cli.shared_options import INPUT, OUTPUT, SOLVER, Command, Option, talk_options
from slopecli.cli.table import Table, print_table
from slopecli.cli.talk import Talk
from slopecli.options import MIN_SIDE_PX
from slopecli.study.parameters import StudyOptions

if TYPE_CHECKING:
    from collections.abc import Iterable
    from concurrent.futures import Executor

    from slopecli.study.claims import Claim

STUDY, FLIGHT, GROUND, ERRORS = "Study", "Flight", "Ground", "Errors"
IMAGE_SIZE = two_sides(f"WIDTHxHEIGHT of at least {MIN_SIDE_PX} px each", "1024x768", MIN_SIDE_PX)
_option = partial(Option, of=StudyOptions)


@click.command(
    cls=Command,
    params=[
        Option(OUTPUT, "-o --output", "DIR", PATH, "Folder for the results (required)", required=True),
        _option(STUDY, "--trajectories trajectories_deg", "DEG,...", number_list(0, 180), "0 descends, 90 flies level"),
        _option(STUDY, "--noise noises_px", "PX,...", number_list(0, 100), "1-sigma of a coordinate in image 2"),
        _option(STUDY, "--terrains", "N", Whole(1, 100_000), "For every trajectory and noise"),
        _option(STUDY, "--seed", "N", SEED, "The same seed gives the same bytes"),
        Option(STUDY, "--jobs", "N", Whole(1, 256), "Worker processes", shown="one per core"),
        Option(INPUT, "--camera", "FILE", PATH, "Camera file, with lens distortion if it has any"),
        _option(INPUT, "--fov fov_deg", "DEG", Between(1, 150), "Without --camera: horizontal field of view"),
        _option(INPUT, "--size image_size", "WxH", IMAGE_SIZE, "Without --camera: image size, px"),
        _option(GROUND, "--grid", "COLSxROWS", GRID, "Windows, each with a plane of its own"),
        _option(GROUND, "--points", "N", Whole(3, 100_000), "Correspondences in every window"),
        _option(GROUND, "--max-slope max_slope_deg", "DEG", Between(0, 89), "Slopes are uniform from 0 to this"),
        _option(GROUND, "--height-spread", "SHARE", Between(0, 0.9), "Windows lie up to this much higher or lower"),
        _option(GROUND, "--relief", "SHARE", Between(0, 0.3), "RMS height of points off their plane over distance"),
        _option(FLIGHT, "--baseline-over-height", "RATIO", POSITIVE, "Distance between the cameras over height"),
        _option(FLIGHT, "--rotation rotation_deg", "DEG", Between(0, 90), "Between the images, about a random axis"),
        _option(FLIGHT, "--heading heading_deg", "DEG", Between(-360, 360), "Direction, from image x towards image y"),
        _option(ERRORS, "--noise1 noise1_px", "PX", Between(0, 100), "1-sigma of a coordinate in image 1"),
        _option(ERRORS, "--outliers", "SHARE", Between(0, 0.9), "Share of points that are matched wrongly"),
        _option(SOLVER, "--solvers", "NAME,...", name_list(StudyOptions.solvers), "Which to run"),
        _option(SOLVER, "--most-windows", "N", Whole(0, 4**8), "Windows timed at most; 0: none are timed"),
        *talk_options(),
    ],
)
@click.pass_context
def simulate(ctx: click.Context, output: str, camera: str | None, jobs: int | None, **parameters: Any) -> None:
    """The paper's simulation study (section 4.1), or another like it.

    Runs every solver on simulated scenes, by default the paper's 1320, and prints which of the paper's claims hold. DIR
    gets the figures (PNG, SVG), every trial (trials.csv), the bound of every scene (scenes.csv), a summary with the
    verdicts (summary.json), and the time taken (timing.csv, timing.json, figure6_time), which alone differs from run
    to run. The default takes about 80 s of processor time; a quarter of that with --terrains 10 --most-windows 0.

    \b
    Example:
      slopemap simulate -o study
    """
    at_most_one(ctx, ("camera", "fov_deg"), ("camera", "image_size"))
    options = StudyOptions(**{field.name: parameters[field.name] for field in fields(StudyOptions)})
    _run(options, camera, jobs, output, ctx.ensure_object(Talk))


def _run(options: StudyOptions, camera_file: str | None, jobs: int | None, output: str, talk: Talk) -> None:
    from slopecli.io.cameras.reading import load_camera
    from slopecli.io.outputs import check_directory
    from slopecli.io.study_files import STUDY_NAMES, write_study
    from slopecli.study.claims import judge_spread, judge_study, judge_times
    from slopecli.study.trials import alignment_spread, camera_of, measure_times, run_study

    check_directory(output, STUDY_NAMES)
    camera = load_camera(camera_file) if camera_file else camera_of(options)
    with talk.timed("trials"), ExitStack() as stack:
        progress = stack.enter_context(StageProgress(talk, "trials"))
        study = run_study(options, camera, _workers(jobs, stack), progress)
    with talk.timed("alignment"):
        spread = alignment_spread(options, camera)
    with talk.timed("timing"), StageProgress(talk, "sizes timed") as progress:
        timings = measure_times(options, camera, progress)
    claims, timed = [judge_spread(spread), *judge_study(study)], judge_times(timings)
    with talk.timed("write"):
        written = write_study(study, spread, claims, timings, timed, output)
    print_table(_claim_table([*claims, *timed]), talk)
    talk.say(f"wrote {', '.join(map(str, written))}")


def _workers(jobs: int | None, stack: ExitStack) -> list[Executor]:
    """Worker processes that end with the stack, or none where one would do."""
    from slopecli.batch.worker import Worker

    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    count = jobs or cores
    workers: list[Executor] = [Worker() for _ in range(count if count > 1 else 0)]
    for worker in workers:
        stack.callback(partial(worker.shutdown, cancel_futures=True))
    return workers


def _claim_table(claims: Iterable[Claim]) -> Table:
    """A row for each claim of the paper."""
    held = {None: "-", True: "yes", False: "no"}
    rows = [(held[claim.held], claim.statement, _measured(claim), claim.limit, claim.source) for claim in claims]
    return Table(("held", "claim", "measured", "limit", "source"), rows)


def _measured(claim: Claim) -> str:
    if claim.measured is None:
        return "-"
    number = f"{claim.measured:.3g}" if abs(claim.measured) > 1e-12 else "0"  # rounding of an exact zero
    return f"{number}, {claim.reason}" if claim.held is None else number
