"""Options under headings of `--help`, and those that several commands have: one row an option, one tuple a group.

Names of parameters are those of `Options`, and so are the defaults. A command takes a group by naming it in its
`params`; in a group the everyday options come first.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from functools import partial
from typing import Any

import click
from click.core import ParameterSource

from slopecli.cli import parameter_types as kinds
from slopecli.cli.parameter_types import PATH, POSITIVE, VECTOR, Between, Whole, choices_of, inside
from slopecli.cli.talk import Talk
from slopecli.options import MOST_SIGMA_DEG, MapOptions, Options
from slopecli.patches import FINDERS, PLANE_FINDERS
from slopecli.products import BY_DEFAULT, CHOICES, MAP_PRODUCTS, PRODUCTS, Product

INPUT, OUTPUT, PLANES, FRAME = "Input", "Output", "Windows and planes", "Frame and scale"
MAP = "Map and landing sites"
PRIOR, DECISION, SOLVER, GENERAL = "Prior knowledge", "Decision", "Solver", "General"
SETTINGS = "slopemap settings file"  # key of a context's `meta`
CONFIG_HELP = "TOML file of options; the command line comes first"
NAMES_WIDTH = 27  # characters, so that the lists of a help text line up


class Option(click.Option):
    """An option under a heading of `--help`. Its line there has the default; the range is said when a value is refused.

    Parameters
    ----------
    heading : the list that it stands in.
    names : its flags and, where it differs from them, the name of the parameter, separated by spaces.
    metavar : what stands for its value; None to show the choices of `kind`.
    kind : type of its value.
    help : one plain sentence, without a full stop.
    default : value where it is not given.  shown : what the help calls that, the value itself by default.
    of : a class with a field of the parameter's name, whose default it takes.
    """

    def __init__(
        self,
        heading: str,
        names: str,
        metavar: str | None,
        kind: Any,
        help: str,
        default: Any = None,
        *,
        shown: str | None = None,
        of: type | None = None,
        **attributes: Any,
    ) -> None:
        super().__init__(names.split(), metavar=metavar, type=kind, help=help, default=default, **attributes)
        self.heading = heading
        if of is not None:
            self.default = default = getattr(of, str(self.name))
        if isinstance(default, tuple):  # as a user would write it
            separator = "x" if "x" in str(metavar) else ","
            self.default = default = separator.join(part if isinstance(part, str) else f"{part:g}" for part in default)
        shown = shown or (None if default is None else str(default))
        self.line = help if shown is None else f"{help}  [{shown}]"
        self.names = ""  # what stands on the left in place of its own flags, "" for these

    def process_value(self, ctx: click.Context, value: Any) -> Any:
        """The value as the program takes it; one out of a settings file is refused with the name of that file."""
        try:
            return super().process_value(ctx, value)
        except click.BadParameter as error:
            if ctx.get_parameter_source(str(self.name)) is not ParameterSource.DEFAULT_MAP:
                raise
            raise click.BadParameter(f"{error.message} It stands in {ctx.meta[SETTINGS]}.", ctx, self) from error

    def get_help_record(self, ctx: click.Context) -> tuple[str, str] | None:
        """What stands on the left, and on the right, of its line in the help."""
        record = super().get_help_record(ctx)
        return record and (self.names or record[0], self.line)


def unlisted(option: Option) -> Option:
    """The same option, not shown by `--help`."""
    hidden = copy(option)
    hidden.hidden = True
    return hidden


class Flag(Option):
    """An option without a value."""

    def __init__(self, heading: str, names: str, help: str, **attributes: Any) -> None:
        super().__init__(heading, names, None, None, help, is_flag=True, **attributes)
        self.default = False


class Command(click.Command):
    """A command whose `--help` prints options under their headings; what has none stands under "General"."""

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the lists, those of the options named first first."""
        lists: dict[str, list[tuple[str, str]]] = {}
        for parameter in self.get_params(ctx):
            record = parameter.get_help_record(ctx) if isinstance(parameter, click.Option) else None
            if record:
                lines = lists.setdefault(getattr(parameter, "heading", GENERAL), [])
                lines.append((record[0].ljust(NAMES_WIDTH), record[1].removesuffix(".")))
        for heading, lines in lists.items():
            with formatter.section(heading):
                formatter.write_dl(lines, col_max=NAMES_WIDTH)
        formatter.write_paragraph()
        formatter.write("Values in [brackets] are defaults.\n")


