"""Options shared by the commands, in groups; parameter names are those of `Options`, and so are the defaults."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from functools import reduce
from typing import Any

import click
from click.core import ParameterSource

from slopecli.cli.parameter_types import (
    DIRECTION_PRIOR,
    GRID,
    INTRINSICS,
    PATH,
    POSITIVE,
    ROTATION_PRIOR,
    UP,
    VECTOR,
    WINDOW,
    Between,
    choices_of,
)
from slopecli.cli.talk import Talk
from slopecli.options import MOST_SIGMA_DEG, Options

Decorator = Callable[[Any], Any]


def _group(*decorators: Decorator) -> Decorator:
    """One decorator that adds options in the order written."""
    return lambda command: reduce(lambda decorated, add: add(decorated), reversed(decorators), command)


def _option(*names: str, **attributes: Any) -> Decorator:
    return click.option(*names, **{"show_default": attributes.get("default") is not None, **attributes})


def _set_talk(ctx: click.Context, parameter: click.Parameter, value: bool) -> None:
    talk: Talk = ctx.ensure_object(Talk)
    setattr(talk, str(parameter.name), value)
    if talk.verbose and talk.quiet:
        raise click.UsageError("-v and -q contradict each other; give one.", ctx)


camera_options = _group(
    _option(
        "--camera",
        metavar="FILE",
        type=PATH,
        help="Camera file of both images; FILE#NAME takes one of several in it.",
    ),
    _option("--camera2", metavar="FILE", type=PATH, help="Camera file of image 2 where it differs."),
    _option(
        "--intrinsics", metavar="FX,FY,CX,CY", type=INTRINSICS, help="Instead of a camera file, px; no distortion."
    ),
    _option(
        "--fov",
        metavar="DEG",
        type=Between(0, 180, min_open=True, max_open=True),
        help="Instead of a camera file: horizontal field of view, principal point in the centre.",
    ),
)

window_options = _group(
    _option(
        "--grid",
        metavar="COLSxROWS",
        type=GRID,
        default="{}x{}".format(*Options.grid),
        help="Windows that divide image 1 evenly.",
    ),
    _option(
        "--window",
        "windows",
        metavar="X,Y,W,H",
        type=WINDOW,
        multiple=True,
        help="A window of image 1, px; repeat it for more. They get ids 1, 2, ... in this order.",
    ),
)

finder_options = _group(
    _option(
        "--planes",
        type=choices_of("planes"),
        default=Options.planes,
        help="What is held to be a plane: windows, given or of a grid; ransac: what many matches lie on; regions: what "
        "explains the pixels, as slopemap segment does. --grid and --window are for windows, --min-region for the "
        "other two, the options after it for regions.",
    ),
)

region_options = _group(
    _option(
        "--min-region",
        "min_region_percent",
        metavar="PERCENT",
        type=Between(0, 100, min_open=True),
        default=Options.min_region_percent,
        help="Of image 1: smaller planes are not reported.",
    ),
    _option(
        "--gradient-threshold",
        metavar="GREY/PX",
        type=POSITIVE,
        help="Of the smoothed image: a pixel below it is inside a surface, one above it at a border.  "
        "[default: what 60 % of the image stay below]",
    ),
    _option(
        "--merge-px",
        metavar="PX",
        type=POSITIVE,
        default=Options.merge_px,
        help="Two regions that send the smaller's pixels this close together in image 2 may be one plane; they are if "
        "one plane transfers both as well as two. px of an image of at most half a million.",
    ),
    _option(
        "--debug-images",
        is_flag=True,
        help="Add pictures of how regions were found: step1_gradient.png, step2_components.png, step3_merged.png.",
    ),
)

solver_options = _group(
    _option(
        "--solver",
        type=choices_of("solver"),
        default=Options.solver,
        help="mle: joint least squares; ha: homography alignment as printed; lh: Longuet-Higgins, averaged. "
        "Sigmas of ha and lh are lower bounds.",
    ),
    _option(
        "--merge-coplanar",
        is_flag=True,
        help="Solve windows or planes that may well lie on one plane, or face one way, as such: level fields are known "
        "several times better. It says which.",
    ),
)

solving_options = _group(
    _option(
        "--features",
        type=choices_of("features"),
        default=Options.features,
        help="What is matched first; foerstner: the paper's corners and correlation.",
    ),
    solver_options,
    _option(
        "--seed",
        metavar="N",
        type=click.IntRange(0, 2**31 - 1),
        default=Options.seed,
        help="Seed of random sampling; the same seed gives the same bytes.",
    ),
)


def frame_options_with(up: str, shown: str | None = None) -> Decorator:
    """Options of the reference of slopes, with the command's own default for what is level, shown as it says."""
    return _group(
        _option(
            "--up",
            metavar="camera|dominant-plane|X,Y,Z",
            type=UP,
            default=up,
            show_default=shown or True,
            help="What is level: camera 1 looks straight down; the largest plane, which must not be a wall then; or a "
            "vector against gravity in camera-1 axes (x right, y down, z forward).",
        ),
        _option(
            "--up-sigma",
            "up_sigma_deg",
            metavar="DEG",
            type=Between(0, 90, max_open=True),
            default=Options.up_sigma_deg,
            help="1-sigma uncertainty of that direction; it enters the slopes' intervals.",
        ),
        _option(
            "--north",
            metavar="X,Y,Z",
            type=VECTOR,
            help="Where aspect is 0, in camera-1 axes.  [default: the image's up direction]",
        ),
    )


