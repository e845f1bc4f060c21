"""`slopemap batch --command map`: the files of `slopemap map`, their shares and largest site in table and page."""

from __future__ import annotations

import csv
import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import pytest
from batch_factory import DESCENT, make_images, make_job, make_pairs, tree
from command import Done, slopemap
from output_names import files_of

from slopecli.batch import Outcome, fingerprint_of, index_html, read_outcome
from slopecli.cli import maps_table
from slopecli.options import Lander, MapOptions
from slopecli.products import MAP_PRODUCTS

SIDE = 256  # px
ASKED = ("--footprint", "24", "--sites", "3", "--altitude", "13")
SHARES = ("safe", "unsafe", "undecided", "unknown")
FILES = files_of(MAP_PRODUCTS)
Run = tuple[Done, Path, Path]

pytestmark = pytest.mark.usefixtures("_solved_once")


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Three images, the last of which is torn, and a batch of maps of them."""
    images = tmp_path_factory.mktemp("flight")
    for number, view in enumerate((1, 2, 1)):
        sample = cv2.imread(str(DESCENT / f"image{view}.png"), cv2.IMREAD_GRAYSCALE)
        small = cv2.resize(sample, (SIDE, SIDE), interpolation=cv2.INTER_AREA)
        cv2.imwrite(str(images / f"view00{number}.png"), small)
    torn = images / "view002.png"
    torn.write_bytes(torn.read_bytes()[:900])
    shutil.copy(DESCENT / "camera.json", images)
    out = tmp_path_factory.mktemp("out")
    return slopemap("batch", str(images), "--command", "map", *ASKED, "-o", str(out), "--jobs", "1"), images, out


def lines_of(folder: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (folder / "results.jsonl").read_text().splitlines()]


def again(flight: Run, *options: str) -> tuple[Done, dict[str, int]]:
    """The same batch with more options, and when its files were written."""
    done = slopemap("batch", str(flight[1]), "--command", "map", *ASKED, *options, "-o", str(flight[2]))
    return done, {path.name: path.stat().st_mtime_ns for path in (flight[2] / "view000-view001").iterdir()}


def test_a_pair_has_the_files_of_map_to_the_byte(flight: Run, tmp_path: Path) -> None:
    _, images, out = flight
    pair = [str(images / f"view00{number}.png") for number in (0, 1)]
    alone = slopemap("map", *pair, "--camera", str(images / "camera.json"), *ASKED, "-o", str(tmp_path))
    assert alone.returncode == 0, alone.stderr
    ours = tree(out / "view000-view001")
    ours.pop("pair.json")
    assert ours == tree(tmp_path)
    assert set(ours) == FILES


def test_lines_and_columns_have_shares_and_the_largest_site(flight: Run) -> None:
    done, _, out = flight
    first, second = lines_of(out)
    result = json.loads((out / "view000-view001" / "slopes.json").read_text())
    for name, share in result["map"]["area_share"].items():
        assert first[f"{name}_share"] == pytest.approx(share, abs=1e-6)
    largest = max(result["sites"], key=lambda site: site["radius_px"])
    assert first["n_sites"] == len(result["sites"])
    for name in ("radius_px", "radius", "slope_deg", "slope_sigma_deg"):
        assert first[f"site_{name}"] == pytest.approx(largest[name], abs=1e-6)
    assert set(first["files"]) == FILES
    assert second["exit_status"] == 1
    assert [second[f"{name}_share"] for name in result["map"]["area_share"]] == [None] * 4
    rows = list(csv.DictReader((out / "summary.csv").open(encoding="utf-8")))
    assert float(rows[0]["safe_share"]) == first["safe_share"]
    assert rows[1]["safe_share"] == rows[1]["site_radius_px"] == ""
    assert done.returncode == 4


def test_the_table_says_the_same(flight: Run) -> None:
    done, _, out = flight
    header, row, failed = done.stdout.splitlines()
    first = lines_of(out)[0]
    assert header.split() == [
        "pair",
        "result",
        "safe",
        "unsafe",
        "undecided",
        "unknown",
        "sites",
        "radius",
        "slope",
        "note",
    ]
    for name in SHARES:
        assert f"{100 * first[f'{name}_share']:.1f} %" in row
    assert f"{first['site_radius_px']:.0f} px" in row
    assert f"{first['site_slope_deg']:.2f} ± {first['site_slope_sigma_deg']:.2f}°" in row
    assert failed.split()[1] == "failed"


def test_the_page_shows_maps(flight: Run) -> None:
    page = (flight[2] / "index.html").read_text(encoding="utf-8")
    assert 'src="view000-view001/map.png"' in page
    assert "Percentages of image 1" in page
    for title in (*SHARES, "sites", "radius", "slope"):
        assert f'<button type="button">{title}</button>' in page
    assert "steepest" not in page.split("<thead>")[1].split("</thead>")[0]
    row = page.split("<tbody>")[1].split("</tbody>")[0].splitlines()[2]
    assert row.count("<td") == page.split("<thead>")[1].split("</thead>")[0].count("<th ")


@pytest.mark.usefixtures("_worker_here")
def test_a_finished_pair_is_kept_and_a_changed_option_of_the_map_does_it_again(flight: Run) -> None:
    recorded = read_outcome((flight[2] / "view000-view001" / "pair.json").read_bytes())
    assert recorded is not None
    assert recorded[0].is_map
    _, before = again(flight)
    _, kept = again(flight)
    assert kept == before
    _, other = again(flight, "--max-height", "3")
    assert other["slopes.json"] != before["slopes.json"]
    done, fewer = again(flight, "--no-pictures")
    assert set(fewer) == files_of(MAP_PRODUCTS, without=("pictures",)) | {"pair.json"}
    assert done.returncode == 4


@pytest.mark.usefixtures("_worker_here")
def test_maps_and_estimates_replace_each_other(flight: Run, tmp_path: Path) -> None:
    shutil.copytree(flight[2], tmp_path / "out")
    done = slopemap("batch", str(flight[1]), "-o", str(tmp_path / "out"))
    assert done.returncode == 4
    names = {path.name for path in (tmp_path / "out" / "view000-view001").iterdir()}
    assert names == files_of() | {"pair.json"}


USAGE = {
    "footprint of an estimate": (("--footprint", "30"), "--footprint is for --command map"),
    "cloud of an estimate": (("--ply",), "--ply is for --command map"),
    "lander of a segment": (("--command", "segment", "--lander", "3,2"), "--lander is for --command map"),
    "grid of a map": (("--command", "map", "--grid", "2x2"), "--grid is for --command estimate or segment"),
    "overlay of a map": (("--command", "map", "--no-overlay"), "--no-overlay is for --command estimate or segment"),
    "finder of a map": (("--command", "map", "--planes", "ransac"), "--planes is for --command estimate or segment"),
    "two footprints": (("--command", "map", "--footprint", "30", "--footprint-m", "1"), "contradict each other"),
}


@pytest.mark.parametrize(("options", "told"), USAGE.values(), ids=USAGE)
def test_options_of_other_commands_are_refused(options: tuple[str, ...], told: str, tmp_path: Path) -> None:
    done = slopemap("batch", str(tmp_path), *options, "-o", str(tmp_path / "out"))
    assert (done.returncode, done.stdout) == (2, "")
    assert told in done.stderr


def test_every_option_of_a_map_is_in_the_fingerprint(tmp_path: Path) -> None:
    job = make_job(make_pairs(make_images(tmp_path, 2))[0], tmp_path)
    pair = job.pair
    assert pair.camera1 is not None
    assert pair.camera1.file is not None
    digests = {pair.image1: "1", pair.image2: "2", pair.camera1.file: "3"}
    changed = [
        None,
        MapOptions(),
        MapOptions(footprint_px=30.0),
        MapOptions(footprint_m=30.0),
        MapOptions(spacing_px=3),
        MapOptions(max_height=1.0),
        MapOptions(sites=1),
        MapOptions(site_radius=9.0),
        MapOptions(classes_deg=(5.0,)),
        MapOptions(lander=Lander(3, 2.0)),
    ]
    prints = {fingerprint_of(replace(job, wanted=wanted), digests) for wanted in changed}
    prints |= {fingerprint_of(replace(job, wanted=MapOptions(), keep=frozenset({"pictures"})), digests)}
    assert len(prints) == len(changed) + 1


def test_a_map_without_a_site_has_dashes() -> None:
    shares = {"safe_share": 0.0, "unsafe_share": 0.9, "undecided_share": 0.05, "unknown_share": 0.05}
    outcome = Outcome("a-b", "a.png", "b.png", 0, files=("slopes.json",), n_planes=9, **shares)
    (row,) = maps_table([outcome]).rows
    assert row == ("a-b", "answered", "0.0 %", "90.0 %", "5.0 %", "5.0 %", "0", "-", "-", "")
    assert b"90.0 %" in index_html([outcome])
