"""Options that several commands have: one row an option, one tuple a group.

Names of parameters are those of `Options`, and so are the defaults. A command takes a group by naming it in its
`params`; in a group the everyday options come first.
"""

from __future__ import annotations

import click

from slopecli.cli.groups import GENERAL, Flag, Option
from slopecli.cli.parameter_types import (
    DIRECTION_PRIOR,
    GRID,
    INTRINSICS,
    PATH,
    POSITIVE,
    ROTATION_PRIOR,
    SEED,
    SIZE,
    UP,
    VECTOR,
    WINDOW,
    Between,
    choices_of,
)
from slopecli.cli.talk import Talk
from slopecli.options import MOST_SIGMA_DEG, Options
from slopecli.patches import FINDERS, PLANE_FINDERS
from slopecli.products import BY_DEFAULT, CHOICES, PRODUCTS

INPUT, OUTPUT, PLANES, FRAME = "Input", "Output", "Windows and planes", "Frame and scale"
PRIOR, DECISION, SOLVER = "Prior knowledge", "Decision", "Solver"

ANGLE = Between(0, 90, min_open=True, max_open=True)

camera = Option(INPUT, "--camera", "FILE", PATH, "Camera file; FILE#NAME: one of several in it")
camera2 = Option(INPUT, "--camera2", "FILE", PATH, "Camera file of image 2, if it has another")
intrinsics_options = (
    Option(INPUT, "--intrinsics", "FX,FY,CX,CY", INTRINSICS, "Instead of a file: px, no distortion"),
    Option(
        INPUT,
        "--fov",
        "DEG",
        Between(0, 180, min_open=True, max_open=True),
        "Instead of a file: horizontal field of view",
    ),
)
size = Option(INPUT, "--size", "WxH", SIZE, "Image size, px, for --fov and --intrinsics")
camera_options = (camera, camera2, *intrinsics_options)

json_flag = Flag(OUTPUT, "--json as_json", "Print slopes.json instead of the table")


def _product_flag(choice: str) -> Flag:
    """The flag that declines or asks for the files of one of the user's choices."""
    products = [product for product in PRODUCTS if product.choice == choice]
    does = "Leave out" if products[0].by_default else "Also write"
    of = {"": "", "found": " (of planes found)", "segmentation": " (of regions)"}[products[0].requires]
    return Flag(OUTPUT, products[0].flag, f"{does} {', '.join(product.file for product in products)}{of}")


file_options = tuple(map(_product_flag, sorted(CHOICES, key=lambda choice: choice not in BY_DEFAULT)))
output_options = (
    Option(OUTPUT, "-o --output", "DIR", PATH, "Folder for the results; optional with --json"),
    json_flag,
    *file_options,
)

window_options = (
    Option(PLANES, "--grid", "COLSxROWS", GRID, "Equal windows that cover image 1", "{}x{}".format(*Options.grid)),
    Option(
        PLANES, "--window windows", "X,Y,W,H", WINDOW, "A window, px; repeat for more, in order of id", multiple=True
    ),
)
finder_options = (
    Option(
        PLANES,
        "--planes",
        "NAME",
        click.Choice(list(PLANE_FINDERS)),
        "; ".join(finder.what for finder in FINDERS if finder.choice),
        Options.planes,
    ),
)
region_options = (
    Option(
        PLANES,
        "--min-region min_region_percent",
        "PERCENT",
        Between(0, 100, min_open=True),
        "Smallest plane found, % of image 1",
        Options.min_region_percent,
    ),
    Option(
        PLANES,
        "--gradient-threshold",
        "GREY/PX",
        POSITIVE,
        "Largest gradient inside a region",
        shown="60 % below",
    ),
    Option(
        PLANES,
        "--merge-px",
        "PX",
        POSITIVE,
        "Merge regions whose planes agree to this",
        Options.merge_px,
    ),
)


def frame_options(up: str = str(Options.up), shown: str | None = None) -> tuple[Option, ...]:
    """Options of the reference of slopes, with a command's own default for the vertical, shown as it says."""
    return (
        Option(
            FRAME,
            "--up",
            "VERTICAL",
            UP,
            "What is up: camera (looks straight down), dominant-plane (is level), or a vector X,Y,Z",
            up,
            shown=shown,
        ),
        Option(
            FRAME,
            "--up-sigma up_sigma_deg",
            "DEG",
            Between(0, 90, max_open=True),
            "1-sigma of the vertical",
            Options.up_sigma_deg,
        ),
        Option(FRAME, "--north", "X,Y,Z", VECTOR, "Where aspect is 0, camera-1 axes", shown="image's up"),
    )


scale_options = (
    Option(FRAME, "--baseline baseline_m", "M", POSITIVE, "Distance between the cameras, for metres"),
    Option(FRAME, "--altitude altitude_m", "M", POSITIVE, "Height of camera 1 above ground, for metres"),
)

prior_options = (
    Option(
        PRIOR,
        "--rotation-prior",
        "R,SIGMA",
        ROTATION_PRIOR,
        "R = RX,RY,RZ (deg) or QW,QX,QY,QZ, camera 2 from camera 1; its 1-sigma, deg",
    ),
    Option(
        PRIOR,
        "--direction-prior",
        "D,SIGMA",
        DIRECTION_PRIOR,
        "D = X,Y,Z to camera 2; its 1-sigma, deg",
    ),
    Option(
        PRIOR,
        "--pose pose_file",
        "FILE",
        PATH,
        'Known motion, JSON: "R" (3x3), "T" (metres).',
    ),
    Option(
        PRIOR,
        "--pose-sigma pose_sigma_deg",
        "DEG",
        ANGLE,
        "1-sigma of the pose",
        shown="exact",
    ),
)

decision_options = (
    Option(
        DECISION, "--tolerance tolerance_deg", "DEG", ANGLE, "The steepest slope that is safe", Options.tolerance_deg
    ),
    Option(
        DECISION,
        "--confidence",
        "P",
        Between(0.5, 1, min_open=True, max_open=True),
        "Probability needed for a verdict",
        Options.confidence,
    ),
    Option(
        DECISION,
        "--max-sigma max_sigma_deg",
        "DEG",
        Between(0, MOST_SIGMA_DEG, min_open=True),
        "Largest 1-sigma of a slope that is told",
        Options.max_sigma_deg,
    ),
)

solver_options = (
    Option(
        SOLVER,
        "--solver",
        None,
        choices_of("solver"),
        "Joint least squares (mle), homography alignment (ha) or Longuet-Higgins (lh)",
        Options.solver,
    ),
    Flag(SOLVER, "--merge-coplanar", "Solve coplanar and parallel planes as such"),
)
matching_options = (
    Option(
        SOLVER,
        "--features",
        None,
        choices_of("features"),
        "Image features; foerstner: the paper's",
        Options.features,
    ),
    Option(SOLVER, "--seed", "N", SEED, "Of random sampling; same seed, same bytes", Options.seed),
)


def _set_talk(ctx: click.Context, parameter: click.Parameter, value: bool) -> None:
    talk: Talk = ctx.ensure_object(Talk)
    setattr(talk, str(parameter.name), value)
    if talk.verbose and talk.quiet:
        raise click.UsageError("-v and -q contradict each other; give one.", ctx)


def talk_options(verbose: str = "Time of every stage") -> tuple[Option, ...]:
    """How much is said on stderr; `verbose` says what more -v gives."""
    return (
        Flag(GENERAL, "-v --verbose", verbose, expose_value=False, callback=_set_talk),
        Flag(GENERAL, "-q --quiet", "Only errors on stderr", expose_value=False, callback=_set_talk),
    )
