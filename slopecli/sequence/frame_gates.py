"""Frames that tell nothing: of another size, without contrast, repeated, blurred. Each is said and skipped."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from slopecli.look.features import Grey
from slopecli.look.noise import NOISE_GREY
from slopecli.sequence.tracking_tunables import TRACKING


class Skipped(NamedTuple):
    """Why a frame is not used: a diagnostic code, and words."""

    code: str
    message: str


class FrameGates:
    """Checks a frame against those used before it; `accept` is told of each one that was used."""

    def __init__(self, shape: tuple[int, int]) -> None:
        self._shape = shape
        self._last: Grey | None = None
        self._sharpness = self._own = 0.0  # of the frame used last, and of the one checked
        self._blurred = 0

    def check(self, frame: Grey) -> Skipped | None:
        """Why the frame tells nothing; None if it may be used."""
        if frame.ndim != 2 or frame.dtype != np.uint8 or frame.shape != self._shape:
            found = "x".join(str(n) for n in reversed(frame.shape))
            wanted = "x".join(str(n) for n in reversed(self._shape))
            return Skipped("size", f"is {found} px, the sequence {wanted}")
        contrast = float(frame[::4, ::4].std())
        if contrast < 2 * NOISE_GREY:
            return Skipped("dark", f"shows nothing: its grey values differ by {contrast:.1f}")
        if self._last is not None and self._repeats(frame):
            return Skipped("repeated", "repeats the frame before")
        if self._last is not None:
            self._own = sharpness(frame)
            share = self._own / max(self._sharpness, 1e-9)
            if share < TRACKING.sharpness and self._blurred < TRACKING.in_turn:
                self._blurred += 1
                return Skipped("blurred", f"is blurred: {100 * share:.0f} % of the sharpness of the one before")
        return None

    def accept(self, frame: Grey) -> None:
        """Remember a frame that was used."""
        self._sharpness = sharpness(frame) if self._last is None else self._own
        self._last = frame
        self._blurred = 0

    def _repeats(self, frame: Grey) -> bool:
        if self._last is None:
            return False
        return float(cv2.norm(frame, self._last, cv2.NORM_L1)) < TRACKING.same_grey * frame.size


def sharpness(frame: Grey) -> float:
    """Mean finest detail of a frame over its contrast; noise of the sensor counts as detail."""
    fine = cv2.Laplacian(cv2.blur(frame, (3, 3)), cv2.CV_16S)
    return float(cv2.norm(fine, cv2.NORM_L1) / fine.size / max(float(frame[::4, ::4].std()), 1.0))
