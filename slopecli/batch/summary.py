"""The files that summarise a batch: summary.csv for spreadsheets, results.jsonl for programs, the page index.html."""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Iterable
from dataclasses import asdict, fields
from html import escape
from typing import Any, NamedTuple
from urllib.parse import quote

from slopecli import __version__
from slopecli.batch.jobs import Outcome
from slopecli.errors import ExitStatus, visible
from slopecli.products import MAP_PICTURE, OVERLAY

FILES = SUMMARY, RESULTS, PAGE = "summary.csv", "results.jsonl", "index.html"
LAST, NOT_SHOWN = ("message", "remedy"), ("fingerprint", "files")
# of summary.csv: attributes of Outcome, the long texts last
COLUMNS = (*(field.name for field in fields(Outcome) if field.name not in LAST + NOT_SHOWN), *LAST)
FORMULA_STARTS = ("=", "+", "-", "@", "\t", "\r")  # of texts that spreadsheets would evaluate


def summary_csv(outcomes: Iterable[Outcome]) -> bytes:
    """A header and one row per pair in the order given, UTF-8; an unknown value is an empty cell.

    Codes of diagnostics are joined by spaces. An apostrophe is put before text that a spreadsheet would evaluate as a
    formula, as file names may come from anybody. Ends of lines stay, quoted; what a terminal would obey is escaped.
    """
    rows = [COLUMNS, *([_csv_cell(getattr(outcome, column)) for column in COLUMNS] for outcome in outcomes)]
    return _encode_text("".join(",".join(map(_quoted, row)) + "\n" for row in rows))


def _quoted(cell: str) -> str:
    # Python's csv leaves a carriage return without quotes
    return '"{}"'.format(cell.replace('"', '""')) if re.search('[",\r\n]', cell) else cell


def results_jsonl(outcomes: Iterable[Outcome]) -> bytes:
    """One JSON object per line and pair in the order given, keys as in `Outcome`; ASCII, no NaN."""
    lines = [json.dumps(_plain(asdict(outcome)), allow_nan=False) + "\n" for outcome in outcomes]
    return "".join(lines).encode("ascii")


def _encode_text(text: str) -> bytes:
    return text.encode("utf-8", "backslashreplace")


def _csv_cell(value: Any) -> str:
    value = _plain(value)
    if isinstance(value, list):
        value = " ".join(value)
    if isinstance(value, str):
        text = f"'{value}" if value.startswith(FORMULA_STARTS) else value
        return re.sub(r"[^\r\n]+", lambda part: visible(part[0]), text)
    return "" if value is None else str(value)


def _plain(value: Any) -> Any:
    """Numbers rounded as in slopes.json, None for those that are not finite; tuples as lists."""
    if isinstance(value, float):
        return float(f"{value:.9g}") if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, list | tuple) else value


# ---- index.html ----


class Cell(NamedTuple):
    """html: what is shown. value: the sort key, "" if unknown (sorted last). kind: CSS class."""

    html: str
    value: str = ""
    kind: str = ""


HEADERS = "# picture pair result steepest safe unsafe undecided poor refused notes files"
MAP_HEADERS = "# picture pair result safe unsafe undecided unknown sites radius slope notes files"
WHAT, WHAT_OF_MAPS = (
    "Slopes in degrees; counts are of windows or planes.",
    "Percentages of image 1; sites to land on, and the largest of them: radius in px, slope in degrees.",
)
STYLE = """
:root { color-scheme: light dark; --ink: #1b1d21; --dim: #5f6672; --paper: #fff; --band: #f3f4f6; --line: #d9dce1;
  --link: #0b57b8; --bad: #b3261e; --bad-paper: #fdeeec; --good: #1b6e33; }
@media (prefers-color-scheme: dark) { :root { --ink: #e6e7ea; --dim: #a0a6b1; --paper: #17191d; --band: #22252b;
  --line: #383c44; --link: #8ab8ff; --bad: #ff9d94; --bad-paper: #37201e; --good: #86d39b; } }
body { margin: 1.5rem; font: 14px/1.45 system-ui, sans-serif; color: var(--ink); background: var(--paper); }
h1 { font-size: 1.35rem; margin: 0 0 .25rem; }
p { margin: .25rem 0 .75rem; }
a { color: var(--link); }
label { display: block; margin: 0 0 .75rem; }
input { font: inherit; color: inherit; background: var(--band); border: 1px solid var(--line); border-radius: 4px;
  padding: .25rem .5rem; width: 22rem; max-width: 100%; }
table { border-collapse: collapse; width: 100%; }
th { position: sticky; top: 0; background: var(--band); text-align: left; z-index: 1; }
th, td { padding: .4rem .6rem; border-bottom: 1px solid var(--line); vertical-align: top; }
th[data-by=number] { text-align: right; }
th button { all: unset; cursor: pointer; font-weight: 600; white-space: nowrap; }
th button:focus-visible { outline: 2px solid var(--link); outline-offset: 2px; }
th[aria-sort=ascending] button::after { content: " \\25B2"; }
th[aria-sort=descending] button::after { content: " \\25BC"; }
.number { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
.pair { overflow-wrap: anywhere; min-width: 11rem; }
.notes { max-width: 16rem; }
small { color: var(--dim); display: block; overflow-wrap: anywhere; }
tr.failed { background: var(--bad-paper); }
strong { font-weight: 600; color: var(--good); }
tr.failed strong { color: var(--bad); }
img { display: block; object-fit: contain; background: var(--band); }
.files a { display: block; white-space: nowrap; }
footer { color: var(--dim); margin-top: 1rem; }
"""

