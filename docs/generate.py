"""Write what the documents quote: docs/cli.md, tables of rows, the examples and the pictures. `make docs` runs it.

`docs/generate.py tables` writes docs/cli.md, the schema of slopes.json and the tables only, which takes a second.
The tests call the same functions and compare, so that neither can drift from what the program does.
"""

from __future__ import annotations

import csv
import json
import re
import shlex
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import get_args

import click

from slopecli.cli import slopemap
from slopecli.findings.codes import CODES
from slopecli.io import load_schema
from slopecli.io.cameras import CAMERA_FORMATS
from slopecli.io.correspondences import MATCH_FORMATS
from slopecli.io.metadata import ATTITUDE_SOURCES, LENS_SOURCES
from slopecli.patches import FINDERS
from slopecli.products.slopes_json import SCHEMA_VERSION
from slopecli.report import CAUSES
from slopecli.types import CameraModel

ROOT = Path(__file__).resolve().parent.parent
README = ROOT / "README.md"
PACKAGE_PAGE = ROOT / "docs" / "package_page.md"
API = ROOT / "docs" / "api.md"
REFERENCE = ROOT / "docs" / "cli.md"
DIAGNOSTICS = ROOT / "docs" / "diagnostics.md"
SEGMENT = ROOT / "docs" / "segment.md"
CAMERAS = ROOT / "docs" / "cameras.md"
BATCH = ROOT / "docs" / "batch.md"
DRONE = ROOT / "docs" / "drone.md"
NEVER_SAFE = " While it stands, no verdict is safe."
PLAN = ROOT / "docs" / "plan.md"
SOLVE = ROOT / "docs" / "solve.md"
MAP = ROOT / "docs" / "map.md"
GIS = ROOT / "docs" / "gis.md"
VALIDATE = ROOT / "docs" / "validate.md"
IMAGES = ROOT / "docs" / "images"
SCHEMA = ROOT / "slopecli" / "schemas" / f"slopes-{SCHEMA_VERSION}.schema.json"
EXAMPLE = re.compile(r"```console\n\$ (?P<command>slopemap (?:[^\n]*\\\n)*[^\n]*)\n(?P<output>.*?)```", re.DOTALL)


def commands(command: click.Command, parent: click.Context | None = None) -> Iterator[tuple[str, str]]:
    """Path and help text of a command and of all below it."""
    settings = {**command.context_settings, "terminal_width": 80}
    context = click.Context(command, info_name=command.name, parent=parent, **settings)
    yield context.command_path, command.get_help(context)
    if isinstance(command, click.Group):
        for name in command.list_commands(context):
            yield from commands(command.commands[name], context)


def cli_reference() -> str:
    """docs/cli.md: the help of every command."""
    sections = [f"## {path}\n\n```text\n{text}\n```\n" for path, text in commands(slopemap)]
    return "# Command line reference\n\nMade from `--help` by `make docs`.\n\n" + "\n".join(sections)


def camera_formats_table() -> str:
    """The table of docs/cameras.md: a row a format."""
    rows = [
        ("format", "files", "recognised by", "lenses", "what is converted"),
        ("---",) * 5,
        *((f.name, f.files, f.recognised_by, f.lenses, f.converted) for f in CAMERA_FORMATS),
    ]
    return table(rows)


def match_formats_table() -> str:
    """The table of docs/solve.md: a row a format."""
    rows = [("format", "files", "what is read of it", "what is converted"), ("---",) * 4]
    return table([*rows, *((f.name, f.files, f.holds, f.converted) for f in MATCH_FORMATS)])


def lenses_table() -> str:
    """The table of docs/drone.md: a row a way in which focal lengths are stated."""
    return table([("stated", "tags"), ("---",) * 2, *((row.name, row.needs) for row in LENS_SOURCES)])


def attitudes_table() -> str:
    """The table of docs/drone.md: a row a set of names for angles."""
    rows = [("stated by", "XMP names", "angles are 0 where the camera", "1 sigma of up, of north"), ("---",) * 4]
    for row in ATTITUDE_SOURCES:
        zero = "looks down, the top of the image to the north" if row.of_body else "looks north along the horizon"
        names = " ".join(f"`{name}`" for name in row.angles)
        rows.append((row.name, names, zero, f"{row.tilt_sigma_deg:g}°, {row.yaw_sigma_deg:g}°"))
    return table(rows)


def table(rows: Sequence[Sequence[str]]) -> str:
    """A table of Markdown."""
    return "".join(f"| {' | '.join(row)} |\n" for row in rows).replace("|  |", "| |")


def rewrite_table(document: Path, table: str) -> None:
    """Replace the table of a document that has the same header."""
    header = re.escape(table.splitlines()[0])
    text = document.read_text(encoding="utf-8")
    document.write_text(re.sub(rf"^{header}\n(\|.*\n)*", lambda _: table, text, flags=re.MULTILINE), encoding="utf-8")


def codes_table() -> str:
    """The table of docs/diagnostics.md: a row a code and severity."""
    rows = [
        ("code", "severity", "value", "what was found, and why it matters", "what to do"),
        ("---",) * 5,
        *(
            (f"`{c.code}`", c.severity, c.value, c.meaning + NEVER_SAFE * c.forbids_safe, _sentence(c.remedy))
            for c in sorted(CODES, key=lambda row: row.code)
            if c.severity != "rejection"
        ),
    ]
    return table(rows)


def rejections_table() -> str:
    """The table of docs/diagnostics.md with the reasons of patches without an answer."""
    rows = [("reason", "what was found"), ("---",) * 2]
    return table([*rows, *((f"`{c.code}`", c.meaning) for c in CODES if c.severity == "rejection")])


