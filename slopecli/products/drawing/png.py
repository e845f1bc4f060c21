"""Encoding of pictures and label maps as PNG."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from slopecli.errors import InputError


def encode_labels(labels: NDArray[np.uint16]) -> bytes:
    """Encode a label map (h, w) as a 16-bit PNG."""
    # run lengths alone suit areas of one value: a third of the size, at the least effort
    return _encode_png(labels, [cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE])


def encode_picture(pixels: NDArray[np.uint8]) -> bytes:
    """Encode a picture (h, w, 3) uint8 BGR; level 1 costs a tenth of the time of level 6 for a tenth more bytes.

    To try all filters on every row would take as long again and gain nothing; OpenCV before 4.11 leaves no choice.
    """
    one_filter = [cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_UP] if hasattr(cv2, "IMWRITE_PNG_FILTER") else []
    return _encode_png(pixels, [cv2.IMWRITE_PNG_COMPRESSION, 1, *one_filter])


def _encode_png(pixels: NDArray[np.uint8] | NDArray[np.uint16], parameters: list[int]) -> bytes:
    done, buffer = cv2.imencode(".png", pixels, parameters)
    if not done:
        raise InputError(
            f"an image of {pixels.shape[1]} x {pixels.shape[0]} px cannot be written as PNG; use a smaller one"
        )
    return buffer.tobytes()
