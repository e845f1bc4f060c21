"""The geologist's pair: the commands of docs/gis.md run on it as printed, print what the page has, and are true."""

from __future__ import annotations

import csv
import json
import re
import runpy
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from command import slopemap

ROOT = Path(__file__).parents[1]
GENERATE = runpy.run_path(str(ROOT / "docs" / "generate.py"))
NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?")
FACE = re.compile(r"^ *(\d+)  (\S+) +([\d.]+) % +([\d.]+) ±", re.MULTILINE)
OTHER_OPENCV = {"abs": 0.1, "rel": 0.05}  # by which numbers of another version of OpenCV may differ
PAGE = (ROOT / "docs" / "gis.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def outcrop(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder in which the commands run, with that of the pair in it."""
    folder = tmp_path_factory.mktemp("geologist")
    script = str(ROOT / "sample_data" / "make_rock_pair.py")
    subprocess.run([sys.executable, script, str(folder / "outcrop")], check=True)
    return folder


def example(command: str) -> tuple[list[str], str]:
    """Arguments of an example of the page, and what the page says it prints."""
    (found,) = [one for one in GENERATE["EXAMPLE"].finditer(PAGE) if f"slopemap {command} " in one["command"]]
    return shlex.split(found["command"].replace("\\\n", " "))[1:], found["output"]


def test_strike_and_dip_are_what_the_page_has_and_true(outcrop: Path) -> None:
    arguments, printed = example("estimate")
    done = slopemap(*arguments, cwd=outcrop)
    assert done.returncode == 0, done.stderr
    shown, now = (text.splitlines()[:5] for text in (printed, done.stdout))
    assert NUMBER.sub("#", " ".join(now).replace(" ", "")) == NUMBER.sub("#", " ".join(shown).replace(" ", ""))
    told, found = (list(map(float, NUMBER.findall(" ".join(lines)))) for lines in (shown, now))
    assert found == pytest.approx(told, **OTHER_OPENCV)
    table = GENERATE["strike_and_dip_table"](outcrop / "bedding" / "planes.csv")
    of_page = re.search(re.escape(table.splitlines()[0]) + r"\n(?:\|.*\n)*", PAGE)
    assert of_page is not None
    found, told = (list(map(float, NUMBER.findall(text.split("\n", 2)[2]))) for text in (table, of_page[0]))
    assert found == pytest.approx(told, **OTHER_OPENCV)

    planes = json.loads((outcrop / "outcrop" / "truth.json").read_text())["planes"]
    with (outcrop / "bedding" / "planes.csv").open() as file:
        rows = list(csv.DictReader(file))
    for row, true in zip(rows, planes, strict=True):
        assert abs(float(row["dip_deg"]) - true["dip_deg"]) < float(row["slope_sigma_deg"])
        for name in ("dip_direction_deg", "strike_deg"):
            off = (float(row[name]) - true[name] + 180.0) % 360.0 - 180.0
            assert abs(off) < float(row["azimuth_sigma_deg"])
        assert row["longitude_deg"]
    assert (outcrop / "bedding" / "slopes.geojson").exists()


@pytest.mark.slow
def test_faces_are_found_as_the_page_has_them(outcrop: Path) -> None:
    arguments, printed = example("segment")
    done = slopemap(*arguments, cwd=outcrop)
    assert done.returncode == 0, done.stderr
    shown, now = (FACE.findall(text) for text in (printed, done.stdout))
    assert [face[:2] for face in now] == [face[:2] for face in shown]
    for then, face in zip(shown, now, strict=True):
        assert float(face[2]) == pytest.approx(float(then[2]), rel=0.15)
        assert float(face[3]) == pytest.approx(float(then[3]), abs=0.5)
