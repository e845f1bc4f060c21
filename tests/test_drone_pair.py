"""The sample pair as the files of a drone: what it states is true, and the commands of docs/drone.md run on it."""

from __future__ import annotations

import json
import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from command import slopemap
from metadata_factory import FOCAL_35, exif_block
from PIL import Image as PilImage

ROOT = Path(__file__).parents[1]
TRUTH = json.loads((ROOT / "sample_data" / "descent" / "truth.json").read_text(encoding="utf-8"))
HEADING_DEG = 120.0  # of the top of image 1


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("drone") / "flight"
    subprocess.run([sys.executable, str(ROOT / "sample_data" / "make_drone_pair.py"), str(folder)], check=True)
    return folder


def commands(page: str, words: str) -> list[list[str]]:
    """The commands with these words in the blocks of a page, without `slopemap` and what is said of them."""
    blocks = re.findall(r"```sh\n(.*?)```", (ROOT / "docs" / page).read_text(encoding="utf-8"), re.DOTALL)
    lines = [line for block in blocks for line in block.splitlines() if line.startswith("slopemap") and words in line]
    return [shlex.split(line, comments=True)[1:] for line in lines]


def test_slopes_are_against_gravity_aspects_from_north_and_lengths_in_metres(flight: Path, tmp_path: Path) -> None:
    show, estimate = commands("drone.md", "flight/")[:2]
    done = slopemap(*show, cwd=flight.parent)
    assert (done.returncode, "heading 120.00" in done.stdout) == (0, True)
    done = slopemap(*estimate, "--no-overlay", "--no-ply", cwd=flight.parent)
    assert done.returncode == 0, done.stderr
    document = json.loads((flight.parent / "slopes" / "slopes.json").read_text())
    for plane, true in zip(document["planes"], TRUTH["windows"], strict=True):
        x, y, _ = true["normal_cam1"]
        aspect = (HEADING_DEG + np.degrees(np.arctan2(x, -y))) % 360.0
        assert plane["slope_deg"] == pytest.approx(true["slope_deg"], abs=plane["slope_sigma_deg"])
        if plane["aspect_deg"] is not None and true["slope_deg"] > 5:
            assert abs((plane["aspect_deg"] - aspect + 180.0) % 360.0 - 180.0) < 2.0
        assert plane["distance"] == pytest.approx(true["distance_m"], rel=0.03)
    assert (document["scale"]["unit"], document["scale"]["source"]) == ("m", "exif")
    length = np.linalg.norm(TRUTH["T"])
    assert np.linalg.norm(document["motion"]["baseline_cam1"]) == pytest.approx(length, rel=0.002)
    assert (flight.parent / "slopes" / "slopes.geojson").exists()


@pytest.mark.slow
def test_photographs_of_ones_own_have_pitches_and_a_model(tmp_path: Path) -> None:
    """The commands of docs/segment.md on the town as a telephone would have taken it: 50 degrees wide, 37 mm."""
    for number in (1, 2):
        with PilImage.open(ROOT / "slopecli" / "sample" / "town" / f"image{number}.jpg") as picture:
            exif = exif_block({FOCAL_35: 37})
            picture.save(tmp_path / f"photo{number}.jpg", exif=exif, quality=97)
    show, segment = commands("segment.md", "photo1.jpg")
    assert "35 mm equivalent 37 mm" in slopemap(*show, cwd=tmp_path).stdout
    done = slopemap(*segment, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    roofs = [line for line in done.stdout.splitlines() if line.split()[1:2] == ["roof"]]
    assert sum("in 12" in line for line in roofs) >= 5
    assert {"report.html", "patches.glb", "planes.csv"} <= {path.name for path in (tmp_path / "house").iterdir()}


@pytest.mark.slow
@pytest.mark.parametrize("page", ["drone.md", "gis.md"])
def test_every_command_of_the_page_runs(flight: Path, page: str) -> None:
    found = commands(page, "flight")
    assert found
    for command in found:
        done = slopemap(*command, cwd=flight.parent)
        assert done.returncode == 0, (command, done.stderr)