_option = partial(Option, of=Options)

camera = Option(INPUT, "--camera", "FILE", PATH, "Camera file; FILE#NAME: one of several in it")
camera2 = Option(INPUT, "--camera2", "FILE", PATH, "Camera file of image 2, if it has another")
intrinsics_options = (
    Option(INPUT, "--intrinsics", "FX,FY,CX,CY", kinds.INTRINSICS, "Instead of a file: px, no distortion"),
    Option(INPUT, "--fov", "DEG", inside(0, 180), "Instead of a file: horizontal field of view"),
)
size = Option(INPUT, "--size", "WxH", kinds.SIZE, "Image size, px, for --fov and --intrinsics")
camera_options = (camera, camera2, *intrinsics_options)


def _set_talk(ctx: click.Context, parameter: click.Parameter, value: bool | str) -> None:
    talk: Talk = ctx.ensure_object(Talk)
    setattr(talk, str(parameter.name), value)
    if talk.verbose and talk.quiet:
        raise click.UsageError("-v and -q contradict each other; give one.", ctx)


all_flag = Flag(OUTPUT, "--all every", "Also list small, poor and refused planes")
json_flag = Flag(OUTPUT, "--json as_json", "Print slopes.json instead of the table")


def _product_flag(choice: str, rows: Sequence[Product] = PRODUCTS) -> Flag:
    """The flag that declines or asks for the files of one of the user's choices."""
    products = [product for product in rows if product.choice == choice]
    does = "Leave out" if products[0].by_default else "Also write"
    of = {"": "", "found": " (of planes found)", "segmentation": " (of regions)"}[products[0].requires]
    names = " and ".join(product.file for product in products)
    what = names if len(products) < 3 else f"{len(products)} pictures of the steps"
    return Flag(OUTPUT, products[0].flag, f"{does} {what}{of}")


report_flag = _product_flag("report")  # of all commands alike
_others = sorted(set(CHOICES) - {"report"}, key=lambda choice: (choice not in BY_DEFAULT, CHOICES.index(choice)))
file_options = tuple(map(_product_flag, _others))
_folder = Option(OUTPUT, "-o --output", "DIR", PATH, "Folder for the results; optional with --json")
_FRAME_HELP = "Of PLY files: up (z is up) or camera"
ply_frame = Option(OUTPUT, "--ply-frame", "AXES", kinds.choices_of("ply_frame"), _FRAME_HELP, of=Options)
_UNIT_HELP = "Shown: deg, percent or x-in-12"
slope_unit = Option(OUTPUT, "--slope-unit", "UNIT", kinds.choices_of("slope_unit"), _UNIT_HELP, of=Options)
output_options = (_folder, json_flag, slope_unit, report_flag, *file_options, ply_frame)
map_file_options = tuple(_product_flag(choice, MAP_PRODUCTS) for choice in ("pictures", "ply"))
map_output_options = (_folder, json_flag, slope_unit, report_flag, *map_file_options, ply_frame)

