"""`slopemap batch --command sequence`: every folder of a folder is a sequence, answered as by `slopemap sequence`."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from batch_factory import tree
from command import slopemap
from frames import GRID, write_frames

pytestmark = pytest.mark.usefixtures("_worker_here")


def lines_of(folder: Path) -> list[dict[str, object]]:
    return [json.loads(line) for line in (folder / "results.jsonl").read_text().splitlines()]


def test_every_folder_is_a_sequence(tmp_path: Path) -> None:
    flights, out, alone = tmp_path / "flights", tmp_path / "out", tmp_path / "alone"
    write_frames(flights / "first", 3)
    shutil.move(flights / "first" / "camera.json", flights / "camera.json")
    shutil.copytree(flights / "first", flights / "second")
    (flights / "second" / "frame3.png").write_bytes(b"torn")
    (flights / "empty").mkdir()
    command = ["batch", str(flights), "--command", "sequence", "--grid", GRID, "-o", str(out), "--jobs", "1"]
    done = slopemap(*command)
    assert done.returncode == 4, done.stderr
    by_name = {line["name"]: line for line in lines_of(out)}
    assert [by_name[name]["exit_status"] for name in ("first", "second", "empty")] == [0, 0, 1]
    assert "frame-skipped" in by_name["second"]["diagnostics"]  # type: ignore[operator]
    camera = str(flights / "camera.json")
    single = ["sequence", str(flights / "first"), "--camera", camera, "--grid", GRID, "-o", str(alone)]
    assert slopemap(*single).returncode == 0
    ours, theirs = tree(out / "first"), tree(alone)
    ours.pop("pair.json")
    theirs.pop("sequence.jsonl")
    assert ours == theirs
    written = (out / "first" / "pair.json").stat().st_mtime_ns
    assert slopemap(*command).returncode == 4
    assert (out / "first" / "pair.json").stat().st_mtime_ns == written


@pytest.mark.parametrize("option", [("--pairing", "folders"), ("--cluster", "tcp://nobody:1", "--ship")])
def test_options_of_pairs_are_refused(option: tuple[str, ...], tmp_path: Path) -> None:
    done = slopemap("batch", str(tmp_path), "--command", "sequence", "-o", str(tmp_path / "out"), *option)
    assert done.returncode == 2
    assert "--command sequence" in done.stderr
