"""`slopemap sequence`: slopes of windows of the first frame from many frames, one line a frame."""

from __future__ import annotations

import time
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from slopecli.cli import parameter_types as kinds
from slopecli.cli import shared_options as shared
from slopecli.cli.checks import (
    CAMERA_FLAGS,
    NO_CAMERA,
    WINDOW_FLAGS,
    at_most_one,
    camera_choice,
    given,
    map_options_from,
    options_from,
    refuse,
)
from slopecli.cli.map_table import print_sites, say_ground
from slopecli.cli.metadata_choices import take_metadata
from slopecli.cli.parameter_types import PATH, POSITIVE
from slopecli.cli.prior_choices import with_priors_file
from slopecli.cli.report_table import print_report, say_place
from slopecli.cli.shared_options import INPUT, OUTPUT, Flag, Option
from slopecli.cli.talk import Talk, origin_of, print_result
from slopecli.options import Options
from slopecli.products import STREAM
from slopecli.report.slope_units import slope_unit_of

if TYPE_CHECKING:
    from slopecli.io.frame_sources import FrameSource
    from slopecli.io.metadata.of_frames import OptionsOf
    from slopecli.options import MetadataChoice
    from slopecli.sequence.frame import SequenceAnswer, SequenceStep
    from slopecli.sequence.stream import Sequence
    from slopecli.types import Report

STOPS = click.Choice(["settled"])
FOCAL_SIGMA = Option(
    *(INPUT, "--focal-sigma focal_sigma_percent", "PERCENT", kinds.Between(0, 30), "1-sigma of the focal length"),
    shown="3 with --fov",
    of=Options,
)
FRAMES = (
    Option(INPUT, "--glob pattern", "PATTERN", str, "Of the images in a folder", "", shown="all"),
    Option(INPUT, "--times times_file", "FILE", PATH, "Time of every frame, s, one a line"),
    Option(INPUT, "--positions positions_file", "FILE", PATH, "Of the camera: x,y,z or TUM lines, for metres"),
    Option(INPUT, "--priors priors_file", "FILE", PATH, "CSV of altitudes, angles, positions of frames"),
    Option(INPUT, "--every", "N", kinds.Whole(1), "Of a video: every N-th frame", 1),
    Option(INPUT, "--fps", "RATE", POSITIVE, "Of a video: so many frames a second", shown="all"),
    Option(INPUT, "--start start_s", "S", kinds.Between(0, 1e6), "Of a video: where to begin, s", 0.0),
    Option(INPUT, "--stop stop_s", "S", POSITIVE, "Of a video: where to end, s", shown="its end"),
    Option(INPUT, "--live", "DEVICE", str, "Read a camera of this computer"),
)
SCALE = ("baseline_m", "altitude_m", "scale_sigma_percent", "tolerance_deg", "confidence", "max_sigma_deg")
DECIDING = tuple(option for option in shared.pair_solving_options if option.name in SCALE)
FILES = (
    Option(OUTPUT, "-o --output", "DIR", PATH, "Folder for the results"),
    shared.json_flag,
    shared.slope_unit,
    Flag(OUTPUT, "--no-overlay", "Leave out overlay.png"),
    shared.report_flag,
    Flag(OUTPUT, "--video", "Also write sequence.mp4, with overlays"),
    Flag(OUTPUT, "--map with_map", "Also map slopes everywhere; landing sites"),
    Option(OUTPUT, "--stop-when", "settled", STOPS, "End when every verdict is final"),
)


@click.command(
    cls=shared.Command,
    short_help="Slopes of windows of the first of many frames.",
    params=[
        shared.pair_camera_options[0],
        *shared.intrinsics_options,
        FOCAL_SIGMA,
        *FRAMES,
        *FILES,
        *shared.map_options,
        *shared.window_options,
        *shared.pair_frame_options(),
        *shared.place_options,
        *DECIDING,
        *shared.talk_options("Frame rate, time of every stage"),
    ],
)
@click.argument("frames", type=PATH, nargs=-1)
@click.pass_context
def sequence(ctx: click.Context, frames: tuple[str, ...], **parameters: Any) -> None:
    """Slopes of windows of the first of many images, of a folder or a video.

    Prints a line a frame, then the table; -o DIR also writes both, the lines while it runs, and more at the end. Ctrl-C
    ends it early.

    \b
    Example:
      slopemap sequence descent/ --camera camera.json -o out
    """
    _check(ctx, frames, parameters)
    parameters, metadata = take_metadata(ctx, parameters)
    talk = ctx.ensure_object(Talk)
    source = with_priors_file(ctx, _with_cameras(_opened(frames, parameters), parameters, talk), parameters, talk)
    runner, options_at_end = _runner(ctx, source, parameters, metadata)
    interrupted, problem = _run(source, runner, parameters, talk)
    if interrupted and not runner.started:
        raise KeyboardInterrupt
    runner.options_of = options_at_end
    answer = _answer(runner, parameters, talk)
    written = _written(answer, runner, parameters, talk)
    _say_dense(answer.report, runner.report(), talk)
    _print(answer, written, talk, parameters["as_json"])
    if problem is not None:
        raise problem
    if interrupted:
        raise KeyboardInterrupt


