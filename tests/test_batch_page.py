"""index.html: every pair is there, failures first, links lead to the files, and names of others do no harm."""

from __future__ import annotations

import html
import os
import re
import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote_to_bytes, urlsplit

import pytest

from slopecli.batch import Outcome, index_html

FILES = ("slopes.json", "labels.png", "overlay.png")
HOSTILE = '</td><script>alert("x")</script> & \' # % ? :é'
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")


def answered(name: str, steepest: float | None = 12.5, **changes: object) -> Outcome:
    values: dict[str, object] = {"files": FILES, "n_planes": 9, "n_ok": 9, "n_safe": 9, "steepest_deg": steepest}
    return Outcome(name, f"{name}_1.png", f"{name}_2.png", 0, **{**values, **changes})  # type: ignore[arg-type]


def failed(name: str, status: int = 3) -> Outcome:
    return Outcome(name, f"{name}_1.png", f"{name}_2.png", status, "low-texture", "no <texture>", "use sharper images")


OUTCOMES = (answered("two", 5.0), answered("ten", 30.0), failed("bad"), answered("one", None), answered("six", 12.0))


class Page(HTMLParser):
    """Rows of the table body as their cells' text, and all addresses."""

    def __init__(self, data: bytes) -> None:
        super().__init__()
        self.rows: list[list[str]] = []
        self.links: list[str] = []
        self.pictures: list[dict[str, str | None]] = []
        self.scripts = 0
        self.feed(data.decode("utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        attributes = dict(attrs)
        if tag == "tr":
            self.rows.append([])
        elif tag == "td":
            self.rows[-1].append("")
        elif tag == "a":
            self.links.append(attributes["href"] or "")
        elif tag == "img":
            self.pictures.append(attributes)
        self.scripts += tag == "script"

    def handle_data(self, data: str) -> None:
        if self.rows and self.rows[-1]:
            self.rows[-1][-1] += data


def page(*outcomes: Outcome) -> Page:
    return Page(index_html(outcomes))


def names_in(rows: Sequence[Sequence[str]]) -> list[str]:
    return [row[2][:3] for row in rows if row]


def test_every_pair_has_a_row_and_those_without_an_answer_come_first() -> None:
    assert names_in(page(*OUTCOMES).rows) == ["bad", "two", "ten", "one", "six"]


def test_headline_counts() -> None:
    assert b"<h1>5 pairs, 4 answered, 1 without an answer</h1>" in index_html(OUTCOMES)
    assert b"<h1>1 pair, all answered</h1>" in index_html([answered("one")])


def test_a_failure_says_why_and_what_to_do() -> None:
    (row,) = (row for row in page(*OUTCOMES).rows if row and row[2].startswith("bad"))
    for said in ("no answer", "low-texture", "no <texture>", "use sharper images"):
        assert said in row[3]
    assert not any(row[4:10])


def test_links_and_pictures_lead_to_the_files_of_the_pair(tmp_path: Path) -> None:
    names = ["plain-pair", HOSTILE.replace("/", "_"), "100%25", os.fsdecode(b"caf\xe9")]
    shown = page(*map(answered, names))
    for name in names:
        (tmp_path / name).mkdir()
        for file in FILES:
            (tmp_path / name / file).touch()
    addresses = shown.links + [picture["src"] or "" for picture in shown.pictures]
    assert len(shown.pictures) == len(names)
    for address in addresses:
        parts = urlsplit(address)
        assert not any((parts.scheme, parts.netloc, parts.query, parts.fragment))
        found = tmp_path / os.fsdecode(unquote_to_bytes(parts.path))
        assert found.exists() or found.name in ("summary.csv", "results.jsonl")


def test_names_of_others_stay_text() -> None:
    outcome = Outcome(HOSTILE, HOSTILE, HOSTILE, 0, files=FILES, diagnostics=(HOSTILE,), ambiguity=HOSTILE)
    bad = Outcome(HOSTILE, HOSTILE, HOSTILE, 1, HOSTILE, HOSTILE, HOSTILE)
    shown = page(outcome, bad)
    assert shown.scripts == 1
    rows = [row for row in shown.rows if row]
    assert all(row[2] == 3 * HOSTILE for row in rows)
    assert HOSTILE in rows[0][3]


def test_names_have_no_control_characters_on_the_page() -> None:
    name = "a\x1b[31m\x85b\u202egnp"
    text = index_html([Outcome(name, name, name, 1, "input", name), answered(name)]).decode("utf-8")
    assert not re.search(r"[\x00-\x09\x0b-\x1f\x7f-\x9f\u202e]", text)
    assert r"a\x1b[31m\x85b\u202egnp" in text


def test_pictures_are_loaded_when_they_come_into_view_and_keep_their_place() -> None:
    for picture in page(*OUTCOMES).pictures:
        assert picture["loading"] == "lazy"
        assert picture["width"]
        assert picture["height"]


def test_without_an_overlay_there_is_no_picture() -> None:
    shown = page(answered("one", files=("slopes.json",)))
    assert not shown.pictures
    assert "one/slopes.json" in shown.links


def test_page_needs_nothing_from_elsewhere() -> None:
    text = index_html(OUTCOMES).decode("utf-8")
    assert not re.search(r"https?:|//[a-z]|@import|url\(|<link|<script [^>]*src", text)
    assert "prefers-color-scheme: dark" in text


def test_two_answers_and_diagnostics_are_noted_once() -> None:
    outcome = answered("one", ambiguity="unresolved", diagnostics=("low-parallax", "poor-fit", "low-parallax"))
    (row,) = (row for row in page(outcome).rows if row)
    assert row[10] == "two answerslow-parallaxpoor-fit"


def test_two_thousand_pairs_are_a_page_of_megabytes_not_more() -> None:
    outcomes = [answered(f"frame_{i:04d}-frame_{i + 1:04d}") for i in range(2000)]
    data = index_html(outcomes)
    assert len(data) < 3_000_000
    assert len(Page(data).pictures) == 2000


# ---- in a browser, where there is one ----


def after(script: str, folder: Path) -> list[str]:
    """Names of the rows shown, from top to bottom, after a script has run at the end of the page."""
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        pytest.skip("needs Chromium or Chrome")
    file = folder / "index.html"
    text = index_html(OUTCOMES).decode("utf-8")
    file.write_text(text.replace("</body>", f"<script>{script}</script></body>"), encoding="utf-8")
    options = ["--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={folder / 'profile'}"]
    done = subprocess.run(
        [browser, *options, "--dump-dom", file.as_uri()], capture_output=True, encoding="utf-8", timeout=120, check=True
    )
    shown = re.findall(r'<tr class="\w+">.*?</tr>', done.stdout, re.DOTALL)
    return [html.unescape(row) for row in re.findall(r'class="pair" data-value="(\w+)"', "".join(shown))]


def click(title: str, times: int = 1) -> str:
    button = f'[...document.querySelectorAll("th button")].find(one => one.textContent === "{title}")'
    return f"{button}.click();" * times


@pytest.mark.parametrize(
    ("script", "order"),
    [
        (click("steepest"), ["two", "six", "ten", "bad", "one"]),  # unknown ones last, both ways
        (click("steepest", 2), ["ten", "six", "two", "bad", "one"]),
        (click("pair"), ["bad", "one", "six", "ten", "two"]),
        (click("pair") + click("#"), ["two", "ten", "bad", "one", "six"]),
        (
            'document.querySelector("input").value = "SHARPER";'
            'document.querySelector("input").dispatchEvent(new Event("input"));'
            'document.querySelectorAll("tr[hidden]").forEach(row => row.remove());',
            ["bad"],
        ),
    ],
)
def test_a_click_sorts_and_the_box_filters(script: str, order: list[str], tmp_path: Path) -> None:
    assert after(script, tmp_path) == order


def test_both_answers_of_a_pair_are_shown_and_sorted_by_the_steeper() -> None:
    both = answered("two", 51.1, steepest_sigma_deg=0.03, steepest_other_deg=13.07, steepest_other_sigma_deg=0.03)
    html = index_html([replace(both, ambiguity="unresolved")]).decode()
    assert 'data-value="51.1">13.07 ± 0.03°<br>or 51.10 ± 0.03°</td>' in html
