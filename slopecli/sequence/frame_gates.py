"""Frames that tell nothing: of another size, without contrast, repeated, blurred. Each is said and skipped.

Blur is judged once a frame is aligned with the reference, at the scale of the reference: a frame from nearer is
smoother, and not blurred. A frame that could not be aligned is compared with the one used before it as they are.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from slopecli.look.features import Grey
from slopecli.look.noise import NOISE_GREY
from slopecli.sequence.tracking_tunables import TRACKING
from slopecli.types import FloatArray


class Skipped(NamedTuple):
    """Why a frame is not used: a diagnostic code, and words."""

    code: str
    message: str


class FrameGates:
    """Checks a frame against those used before it; `accept` is told of each one that was used."""

    def __init__(self, shape: tuple[int, int]) -> None:
        self._shape = shape
        self._last: Grey | None = None
        # share of the reference's detail: of the frame used last, and of the one checked
        self._detail = self._own = np.ones(4)
        self._blurred = 0  # frames in turn

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
        return None

    def blur(self, detail: FloatArray) -> Skipped | None:
        """That an aligned frame is blurred, if it is. detail : (4,) of `detail_shown`.

        It shows less in some direction than the frame before: what a slanting view shows less of is not blur.
        """
        self._own = np.minimum(detail, 1.0)
        return self._blur(float((self._own / self._detail).min()))

    def blur_alone(self, frame: Grey) -> Skipped | None:
        """That a frame which could not be aligned is blurred, if it is."""
        return None if self._last is None else self._blur(sharpness(frame) / max(sharpness(self._last), 1e-9))

    def _blur(self, share: float) -> Skipped | None:
        if share >= TRACKING.sharpness or self._blurred >= TRACKING.in_turn:
            return None
        self._blurred += 1
        return Skipped("blurred", f"is blurred: {100 * share:.0f} % of the sharpness of the one before")

    def accept(self, frame: Grey) -> None:
        """Remember a frame that was used."""
        self._last, self._detail, self._blurred = frame, np.maximum(self._own, 1e-3), 0

    def forget_detail(self) -> None:
        """Compare the next frame with the reference itself: it is another one."""
        self._detail = self._own = np.ones(4)

    def _repeats(self, frame: Grey) -> bool:
        if self._last is None:
            return False
        return float(cv2.norm(frame, self._last, cv2.NORM_L1)) < TRACKING.same_grey * frame.size


def sharpness(frame: Grey) -> float:
    """Mean finest detail of a frame over its contrast; noise of the sensor counts as detail."""
    fine = cv2.Laplacian(cv2.blur(frame, (3, 3)), cv2.CV_16S)
    return float(cv2.norm(fine, cv2.NORM_L1) / fine.size / max(float(frame[::4, ::4].std()), 1.0))
