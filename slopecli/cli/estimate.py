"""`slopemap estimate`: slopes of windows, or of planes found, from one pair of images."""

from __future__ import annotations

from typing import Any

import click

from slopecli.cli.pair import answer_pair
from slopecli.cli.parameter_types import PATH
from slopecli.cli.shared_options import (
    camera_options,
    finder_options,
    frame_options,
    output_options,
    prior_options,
    region_options,
    scale_options,
    solving_options,
    talk_options,
    verdict_options,
    window_options,
)


@click.command()
@click.argument("image1", type=PATH)
@click.argument("image2", type=PATH)
@camera_options
@output_options
@finder_options
@window_options
@region_options
@frame_options
@scale_options
@prior_options
@verdict_options
@solving_options
@talk_options
@click.pass_context
def estimate(ctx: click.Context, image1: str, image2: str, **parameters: Any) -> None:
    """Slopes of windows of IMAGE1 from two overlapping images.

    Prints one line per window; -o DIR also keeps the answer as slopes.json, a picture (overlay.png), 3-D patches
    (patches.ply) and a map of window ids (labels.png). With --planes ransac or regions it finds the planes itself:
    one line per plane, and a textured model (patches.glb) too.

    \b
    Example:
      slopemap estimate first.png second.png --camera camera.json -o out
    """
    answer_pair(ctx, image1, image2, parameters)
