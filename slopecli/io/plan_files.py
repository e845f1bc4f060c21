"""Writing plan.json and plan.png."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

from slopecli import __version__
from slopecli.io.outputs import check_directory, store_outputs
from slopecli.plan.planned import Plan
from slopecli.products.slopes_json import to_json

PLAN, MAP = "plan.json", "plan.png"
NAMES = (MAP, PLAN)  # the plan comes last: where it is, the map is
SCHEMA_VERSION = "1.0"


def plan_to_json(plan: Plan) -> str:
    """Serialise a plan as the text of plan.json, without a final newline; keys as in `Plan`, the same bytes always."""
    body = {field.name: getattr(plan, field.name) for field in fields(plan)}
    return to_json({"schema_version": SCHEMA_VERSION, "slopemap_version": __version__, **body})


def check_plan_directory(directory: str | Path) -> None:
    """Raise InputError if a plan could not be written to a folder. Makes and changes nothing."""
    check_directory(directory, NAMES)


def write_plan(plan: Plan, directory: str | Path) -> list[Path]:
    """Write plan.json and plan.png, both or none, to a folder, made if missing.

    Returns
    -------
    Their paths.

    Raises
    ------
    InputError : the folder cannot be made or written to.
    DiskFull : there is no space left.
    """
    from slopecli.plan.plan_map import draw_plan
    from slopecli.products.drawing.png import encode_picture

    contents = {PLAN: (plan_to_json(plan) + "\n").encode("ascii"), MAP: encode_picture(draw_plan(plan))}
    return store_outputs(contents, directory, NAMES)
