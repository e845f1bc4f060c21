"""The frames of a sequence test its camera, as a pair does; a focal length that is not known well widens the sigmas."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest
from command import slopemap
from frames import CAMERA, frame
from scenery import Grey

from slopecli.findings import CameraTest
from slopecli.geometry.solver import CameraScore
from slopecli.options import Options
from slopecli.pipeline import sequence as run_sequence
from slopecli.sequence import Frame, KnownCamera, Sequence, SequenceStep, SettlingTest
from slopecli.types import Camera, Image, Report

OPTIONS = Options(grid=(2, 2), tolerance_deg=20.0)


def focused(times: float) -> Camera:
    return replace(CAMERA, fx=times * CAMERA.fx, fy=times * CAMERA.fy)


@cache
def steps(times: float, focal_sigma_percent: float | None = None) -> tuple[SequenceStep, ...]:
    options = replace(OPTIONS, focal_sigma_percent=focal_sigma_percent)
    frames = [Frame(f"{number}.png", Image(frame(number), path=f"{number}.png")) for number in range(3)]
    return tuple(run_sequence(frames, Sequence(focused(times), options)))


def last(times: float, focal_sigma_percent: float | None = None) -> Report:
    report = steps(times, focal_sigma_percent)[-1].report
    assert report is not None
    return report


def test_a_right_camera_is_not_doubted() -> None:
    report = last(1.0)
    assert "suspect-camera" not in {one.code for one in report.diagnostics}
    assert report.fit.focal_factor == pytest.approx(1.0, abs=0.05)
    assert {plane.verdict for plane in report.planes} == {"safe"}


def test_a_wrong_camera_is_said_with_the_right_one_and_nothing_is_safe() -> None:
    """Its windows look as safe as those of the right camera; the first pair tells, and every later line says so."""
    reports = [step.report for step in steps(0.65) if step.report is not None]
    assert len(reports) == 2
    for report in reports:
        doubt = next(one for one in report.diagnostics if one.code == "suspect-camera")
        assert "--free-focal" not in f"{doubt.message} {doubt.remedy}"  # an option that this command lacks
        assert report.fit.focal_factor == pytest.approx(1.0 / 0.65, rel=0.1)
        assert "safe" not in {plane.verdict for plane in report.planes}
    assert not steps(0.65)[-1].settled


@pytest.mark.slow
def test_no_run_stops_on_a_wrong_camera() -> None:
    """Nor on what was settled before the camera was doubted."""
    right, wrong = last(1.0), last(0.65)
    test = SettlingTest(4, 0.9)
    assert len(test.look(right)) == 4
    assert test.complete
    assert not test.look(wrong)
    assert not test.complete


def test_the_sigma_of_the_focal_length_is_in_the_slopes() -> None:
    """With a focal length 3 % too long slopes are off by more than the frames tell; `--focal-sigma 3` allows for it."""
    right, off, allowed = (slopes(last(*one)) for one in ((1.0,), (1.03,), (1.03, 3.0)))
    grown = np.sqrt(np.array(allowed[1]) ** 2 - np.array(off[1]) ** 2)
    error = np.abs(np.array(allowed[0]) - right[0])
    assert (error < 2.0 * grown + 0.02).all()
    assert grown.max() < 3.0 * error.max()


def slopes(report: Report) -> tuple[list[float], list[float]]:
    """Slopes and their sigmas, deg."""
    return [one.slope_deg for one in report.planes], [one.slope_sigma_deg or 0.0 for one in report.planes]


def test_the_first_pair_settles_a_focal_length_that_is_not_known_well() -> None:
    """Where the images know it better than its sigma, slopes are computed with what both agree on, as in `estimate`."""
    options = replace(OPTIONS, focal_sigma_percent=3.0)
    known = KnownCamera.of(CAMERA, options)
    score = CameraScore(np.zeros(4), np.full(4, 0.004), np.full(4, 5.0), 0.05, np.zeros(5), np.zeros((4, 3)))
    asked = replace(known, test=CameraTest(step=-0.03, sigma=0.004, score=score)).refocused(options)
    assert known.focal_sigma == 0.03
    assert asked.focal_sigma == pytest.approx(0.0045, abs=0.0005)
    assert asked.used.focal_px == pytest.approx(CAMERA.focal_px * np.exp(-0.03), rel=0.001)
    assert [one.code for one in asked.notes(options)] == ["focal-length"]
    assert not asked.asks(100.0)


WIDER = replace(CAMERA, fx=0.8 * CAMERA.fx, fy=0.8 * CAMERA.fy, cx=CAMERA.cx + 6.0)


def seen_by_wider(number: int) -> Grey:
    """A frame as `WIDER` takes it, but for a border of what `CAMERA` does not see."""
    moved = np.array([[0.8, 0.0, WIDER.cx - 0.8 * CAMERA.cx], [0.0, 0.8, WIDER.cy - 0.8 * CAMERA.cy]])
    size = CAMERA.width, CAMERA.height
    return np.asarray(cv2.warpAffine(frame(number), moved, size, flags=cv2.INTER_CUBIC, borderValue=90), np.uint8)


def test_a_frame_of_another_camera_is_seen_as_that_of_the_first_would(tmp_path: Path) -> None:
    """Each image of a folder has the camera of its name, where the file holds several."""
    named = {"left": CAMERA, "right": WIDER}
    cameras = {name: {"K": [[c.fx, 0, c.cx], [0, c.fy, c.cy], [0, 0, 1]]} for name, c in named.items()}
    (tmp_path / "cameras.json").write_text(json.dumps(cameras), encoding="utf-8")
    images = {"left_1.png": frame(0), "left_2.png": frame(1), "right_3.png": seen_by_wider(2)}
    for name, grey in images.items():
        cv2.imwrite(str(tmp_path / name), grey)
    files = [str(tmp_path / name) for name in images]
    done = slopemap("sequence", *files, "--camera", str(tmp_path / "cameras.json"), "--grid", "2x2", "--json")
    assert done.returncode == 0, done.stderr
    document = json.loads(done.stdout)
    assert [one["frame"] for one in document["motions"]] == [1, 2, 3]
    for plane, same in zip(document["planes"], last(1.0).planes, strict=True):
        assert plane["slope_deg"] == pytest.approx(same.slope_deg, abs=0.3)
