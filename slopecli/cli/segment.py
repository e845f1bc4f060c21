"""`slopemap segment`: every plane of an urban scene, found in the image itself."""

from __future__ import annotations

from typing import Any

import click

from slopecli.cli import shared_options as shared
from slopecli.cli.groups import Command
from slopecli.cli.pair import answer_pair
from slopecli.cli.parameter_types import PATH


@click.command(
    cls=Command,
    params=[
        *shared.camera_options,
        *shared.output_options,
        *shared.region_options,
        *shared.frame_options("dominant-plane"),
        *shared.scale_options,
        *shared.prior_options,
        *shared.decision_options,
        *shared.solver_options,
        *shared.matching_options,
        *shared.talk_options(),
    ],
)
@click.argument("image1", type=PATH)
@click.argument("image2", type=PATH)
@click.pass_context
def segment(ctx: click.Context, image1: str, image2: str, **parameters: Any) -> None:
    """Ground, walls and roofs, found in IMAGE1 itself.

    Prints a table, the largest plane first; -o DIR also writes slopes.json, overlay.png, the planes as coloured and as
    textured meshes (patches.ply, patches.glb) and labels.png. The largest plane is taken as level; if it is a wall,
    give --up X,Y,Z.

    \b
    Example:
      slopemap segment first.png second.png --camera camera.json -o out
    """
    answer_pair(ctx, image1, image2, {**parameters, "planes": "regions"})
