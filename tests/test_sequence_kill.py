"""A sequence killed at any time leaves lines that can be read, and the next run gives what it would have given."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from command import slopemap
from frames import GRID, write_frames

from slopecli.io import read_lines


@pytest.mark.slow
@pytest.mark.parametrize("lines", [1, 3])
def test_killed_it_leaves_whole_lines_and_no_half_answer(tmp_path: Path, lines: int) -> None:
    frames, out, whole = tmp_path / "frames", tmp_path / "out", tmp_path / "whole"
    write_frames(frames, 8)
    command = ["sequence", str(frames), "--camera", str(frames / "camera.json"), "--grid", GRID, "-o"]
    process = subprocess.Popen([sys.executable, "-m", "slopecli", *command, str(out)], stdout=subprocess.DEVNULL)
    file, started = out / "sequence.jsonl", time.monotonic()
    while time.monotonic() < started + 60 and (not file.exists() or file.read_bytes().count(b"\n") < lines):
        time.sleep(0.002)
    process.send_signal(signal.SIGKILL)
    process.wait()
    left = read_lines(file)
    assert [line["frame"] for line in left] == [*range(1, len(left) + 1)]
    assert len(left) >= lines
    if (out / "slopes.json").exists():
        json.loads((out / "slopes.json").read_text())
    assert slopemap(*command, str(out)).returncode == 0
    assert slopemap(*command, str(whole)).returncode == 0
    for path in whole.iterdir():
        assert (out / path.name).read_bytes() == path.read_bytes(), path.name