_map = partial(Option, of=MapOptions)
map_options = (
    _map(MAP, "--footprint footprint_px", "PX", POSITIVE, "Diameter of a slope's disc", shown="short side / 16"),
    _map(MAP, "--footprint-m", "M", POSITIVE, "The same on the ground, in metres"),
    _map(MAP, "--spacing spacing_px", "PX", Whole(1), "Between places of the map", shown="footprint / 8"),
    _map(MAP, "--sites", "N", Whole(0, 99), "Landing sites listed"),
    _map(MAP, "--site-radius", "R", POSITIVE, "Their radius, px; m with a scale", shown="largest"),
    _map(MAP, "--max-height", "H", POSITIVE, "Largest height off a safe footprint's plane"),
    _map(MAP, "--lander", "PADS,D[,PAD]", kinds.LANDER, "Stands on pads on a circle of diameter D"),
    _map(MAP, "--classes classes_deg", "DEG,DEG", kinds.CLASSES, "Edges of classes drawn"),
)
_WINDOWS_HELP = "A window, px; repeat for more, in order of id"
_TOLD, _FOUND = (
    ", ".join(one.choice for one in FINDERS if one.choice and one.found is found) for found in (False, True)
)
_PLANES_HELP = f"{_TOLD}; or found: {_FOUND}"
window_options = (
    _option(PLANES, "--grid", "COLSxROWS", kinds.GRID, "Equal windows that cover image 1"),
    Option(PLANES, "--window windows", "X,Y,W,H", kinds.WINDOW, _WINDOWS_HELP, multiple=True),
)
finder_options = (_option(PLANES, "--planes", "NAME", click.Choice(list(PLANE_FINDERS)), _PLANES_HELP),)
region_options = (
    _option(
        PLANES,
        "--min-region min_region_percent",
        "PERCENT",
        Between(0, 100, min_open=True),
        "Smallest plane found, % of image 1",
    ),
    _option(PLANES, "--gradient-threshold", "GREY", POSITIVE, "Largest per px inside a region", shown="60 % below"),
    _option(PLANES, "--merge-px", "PX", POSITIVE, "Merge regions whose planes agree to this"),
)


def frame_options(up: str = str(Options.up), shown: str | None = None) -> tuple[Option, ...]:
    """Options of the reference of slopes, with a command's own default for the vertical, shown as it says."""
    what = "camera (axis), dominant-plane, X,Y,Z"
    return (
        Option(FRAME, "--up", "VERTICAL", kinds.UP, what, up, shown=shown),
        _option(FRAME, "--up-sigma up_sigma_deg", "DEG", Between(0, 90, max_open=True), "1-sigma of the vertical"),
        _option(FRAME, "--north", "X,Y,Z", VECTOR, "Where aspect is 0, camera-1 axes", shown="image's up"),
    )


_ROTATION_HELP = "R: RX,RY,RZ, deg, or QW,QX,QY,QZ; 1-sigma, deg"
_DIRECTION_HELP = "D = X,Y,Z to camera 2; its 1-sigma, deg"
_SOLVERS_HELP = "Joint (mle), alignment (ha), linear (lh)"
solving_options = (
    _option(FRAME, "--baseline baseline_m", "M", POSITIVE, "Distance between the cameras, for metres"),
    _option(FRAME, "--altitude altitude_m", "M", POSITIVE, "Height of camera 1 above ground, for metres"),
    _option(FRAME, "--scale-sigma scale_sigma_percent", "PERCENT", Between(0, 30), "1-sigma of that length, %"),
    Option(PRIOR, "--rotation-prior", "R,SIGMA", kinds.ROTATION_PRIOR, _ROTATION_HELP),
    Option(PRIOR, "--direction-prior", "D,SIGMA", kinds.DIRECTION_PRIOR, _DIRECTION_HELP),
    Option(PRIOR, "--pose pose_file", "FILE", PATH, 'Known motion, JSON: "R" (3x3), "T" (metres).'),
    Option(PRIOR, "--pose-sigma pose_sigma_deg", "DEG", inside(0, 90), "1-sigma of the pose", shown="exact"),
    _option(
        PRIOR,
        "--focal-sigma focal_sigma_percent",
        "PERCENT",
        Between(0, 30),
        "1-sigma of the focal length",
        shown="3 with --fov",
    ),
    Flag(PRIOR, "--free-focal", "Solve for the focal length, too"),
    _option(DECISION, "--tolerance tolerance_deg", "DEG", inside(0, 90), "The steepest slope that is safe"),
    _option(DECISION, "--confidence", "P", inside(0.5, 1), "Probability needed for a verdict"),
    _option(
        DECISION,
        "--max-sigma max_sigma_deg",
        "DEG",
        Between(0, MOST_SIGMA_DEG, min_open=True),
        "Largest 1-sigma of a slope that is told",
    ),
    _option(SOLVER, "--solver", None, choices_of("solver"), _SOLVERS_HELP),
    Flag(SOLVER, "--merge-coplanar", "Solve coplanar and parallel planes as such"),
)
seed = _option(SOLVER, "--seed", "N", kinds.SEED, "Of random sampling; same seed, same bytes")
EXIF = "exif"  # stands for what the metadata of the images state
_WIDER = {  # options that take that word too, and what their help says then
    "camera": "Camera file (#NAME: one of several), or exif",
    "camera2": "Camera file of image 2, if another, or exif",
    "up": "camera, dominant-plane, X,Y,Z or exif",
    "north": "Aspect 0, or exif; --north-sigma",
    "baseline_m": "Distance between the cameras, m, or exif",
    "altitude_m": "Height of camera 1 above ground, m, or exif",
}
metadata_options = (
    unlisted(_option(FRAME, "--north-sigma north_sigma_deg", "DEG", Between(0, 90, max_open=True), "1-sigma of north")),
    Flag(FRAME, "--metadata", "All that EXIF and XMP state, as by each exif"),
    Option(FRAME, "--pitch pitch_deg", "DEG", Between(-360, 360), "Of camera 1: -90 is down; yaw from north"),
    unlisted(Option(FRAME, "--roll roll_deg", "DEG", Between(-360, 360), "Clockwise about the line of sight")),
    unlisted(Option(FRAME, "--yaw yaw_deg", "DEG", Between(-360, 360), "Heading, clockwise from true north")),
)
metadata_options[2].names = "--pitch, --roll, --yaw DEG"
_PLACE_HELP = "Of camera 1, WGS 84; --position-sigma M  [3]"
place_options = (
    Option(FRAME, "--position", "LAT,LON[,ALT]", kinds.POSITION, _PLACE_HELP),
    unlisted(Option(FRAME, "--position-sigma position_sigma_m", "M", POSITIVE, "1-sigma north and east, each", 3)),
)


