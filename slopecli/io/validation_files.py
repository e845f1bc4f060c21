"""Write a comparison with known ground: validation.csv, validation.png, validation.json."""

from __future__ import annotations

import csv
from dataclasses import asdict
from io import StringIO
from pathlib import Path
from typing import Any

from slopecli import __version__
from slopecli.io.outputs import store_outputs
from slopecli.products.slopes_json import SIGNIFICANT_DIGITS, to_json
from slopecli.validate.comparison import Comparison, PatchCompared
from slopecli.validate.finished_result import Result
from slopecli.validate.truth import Truth
from slopecli.validate.validation_figure import draw_validation

TABLE, PICTURE, NUMBERS = "validation.csv", "validation.png", "validation.json"
VALIDATION_NAMES = (TABLE, PICTURE, NUMBERS)  # the numbers come last: where they are, the others are
COLUMNS = (
    "id", "slope_deg", "true_slope_deg", "difference_deg", "sigma_deg", "sigmas", "normal_error_deg", "distance_ratio",
    "n_points", "true_rms", "verdict", "status",
)  # fmt: skip


def write_validation(result: Result, truth: Truth, comparison: Comparison, directory: str) -> list[Path]:
    """Write the files of a comparison to a folder as `store_outputs`; returns their paths."""
    contents = {
        NUMBERS: (comparison_json(comparison) + "\n").encode("ascii"),
        TABLE: comparison_csv(comparison),
        PICTURE: draw_validation(result, truth, comparison),
    }
    return store_outputs(contents, directory, VALIDATION_NAMES)


def comparison_json(comparison: Comparison) -> str:
    """The comparison as text: every patch, the scale, and for a map its cells."""
    patches = [{name: getattr(one, name) for name in COLUMNS} for one in comparison.patches]
    return to_json(
        {
            "slopemap_version": __version__,
            "scale": comparison.scale,
            "scale_spread": comparison.scale_spread,
            "planes": patches,
            "missing": list(comparison.missing),
            "cells": None if comparison.cells is None else asdict(comparison.cells),
        }
    )


def comparison_csv(comparison: Comparison) -> bytes:
    """A row for every patch; numbers in degrees and in the unit of the truth, empty where there is none."""
    text = StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    writer.writerows([_cell(one, name) for name in COLUMNS] for one in comparison.patches)
    return text.getvalue().encode("utf-8")


def _cell(one: PatchCompared, name: str) -> Any:
    value = getattr(one, name)
    if value is None:
        return ""
    return f"{value:.{SIGNIFICANT_DIGITS}g}" if isinstance(value, float) else value