frame_options = frame_options_with(str(Options.up))

scale_options = _group(
    _option("--baseline", "baseline_m", metavar="M", type=POSITIVE, help="Distance between the cameras, for metres."),
    _option(
        "--altitude", "altitude_m", metavar="M", type=POSITIVE, help="Height of camera 1 above the ground, for metres."
    ),
)

prior_options = _group(
    _option(
        "--rotation-prior",
        metavar="RX,RY,RZ,SIGMA",
        type=ROTATION_PRIOR,
        help="Rotation of camera 2 from camera 1 as another sensor measured it: rotation vector in camera axes, deg, "
        "or a quaternion QW,QX,QY,QZ; and its 1-sigma about each axis, deg.",
    ),
    _option(
        "--direction-prior",
        metavar="X,Y,Z,SIGMA",
        type=DIRECTION_PRIOR,
        help="Direction from camera 1 to camera 2 in camera-1 axes, and its 1-sigma to each side, deg.",
    ),
    _option(
        "--pose",
        "pose_file",
        metavar="FILE",
        type=PATH,
        help='The motion itself, in metres, as JSON: "R" (3x3, camera 2 from camera 1) and "T" (where camera 2 is, in '
        "camera-1 axes). Only planes are solved then, and lengths are metres.",
    ),
    _option(
        "--pose-sigma",
        "pose_sigma_deg",
        metavar="DEG",
        type=Between(0, 90, min_open=True, max_open=True),
        help="1-sigma of that rotation about each axis, and of the direction of T to each side; the motion is solved "
        "too then.  [default: exact]",
    ),
)

verdict_options = _group(
    _option(
        "--tolerance",
        "tolerance_deg",
        metavar="DEG",
        type=Between(0, 90, min_open=True, max_open=True),
        default=Options.tolerance_deg,
        help="The steepest slope that is safe.",
    ),
    _option(
        "--confidence",
        metavar="P",
        type=Between(0.5, 1, min_open=True, max_open=True),
        default=Options.confidence,
        help="A window or plane is safe if its slope is below the tolerance with this probability, unsafe if it is "
        "above with this one, undecided in between.",
    ),
    _option(
        "--max-sigma",
        "max_sigma_deg",
        metavar="DEG",
        type=Between(0, MOST_SIGMA_DEG, min_open=True),
        default=Options.max_sigma_deg,
        help="No slope is told whose 1-sigma is larger: a window is then unknown and never safe, a plane found is "
        "dropped.",
    ),
)

file_options = _group(
    _option("--no-overlay", is_flag=True, help="Leave out overlay.png."),
    _option("--no-ply", is_flag=True, help="Leave out patches.ply."),
    _option("--no-glb", is_flag=True, help="Leave out patches.glb, which there is of planes, not of windows."),
)

output_options = _group(
    _option(
        "-o",
        "--output",
        metavar="DIR",
        type=PATH,
        help="Where the files go, made if need be. Required unless --json is given.",
    ),
    _option("--json", "as_json", is_flag=True, help="Print slopes.json on stdout instead of the table."),
    file_options,
)


def talk_options_with(verbose: str) -> Decorator:
    """How much is said on stderr; `verbose` says what more -v gives."""
    return _group(
        _option("-v", "--verbose", is_flag=True, expose_value=False, callback=_set_talk, help=verbose),
        _option("-q", "--quiet", is_flag=True, expose_value=False, callback=_set_talk, help="Only errors on stderr."),
    )


talk_options = talk_options_with("Time of every stage.")


def given(ctx: click.Context, *names: str) -> list[str]:
    """Flags, as the user writes them, of those of the named parameters that are on the command line."""
    return [
        parameter.opts[-1]
        for parameter in ctx.command.params
        if parameter.name in names and ctx.get_parameter_source(parameter.name) is not ParameterSource.DEFAULT
    ]


def at_most_one(ctx: click.Context, *names: str) -> None:
    """Refuse a command line that has more than one of the named parameters."""
    flags = given(ctx, *names)
    if len(flags) > 1:
        raise click.UsageError(f"{' and '.join(flags)} contradict each other; give one.", ctx)


def check_known_motion(ctx: click.Context) -> None:
    """Refuse ways to give the motion or the scale that contradict each other, and what only one solver can use."""
    at_most_one(ctx, "baseline_m", "altitude_m", "pose_file")
    for other in ("rotation_prior", "direction_prior"):
        at_most_one(ctx, "pose_file", other)
    if given(ctx, "pose_sigma_deg") and not given(ctx, "pose_file"):
        raise click.UsageError("--pose-sigma is of a --pose; give both.", ctx)
    if ctx.params["merge_coplanar"] and ctx.params["solver"] != "mle":
        raise click.UsageError("--merge-coplanar is for --solver mle; leave one out.", ctx)
    known = given(ctx, "rotation_prior", "direction_prior", "pose_file")
    if known and ctx.params["solver"] != "mle":
        raise click.UsageError(f"{known[0]} is for --solver mle; leave one out.", ctx)


def options_from(parameters: dict[str, Any]) -> Options:
    """The library's options out of a command's parameters of the same names; the pose is read from its file."""
    if parameters.get("pose_file"):
        from slopecli.io.poses import load_pose

        parameters = {**parameters, "pose": load_pose(parameters["pose_file"])}
    return Options(**{field.name: parameters[field.name] for field in fields(Options) if field.name in parameters})