def or_exif(options: Sequence[Option]) -> tuple[Option, ...]:
    """The same options, of which those that can be taken from metadata of the images take the word exif too."""
    return tuple(_or_exif(option) if option.name in _WIDER else option for option in options)


def _or_exif(option: Option) -> Option:
    wider = copy(option)
    wider.type = kinds.OrWord(option.type, EXIF)
    _, bracket, shown = option.line.partition("  [")
    wider.line = f"{_WIDER[str(option.name)]}{bracket}{shown}"
    return wider


pair_camera_options = or_exif(camera_options)
pair_solving_options = or_exif(solving_options)


def pair_frame_options(up: str = str(Options.up), shown: str | None = None) -> tuple[Option, ...]:
    """As `frame_options`, of commands that have images, whose metadata may state what is up."""
    return (*or_exif(frame_options(up, shown)), *metadata_options)


matching_options = (
    _option(SOLVER, "--features", None, choices_of("features"), "Image features; foerstner: the paper's"),
    seed,
)


def _take_settings(ctx: click.Context, _: click.Parameter, path: str | None) -> None:
    """Let a settings file give what the command line does not."""
    if path is None:
        return
    from slopecli.cli.app import slopemap
    from slopecli.io.settings_files import read_settings

    ctx.meta[SETTINGS] = path
    commands = {name: _spellings(slopemap.commands[name]) for name in slopemap.commands}
    ctx.default_map = {**(ctx.default_map or {}), **read_settings(path, commands, str(ctx.info_name))}


def _spellings(command: click.Command) -> dict[str, str]:
    """Options of a command as users write them, without dashes in front, and the names of their parameters."""
    options = [one for one in command.params if isinstance(one, click.Option) and one.expose_value]
    return {flag.lstrip("-"): str(one.name) for one in options for flag in one.opts if flag.startswith("--")}


def talk_options(verbose: str = "Time of every stage") -> tuple[Option, ...]:
    """How much is said on stderr; `verbose` says what more -v gives."""
    say_more = Flag(GENERAL, "-v --verbose", f"{verbose}; or only errors", expose_value=False, callback=_set_talk)
    say_more.names = "-v, --verbose; -q, --quiet"
    return (
        unlisted(
            Option(
                GENERAL,
                "--config",
                "FILE",
                PATH,
                CONFIG_HELP,
                expose_value=False,
                is_eager=True,
                callback=_take_settings,
            )
        ),
        say_more,
        unlisted(Flag(GENERAL, "-q --quiet", "Only errors on stderr", expose_value=False, callback=_set_talk)),
    )
