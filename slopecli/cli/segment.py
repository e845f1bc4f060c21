"""`slopemap segment`: every plane of an urban scene, found in the image itself."""

from __future__ import annotations

from typing import Any

import click

from slopecli.cli.pair import answer_pair
from slopecli.cli.parameter_types import PATH
from slopecli.cli.shared_options import (
    camera_options,
    frame_options_with,
    output_options,
    prior_options,
    region_options,
    scale_options,
    solving_options,
    talk_options,
    verdict_options,
)


@click.command()
@click.argument("image1", type=PATH)
@click.argument("image2", type=PATH)
@camera_options
@output_options
@region_options
@frame_options_with("dominant-plane")
@scale_options
@prior_options
@verdict_options
@solving_options
@talk_options
@click.pass_context
def segment(ctx: click.Context, image1: str, image2: str, **parameters: Any) -> None:
    """Ground, walls and roofs, found in IMAGE1 itself.

    Prints one line per plane, the largest first; -o DIR also keeps the answer as slopes.json, a picture (overlay.png),
    the planes as coloured meshes (patches.ply) and with the image as texture (patches.glb), and a map of their ids
    (labels.png). What is ground, wall or roof follows from what is level: the largest plane, if not told otherwise.
    Where that is a wall, give --up X,Y,Z.

    \b
    Example:
      slopemap segment first.png second.png --camera camera.json -o out
    """
    answer_pair(ctx, image1, image2, {**parameters, "planes": "regions"})
