"""`slopemap simulate`: the paper's simulation study, its figures, and whether its claims hold."""

from __future__ import annotations

import math
import os
import shutil
import sys
import time
from contextlib import ExitStack
from dataclasses import fields
from functools import partial
from typing import TYPE_CHECKING, Any

import click

from slopecli.cli.parameter_types import GRID, PATH, POSITIVE, Between
from slopecli.cli.progress import ERASE_LINE, REDRAW_S
from slopecli.cli.shared_options import at_most_one, talk_options_with
from slopecli.cli.talk import Talk, print_result
from slopecli.study.parameters import StudyOptions

if TYPE_CHECKING:
    from collections.abc import Sequence
    from concurrent.futures import Executor

    from slopecli.study.claims import Claim
    from slopecli.study.trials import Study
    from slopecli.types import Camera

MOST_NUMBERS = 100
BAR = 30  # characters
LOG_S = 10.0
ROUNDING = 1e-12  # what is left of an exact zero
HEADER = ("held", "claim", "measured", "limit", "source")


class Numbers(click.ParamType):
    """Comma-separated numbers within bounds, none twice."""

    name = "numbers"

    def __init__(self, low: float, high: float) -> None:
        self.low, self.high = low, high

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[float, ...]:
        if isinstance(value, tuple):
            return value
        try:
            numbers = tuple(float(part) for part in value.split(","))
        except ValueError:
            self.fail(f"{value!r} is not a list of numbers, for example 0,0.3,1.", param, ctx)
        wrong = [number for number in numbers if not self.low <= number <= self.high]
        if wrong:
            self.fail(f"{wrong[0]:g} is not between {self.low:g} and {self.high:g}.", param, ctx)
        if len(set(numbers)) < len(numbers) or len(numbers) > MOST_NUMBERS:
            self.fail(f"{value!r} has a number twice, or more than {MOST_NUMBERS}.", param, ctx)
        return numbers


class Names(click.ParamType):
    """Comma-separated solvers."""

    name = "solvers"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[str, ...]:
        names = value if isinstance(value, tuple) else tuple(value.split(","))
        if not set(names) <= set(StudyOptions.solvers) or len(set(names)) < len(names):
            self.fail(f"{value!r} is not a list of {', '.join(StudyOptions.solvers)}.", param, ctx)
        return names


class Size(click.ParamType):
    """WIDTHxHEIGHT in pixels."""

    name = "size"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[int, int]:
        if isinstance(value, tuple):
            return value
        width, _, height = value.partition("x")
        if not (width.isdecimal() and height.isdecimal() and 16 <= int(width) < 10**5 and 16 <= int(height) < 10**5):
            self.fail(f"{value!r} is not WIDTHxHEIGHT of at least 16 px each, for example 1024x1024.", param, ctx)
        return int(width), int(height)


def _option(flag: str, name: str, metavar: str, kind: Any, help: str) -> Any:
    """An option of the field `name` of `StudyOptions`, with its default as a user would write it."""
    default = _written(name, getattr(StudyOptions, name))
    return click.option(flag, name, metavar=metavar, type=kind, default=default, show_default=True, help=help)


def _written(name: str, value: Any) -> Any:
    if name in ("grid", "image_size"):
        return "x".join(map(str, value))
    if isinstance(value, tuple):
        return ",".join(part if isinstance(part, str) else f"{part:g}" for part in value)
    return value


@click.command()
@click.option("-o", "--output", metavar="DIR", type=PATH, required=True, help="Where the files go, made if need be.")
@_option("--trajectories", "trajectories_deg", "DEG,...", Numbers(0, 180), "Of the flight: 0 descends, 90 flies level.")
@_option("--noise", "noises_px", "PX,...", Numbers(0, 100), "1-sigma of a coordinate in image 2.")
@_option("--terrains", "terrains", "N", click.IntRange(1, 100_000), "For every trajectory and noise.")
@_option("--grid", "grid", "COLSxROWS", GRID, "Windows, each with a plane of its own.")
@_option("--points", "points", "N", click.IntRange(3, 100_000), "In every window.")
@click.option("--camera", metavar="FILE", type=PATH, help="Camera file, with the lens's distortion if it has one.")
@_option("--size", "image_size", "WxH", Size(), "Without --camera: of the image, px.")
@_option("--fov", "fov_deg", "DEG", Between(1, 150), "Without --camera: horizontal field of view.")
@_option("--baseline-over-height", "baseline_over_height", "RATIO", POSITIVE, "Distance between the cameras.")
@_option("--rotation", "rotation_deg", "DEG", Between(0, 90), "Between the images, about a random axis.")
@_option("--heading", "heading_deg", "DEG", Between(-360, 360), "Of the flight, from image x towards image y.")
@_option("--max-slope", "max_slope_deg", "DEG", Between(0, 89), "Slopes are uniform from 0 to this.")
@_option("--height-spread", "height_spread", "SHARE", Between(0, 0.9), "Windows lie this much above or below.")
@_option("--relief", "relief", "SHARE", Between(0, 0.3), "RMS height of points off their plane, over its distance.")
@_option("--noise1", "noise1_px", "PX", Between(0, 100), "1-sigma of a coordinate in image 1.")
@_option("--outliers", "outliers", "SHARE", Between(0, 0.9), "Of points that are matched wrongly.")
@_option("--solvers", "solvers", "NAME,...", Names(), "Which to run.")
@_option("--most-windows", "most_windows", "N", click.IntRange(0, 4**8), "In the measurement of time; 0 leaves it out.")
@_option("--seed", "seed", "N", click.IntRange(0, 2**31 - 1), "The same seed gives the same bytes.")
@click.option("--jobs", metavar="N", type=click.IntRange(1, 256), help="Worker processes.  [default: one per core]")
@talk_options_with("Time of every stage.")
@click.pass_context
def simulate(ctx: click.Context, output: str, **parameters: Any) -> None:
    """The paper's simulation study (section 4.1), or another like it.

    Runs every solver on scenes whose truth is known, by default the paper's 1320, and prints which of the paper's
    claims hold. DIR gets the figures as PNG and SVG, every trial (trials.csv), the bound of every scene (scenes.csv)
    and a summary with the verdicts (summary.json). What is measured of time is in timing.csv, timing.json and
    figure6_time; only these differ from run to run.

    \b
    Example:
      slopemap simulate -o study
    """
    at_most_one(ctx, "camera", "fov_deg")
    at_most_one(ctx, "camera", "image_size")
    talk = ctx.ensure_object(Talk)
    options = StudyOptions(**{f.name: parameters[f.name] for f in fields(StudyOptions)})
    _run(options, parameters["camera"], parameters["jobs"], output, talk)