def _check(ctx: click.Context, frames: tuple[str, ...], parameters: dict[str, Any]) -> None:
    """Refuse contradictions of the command line, and a folder that cannot take the results."""
    at_most_one(ctx, CAMERA_FLAGS, WINDOW_FLAGS, ("baseline_m", "altitude_m", "positions_file"), ("every", "fps"))
    lengths = ("baseline_m", "altitude_m", "positions_file", "priors_file", "metadata")
    sigma_alone = given(ctx, "scale_sigma_percent") and not given(ctx, *lengths)
    live = parameters["live"]
    refuse(
        ctx,
        (not frames and not live, "No frames: give images, a folder, a video, or --live DEVICE."),
        (frames and live, "--live reads a camera; leave the files out."),
        (not given(ctx, *CAMERA_FLAGS, "metadata"), NO_CAMERA),
        (
            not given(ctx, "output", "as_json"),
            "Nowhere to put the answer: give -o DIR, or --json to print it.",
        ),
        (parameters["video"] and not parameters["output"], "--video is a file; give -o DIR for it."),
        (
            given(ctx, "north_sigma_deg") and not given(ctx, "north", "yaw_deg", "metadata"),
            "--north-sigma is of --north, --yaw or --metadata; give both.",
        ),
        (
            given(ctx, "position_sigma_m") and not given(ctx, "position"),
            "--position-sigma is of a --position; give both.",
        ),
        (sigma_alone, "--scale-sigma is of a --baseline, --altitude, --positions or --priors; give both."),
    )
    if parameters["output"]:
        from slopecli.io.outputs import check_directory
        from slopecli.products import OUTPUT_NAMES

        files = (parameters[name] for name in ("camera", "times_file", "positions_file", "priors_file"))
        check_directory(parameters["output"], OUTPUT_NAMES, inputs=(*frames, *files))


def _opened(frames: tuple[str, ...], parameters: dict[str, Any]) -> FrameSource:
    """The frames that the command line names."""
    from slopecli.io.frame_sources import VideoChoice, open_camera, open_frames, read_positions, read_times

    if parameters["live"]:
        return open_camera(parameters["live"])
    times = read_times(parameters["times_file"]) if parameters["times_file"] else None
    choice = VideoChoice(parameters["every"], parameters["fps"], parameters["start_s"], parameters["stop_s"])
    positions = read_positions(parameters["positions_file"]) if parameters["positions_file"] else None
    return open_frames(frames, parameters["pattern"], times, choice, positions)


def _with_cameras(source: FrameSource, parameters: dict[str, Any], talk: Talk) -> FrameSource:
    """The frames with their own cameras, where the file holds several."""
    from slopecli.io.cameras.frame_cameras import FrameCameras

    cameras = FrameCameras(camera_choice(parameters))
    if not cameras.several:
        return source
    talk.say("info: of the cameras of the file, every frame has that of its name, as the first would show it")
    return replace(source, rest=cameras.of(source.rest))


def _runner(
    ctx: click.Context, source: FrameSource, parameters: dict[str, Any], metadata: MetadataChoice | None
) -> tuple[Sequence, OptionsOf | None]:
    """What takes in the frames, and the options of its first frame and the last when it ends; None where they stay."""
    from slopecli.io.cameras.reading import camera_for
    from slopecli.io.metadata.image_metadata import Metadata
    from slopecli.io.metadata.metadata_reading import read_metadata
    from slopecli.io.metadata.of_frames import options_of_frames
    from slopecli.sequence.stream import Sequence

    first, choice, options = source.image, camera_choice(parameters), options_from(parameters)
    asked = choice.exif or (metadata is not None and (metadata.must or metadata.may))
    of_files = Path(first.path).is_file()
    why = "Frames of a video or a camera state nothing of how they were taken: leave out --metadata and exif."
    refuse(ctx, (asked and not of_files, why))
    camera, notes = camera_for(first, choice)
    for note in notes:
        ctx.ensure_object(Talk).say(f"info: {note}")
    if metadata is None:
        return Sequence(camera, options, keep_depth=True), None
    read = read_metadata if of_files else partial(Metadata, size=(first.width, first.height), orientation=1)
    running, at_end = options_of_frames(read, metadata, options, choice)
    running(first.path, first.path)  # refuses what the first frame has to state
    return Sequence(camera, options, keep_depth=True, options_of=running), at_end


