"""The frames of a sequence test its camera, as a pair does; a focal length that is not known well widens the sigmas."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from frames import CAMERA, frame

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