def _run(options: StudyOptions, camera_file: str | None, jobs: int | None, output: str, talk: Talk) -> None:
    from slopecli.io.study_files import check_study_directory, write_study
    from slopecli.study.claims import judge_spread, judge_study, judge_times
    from slopecli.study.timing import measure_times
    from slopecli.study.trials import alignment_spread

    check_study_directory(output)
    camera = _camera(options, camera_file)
    study = _study(options, camera, jobs, talk)
    with talk.timed("alignment"):
        spread = alignment_spread(options, camera)
    with talk.timed("timing"), ProgressBar(talk, "sizes timed") as progress:
        timings = measure_times(options, camera, progress)
    claims, timed = [judge_spread(spread), *judge_study(study)], judge_times(timings)
    with talk.timed("write"):
        written = write_study(study, spread, claims, timings, timed, output)
    print_result("\n".join(_table([*claims, *timed])))
    talk.say(f"wrote {', '.join(map(str, written))}")


def _camera(options: StudyOptions, file: str | None) -> Camera:
    from slopecli.io.cameras.reading import load_camera
    from slopecli.study.trials import camera_of

    return load_camera(file) if file else camera_of(options)


def _study(options: StudyOptions, camera: Camera, jobs: int | None, talk: Talk) -> Study:
    from slopecli.study.trials import run_study

    with talk.timed("trials"), ExitStack() as stack:
        progress = stack.enter_context(ProgressBar(talk, "trials"))
        return run_study(options, camera, _workers(jobs, stack), progress)


def _workers(jobs: int | None, stack: ExitStack) -> list[Executor]:
    """Worker processes that end with the stack, or none where one would do."""
    from slopecli.batch.worker import Worker

    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    count = jobs or cores
    workers: list[Executor] = [Worker() for _ in range(count if count > 1 else 0)]
    for worker in workers:
        stack.callback(partial(worker.shutdown, cancel_futures=True))
    return workers


class ProgressBar:
    """How far a stage is, on stderr: a bar that is written over on a terminal, now and then a line in a log."""

    def __init__(self, talk: Talk, what: str) -> None:
        self._talk, self._what = talk, what
        self._live = sys.stderr.isatty() and os.environ.get("TERM") != "dumb" and not talk.quiet
        self._start = self._last = time.monotonic()

    def __enter__(self) -> ProgressBar:
        return self

    def __exit__(self, *_: object) -> None:
        if self._live:
            click.echo(ERASE_LINE, nl=False, err=True)

    def __call__(self, done: int, total: int) -> None:
        now = time.monotonic()
        if now - self._last < (REDRAW_S if self._live else LOG_S):
            return
        self._last, left = now, (now - self._start) * (total - done) / done
        line = f"{done} of {total} {self._what}, {math.ceil(left)} s left"
        if not self._live:
            self._talk.say(line)
            return
        full = round(BAR * done / total)
        shown = f"[{'#' * full}{'.' * (BAR - full)}] {line}"[: shutil.get_terminal_size().columns - 1]
        click.echo(f"{ERASE_LINE}{shown}", nl=False, err=True)


def _table(claims: Sequence[Claim]) -> Sequence[str]:
    """One line for each claim."""
    rows = [(_verdict(claim), claim.statement, _measured(claim), claim.limit, claim.source) for claim in claims]
    widths = [max(map(len, column)) for column in zip(HEADER, *rows, strict=True)]
    return [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in (HEADER, *rows)
    ]


def _verdict(claim: Claim) -> str:
    return "-" if claim.held is None else "yes" if claim.held else "no"


def _measured(claim: Claim) -> str:
    if claim.measured is None:
        return "-"
    number = f"{claim.measured:.3g}" if abs(claim.measured) > ROUNDING else "0"
    return f"{number}, {claim.reason}" if claim.held is None else number