def _sentence(remedy: str) -> str:
    marked = re.sub(r"(?<!`)--[a-z-]+(?: [A-Z]+)?", lambda option: f"`{option[0]}`", remedy)
    return f"{marked[:1].upper()}{marked[1:]}." if marked else ""


def run_example(command: str, folder: Path) -> str:
    """What a user sees on running a command of a document with the sample data at hand; outputs go into `folder`."""
    if not (folder / "sample_data").exists():
        (folder / "sample_data").symlink_to(ROOT / "sample_data")
    if " outcrop/" in command and not (folder / "outcrop").exists():
        subprocess.run(
            [sys.executable, str(ROOT / "sample_data" / "make_rock_pair.py"), folder / "outcrop"], check=True
        )
    if " slopemap_demo" in command and not (folder / "slopemap_demo").exists():
        subprocess.run([sys.executable, "-m", "slopecli", "demo", "-q"], cwd=folder, capture_output=True, check=True)
    arguments = shlex.split(command.replace("\\\n", " "))[1:]
    done = subprocess.run(
        [sys.executable, "-m", "slopecli", *arguments],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        encoding="utf-8",
        check=False,
    )
    if done.returncode:
        sys.exit(f"{command} ended with {done.returncode}: {done.stdout}")
    return done.stdout


def rewrite_examples(document: Path, folder: Path) -> None:
    """Put what its command prints now below the command of each of a document's console blocks."""
    text = document.read_text(encoding="utf-8")
    examples = list(EXAMPLE.finditer(text))
    if not examples:
        sys.exit(f"{document.name} has no console block with a slopemap command")
    for example in reversed(examples):
        output = run_example(example["command"], folder)
        text = text[: example.start("output")] + output + text[example.end("output") :]
    document.write_text(text, encoding="utf-8")


def strike_and_dip_table(planes_csv: Path) -> str:
    """The columns of a planes.csv that geologists read."""
    columns = ("id", "dip_deg", "slope_sigma_deg", "dip_direction_deg", "strike_deg", "azimuth_sigma_deg", "area")
    with planes_csv.open(encoding="ascii") as file:
        rows = [[one["id"], *(f"{float(one[name]):.1f}" for name in columns[1:])] for one in csv.DictReader(file)]
    return table([[f"`{name}`" for name in columns], ("---",) * len(columns), *rows])


def package_page() -> str:
    """README.md for a package index, where relative links lead nowhere: with links to the repository."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    home = project["urls"]["Homepage"]
    text = README.read_text(encoding="utf-8")
    text = re.sub(r"(!\[[^]]*\])\((?!https?:)([^)]+)\)", rf"\1({home}/raw/main/\2)", text)
    return re.sub(r"(?<!!)(\[[^]]*\])\((?!https?:|#)([^)]+)\)", rf"\1({home}/blob/main/\2)", text)


def schema() -> str:
    """The schema of slopes.json of this version, its lists of values as the rows have them."""
    document = load_schema()
    parts = document["$defs"]
    parts["plane"]["properties"]["source"]["enum"] = [finder.source for finder in FINDERS]
    parts["sigma_causes_deg"]["propertyNames"]["enum"] = list(CAUSES)
    parts["camera"]["properties"]["model"]["enum"] = list(get_args(CameraModel))
    return json.dumps(document, indent=2) + "\n"


def write_tables() -> None:
    """Write docs/cli.md, the tables made from rows, and the schema."""
    SCHEMA.write_text(schema(), encoding="utf-8")
    rewrite_table(CAMERAS, camera_formats_table())
    rewrite_table(SOLVE, match_formats_table())
    rewrite_table(DRONE, lenses_table())
    rewrite_table(DRONE, attitudes_table())
    PACKAGE_PAGE.write_text(package_page(), encoding="utf-8")
    from api_page import api_reference  # beside this script, as below

    API.write_text(api_reference(), encoding="utf-8")
    REFERENCE.write_text(cli_reference(), encoding="utf-8")
    rewrite_table(DIAGNOSTICS, codes_table())
    rewrite_table(DIAGNOSTICS, rejections_table())


def write_examples_and_pictures() -> None:
    """Run the examples of the documents and draw their pictures anew."""
    from pictures import (
        make_pictures,
        write_camera_picture,
        write_map_picture,
        write_validation_picture,
    )  # beside this script; the tests run the rest without that
    from study_figures import make_study_figures

    IMAGES.mkdir(exist_ok=True)
    for document in (README, CAMERAS, SEGMENT, BATCH, PLAN, SOLVE, MAP, GIS, VALIDATE):
        with tempfile.TemporaryDirectory() as folder:
            rewrite_examples(document, Path(folder))
            if document == CAMERAS:
                write_camera_picture(Path(folder) / "camera_shown" / "camera.png", IMAGES)
            if document == PLAN:
                (IMAGES / "plan.png").write_bytes(next(Path(folder).glob("*/plan.png")).read_bytes())
            if document == GIS:
                rewrite_table(GIS, strike_and_dip_table(Path(folder) / "bedding" / "planes.csv"))
            if document == VALIDATE:
                write_validation_picture(Path(folder) / "check" / "validation.png", IMAGES)
            if document == MAP:
                write_map_picture(Path(folder) / "map_output" / "map.png", IMAGES)
    with tempfile.TemporaryDirectory() as folder:
        make_pictures(Path(folder), IMAGES)
    make_study_figures(IMAGES)


if __name__ == "__main__":
    write_tables()
    if sys.argv[1:] != ["tables"]:
        write_examples_and_pictures()