SCRIPT = """
const body = document.querySelector("tbody"), rows = [...body.rows], headers = [...document.querySelectorAll("th")];
const words = new Intl.Collator(undefined, { numeric: true });
const compare = { number: (a, b) => a - b, text: words.compare };
function sortBy(header) {
  const sign = header.ariaSort === "ascending" ? -1 : 1;
  const column = header.cellIndex, by = compare[header.dataset.by];
  headers.forEach(one => one.removeAttribute("aria-sort"));
  header.setAttribute("aria-sort", sign > 0 ? "ascending" : "descending");
  const keyed = rows.map(row => [row.cells[column].dataset.value || "", Number(row.cells[0].dataset.value), row]);
  keyed.sort(([a, i], [b, j]) => (a === "") - (b === "") || (a === "" ? 0 : sign * by(a, b)) || i - j);
  const sorted = document.createDocumentFragment();
  keyed.forEach(([, , row]) => sorted.append(row));
  body.append(sorted);
}
headers.filter(one => one.dataset.by).forEach(one => one.firstChild.addEventListener("click", () => sortBy(one)));
const box = document.querySelector("input");
const texts = rows.map(row => row.textContent.toLowerCase());
box.addEventListener("input", () => {
  const wanted = box.value.toLowerCase();
  rows.forEach((row, i) => { row.hidden = !texts[i].includes(wanted); });
});
box.parentElement.hidden = false;
"""


def index_html(outcomes: Iterable[Outcome]) -> bytes:
    """The page, UTF-8: a table with a row per pair, those without an answer first, otherwise in the order given.

    With JavaScript, columns can be sorted and rows filtered. Pictures are loaded when they come into view. Links are
    relative to the folder of the batch.
    """
    numbered = list(enumerate(outcomes, 1))
    maps = any(one.is_map for _, one in numbered)
    failed = sum(one.exit_status != 0 for _, one in numbered)
    rows = sorted(numbered, key=lambda row: row[1].exit_status == 0)
    answered = f"{len(rows) - failed} answered, {failed} without an answer" if failed else "all answered"
    headline = f"{len(rows)} pair{'s' * (len(rows) != 1)}, {answered}"
    return _encode_text(_page(headline, "\n".join(_row(*row, maps) for row in rows), maps))


