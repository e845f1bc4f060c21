"""Frames kept for the depth of every pixel: few, of short and long baselines, and the last one."""

from __future__ import annotations

import numpy as np
import pytest

from slopecli.sequence import DepthFrames

GREY = np.zeros((8, 8), np.uint8)


@pytest.mark.parametrize("step", [0.05, 1.0])
def test_frames_kept_lead_from_short_to_long_baselines(step: float) -> None:
    frames = DepthFrames()
    for number in range(200):
        frames.add(GREY, np.eye(3), np.array([1.0 + step * number, 0.0, 0.0]))
    *kept, last = frames.baselines
    assert last == pytest.approx(1.0 + step * 199)
    assert len(kept) <= 5
    ratios = np.diff(np.log([*kept, last]))
    assert (ratios >= 0.0).all()
    assert ratios.max() < np.log(2.0)  # the depth of one leads to that of the next


def test_a_camera_that_returns_does_not_push_out_what_tells_more() -> None:
    frames = DepthFrames()
    for length in (1.0, 2.0, 4.0, 1.0, 0.9, 1.1, 1.0):
        frames.add(GREY, np.eye(3), np.array([length, 0.0, 0.0]))
    assert frames.baselines == [1.0, 2.0, 4.0, 1.0]


def test_what_is_kept_stays_when_more_frames_come() -> None:
    frames = DepthFrames()
    frames.add(GREY, np.eye(3), np.array([1.0, 0.0, 0.0]))
    held = frames.kept()
    frames.add(GREY, np.eye(3), np.array([2.0, 0.0, 0.0]))
    assert held.baselines == [1.0]
    assert frames.baselines == [1.0, 2.0]
