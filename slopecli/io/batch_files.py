"""summary.csv and results.jsonl: what every pair of a batch came to, for spreadsheets and for programs."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterable
from dataclasses import asdict
from io import StringIO
from typing import Any

from slopecli.orders import Outcome

SUMMARY, RESULTS = "summary.csv", "results.jsonl"
SIGNIFICANT_DIGITS = 9  # as in slopes.json
# of Outcome, in the order of the columns; what is long or only for programs stays in results.jsonl
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
FORMULA_STARTS = ("=", "+", "-", "@", "\t", "\r")  # a spreadsheet would compute a text that begins with one of these


def summary_csv(outcomes: Iterable[Outcome]) -> bytes:
    """One row per pair in the order given, under a header, UTF-8; what is not known is an empty cell.

    Codes of diagnostics are joined by spaces. Text that a spreadsheet would take for a formula has an apostrophe before
    it, as names of files are not ours to trust.
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
    """UTF-8; of a file name that is not text the strange bytes are written as backslash escapes."""
    return text.encode("utf-8", "backslashreplace")


def _cell(value: Any) -> Any:
    value = _plain(value)
    if isinstance(value, list):
        value = " ".join(value)
    if isinstance(value, str) and value.startswith(FORMULA_STARTS):
        return f"'{value}"
    return "" if value is None else value


def _plain(value: Any) -> Any:
    if isinstance(value, float):
        return float(f"{value:.{SIGNIFICANT_DIGITS}g}") if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, list | tuple) else value