def _page(headline: str, rows: str, maps: bool) -> str:
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>slopemap: {headline}</title>
<style>{STYLE}</style>
</head>
<body>
<h1>{headline}</h1>
<p>{WHAT_OF_MAPS if maps else WHAT} The same as a table: <a href="{SUMMARY}">{SUMMARY}</a>,
for programs: <a href="{RESULTS}">{RESULTS}</a>.</p>
<label hidden>Show rows with <input type="search" placeholder="a name, a code, a word"></label>
<table>
<thead><tr>{"".join(map(_header, (MAP_HEADERS if maps else HEADERS).split()))}</tr></thead>
<tbody>
{rows}
</tbody>
</table>
<footer>slopemap {__version__}</footer>
<script>{SCRIPT}</script>
</body>
</html>
"""


def _header(title: str) -> str:
    if title in ("picture", "files"):
        return f'<th scope="col">{title}</th>'
    by = "text" if title in ("pair", "result", "notes") else "number"
    return f'<th scope="col" data-by="{by}"><button type="button">{title}</button></th>'


def _row(number: int, outcome: Outcome, maps: bool) -> str:
    shown = "".join(map(_cell, _cells(number, outcome, maps)))
    return f'<tr class="{"failed" if outcome.exit_status else "answered"}">{shown}</tr>'


def _cell(cell: Cell) -> str:
    value = escape(visible(cell.value))
    attributes = f' class="{cell.kind}"' * bool(cell.kind) + f' data-value="{value}"' * bool(value)
    return f"<td{attributes}>{cell.html}</td>"


def _cells(number: int, outcome: Outcome, maps: bool) -> tuple[Cell, ...]:
    images = "<br>".join(_text(path) for path in (outcome.image1, outcome.image2) if path)
    files = "".join(f'<a href="{_address(outcome, name)}">{escape(name)}</a>' for name in outcome.files)
    return (
        Cell(str(number), str(number), "number"),
        _picture(outcome),
        Cell(f"{_text(outcome.name)}<small>{images}</small>", outcome.name, "pair"),
        _result(outcome),
        *(_ground_cells(outcome) if maps else _plane_cells(outcome)),
        _notes(outcome),
        Cell(files, kind="files"),
    )


def _plane_cells(outcome: Outcome) -> list[Cell]:
    poor, known = outcome.n_planes - outcome.n_ok, outcome.exit_status == 0
    counts = (outcome.n_safe, outcome.n_unsafe, outcome.n_undecided, poor, outcome.n_rejected)
    return [_steepest(outcome), *(_number(str(count) if known else "") for count in counts)]


def _ground_cells(outcome: Outcome) -> list[Cell]:
    """Shares of a map, and its largest site."""
    shares = [_number("" if share is None else f"{100 * share:.1f}", " %") for share in outcome.shares]
    radius, slope, sigma = outcome.site_radius_px, outcome.site_slope_deg, outcome.site_slope_sigma_deg
    within = "" if sigma is None else f" ± {sigma:.2f}°"
    return [
        *shares,
        _number(str(outcome.n_sites) if outcome.is_map else ""),
        _number("" if radius is None else f"{radius:.0f}", " px"),
        _number("" if slope is None else f"{slope:.2f}", within),
    ]


def _number(value: str, unit: str = "") -> Cell:
    """A number, or an empty cell where it is not known."""
    return Cell(f"{value}{unit}", value, "number") if value else Cell("", kind="number")


def _text(text: str) -> str:
    """Text from outside: escaped, and isolated so that right-to-left text does not reorder its neighbours."""
    return f"<bdi>{escape(visible(text))}</bdi>"


def _picture(outcome: Outcome) -> Cell:
    shown = next((name for name in (OVERLAY, MAP_PICTURE) if name in outcome.files), None)
    if shown is None:
        return Cell("")
    address = _address(outcome, shown)
    # a fixed size keeps the page still while pictures load; some browsers ignore `loading` after `src`
    attributes = 'loading="lazy" decoding="async" width="160" height="120"'
    picture = f'<img {attributes} src="{address}" alt="slopes of {escape(visible(outcome.name))}">'
    return Cell(f'<a href="{address}">{picture}</a>')


def _result(outcome: Outcome) -> Cell:
    if outcome.exit_status == 0:
        return Cell("<strong>answered</strong>", "answered")
    verdict = "no answer" if outcome.exit_status == ExitStatus.NO_ANSWER else "failed"
    code = outcome.code or f"exit status {outcome.exit_status}"
    reason = "; ".join(part for part in (outcome.message, outcome.remedy) if part)
    return Cell(f"<strong>{verdict}: {_text(code)}</strong><br>{_text(reason)}", f"{verdict}: {code}", "pair")


def _steepest(outcome: Outcome) -> Cell:
    """The steepest slope in each root; the column is sorted by the larger."""
    texts = [f"{slope:.2f}{'' if sigma is None else f' ± {sigma:.2f}'}°" for slope, sigma in outcome.steepest]
    value = "" if outcome.steepest_deg is None else f"{outcome.steepest_deg:.9g}"
    return Cell("<br>or ".join(texts), value, "number")


def _notes(outcome: Outcome) -> Cell:
    notes = list(dict.fromkeys(outcome.diagnostics))
    if outcome.ambiguity == "unresolved":
        notes.insert(0, "two answers")
    return Cell("<br>".join(map(_text, notes)), " ".join(notes), "notes")


def _address(outcome: Outcome, name: str) -> str:
    """Relative URL of a file of a pair, percent-encoded byte by byte."""
    return quote(os.fsencode(f"{outcome.name}/{name}"))
