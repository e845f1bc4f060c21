"""The planes of a report as a table of pandas."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from slopecli.errors import InputError
from slopecli.types import Plane, Report

if TYPE_CHECKING:
    from pandas import DataFrame

NUMBERS = (
    "slope_deg",
    "slope_sigma_deg",
    "aspect_deg",
    "dip_direction_deg",
    "azimuth_sigma_deg",
    "distance",
    "roughness",
    "p_safe",
    "rms_px",
)
OTHERS = ("source", "n_correspondences", "n_inliers", "verdict", "status", "reason")


def report_to_dataframe(report: Report) -> DataFrame:
    """The planes of a report, a row a plane under its id, in the columns of slopes.json.

    Intervals and vectors have a column a number; `other_slope_deg` is the slope in the second root, NaN where there is
    none. A slope that is not known has its numbers, as in slopes.json: see `slope_sigma_deg`. `attrs["unit"]` is the
    unit of lengths.

    Raises
    ------
    InputError : pandas is not installed.
    """
    try:
        import pandas
    except ImportError:
        raise InputError(
            "to_dataframe needs pandas, which is not installed: pip install pandas; to_json and planes.csv do without"
        ) from None
    rows = [_row(plane, report) for plane in report.planes]
    frame = pandas.DataFrame(rows, index=pandas.Index([plane.id for plane in report.planes], name="id"))
    frame.attrs["unit"] = report.scale.unit
    return frame


def _row(plane: Plane, report: Report) -> dict[str, Any]:
    low, high = plane.slope_ci95_deg or (None, None)
    other = report.ambiguity.others.get(plane.id)
    numbers = {
        **{name: getattr(plane, name) for name in NUMBERS},
        "slope_ci95_low_deg": low,
        "slope_ci95_high_deg": high,
        "other_slope_deg": None if other is None else other.slope_deg,
        **{f"normal_{axis}_cam1": value for axis, value in zip("xyz", plane.normal_cam1.tolist(), strict=True)},
    }
    known = {name: math.nan if value is None else float(value) for name, value in numbers.items()}
    return {**known, **{name: getattr(plane, name) for name in OTHERS}}
