"""Image 1 as background of a drawing: its scale, its colours, the size of text on it; pictures as PNG."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from slopecli.errors import InputError
from slopecli.products.drawing.marks import Picture
from slopecli.types import FloatArray, Image, Report

# long side of a drawing: numbers are legible from the smallest on, and what is larger takes long to write and to open.
# Maps, and scenes of planes found as regions, which are many, need more room for them
LONG_SIDE_PX = {"smallest": 640, "smallest map": 1200, "largest": 2000}


def drawing_scale(report: Report, image: Image) -> float:
    """Return the scale of a drawing against image 1, whose long side lies between the limits above."""
    return _within_limits(image, LONG_SIDE_PX["smallest map"] if report.found else LONG_SIDE_PX["smallest"])


@dataclass(frozen=True)
class Frame:
    """The drawing of a map over image 1, px: its size, its scale against the image, the size of its text."""

    height: int
    width: int
    scale: float
    text_px: int

    def place(self, uv: ArrayLike) -> FloatArray:
        """Return where points (..., 2) px of image 1 are on the drawing."""
        return (np.asarray(uv, float) + 0.5) * self.scale - 0.5


def map_frame(image: Image) -> Frame:
    """Return the frame of a map with small marks, which stays legible at half its size."""
    scale = _within_limits(image, LONG_SIDE_PX["smallest map"])
    height, width = resized(image.grey, scale).shape
    return Frame(height, width, scale, text_size(np.empty((height, width, 0), np.uint8)))


def _within_limits(image: Image, smallest: int) -> float:
    return float(np.clip(1.0, smallest / max(image.grey.shape), LONG_SIDE_PX["largest"] / max(image.grey.shape)))


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


def encode_labels(report: Report, image: Image) -> bytes:
    """Return the content of labels.png: the plane id of every pixel of image 1, 16 bits; 0 where there is no plane."""
    # run lengths alone suit areas of one value: a third of the size, at the least effort
    return _encode_png(report.labels, [cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE])


def encode_picture(pixels: NDArray[np.uint8]) -> bytes:
    """Encode a picture (h, w, 3) uint8 BGR; level 1 costs a tenth of the time of level 6 for a tenth more bytes.

    To try all filters on every row would take as long again and gain nothing; OpenCV before 4.11 leaves no choice.
    """
    one_filter = [cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_UP] if hasattr(cv2, "IMWRITE_PNG_FILTER") else []
    return _encode_png(pixels, [cv2.IMWRITE_PNG_COMPRESSION, 1, *one_filter])


def _encode_png(pixels: NDArray[np.uint8] | NDArray[np.uint16], parameters: list[int]) -> bytes:
    done, buffer = cv2.imencode(".png", pixels, parameters)
    if not done:
        size = f"{pixels.shape[1]} x {pixels.shape[0]} px"
        raise InputError(f"an image of {size} cannot be written as PNG; use a smaller one")
    return buffer.tobytes()