def _run(
    source: FrameSource, runner: Sequence, parameters: dict[str, Any], talk: Talk
) -> tuple[bool, Exception | None]:
    """Take in the frames, a line for each; whether Ctrl-C ended it, and what kept a line from being written."""
    from slopecli import pipeline
    from slopecli.products.sequence_files import frame_line

    output = parameters["output"]
    say = talk.say if parameters["as_json"] else print_result
    began = time.monotonic()
    with ExitStack() as stack:
        lines = film = None
        if output:
            from slopecli.io.line_files import LineFile
            from slopecli.io.outputs import store_outputs

            store_outputs({}, output)  # an earlier answer does not stay beside the lines of this run
            lines = stack.enter_context(LineFile(Path(output, STREAM)))
        if parameters["video"]:
            from slopecli.io.film import Film

            film = stack.enter_context(Film(output))
        try:
            for step in pipeline.sequence(source, runner, stop_when_settled=parameters["stop_when"] == "settled"):
                if lines is not None:
                    lines.write(frame_line(step))
                if film is not None:
                    film.add(step, runner)
                say(_line(step, len(runner.windows)))
                if talk.verbose:
                    talk.say(_pace(step.state.frame, time.monotonic() - began, source.total))
        except KeyboardInterrupt:
            return True, None
        except Exception as problem:  # whatever it is, the answer so far is kept before it is told
            if not runner.started:
                raise
            return False, problem
        finally:
            if film is not None:
                parameters["film"] = film.content()
    return False, None


def _line(step: SequenceStep, windows: int) -> str:
    """One frame on the terminal."""
    state, report = step.state, step.report
    name = Path(state.image).name
    if state.why is not None:
        return f"{state.frame:4d}  {name}: skipped, {state.why.message}"
    if state.later:
        return f"{state.frame:4d}  {name}: followed; it shows too little of the windows"
    if report is None:
        return f"{state.frame:4d}  {name}: {'the first frame' if state.status == 'reference' else 'no slope known yet'}"
    from slopecli.findings.wording import forbidding

    slopes = [plane.slope_deg for plane in report.planes]
    sigmas = sorted(plane.slope_sigma_deg or 0.0 for plane in report.planes)
    counts = {verdict: list(step.settled.values()).count(verdict) for verdict in ("safe", "unsafe")}
    two = ", two answers" if report.ambiguity.status == "unresolved" else ""
    two += "".join(f", {code}" for code in forbidding(report.diagnostics))
    unit = slope_unit_of(report.options)
    span = unit.interval(min(slopes), max(slopes)) if unit.run else f"{min(slopes):.1f}-{max(slopes):.1f}°"
    return (
        f"{state.frame:4d}  {name}: {len(slopes)} slopes {span}, sigma "
        f"{sigmas[0]:.2f}-{sigmas[-1]:.2f}°{two}; settled {sum(counts.values())} of {windows}: "
        f"{counts['safe']} safe, {counts['unsafe']} unsafe"
    )


def _pace(done: int, seconds: float, total: int | None) -> str:
    """Frames a second, and the time left where the end is known."""
    rate = done / max(seconds, 1e-9)
    left = "" if total is None else f", {(total - done) / rate:.0f} s left"
    return f"{rate:.1f} frames a second{left}"


def _answer(runner: Sequence, parameters: dict[str, Any], talk: Talk) -> SequenceAnswer:
    """The answer so far, with the map if one was asked for."""
    from slopecli import pipeline

    if not parameters["with_map"] or not runner.started:
        with talk.timed("dense windows"):
            return pipeline.sequence_answer(runner)
    with talk.timed("map"):
        ground = pipeline.sequence_map(runner, map_options_from(parameters))
    return runner.answer(ground.report, ground)


def _print(answer: SequenceAnswer, written: list[Path], talk: Talk, as_json: bool) -> None:
    """The table, or slopes.json, and with a map its landing sites."""
    if as_json:
        from slopecli.products.sequence_files import sequence_to_json

        print_result(sequence_to_json(answer))
        return
    say_place(answer.report, talk)
    print_report(answer.report, written, talk, as_json=False)
    if answer.map is not None:
        print_sites(answer.map, talk)
        say_ground(answer.map, talk)


def _say_dense(report: Report, tracked: Report, talk: Talk) -> None:
    """Say of which windows the answer differs from that by the points tracked, which the lines of frames are of."""
    before = {plane.id: plane.slope_deg for plane in tracked.planes}
    dense = [str(plane.id) for plane in report.planes if before.get(plane.id, plane.slope_deg) != plane.slope_deg]
    if dense:
        talk.say(
            f"info: planes through all pixels, of window{'s' if len(dense) > 1 else ''} {', '.join(dense)}, have taken "
            "the place of those through the points tracked, which the lines above are of"
        )


def _written(answer: SequenceAnswer, runner: Sequence, parameters: dict[str, Any], talk: Talk) -> list[Path]:
    """The files of the answer so far, with that of the lines first."""
    from slopecli.types import Image

    output, first = parameters["output"], runner.images[0]
    if not output or not isinstance(first, Image):
        return []
    from slopecli.io.outputs import store_outputs
    from slopecli.products import OUTPUT_NAMES, SEQUENCE_PRODUCTS, VIDEO, encode_products, kept_choices

    with talk.timed("write"):
        keep, last = kept_choices(parameters, SEQUENCE_PRODUCTS), runner.current
        shown = last if last is not None and last.path == answer.report.images[1].path else None
        contents = encode_products(answer, first, keep, SEQUENCE_PRODUCTS, origin_of(talk, shown))
        if parameters.get("film"):
            contents[VIDEO] = parameters["film"]
        names = [name for name in OUTPUT_NAMES if name != STREAM]
        return [Path(output, STREAM), *store_outputs(contents, output, names)]
