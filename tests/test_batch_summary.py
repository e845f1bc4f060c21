"""summary.csv and results.jsonl: a row and a line per pair, in order, readable by what reads such files."""

from __future__ import annotations

import csv
import json
from dataclasses import fields
from io import StringIO

from slopecli.batch import Outcome, results_jsonl, summary_csv

ANSWERED = Outcome(
    "frame_1-frame_2",
    "flight/frame_1.png",
    "flight/frame_2.png",
    0,
    fingerprint="ab" * 32,
    files=("slopes.json", "labels.png", "overlay.png"),
    n_planes=9,
    n_ok=8,
    n_safe=4,
    n_unsafe=3,
    n_undecided=2,
    steepest_deg=23.4000000000007,
    steepest_sigma_deg=0.25,
    ambiguity="none",
    noise_px=0.2,
    diagnostics=("low-parallax", "foe-in-window"),
)
REFUSED = Outcome("a-b", "a.png", "b.png", 3, "low-texture", "only 11 features match", "use sharper images")
OUTCOMES = (ANSWERED, REFUSED)


def rows_of(data: bytes) -> list[dict[str, str]]:
    return list(csv.DictReader(StringIO(data.decode("utf-8"))))


def test_summary_has_a_row_per_pair_in_the_order_given() -> None:
    rows = rows_of(summary_csv(reversed(OUTCOMES)))
    assert [row["name"] for row in rows] == ["a-b", "frame_1-frame_2"]
    assert [row["exit_status"] for row in rows] == ["3", "0"]


def test_summary_says_what_is_known_and_leaves_the_rest_empty() -> None:
    answered, refused = rows_of(summary_csv(OUTCOMES))
    assert float(answered["steepest_deg"]) == 23.4
    assert (answered["n_safe"], answered["n_unsafe"], answered["n_undecided"]) == ("4", "3", "2")
    assert answered["diagnostics"] == "low-parallax foe-in-window"
    assert answered["code"] == answered["message"] == ""
    assert refused["steepest_deg"] == refused["noise_px"] == refused["ambiguity"] == ""
    assert (refused["code"], refused["remedy"]) == ("low-texture", "use sharper images")


def test_summary_keeps_commas_quotes_and_lines_of_names_in_their_cell() -> None:
    name = 'one, "two"\nthree\r4'
    (row,) = rows_of(summary_csv([Outcome(name, name, "b.png", 1)]))
    assert row["name"] == row["image1"] == name


def test_summary_gives_a_terminal_nothing_to_obey() -> None:
    (row,) = rows_of(summary_csv([Outcome("a", "\x1b[31mred\x07\u202e.png", "b.png", 1)]))
    assert row["image1"] == r"\x1b[31mred\x07\u202e.png"


def test_summary_gives_a_spreadsheet_no_formulas() -> None:
    (row,) = rows_of(summary_csv([Outcome("a", "=1+1.png", "@b.png", 1, "input", "-1")]))
    assert (row["image1"], row["image2"], row["message"]) == ("'=1+1.png", "'@b.png", "'-1")


def test_results_have_every_key_of_an_outcome_in_ascii() -> None:
    outcome = Outcome("Höhe", "Höhe.png", "b.png", 1, message="é")
    data = results_jsonl([ANSWERED, outcome])
    assert data.isascii()
    first, second = map(json.loads, data.splitlines())
    assert list(first) == list(second) == [field.name for field in fields(Outcome)]
    assert first["files"] == ["slopes.json", "labels.png", "overlay.png"]
    assert (second["name"], second["message"]) == ("Höhe", "é")


def test_numbers_that_are_not_finite_are_null_or_empty() -> None:
    outcome = Outcome("a", "a.png", "b.png", 0, steepest_deg=10.0, steepest_sigma_deg=float("inf"))
    assert json.loads(results_jsonl([outcome]))["steepest_sigma_deg"] is None
    assert rows_of(summary_csv([outcome]))[0]["steepest_sigma_deg"] == ""


def test_file_names_that_are_not_text_are_written_all_the_same() -> None:
    outcome = Outcome("a", b"\xff.png".decode("utf-8", "surrogateescape"), "b.png", 1)
    assert rows_of(summary_csv([outcome]))[0]["image1"] == r"\udcff.png"
    assert json.loads(results_jsonl([outcome]))["image1"] == outcome.image1


def test_no_pairs_give_a_header_and_no_lines() -> None:
    assert summary_csv([]).count(b"\n") == 1
    assert results_jsonl([]) == b""
