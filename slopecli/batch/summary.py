"""The outcomes of a batch as files: summary.csv for spreadsheets, results.jsonl for programs."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterable
from dataclasses import asdict
from io import StringIO
from typing import Any

from slopecli.batch.jobs import Outcome

FILES = SUMMARY, RESULTS, PAGE = "summary.csv", "results.jsonl", "index.html"
# Attributes of Outcome in the order of the columns of summary.csv.
COLUMNS = (
    "name",
    "image1",
    "image2",
    "exit_status",
    "code",
    "n_planes",
    "n_ok",
    "n_safe",
    "n_unsafe",
    "n_undecided",
    "n_rejected",
    "steepest_deg",
    "steepest_sigma_deg",
    "steepest_other_deg",
    "steepest_other_sigma_deg",
    "ambiguity",
    "noise_px",
    "diagnostics",
    "message",
    "remedy",
)
FORMULA_STARTS = ("=", "+", "-", "@", "\t", "\r")  # of texts that spreadsheets would evaluate


def summary_csv(outcomes: Iterable[Outcome]) -> bytes:
    """A header and one row per pair in the order given, UTF-8; an unknown value is an empty cell.

    Codes of diagnostics are joined by spaces. An apostrophe is put before text that a spreadsheet would evaluate as a
    formula, as file names may come from anybody.
    """
    table = StringIO()
    writer = csv.writer(table, lineterminator="\n")
    writer.writerow(COLUMNS)
    writer.writerows([_cell(getattr(outcome, column)) for column in COLUMNS] for outcome in outcomes)
    return encode_text(table.getvalue())


def results_jsonl(outcomes: Iterable[Outcome]) -> bytes:
    """One JSON object per line and pair in the order given, keys as in `Outcome`; ASCII, no NaN."""
    lines = [json.dumps(_plain(asdict(outcome)), allow_nan=False) + "\n" for outcome in outcomes]
    return "".join(lines).encode("ascii")


def encode_text(text: str) -> bytes:
    """UTF-8; undecodable bytes of file names become backslash escapes."""
    return text.encode("utf-8", "backslashreplace")


def _cell(value: Any) -> Any:
    value = _plain(value)
    if isinstance(value, list):
        value = " ".join(value)
    if isinstance(value, str) and value.startswith(FORMULA_STARTS):
        return f"'{value}"
    return "" if value is None else value


def _plain(value: Any) -> Any:
    """Numbers rounded as in slopes.json, None for those that are not finite; tuples as lists."""
    if isinstance(value, float):
        return float(f"{value:.9g}") if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, list | tuple) else value
