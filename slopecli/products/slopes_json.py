"""slopes.json: a report as JSON, a key for every field of `types.Report`; the layout and rounding of its text."""

from __future__ import annotations

import json
import math
from dataclasses import fields, is_dataclass
from functools import cache
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

import numpy as np

from slopecli import __version__
from slopecli.errors import expect
from slopecli.types import Image, Report

if TYPE_CHECKING:
    from slopecli.ground.slope_map import SlopeMap

SCHEMA_VERSION = "2.1"
SIGNIFICANT_DIGITS = 9  # 1e-9 of a rotation is 6e-8 deg; more digits would only record the processor's rounding
_ROUNDED = f"%.{SIGNIFICANT_DIGITS}g"
# written as labels.png, drawn on overlay.png and the steps; properties that follow from other keys
_NOT_IN_JSON = {"labels", "epipole1_px", "segmentation", "slope_known", "noun", "found", "size_given", "note"}
_LEFT_OUT_IF_NONE = {"rms_mrad", "noise_mrad"}  # only of correspondences without a camera


def encode(report: Report, image: Image) -> bytes:
    """Return the content of slopes.json."""
    return (report_to_json(report) + "\n").encode("ascii")


def encode_map(slope_map: SlopeMap, image: Image) -> bytes:
    """Return the content of slopes.json of a map: that of its report, and the keys "map" and "sites"."""
    return (map_to_json(slope_map) + "\n").encode("ascii")


def map_to_json(slope_map: SlopeMap) -> str:
    """Serialise a map as `report_to_json` does its report, without its cells, which are in slope_map.tif."""
    return to_json({**report_document(slope_map.report), **map_keys(slope_map)})


def map_keys(slope_map: SlopeMap) -> dict[str, Any]:
    """The keys of slopes.json that a map has besides those of its report."""
    from slopecli.ground.slope_map import MapInfo
    from slopecli.products.map_tiff import BANDS, MAP_FILE

    info = MapInfo(
        file=MAP_FILE,
        spacing_px=slope_map.spacing_px,
        footprint_px=slope_map.footprint_px,
        footprint=slope_map.footprint,
        bands=BANDS,
        valid_share=float(slope_map.known.sum() / max(slope_map.known.size, 1)),
        area_share=slope_map.area_share,
        median_sigma_deg=slope_map.median_sigma_deg,
        median_sigma_causes_deg=slope_map.sigma_causes_deg,
    )
    return {"map": info, "sites": slope_map.sites}


def report_to_json(report: Report) -> str:
    """Serialise a report as the text of slopes.json, without a final newline.

    The same report gives the same bytes on every run: keys in the order of the dataclasses, numbers rounded to
    `SIGNIFICANT_DIGITS`, ASCII only. A number that is not finite becomes null.

    Raises
    ------
    TypeError : the options hold an object that has no JSON form.
    """
    expect("report", report, Report, "as estimate returns it")
    return to_json(report_document(report))


def report_document(report: Report) -> dict[str, Any]:
    """The keys of slopes.json of a report, with its version first."""
    answer = {name: getattr(report, name) for name in _names(Report)}
    return {"schema_version": SCHEMA_VERSION, "slopemap_version": __version__, **answer}


def to_json(document: dict[str, Any]) -> str:
    """Serialise dataclasses, arrays and numbers in a document as `report_to_json` does those of a report."""
    return _layout(plain(document))


def plain(value: Any) -> Any:
    """Reduce dataclasses, arrays and numpy scalars to what JSON knows."""
    kind = type(value)
    if kind is float:  # first, as most values are
        # what is left of an exact zero after arithmetic has other digits on every machine
        return 0.0 if abs(value) < 1e-12 else rounded(value)
    if value is None or kind is str or kind is int or kind is bool:
        return value
    if kind is list or kind is tuple:
        return [plain(item) for item in value]
    if is_dataclass(kind):
        shown = [(name, getattr(value, name)) for name in _names(kind)]
        return {name: plain(item) for name, item in shown if item is not None or name not in _LEFT_OUT_IF_NONE}
    return _plain_of_other(value)


def _plain_of_other(value: Any) -> Any:
    """`plain` of dictionaries, arrays, and what stands for a plain value."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, float):
        return plain(float(value))
    return str(value) if isinstance(value, PurePath) else value


@cache
def _names(kind: type) -> tuple[str, ...]:
    """Names of the fields of a dataclass that are written."""
    return tuple(field.name for field in fields(kind) if field.name not in _NOT_IN_JSON)


def rounded(value: float) -> float | None:
    """Round to `SIGNIFICANT_DIGITS`; None for what is not finite."""
    if not math.isfinite(value):
        return None
    return float(_ROUNDED % value) + 0.0  # which drops the sign of -0.0


_encoded = json.JSONEncoder(allow_nan=False).encode  # one encoder: a value alone takes less time than to make one
_WORDS = {None: "null", True: "true", False: "false"}


@cache
def _key(name: str) -> str:
    return f"{_encoded(name)}: "


def _layout(value: Any, indent: str = "", before: str = "") -> str:
    """Indent by two, but keep on one line whatever fits: a matrix reads better in a row than in nine."""
    kind = type(value)
    if kind is float:
        return before + repr(value)
    if kind is not dict and kind is not list:
        return before + (_WORDS[value] if value is None or kind is bool else _encoded(value))
    inner = indent + "  "
    if kind is dict:
        opened, closed = "{}"
        items = [_layout(item, inner, _key(key)) for key, item in value.items()]
    else:
        opened, closed = "[]"
        items = [_layout(item, inner) for item in value]
    compact = f"{before}{opened}{', '.join(items)}{closed}"  # too long, too, where an item takes several lines
    if len(compact) <= 110 - len(indent):  # characters
        return compact
    return before + opened + ",".join([f"\n{inner}{item}" for item in items]) + f"\n{indent}{closed}"
