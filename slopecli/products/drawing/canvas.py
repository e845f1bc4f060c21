"""Image 1 as background of a drawing: its scale, its colours, and the size of text on it."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from slopecli.products.drawing.marks import Picture
from slopecli.types import Image, Report

SMALLEST_PX, LARGEST_PX = 640, 2000  # long side of the drawing: legible below, quick to write and to open above
SMALLEST_MAP_PX = 1200  # of a scene of planes found as regions: they are many, and their numbers need room


def drawing_scale(report: Report, image: Image) -> float:
    """Return the scale of a drawing against image 1, whose long side lies between the limits above."""
    smallest = SMALLEST_MAP_PX if report.found else SMALLEST_PX
    return float(np.clip(1.0, smallest / max(image.grey.shape), LARGEST_PX / max(image.grey.shape)))


def ground(image: Image, scale: float) -> Picture:
    """Return the image in its colours at a scale, (h, w, 3) uint8 RGB."""
    if image.colour is None:
        return converted(resized(image.grey, scale), cv2.COLOR_GRAY2RGB)
    return converted(resized(image.colour, scale), cv2.COLOR_BGR2RGB)


def text_size(picture: Picture) -> int:
    """Return the size of the text on a drawing, px: 15 at a long side of 1024 px."""
    return max(12, round(max(picture.shape) * 15 / 1024))


def resized(pixels: NDArray[np.uint8], scale: float) -> NDArray[np.uint8]:
    """Return an image at a scale."""
    if scale == 1.0:
        return pixels
    method = cv2.INTER_AREA if scale < 1.0 else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(pixels, None, fx=scale, fy=scale, interpolation=method), np.uint8)


def converted(pixels: NDArray[np.uint8], code: int) -> NDArray[np.uint8]:
    """Return an image in other colours; `code` is one of OpenCV's."""
    return np.asarray(cv2.cvtColor(pixels, code), np.uint8)
