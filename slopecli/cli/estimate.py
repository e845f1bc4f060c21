"""`slopemap estimate`: slopes of windows, or of planes found, from one pair of images."""

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
        *shared.window_options,
        *shared.finder_options,
        *shared.region_options,
        *shared.frame_options(),
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
def estimate(ctx: click.Context, image1: str, image2: str, **parameters: Any) -> None:
    """Slopes of windows of IMAGE1 from two overlapping images.

    Prints a table; -o DIR also writes slopes.json, labels.png, overlay.png and patches.ply. Vectors are in camera-1
    axes: x right, y down, z forward.

    \b
    Example:
      slopemap estimate first.png second.png --camera camera.json -o out
    """
    answer_pair(ctx, image1, image2, parameters)
