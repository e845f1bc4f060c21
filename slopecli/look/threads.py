"""Limit OpenCV to one thread: small images cost more to hand to threads than to process."""

from __future__ import annotations

from collections.abc import Callable

import cv2

from slopecli.geometry.solver.one_thread import SharedLimit


def _limit_opencv() -> Callable[[], object]:
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    return lambda: cv2.setNumThreads(before)


single_threaded = SharedLimit(_limit_opencv)
